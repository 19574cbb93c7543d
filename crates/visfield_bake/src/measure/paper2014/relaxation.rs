//! §3.1: over-relaxation, with every ω, by the paper's rule and by ours.

use std::hint::black_box;

use serde::{Deserialize, Serialize};
use visfield::distance::sphere_trace::{SphereTracing, Traced};

use super::scenes::{CONVERGED, FINER, Subject, TestRay};
use crate::measure::progress::Progress;
use crate::measure::speed::race_all;

/// Which rays are traced.
///
/// ```
/// use visfield_bake::measure::paper2014::RayKind;
/// assert_eq!(RayKind::Grazing.to_string(), "grazing");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RayKind {
    /// Of pixels.
    Camera,
    /// Of pixels, that pass something by closely and hit nothing.
    Grazing,
    /// Of light inside of glass, from one facet to the next.
    Refraction,
    /// Of ambient occlusion: from a mesh's own surface, as fields ask their distances.
    Ambient,
}

impl std::fmt::Display for RayKind {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            Self::Camera => "camera",
            Self::Grazing => "grazing",
            Self::Refraction => "refraction",
            Self::Ambient => "ambient",
        })
    }
}

/// Rays of one kind with one ω.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Relaxation {
    /// The scene.
    pub scene: String,
    /// Which of its rays.
    pub kind: RayKind,
    /// How many.
    pub rays: u64,
    /// ω, 1 to below 2; 1 is none.
    pub relaxation: f32,
    /// Whether it is by our rule, which relaxes again, and where that pays; the paper's stops for good.
    pub adaptive: bool,
    /// Distances asked for, per ray.
    pub evaluations: f64,
    /// Seconds for all rays, of one thread.
    pub seconds: f64,
    /// Rays that hit where they missed with ω = 1, or miss where they hit.
    pub flipped: u64,
    /// Rays that hit elsewhere than with ω = 1: not even near one surface all the way between.
    pub moved: u64,
    /// Rays that pass through what a sixteenth of the threshold meets; with ω = 1 such that come so near without passing through are
    /// counted too.
    pub missed: u64,
}

/// Rays of one kind, and how they are traced with ω = 1.
pub(super) struct RaySet<'a> {
    pub(super) subject: &'a Subject,
    pub(super) kind: RayKind,
    pub(super) rays: Vec<TestRay>,
    pub(super) settings: SphereTracing,
}

/// Every ω by both rules.
pub(super) fn ways(relaxations: &[f32]) -> Vec<(f32, bool)> {
    let both = relaxations.iter().flat_map(|&relaxation| [(relaxation, false), (relaxation, true)]);
    both.filter(|&(relaxation, adaptive)| relaxation > 1.0 || !adaptive).collect()
}

impl RaySet<'_> {
    /// Measures every ω, of which the first is 1.
    pub(super) fn measure(&self, relaxations: &[f32], progress: &Progress) -> Vec<Relaxation> {
        let ways = ways(relaxations);
        let settings = |&(relaxation, adaptive): &(f32, bool)| SphereTracing { relaxation, adaptive, ..self.settings };
        let plain = self.subject.trace_all(&self.rays, &self.settings);
        let (threshold, pixel) = (self.settings.threshold * FINER, self.settings.pixel * FINER);
        let finer = SphereTracing { threshold, pixel, max_steps: 4 * CONVERGED, ..self.settings };
        let exact = self.subject.trace_all(&self.rays, &finer);
        let mut rows: Vec<Relaxation> = ways
            .iter()
            .map(|way| {
                let traced = self.subject.trace_all(&self.rays, &settings(way));
                self.compared(*way, &traced, &plain, &exact)
            })
            .collect();
        for (row, seconds) in rows.iter_mut().zip(self.seconds(&ways.iter().map(settings).collect::<Vec<_>>())) {
            row.seconds = seconds;
        }
        progress.add(1, &format!("{}: {} rays", self.subject.name, self.kind));
        rows
    }

    fn compared(
        &self,
        (relaxation, adaptive): (f32, bool),
        traced: &[Traced],
        plain: &[Traced],
        exact: &[Traced],
    ) -> Relaxation {
        let evaluations: u64 = traced.iter().map(|ray| u64::from(ray.evaluations)).sum();
        let pairs = || traced.iter().zip(plain);
        let moved = |(ray, (here, there)): (&TestRay, (&Traced, &Traced))| {
            here.hit && there.hit && !self.alike(ray, here.t, there.t)
        };
        let missed = |(ray, (here, exact)): (&TestRay, (&Traced, &Traced))| {
            exact.hit && !(here.hit && (here.t <= exact.t || self.alike(ray, here.t, exact.t)))
        };
        Relaxation {
            scene: self.subject.name.to_owned(),
            kind: self.kind,
            rays: self.rays.len() as u64,
            relaxation,
            adaptive,
            evaluations: evaluations as f64 / self.rays.len().max(1) as f64,
            seconds: 0.0,
            flipped: pairs().filter(|(here, there)| here.hit != there.hit).count() as u64,
            moved: self.rays.iter().zip(pairs()).filter(|pair| moved(*pair)).count() as u64,
            missed: self.rays.iter().zip(traced.iter().zip(exact)).filter(|pair| missed(*pair)).count() as u64,
        }
    }

    /// Whether two ends are in one place: near each other, or on a surface that the ray does not leave between them.
    fn alike(&self, ray: &TestRay, a: f32, b: f32) -> bool {
        const SAMPLES: u32 = 8;
        let near = |i: u32| {
            let t = a + (b - a) * i as f32 / SAMPLES as f32;
            let tolerance = self.settings.threshold.max(self.settings.pixel * t);
            self.subject.solid.distance(ray.at(t)).abs() < 2.0 * tolerance
        };
        (a - b).abs() < self.subject.apart || (1..SAMPLES).all(near)
    }

    /// Seconds of one thread for all rays in each of these ways, taken in turn.
    fn seconds(&self, ways: &[SphereTracing]) -> Vec<f64> {
        let trace = |settings: &SphereTracing| {
            let settings = *settings;
            move || {
                for ray in &self.rays {
                    black_box(self.subject.trace(ray, &settings));
                }
            }
        };
        let mut works: Vec<_> = ways.iter().map(trace).collect();
        race_all(&mut works.iter_mut().map(|work| work as &mut dyn FnMut()).collect::<Vec<_>>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::paper2014::facets::Facets;
    use crate::measure::paper2014::scenes::glass;

    #[test]
    fn no_relaxation_is_alike_and_a_blind_one_is_not() {
        let subject = glass("jewel", &Facets::jewel(1.0), 1.0);
        let set =
            RaySet { subject: &subject, kind: RayKind::Camera, rays: subject.camera(40), settings: subject.plain };
        let rows = set.measure(&[1.0, 1.6], &Progress::new(1, &|_, _| ()));
        assert_eq!(rows.iter().map(|row| row.adaptive).collect::<Vec<_>>(), [false, false, true]);
        for row in &rows {
            assert_eq!((row.moved, row.missed), (0, 0), "{row:?}");
        }
        assert_eq!(rows[0].flipped, 0);
        // Rays that end far away are seen to.
        let plain = subject.trace_all(&set.rays, &set.settings);
        let far: Vec<Traced> = plain.iter().map(|ray| Traced { t: ray.t + 1.0, ..*ray }).collect();
        let row = set.compared((1.6, true), &far, &plain, &plain);
        let hits = plain.iter().filter(|ray| ray.hit).count() as u64;
        assert!(hits > 50 && row.moved == hits && row.missed == hits && row.flipped == 0, "{row:?} of {hits}");
    }
}
