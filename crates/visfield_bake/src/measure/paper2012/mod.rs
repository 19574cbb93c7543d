//! The scenes of the 2012 thesis, and its cheap estimators over distances, against very many exact rays; beside them is what this
//! crate draws with.
//!
//! The thesis compares pictures by eye. Here receivers on the ground and on what stands there have the same estimates, and errors
//! are numbers. Distances to balls and boxes are in closed form, those to meshes are grids, as in the thesis; what is marked as
//! ours uses grids for all of them. Lengths are in bounding radii of what stands on the ground.

mod estimates;
mod findings;
mod pictures;
pub mod published;
mod scenes;
mod table;

use serde::{Deserialize, Serialize};
use visfield::distance::DistanceGridFormat;
use visfield::distance::estimators::NormalOcclusion;
use visfield::estimate::Falloff;

use self::estimates::{Bench, SCALES, TAU};
use self::pictures::View;
use self::scenes::Scene;
use super::picture::Pictures;
use super::progress::Progress;
use crate::bake::{BakeError, BakeSettings};
use crate::mesh::Mesh;

/// What is measured.
///
/// ```
/// use visfield_bake::measure::paper2012::Paper2012Question;
/// let question = Paper2012Question::default();
/// assert_eq!((question.rays, question.distance.voxels), (1024, 64));
/// ```
#[derive(Clone, Debug)]
pub struct Paper2012Question {
    /// How fine meshes' distances are.
    pub distance: DistanceGridFormat,
    /// Half of the angle that the light covers in the sky, in radians, above 0, up to 1.2.
    pub angular_radius: f32,
    /// Exact rays of each receiver, at least 1.
    pub rays: u32,
    /// Rays of each receiver over distances, at least 1.
    pub few_rays: u32,
    /// Receivers along each side of a square of ground, at least 2.
    pub side: usize,
    /// Each object has up to three times the square of this of receivers.
    pub surface_side: usize,
    /// Exact rays of each pixel of the pictures, or 0 for no pictures.
    pub picture_rays: u32,
}

impl Default for Paper2012Question {
    /// The sky by 1024 exact rays, a light of 5° to each side.
    fn default() -> Self {
        Self {
            distance: DistanceGridFormat::DEFAULT,
            angular_radius: 5.0_f32.to_radians(),
            rays: 1024,
            few_rays: 64,
            side: 129,
            surface_side: 40,
            picture_rays: 256,
        }
    }
}

/// What was found.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Paper2012 {
    /// Name of the mesh in the place of the thesis' bunny.
    pub mesh: String,
    /// Its triangles.
    pub triangles: u32,
    /// How fine meshes' distances are.
    pub distance: String,
    /// Half of the angle that the light covers in the sky, in radians.
    pub angular_radius: f32,
    /// Exact rays of each receiver.
    pub rays: u32,
    /// Rays of each receiver over distances.
    pub few_rays: u32,
    /// Ambient occlusion: scene by scene, estimator by estimator, on the ground and on the objects.
    pub ambient: Vec<EstimatorError>,
    /// Shadows, likewise.
    pub shadows: Vec<EstimatorError>,
    /// The settings with the least error of each scene.
    pub settings: Vec<TunedSettings>,
    /// How some of it looks.
    pub pictures: Vec<EstimatorPictures>,
}

/// Where errors are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Place {
    /// The ground.
    Ground,
    /// What stands on it.
    Objects,
}

/// What an estimator gets wrong in one place of a scene, over receivers that it or exact rays find occluded by more than 1/255.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct EstimatorError {
    /// What stands on the ground.
    pub scene: String,
    /// The estimator.
    pub estimator: String,
    /// Where the receivers are.
    pub place: Place,
    /// How many of them are affected.
    pub affected: usize,
    /// Root of the mean square error.
    pub rms: f64,
    /// Mean absolute error.
    pub mean_abs: f64,
    /// Mean error: above 0, the estimator is too dark.
    pub bias_signed: f64,
    /// Largest absolute error.
    pub max_abs: f64,
}

