//! The soft shadow of a directional light by a field against the same rays through triangles.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use visfield::estimate::Receiver;
use visfield::estimate::sampling::{DiscBasis, disc_samples};
use visfield::{QueryOptions, VisibilityField};

use super::ambient::{AmbientSpeed, TRUTH_RAYS, shares};
use super::names::Names;
use super::scene::{MeasureScene, pattern_turn};
use super::speed::RaySet;
use crate::bake::{BakeError, BakeSettings, bake, check_rays};
use crate::exact::ExactScene;
use crate::mesh::Mesh;

/// Receivers along each side of the corner's squares. A penumbra is a narrow band, so there are more than for ambient
/// occlusion.
pub const SHADOW_SIDE: usize = 129;

/// Towards the light, before normalisation: slanted, from the open side of the corner, so that the shadow falls on the floor
/// and on both walls.
pub const TO_LIGHT: Vec3 = Vec3::new(0.5, 0.7, 0.6);

/// What is measured.
///
/// ```
/// let ask = visfield_bake::measure::ShadowQuestion::default();
/// assert_eq!((ask.rays, ask.angular_radius), (64, 0.05));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ShadowQuestion {
    /// How the mesh is baked.
    pub bake: BakeSettings,
    /// Where the receivers are.
    pub scene: MeasureScene,
    /// Half of the angle that the light covers in the sky, in radians, 0 to [`DiscBasis::MAX_ANGULAR_RADIUS`].
    pub angular_radius: f32,
    /// Rays per receiver over the light's disc, at least 1. Those below the receiver's horizon are not sent.
    pub rays: u32,
    /// How the field is asked; its normal is the receiver's.
    pub options: QueryOptions,
    /// Whether speeds are measured too. They take one thread, several repeats, and a quiet machine.
    pub speed: bool,
}

impl Default for ShadowQuestion {
    fn default() -> Self {
        Self {
            bake: BakeSettings::two_point(65, 32),
            scene: MeasureScene::Corner,
            angular_radius: 0.05,
            rays: 64,
            options: QueryOptions::default(),
            speed: true,
        }
    }
}

/// What was found. Speeds are of one thread; errors are of the occlusion of the light, 0 to 1, unless named otherwise.
///
/// ```
/// use visfield_bake::{BakeSettings, Mesh, measure::{ShadowQuestion, measure_shadow}};
/// let mesh = Mesh {
///     name: "tetrahedron".to_owned(),
///     positions: vec![[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0]],
///     indices: vec![[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]],
/// };
/// let ask = ShadowQuestion { bake: BakeSettings::two_point(33, 32), speed: false, ..ShadowQuestion::default() };
/// let found = measure_shadow(&mesh, &ask)?;
/// assert!(found.partly_lit > 300 && found.rms_255 < 100.0);
/// # Ok::<(), visfield_bake::BakeError>(())
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ShadowMeasurement {
    /// Name of the mesh.
    pub mesh: String,
    /// Its triangles.
    pub triangles: u32,
    /// Where the receivers are.
    pub scene: MeasureScene,
    /// `two-point`, `hemisphere`, `distance`, or as `two-point + distance` what answers rays together.
    pub representation: String,
    /// The numbers of the representation, as 65² × 32² or 64 voxels.
    pub size: String,
    /// How it is encoded: a table as `bit`, `u8`, `u16` or `f32`, distances as `u8` or `u16`.
    pub encoding: String,
    /// `sphere` or `ellipsoid`; `box` for distances alone.
    pub bounds: String,
    /// `point` or `plain`; `traced` for distances alone.
    pub aim: String,
    /// Half of the angle that the light covers in the sky, in radians.
    pub angular_radius: f32,
    /// Size in memory of what was measured.
    pub field_bytes: u64,
    /// Seconds for the whole bake, on all threads.
    pub bake_seconds: f64,
    /// Rays per second of the bake; of distances, points.
    pub bake_rays_per_second: f64,
    /// Number of receivers.
    pub receivers: usize,
    /// How many of them are partly lit, by the field or by the triangles.
    pub partly_lit: usize,
    /// Rays that were sent by all of them.
    pub rays: u64,
    /// How many of them meet the field's bounds.
    pub rays_meeting_bounds: u64,
    /// Mean share of the light that the triangles occlude.
    pub occluded_fraction: f64,
    /// Speeds, if they were measured.
    #[serde(flatten)]
    pub speed: Option<AmbientSpeed>,
    /// Root of the mean square error against the same rays, over the partly lit receivers, × 255.
    pub rms_255: f64,
    /// Mean absolute error against the same rays, over receivers that either finds not fully lit.
    pub mean_abs: f64,
    /// Largest absolute error over the same receivers.
    pub max_abs: f64,
    /// Mean error over the same receivers: above 0, the field is too dark.
    pub bias_signed: f64,
    /// Mean absolute error against [`TRUTH_RAYS`] exact rays, over receivers that either finds not fully lit.
    pub mean_abs_truth: f64,
    /// The same of the exact rays that the field was compared with: what their number alone costs.
    pub exact_mean_abs_truth: f64,
    /// RMS × 255 of those exact rays, over receivers that either they or the truth finds partly lit.
    pub exact_rms_255_truth: f64,
    /// Occlusion of the light at every receiver by exact rays, 0 where it is fully lit or faces away, for pictures.
    #[serde(skip)]
    pub exact: Vec<f32>,
    /// The same by the field.
    #[serde(skip)]
    pub found: Vec<f32>,
}

