//! In words, from the numbers: what the thesis says of its estimators, and whether it is so.

use super::published::{FRAMES_PER_SECOND, REFERENCE_MINUTES, SHADOW_TARGET};
use super::{EstimatorError, Paper2012, Place, names};
use crate::measure::paper2008::Finding;

/// How many times as large an error has to be to be called larger.
const LARGER: f64 = 1.5;

impl Paper2012 {
    fn scenes(&self) -> Vec<&str> {
        let mut scenes: Vec<&str> = self.ambient.iter().map(|row| row.scene.as_str()).collect();
        scenes.dedup();
        scenes
    }

    /// The mean errors of an estimator, whose name starts so, in one place of all scenes, or of one.
    fn means(rows: &[EstimatorError], estimator: &str, place: Place, scene: Option<&str>) -> Vec<f64> {
        let wanted = |row: &&EstimatorError| {
            row.estimator.starts_with(estimator) && row.place == place && scene.is_none_or(|scene| row.scene == scene)
        };
        rows.iter().filter(wanted).map(|row| row.mean_abs).collect()
    }

    /// What the thesis says of ambient occlusion.
    pub fn ambient_findings(&self) -> Vec<Finding> {
        let mean = |estimator: &str, place| average(&Self::means(&self.ambient, estimator, place, None));
        let [normal, bent] = [names::NORMAL, names::BENT].map(|name| format!("{name}{}", names::SPHERES));
        let first = self.scenes().first().copied();
        let spheres = |estimator: &str, place| average(&Self::means(&self.ambient, estimator, place, first));
        let (ground, objects) = (spheres(&normal, Place::Ground), spheres(&normal, Place::Objects));
        let mut findings = vec![Finding::new(
            objects > ground * LARGER,
            format!(
                "The thesis, Figure 3.10: along the normal the ground looks right, and the sphere does not: what is beyond the \
                 last step occludes nothing. Here the mean error is {ground:.3} on the ground and {objects:.3} on the sphere."
            ),
            "",
        )];
        let (bent_ground, bent_objects) = (spheres(&bent, Place::Ground), spheres(&bent, Place::Objects));
        findings.push(Finding::new(
            bent_objects * LARGER < objects && bent_ground > ground,
            format!(
                "The thesis, Figures 3.14 to 3.16: the bent normal is better on the sphere and worse on the ground. Here it has \
                 {bent_objects:.3} and {bent_ground:.3}."
            ),
            "upwards is where nothing is; what darkens a ball from below is not on the way.",
        ));
        let (grid_ground, grid_objects) =
            (mean(names::GRID_RAYS, Place::Ground), mean(names::GRID_RAYS, Place::Objects));
        let (all_ground, all_objects) = (mean(&normal, Place::Ground), mean(&normal, Place::Objects));
        findings.push(Finding::new(
            all_ground > grid_ground * LARGER && all_objects > grid_objects * LARGER,
            format!(
                "The thesis: the method is not as robust as that of the reference images. Over all scenes algorithm 3.4 has a mean \
                 error of {all_ground:.3} on the ground and {all_objects:.3} on objects; {} rays through grids, of which the references \
                 have more, have {grid_ground:.3} and {grid_objects:.3}. (The thesis' references took {} to {} minutes, its own \
                 pictures less than 1/{FRAMES_PER_SECOND} s.)",
                self.few_rays,
                REFERENCE_MINUTES.iter().min().unwrap_or(&0),
                REFERENCE_MINUTES.iter().max().unwrap_or(&0)
            ),
            "",
        ));
        if let Some(mesh) = self.scenes().get(2).copied() {
            let on_mesh = |estimator: &str| average(&Self::means(&self.ambient, estimator, Place::Objects, Some(mesh)));
            let (slope, normal, bent) = (on_mesh(names::SLOPE), on_mesh(&normal), on_mesh(&bent));
            findings.push(Finding::new(
                slope < normal.min(bent),
                format!(
                    "The thesis, Figure 4.4: on the bunny only a trick comes close to the reference, the slope of the surface by itself. \
                     Here it has {slope:.3}, along the normal {normal:.3}, along the bent normal {bent:.3}."
                ),
                "",
            ));
        }
        findings
    }

    /// What it says of settings.
    pub fn settings_findings(&self) -> Vec<Finding> {
        let of = |name: &str| {
            let of_name = self.settings.iter().filter(|row| row.estimator == name);
            of_name.map(|row| (row.step, row.strength)).collect::<Vec<_>>()
        };
        let differ = |name: &str| of(name).windows(2).any(|pair| pair[0] != pair[1]);
        let worse = |name: &str| {
            let mean = |settings: &str| {
                let errors = |place| Self::means(&self.ambient, &format!("{name}{settings}"), place, None);
                average(&[errors(Place::Ground), errors(Place::Objects)].concat())
            };
            mean(names::SPHERES) / mean(names::OWN)
        };
        vec![Finding::new(
            differ(names::NORMAL) || differ(names::BENT),
            format!(
                "The thesis: each scene needs settings of its own. Here those with the least error {}; with the sphere's in all of \
                 them errors are {:.2} times as large along the normal, and {:.2} times along the bent one.",
                if differ(names::NORMAL) || differ(names::BENT) { "differ" } else { "are the same" },
                worse(names::NORMAL),
                worse(names::BENT)
            ),
            "",
        )]
    }

    /// What it says of shadows, and what is aimed at here.
    pub fn shadow_findings(&self) -> Vec<Finding> {
        let mean = |estimator: &str| average(&Self::means(&self.shadows, estimator, Place::Ground, None));
        let scales = format!("{}, scale", names::PENUMBRA);
        let best = self.shadows.iter().filter(|row| row.estimator.starts_with(&scales) && row.place == Place::Ground);
        let best = best.map(|row| row.estimator.clone()).fold(None, |best: Option<(f64, String)>, name| {
            let error = mean(&name);
            if best.as_ref().is_some_and(|(least, _)| *least <= error) { best } else { Some((error, name)) }
        });
        let mut findings = Vec::new();
        if let Some((error, name)) = best {
            let cones = mean(names::CONES);
            findings.push(Finding::new(
                error > cones * LARGER,
                format!(
                    "The thesis: the scale makes shadows harder or softer; it stands for no light. Of its scales here the best, {name}, has \
                     a mean error of {error:.3} on the ground, that of the light's own angle {:.3}, cones {cones:.3}, and 16 rays, \
                     with noise, {:.3}.",
                    mean(&format!("{}, the light's", names::PENUMBRA)),
                    mean(names::SHADOW_RAYS)
                ),
                "",
            ));
        }
        // Each by itself, as it is aimed at.
        let alone = |(index, scene)| (index == 2 || index > 3).then_some(scene);
        let meshes: Vec<&str> = self.scenes().into_iter().enumerate().filter_map(alone).collect();
        let each = meshes.iter().map(|scene| {
            let of = |place| average(&Self::means(&self.shadows, names::CONES, place, Some(scene)));
            (of(Place::Ground), format!("{scene} {:.4} (on it {:.4})", of(Place::Ground), of(Place::Objects)))
        });
        let (errors, texts): (Vec<f64>, Vec<String>) = each.unzip();
        findings.push(Finding::new(
            errors.iter().all(|error| *error <= SHADOW_TARGET),
            format!(
                "Aimed at: cones on the ground at most {SHADOW_TARGET}, for a light of 5\u{b0} and a grid of 64\u{b3}. Here, {}.",
                texts.join(", ")
            ),
            "a coarser grid or another light; up to 0.04 is aimed at for thinner meshes, such as a cow.",
        ));
        findings
    }
}

fn average(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}