/// Settings that were searched for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TunedSettings {
    /// What stands on the ground.
    pub scene: String,
    /// The estimator.
    pub estimator: String,
    /// Step along the normal, in radii.
    pub step: f32,
    /// Its strength.
    pub strength: f32,
}

/// How an estimator looks.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct EstimatorPictures {
    /// What stands on the ground.
    pub scene: String,
    /// The estimator.
    pub estimator: String,
    /// Exact, found, and the difference.
    pub pictures: Pictures,
}

/// Names of estimators, as tables have them.
pub mod names {
    /// Algorithm 3.4.
    pub const NORMAL: &str = "along the normal (alg. 3.4)";
    /// Algorithm 3.7.
    pub const BENT: &str = "bent normal (alg. 3.7)";
    /// Equation 3.26.
    pub const EVANS: &str = "Evans (eq. 3.26), own settings";
    /// Algorithm 4.3.
    pub const SLOPE: &str = "slope alone (alg. 4.3)";
    /// Equation 3.19, against exact obscurance.
    pub const OBSCURANCE: &str = "obscurance by rays (eq. 3.23)";
    /// Equation 3.18.
    pub const RAYS: &str = "rays over distances (eq. 3.18)";
    /// What this crate draws ambient occlusion with.
    pub const GRID_RAYS: &str = "ours: rays through grids";
    /// Algorithm 3.2, against a ray to the light's centre.
    pub const HARD: &str = "hard shadow (alg. 3.2)";
    /// Algorithm 3.3.
    pub const PENUMBRA: &str = "penumbra (alg. 3.3)";
    /// What this crate casts shadows with.
    pub const CONES: &str = "ours: cones through grids";
    /// What it casts them with where there is noise.
    pub const SHADOW_RAYS: &str = "ours: 16 rays through grids";
    /// Settings that suit the first scene best.
    pub const SPHERES: &str = ", the sphere's settings";
    /// Settings that suit the scene best.
    pub const OWN: &str = ", own settings";
}

/// Repeats the thesis' scenes with `mesh` in the place of its bunny, and measures each of `others` on the ground too. `progress` gets
/// the share of the work that is done, from 0 to 1, and what is being done, from any thread.
///
/// # Errors
/// [`BakeError`] if a mesh cannot be baked.
pub fn paper2012(
    mesh: &Mesh,
    others: &[Mesh],
    question: &Paper2012Question,
    progress: impl Fn(f64, &str) + Sync,
) -> Result<Paper2012, BakeError> {
    let progress = Progress::new(question.work(others.len()), &progress);
    let scenes = Scene::all(mesh, others, question, &progress)?;
    let mut found = Paper2012 {
        mesh: mesh.name.clone(),
        triangles: mesh.solid_triangles().map_or(0, |solid| solid.len() as u32),
        distance: question.distance.to_string(),
        angular_radius: question.angular_radius,
        rays: question.rays,
        few_rays: question.few_rays,
        ambient: Vec::new(),
        shadows: Vec::new(),
        settings: Vec::new(),
        pictures: Vec::new(),
    };
    let mut spheres = None;
    for scene in &scenes {
        let bench = Bench::new(scene, question);
        let doing = format!("rays around {}", scene.name);
        found.measure_ambient(&bench, &mut spheres);
        progress.add(question.scene_work() / 2, &doing);
        found.measure_shadows(&bench, question);
        progress.add(question.scene_work() - question.scene_work() / 2, &doing);
    }
    // The first one, and that of the mesh.
    if let (Some(settings), true) = (spheres, question.picture_rays > 0) {
        for scene in [&scenes[0], &scenes[2]] {
            found.draw(scene, question, &settings);
        }
    }
    progress.add(question.picture_work(), "pictures");
    Ok(found)
}

/// Settings of the algorithms 3.4 and 3.7.
type Spheres = [NormalOcclusion; 2];