/// Bakes a mesh and measures a soft shadow with it.
///
/// # Errors
/// [`BakeError`] if the mesh or the settings cannot be baked, or if they have nothing that answers rays.
pub fn measure_shadow(mesh: &Mesh, question: &ShadowQuestion) -> Result<ShadowMeasurement, BakeError> {
    if question.bake.table.is_none() && question.bake.distance.is_none() {
        return Err(BakeError::NoRays { name: mesh.name.clone() });
    }
    let start = Instant::now();
    let rays = AtomicU64::new(0);
    let field = bake(mesh, &question.bake, |traced| {
        rays.fetch_add(traced, Ordering::Relaxed);
    })?;
    let bake_seconds = start.elapsed().as_secs_f64();
    let mut measurement = measure_shadow_of(mesh, &field, question)?;
    measurement.bake_seconds = bake_seconds;
    measurement.bake_rays_per_second = rays.into_inner() as f64 / bake_seconds;
    Ok(measurement)
}

/// The same with a field that is baked already.
///
/// # Errors
/// [`BakeError`] if the mesh cannot be baked, or if the field answers no rays.
pub fn measure_shadow_of(
    mesh: &Mesh,
    field: &VisibilityField,
    question: &ShadowQuestion,
) -> Result<ShadowMeasurement, BakeError> {
    check_rays(field)?;
    let mesh_error = |source| BakeError::Mesh { name: mesh.name.clone(), source };
    let receivers = question.scene.receivers_by(mesh, SHADOW_SIDE).map_err(mesh_error)?;
    let exact_scene = ExactScene::of_mesh(mesh).map_err(mesh_error)?;
    let triangles = exact_scene.triangles();
    let light = MeasuredLight::new(question.angular_radius, question.rays);
    let start = |receiver: &Receiver| exact_scene.start(receiver);
    let directions = |receiver: &Receiver, index: usize| light.directions(receiver, index);
    let set = RaySet::new(triangles, field, question.options, &receivers, directions, start);
    let meeting = set.meeting_bounds();

    let exact = shares(&set.exact_answers(triangles), &set.receivers);
    let found = shares(&set.field_answers(field), &set.receivers);
    let truth_light = MeasuredLight::new(question.angular_radius, TRUTH_RAYS);
    let truth: Vec<f32> = (0..receivers.len())
        .into_par_iter()
        .map(|i| truth_light.exact_occlusion(&exact_scene, &receivers[i], i))
        .collect();

    let header = field.header();
    let names = Names::of_rays(field, question.options.aim);
    let against_same = ShadowErrors::of(&found, &exact);
    let exact_against_truth = ShadowErrors::of(&exact, &truth);
    Ok(ShadowMeasurement {
        mesh: mesh.name.clone(),
        triangles: header.triangles,
        scene: question.scene,
        representation: names.representation,
        size: names.size,
        encoding: names.encoding,
        bounds: names.bounds,
        aim: names.aim,
        angular_radius: question.angular_radius,
        field_bytes: names.bytes,
        bake_seconds: 0.0,
        bake_rays_per_second: 0.0,
        receivers: receivers.len(),
        partly_lit: against_same.partly_lit,
        rays: set.field.len() as u64,
        rays_meeting_bounds: meeting.field.len() as u64,
        occluded_fraction: exact.iter().map(|&x| f64::from(x)).sum::<f64>() / exact.len().max(1) as f64,
        speed: question.speed.then(|| AmbientSpeed::race(&set, &meeting, field, triangles)),
        rms_255: against_same.rms * 255.0,
        mean_abs: against_same.mean_abs,
        max_abs: against_same.max_abs,
        bias_signed: against_same.bias,
        mean_abs_truth: ShadowErrors::of(&found, &truth).mean_abs,
        exact_mean_abs_truth: exact_against_truth.mean_abs,
        exact_rms_255_truth: exact_against_truth.rms * 255.0,
        exact,
        found,
    })
}

/// The light, and how receivers sample it.
pub(crate) struct MeasuredLight {
    disc: DiscBasis,
    samples: Vec<glam::Vec2>,
}

