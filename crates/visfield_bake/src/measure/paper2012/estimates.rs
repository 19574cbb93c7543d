//! Every estimator at every receiver of a scene, and the exact rays to compare with.

use glam::Vec3;
use rayon::prelude::*;
use visfield::distance::estimators::{
    NormalOcclusion, ShadowMarch, evans_occlusion, hard_shadow, normal_occlusion, penumbra_shadow, ray_occlusion,
};
use visfield::distance::sphere_trace::SphereTracing;
use visfield::estimate::{Falloff, Receiver};

use super::scenes::Scene;
use super::{EstimatorError, Paper2012Question, Place};
use crate::measure::scene::hemisphere_directions;
use crate::measure::shadow::{MeasuredLight, TO_LIGHT};

/// τ of obscurance, per radius of the first object.
pub(super) const TAU: f32 = 1.0;
/// Scales of the penumbra factor as in the thesis' Figures 3.5 and 3.6; beside them is the light's own.
pub(super) const SCALES: [f32; 3] = [4.0, 16.0, 64.0];
/// Where rays over distances start, and what they meet, in radii.
const START: f32 = 0.05;
const THRESHOLD: f32 = 0.0025;
/// Beyond this nothing is in the way, in radii.
const FAR: f32 = 200.0;
/// Of occlusion: what counts as occluded.
const LEAST: f32 = 1.0 / 255.0;

/// What of the light, or of the sky, is hidden from each receiver, on the ground and then on the objects.
pub(super) type Occlusion = Vec<f32>;

/// A scene's receivers, and what exact rays find there.
pub(super) struct Bench<'a> {
    pub(super) scene: &'a Scene,
    question: &'a Paper2012Question,
    light: MeasuredLight,
    pub(super) receivers: Vec<Receiver>,
    grounded: usize,
}

impl<'a> Bench<'a> {
    /// The scene's own receivers.
    pub(super) fn new(scene: &'a Scene, question: &'a Paper2012Question) -> Self {
        Self::at(scene, question, [&scene.ground[..], &scene.surface].concat(), scene.ground.len())
    }

    /// Others, of which the first ones are on the ground.
    pub(super) fn at(
        scene: &'a Scene,
        question: &'a Paper2012Question,
        receivers: Vec<Receiver>,
        grounded: usize,
    ) -> Self {
        let light = MeasuredLight::new(question.angular_radius, question.rays);
        Self { scene, question, light, receivers, grounded }
    }

    fn each(&self, estimate: impl Fn(usize, &Receiver) -> f32 + Sync) -> Occlusion {
        self.receivers.par_iter().enumerate().map(|(index, receiver)| estimate(index, receiver)).collect()
    }

    /// The same for shadows: what faces away counts as lit.
    fn each_lit(&self, estimate: impl Fn(usize, &Receiver) -> f32 + Sync) -> Occlusion {
        let direction = TO_LIGHT.normalize();
        self.each(|index, receiver| if receiver.normal.dot(direction) > 0.0 { estimate(index, receiver) } else { 0.0 })
    }

    pub(super) fn exact_ambient(&self, falloff: Falloff) -> Occlusion {
        self.each(|index, receiver| {
            let (start, triangles) = (self.scene.exact.start(receiver), self.scene.exact.triangles());
            let weight = |direction: Vec3| match falloff {
                Falloff::Binary => f32::from(u8::from(triangles.occluded(start, direction, 0.0, FAR))),
                _ => triangles.closest_hit(start, direction, FAR).map_or(0.0, |t| falloff.weight(t, FAR)),
            };
            let directions = hemisphere_directions(receiver, index, self.question.rays);
            directions.into_iter().map(weight).sum::<f32>() / self.question.rays as f32
        })
    }

    pub(super) fn exact_shadow(&self) -> Occlusion {
        self.each_lit(|index, receiver| self.light.exact_occlusion(&self.scene.exact, receiver, index))
    }

    pub(super) fn exact_hard_shadow(&self) -> Occlusion {
        self.each_lit(|_, receiver| {
            let (start, triangles) = (self.scene.exact.start(receiver), self.scene.exact.triangles());
            f32::from(u8::from(triangles.occluded(start, TO_LIGHT.normalize(), 0.0, FAR)))
        })
    }

    pub(super) fn along_normal(&self, settings: &NormalOcclusion, evans: bool) -> Occlusion {
        let distance = |position| self.scene.distance(position);
        self.each(|_, receiver| {
            let (position, normal) = (receiver.position.as_vec3(), receiver.normal);
            if evans {
                evans_occlusion(distance, position, normal, settings)
            } else {
                normal_occlusion(distance, position, normal, settings)
            }
        })
    }

    /// Algorithm 4.3: nothing but the angle between the normal and up; half of it is the share of the ground below a slope.
    pub(super) fn by_slope(&self) -> Occlusion {
        self.each(|_, receiver| (0.5 * (1.0 - receiver.normal.y)).clamp(0.0, 1.0))
    }