impl Paper2012 {
    fn measure_ambient(&mut self, bench: &Bench, spheres: &mut Option<Spheres>) {
        let exact = bench.exact_ambient(Falloff::Binary);
        let mut add = |name: &str, found: &[f32]| self.ambient.extend(bench.errors(name, found, &exact));
        let bases = [NormalOcclusion::default(), NormalOcclusion::bent(glam::Vec3::Y)];
        let own = bases.map(|base| bench.tuned(&base, false, &exact));
        let spheres = spheres.get_or_insert(own);
        for ((name, own), spheres) in [names::NORMAL, names::BENT].into_iter().zip(own).zip(spheres) {
            add(&format!("{name}{}", names::SPHERES), &bench.along_normal(spheres, false));
            add(&format!("{name}{}", names::OWN), &bench.along_normal(&own, false));
            self.settings.push(TunedSettings {
                scene: bench.scene.name.clone(),
                estimator: name.to_owned(),
                step: own.step,
                strength: own.strength,
            });
        }
        let evans = NormalOcclusion { base: 1.0, ..bases[0] };
        add(names::EVANS, &bench.along_normal(&bench.tuned(&evans, true, &exact), true));
        add(names::SLOPE, &bench.by_slope());
        add(names::RAYS, &bench.traced(Falloff::Binary));
        add(names::GRID_RAYS, &bench.through_grids());
        let falloff = Falloff::Obscurance { tau: TAU };
        let obscurance = bench.errors(names::OBSCURANCE, &bench.traced(falloff), &bench.exact_ambient(falloff));
        self.ambient.extend(obscurance);
    }

    fn measure_shadows(&mut self, bench: &Bench, question: &Paper2012Question) {
        self.shadows.extend(bench.errors(names::HARD, &bench.hard(), &bench.exact_hard_shadow()));
        let exact = bench.exact_shadow();
        let mut add = |name: &str, found: &[f32]| self.shadows.extend(bench.errors(name, found, &exact));
        let lights = 1.0 / question.angular_radius.tan();
        for scale in SCALES {
            add(&format!("{}, scale {scale}", names::PENUMBRA), &bench.penumbra(scale));
        }
        add(&format!("{}, the light's {lights:.1}", names::PENUMBRA), &bench.penumbra(lights));
        add(names::SHADOW_RAYS, &bench.shadow_rays(16));
        add(names::CONES, &bench.cones());
    }

    fn draw(&mut self, scene: &Scene, question: &Paper2012Question, spheres: &Spheres) {
        let question = Paper2012Question { rays: question.picture_rays, ..question.clone() };
        let view = View::new(scene);
        let bench = Bench::at(scene, &question, view.receivers.clone(), view.grounded);
        let mut add = |estimator: &str, exact: &[f32], found: &[f32]| {
            self.pictures.push(EstimatorPictures {
                scene: scene.name.clone(),
                estimator: estimator.to_owned(),
                pictures: view.pictures(exact, found),
            });
        };
        let sky = bench.exact_ambient(Falloff::Binary);
        add(names::NORMAL, &sky, &bench.along_normal(&spheres[0], false));
        add(names::BENT, &sky, &bench.along_normal(&spheres[1], false));
        add(names::GRID_RAYS, &sky, &bench.through_grids());
        let light = bench.exact_shadow();
        add(names::PENUMBRA, &light, &bench.penumbra(1.0 / question.angular_radius.tan()));
        add(names::CONES, &light, &bench.cones());
    }
}

impl Paper2012Question {
    /// In rays.
    fn scene_work(&self) -> u64 {
        let receivers = self.side * self.side + 3 * self.surface_side * self.surface_side;
        receivers as u64 * u64::from(self.rays) * 3
    }

    fn picture_work(&self) -> u64 {
        u64::from(self.picture_rays) * 400_000
    }

    fn work(&self, others: usize) -> u64 {
        let bakes = 5 + others as u64;
        bakes * BakeSettings::of_distance(self.distance).rays()
            + (4 + others as u64) * self.scene_work()
            + self.picture_work()
    }
}