impl MeasuredLight {
    pub(crate) fn new(angular_radius: f32, rays: u32) -> Self {
        Self::towards(TO_LIGHT, angular_radius, rays)
    }

    /// A light elsewhere.
    pub(crate) fn towards(to_light: Vec3, angular_radius: f32, rays: u32) -> Self {
        Self { disc: DiscBasis::new(to_light.normalize(), angular_radius), samples: disc_samples(rays.max(1)) }
    }

    /// The disc of its directions.
    #[cfg(feature = "command")]
    pub(crate) fn disc(&self) -> &DiscBasis {
        &self.disc
    }

    /// Unit vectors to the samples above a receiver's horizon, as `DirectionalShadow::rays_above` has them, in a pattern that
    /// is turned differently for each receiver; none for receivers that face away, which count as lit.
    pub(crate) fn directions(&self, receiver: &Receiver, index: usize) -> Vec<Vec3> {
        if receiver.normal.dot(self.disc.axis) <= 0.0 {
            return Vec::new();
        }
        let turn = pattern_turn(index);
        let directions = self.samples.iter().map(|&sample| self.disc.direction(turn.rotate(sample)));
        directions.filter(|direction| receiver.normal.dot(*direction) > 0.0).collect()
    }

    /// The share of the light that the triangles occlude.
    pub(crate) fn exact_occlusion(&self, scene: &ExactScene, receiver: &Receiver, index: usize) -> f32 {
        let (start, directions) = (scene.start(receiver), self.directions(receiver, index));
        let hits = directions.iter().filter(|&&ray| scene.triangles().occluded(start, ray, 0.0, f32::INFINITY)).count();
        hits as f32 / directions.len().max(1) as f32
    }
}

/// Differences of two estimates of the light's occlusion over receivers.
pub(crate) struct ShadowErrors {
    pub(crate) partly_lit: usize,
    pub(crate) rms: f64,
    pub(crate) mean_abs: f64,
    pub(crate) max_abs: f64,
    pub(crate) bias: f64,
}

impl ShadowErrors {
    /// The RMS is over receivers that either side finds partly lit, the others over those that either finds not fully lit.
    /// All shares of [`TRUTH_RAYS`] or fewer rays are exact in `f32`, so that comparing with 0 and 1 is sound.
    pub(crate) fn of(found: &[f32], exact: &[f32]) -> Self {
        const PARTLY: Range<f32> = f32::MIN_POSITIVE..1.0;
        let (mut squared, mut absolute, mut signed, mut max_abs) = (0.0, 0.0, 0.0, 0.0_f64);
        let (mut partly_lit, mut shadowed) = (0, 0_u32);
        for (&found, &exact) in found.iter().zip(exact) {
            let error = f64::from(found) - f64::from(exact);
            if PARTLY.contains(&found) || PARTLY.contains(&exact) {
                partly_lit += 1;
                squared += error * error;
            }
            if found.max(exact) > 0.0 {
                shadowed += 1;
                absolute += error.abs();
                signed += error;
                max_abs = max_abs.max(error.abs());
            }
        }
        let count = f64::from(shadowed.max(1));
        Self {
            partly_lit,
            rms: (squared / partly_lit.max(1) as f64).sqrt(),
            mean_abs: absolute / count,
            max_abs,
            bias: signed / count,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_count_where_they_are_said_to() {
        // Lit, dark, two in a penumbra, and one that only the field darkens, wholly.
        let (exact, found) = ([0.0, 1.0, 0.5, 0.0, 0.0], [0.0, 1.0, 0.25, 0.5, 1.0]);
        let errors = ShadowErrors::of(&found, &exact);
        assert_eq!(errors.partly_lit, 2);
        assert!((errors.rms - 0.156_25_f64.sqrt()).abs() < 1e-12, "{}", errors.rms);
        assert_eq!((errors.mean_abs, errors.max_abs, errors.bias), (1.75 / 4.0, 1.0, 1.25 / 4.0));
    }

    #[test]
    fn receivers_sample_the_disc_above_their_horizon() {
        let light = MeasuredLight::new(0.3, 256);
        let axis = TO_LIGHT.normalize();
        let facing = Receiver { position: glam::DVec3::ZERO, normal: axis };
        let directions = light.directions(&facing, 7);
        assert_eq!(directions.len(), 256);
        assert!(directions.iter().all(|d| d.angle_between(axis) < 0.301));
        assert_ne!(directions, light.directions(&facing, 8), "another receiver, another turn");
        let (across, _) = axis.any_orthonormal_pair();
        let grazing = light.directions(&Receiver { normal: (across + axis * 0.01).normalize(), ..facing }, 7);
        assert!((100..170).contains(&grazing.len()) && grazing.iter().all(|d| d.dot(across + axis * 0.01) > 0.0));
        assert!(light.directions(&Receiver { normal: -axis, ..facing }, 7).is_empty());
    }
}