    /// A few rays over the scene's distance, sphere-traced.
    pub(super) fn traced(&self, falloff: Falloff) -> Occlusion {
        // Rays that graze the ground meet it far away.
        let tracing = SphereTracing { threshold: THRESHOLD, max_steps: 256, ..SphereTracing::default() };
        let distance = |position| self.scene.distance(position);
        self.each(|index, receiver| {
            let directions = hemisphere_directions(receiver, index, self.question.few_rays);
            ray_occlusion(distance, receiver.position.as_vec3(), &directions, START, falloff, FAR, &tracing)
        })
    }

    /// As many through the baked distances, as this crate draws.
    pub(super) fn through_grids(&self) -> Occlusion {
        self.each(|index, receiver| {
            let directions = hemisphere_directions(receiver, index, self.question.few_rays);
            let hits = directions.iter().filter(|&&direction| self.scene.occluded(receiver, direction)).count();
            hits as f32 / directions.len() as f32
        })
    }

    pub(super) fn hard(&self) -> Occlusion {
        self.each_lit(|_, receiver| {
            let distance = |position| self.scene.distance(position);
            hard_shadow(distance, receiver.position.as_vec3(), TO_LIGHT.normalize(), FAR, &MARCH)
        })
    }

    pub(super) fn penumbra(&self, scale: f32) -> Occlusion {
        self.each_lit(|_, receiver| {
            let distance = |position| self.scene.distance(position);
            penumbra_shadow(distance, receiver.position.as_vec3(), TO_LIGHT.normalize(), FAR, scale, &MARCH)
        })
    }

    pub(super) fn cones(&self) -> Occlusion {
        let tangent = self.question.angular_radius.tan();
        self.each_lit(|_, receiver| self.scene.cone_occlusion(receiver, TO_LIGHT.normalize(), tangent))
    }

    /// The light's disc by rays through the baked distances.
    pub(super) fn shadow_rays(&self, rays: u32) -> Occlusion {
        let light = MeasuredLight::new(self.question.angular_radius, rays);
        self.each_lit(|index, receiver| {
            let directions = light.directions(receiver, index);
            let hits = directions.iter().filter(|&&direction| self.scene.occluded(receiver, direction)).count();
            hits as f32 / directions.len().max(1) as f32
        })
    }

    /// Errors on the ground and on the objects, each over the receivers that either finds occluded.
    pub(super) fn errors(&self, estimator: &str, found: &[f32], exact: &[f32]) -> Vec<EstimatorError> {
        let places = [(Place::Ground, 0..self.grounded), (Place::Objects, self.grounded..self.receivers.len())];
        let error = |(place, range): (Place, std::ops::Range<usize>)| {
            let (mut squared, mut absolute, mut signed, mut largest, mut affected) = (0.0, 0.0, 0.0, 0.0_f64, 0);
            for (&found, &exact) in found[range.clone()].iter().zip(&exact[range]) {
                if found.max(exact) > LEAST {
                    let error = f64::from(found) - f64::from(exact);
                    squared += error * error;
                    absolute += error.abs();
                    signed += error;
                    largest = largest.max(error.abs());
                    affected += 1;
                }
            }
            let count = affected.max(1) as f64;
            EstimatorError {
                scene: self.scene.name.clone(),
                estimator: estimator.to_owned(),
                place,
                affected,
                rms: (squared / count).sqrt(),
                mean_abs: absolute / count,
                bias_signed: signed / count,
                max_abs: largest,
            }
        };
        places.map(error).into()
    }

    /// The settings with the least error at every eighth receiver: the sum of the means on the ground and on the objects.
    pub(super) fn tuned(&self, base: &NormalOcclusion, evans: bool, exact: &[f32]) -> NormalOcclusion {
        const FEW: usize = 8;
        let few = self.receivers.iter().step_by(FEW).copied().collect();
        let bench = Self::at(self.scene, self.question, few, self.grounded.div_ceil(FEW));
        let exact: Vec<f32> = exact.iter().step_by(FEW).copied().collect();
        let candidates = STEPS.iter().flat_map(|&step| STRENGTHS.iter().map(move |&strength| (step, strength)));
        let error = |settings: &NormalOcclusion| {
            let found = bench.along_normal(settings, evans);
            bench.errors("", &found, &exact).iter().map(|error| error.mean_abs).sum::<f64>()
        };
        candidates
            .map(|(step, strength)| NormalOcclusion { step, strength, ..*base })
            .map(|settings| (error(&settings), settings))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(*base, |(_, settings)| settings)
    }
}

/// How shadow rays of the thesis' algorithms are marched.
const MARCH: ShadowMarch = ShadowMarch { start: START, threshold: THRESHOLD, max_steps: 128 };

/// What is tried for steps along the normal, in radii, and for their strength.
const STEPS: [f32; 8] = [0.0125, 0.025, 0.05, 0.1, 0.15, 0.2, 0.3, 0.45];
const STRENGTHS: [f32; 8] = [0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0];
