//! Ambient occlusion by a field against the same rays through triangles.

use std::ops::Range;
use std::time::Instant;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use visfield::estimate::Receiver;
use visfield::field::lookup::Aim;
use visfield::{BoundingEllipsoid, ChordTable, QueryOptions, VisibilityField};

use super::scene::{MeasureScene, hemisphere_directions};
use super::speed::{RaySet, gather_limit};
use crate::bake::{BakeError, BakeSettings, bake, table_of};
use crate::exact::ExactScene;
use crate::mesh::Mesh;
use crate::triangles::TriangleBvh;

/// Rays per receiver of the truth that methods are charged against, their own noise included.
pub const TRUTH_RAYS: u32 = 4096;

/// What is measured.
///
/// ```
/// let ask = visfield_bake::measure::AmbientQuestion::default();
/// assert_eq!(ask.rays, 256);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct AmbientQuestion {
    /// How the mesh is baked.
    pub bake: BakeSettings,
    /// Where the receivers are.
    pub scene: MeasureScene,
    /// Rays per receiver.
    pub rays: u32,
    /// How the field is asked; its normal is the receiver's.
    pub options: QueryOptions,
    /// Whether speeds are measured too. They take one thread, several repeats, and a quiet machine.
    pub speed: bool,
}

impl Default for AmbientQuestion {
    fn default() -> Self {
        Self {
            bake: BakeSettings::two_point(65, 32),
            scene: MeasureScene::Corner,
            rays: 256,
            options: QueryOptions::default(),
            speed: true,
        }
    }
}

/// What was found. Speeds are of one thread; errors are of occlusion, 0 to 1, unless named otherwise.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct AmbientMeasurement {
    /// Name of the mesh.
    pub mesh: String,
    /// Its triangles.
    pub triangles: u32,
    /// Where the receivers are.
    pub scene: MeasureScene,
    /// `two-point` or `hemisphere`.
    pub representation: String,
    /// The numbers of the representation, as 65² × 32².
    pub size: String,
    /// How the table is encoded: `bit`, `u8`, `u16` or `f32`.
    pub encoding: String,
    /// `sphere` or `ellipsoid`.
    pub bounds: String,
    /// `point` or `plain`.
    pub aim: String,
    /// Size of the table in memory.
    pub field_bytes: u64,
    /// Seconds for the whole bake, on all threads.
    pub bake_seconds: f64,
    /// Rays per second of the bake.
    pub bake_rays_per_second: f64,
    /// Number of receivers.
    pub receivers: usize,
    /// Rays that were sent by all of them.
    pub rays: u64,
    /// How many of them meet the field's bounds.
    pub rays_meeting_bounds: u64,
    /// Share of rays that the triangles occlude.
    pub occluded_fraction: f64,
    /// Speeds, if they were measured.
    #[serde(flatten)]
    pub speed: Option<AmbientSpeed>,
    /// Root of the mean square error against the same rays, over all receivers, × 255.
    pub rms_255: f64,
    /// Mean absolute error against the same rays, over receivers whose exact or estimated occlusion exceeds 1/255.
    pub mean_abs: f64,
    /// Largest absolute error over the same receivers.
    pub max_abs: f64,
    /// Mean error over the same receivers: above 0, the field is too dark.
    pub bias_signed: f64,
    /// Mean absolute error over the same receivers against [`TRUTH_RAYS`] exact rays.
    pub mean_abs_truth: f64,
    /// The same of the exact rays that the field was compared with: what their number alone costs.
    pub exact_mean_abs_truth: f64,
    /// RMS × 255 of those exact rays, over all receivers.
    pub exact_rms_255_truth: f64,
    /// Occlusion of every receiver by exact rays, for pictures.
    #[serde(skip)]
    pub exact: Vec<f32>,
    /// Occlusion of every receiver by the field, for pictures.
    #[serde(skip)]
    pub found: Vec<f32>,
}

/// How fast both were.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct AmbientSpeed {
    /// Seconds for all rays through the field.
    pub field_seconds: f64,
    /// Seconds for all rays through the triangles.
    pub bvh_seconds: f64,
    /// Their ratio.
    pub speedup: f64,
    /// The ratio over the rays that meet the field's bounds.
    pub speedup_meeting_bounds: f64,
    /// Random bytes of the table per second.
    pub gather_limit_lookups_per_second: f64,
    /// Rays that meet the bounds, per second, through the field.
    pub lookups_per_second: f64,
    /// The same through the triangles.
    pub bvh_rays_per_second: f64,
}

impl AmbientSpeed {
    /// Times all rays, and those that meet the bounds.
    pub(super) fn race(
        set: &RaySet,
        meeting: &RaySet,
        field: &VisibilityField,
        table: &ChordTable,
        triangles: &TriangleBvh,
    ) -> Self {
        let (field_seconds, bvh_seconds) = set.race(field, triangles);
        let (field_meeting, bvh_meeting) = meeting.race(field, triangles);
        Self {
            field_seconds,
            bvh_seconds,
            speedup: bvh_seconds / field_seconds,
            speedup_meeting_bounds: bvh_meeting / field_meeting,
            gather_limit_lookups_per_second: gather_limit(table),
            lookups_per_second: meeting.field.len() as f64 / field_meeting,
            bvh_rays_per_second: meeting.field.len() as f64 / bvh_meeting,
        }
    }
}

/// Bakes a mesh and measures ambient occlusion with it.
///
/// # Errors
/// [`BakeError`] if the mesh or the settings cannot be baked, or if they have no table.
pub fn measure_ambient(mesh: &Mesh, question: &AmbientQuestion) -> Result<AmbientMeasurement, BakeError> {
    let start = Instant::now();
    let field = bake(mesh, &question.bake, |_| ())?;
    let bake_seconds = start.elapsed().as_secs_f64();
    let mut measurement = measure_ambient_of(mesh, &field, question)?;
    measurement.bake_seconds = bake_seconds;
    measurement.bake_rays_per_second = question.bake.rays() as f64 / bake_seconds;
    Ok(measurement)
}

/// The same with a field that is baked already.
///
/// # Errors
/// [`BakeError`] if the mesh cannot be baked, or if the field has no table.
pub fn measure_ambient_of(
    mesh: &Mesh,
    field: &VisibilityField,
    question: &AmbientQuestion,
) -> Result<AmbientMeasurement, BakeError> {
    let table = table_of(field)?;
    let mesh_error = |source| BakeError::Mesh { name: mesh.name.clone(), source };
    let receivers = question.scene.receivers(mesh).map_err(mesh_error)?;
    let exact_scene = ExactScene::of_mesh(mesh).map_err(mesh_error)?;
    let triangles = exact_scene.triangles();
    let directions = |receiver: &Receiver, index: usize| hemisphere_directions(receiver, index, question.rays);
    let start = |receiver: &Receiver| exact_scene.start(receiver);
    let set = RaySet::new(triangles, field, question.options, &receivers, directions, start);
    let meeting = set.meeting_bounds();

    let exact = shares(&set.exact_answers(triangles), &set.receivers);
    let found = shares(&set.field_answers(field), &set.receivers);
    let truth: Vec<f32> = receivers
        .par_iter()
        .enumerate()
        .map(|(index, receiver)| {
            let origin = start(receiver);
            let directions = hemisphere_directions(receiver, index, TRUTH_RAYS);
            let hit = |direction: &glam::Vec3| triangles.occluded(origin, *direction, 0.0, f32::INFINITY);
            directions.iter().filter(|direction| hit(direction)).count() as f32 / TRUTH_RAYS as f32
        })
        .collect();

    let speed = question.speed.then(|| AmbientSpeed::race(&set, &meeting, field, table, triangles));
    let header = field.header();
    let occluded: f64 = exact.iter().map(|&x| f64::from(x)).sum::<f64>() / exact.len() as f64;
    let against_same = Errors::of(&found, &exact);
    let exact_against_truth = Errors::of(&exact, &truth);
    Ok(AmbientMeasurement {
        mesh: mesh.name.clone(),
        triangles: header.triangles,
        scene: question.scene,
        representation: table.representation().name().to_owned(),
        size: table.representation().to_string(),
        encoding: table.encoding().name().to_owned(),
        bounds: bounds_name(&header.bounds).to_owned(),
        aim: aim_name(question.options.aim).to_owned(),
        field_bytes: table.format().bytes(),
        bake_seconds: 0.0,
        bake_rays_per_second: 0.0,
        receivers: receivers.len(),
        rays: set.field.len() as u64,
        rays_meeting_bounds: meeting.field.len() as u64,
        occluded_fraction: occluded,
        speed,
        rms_255: against_same.rms * 255.0,
        mean_abs: against_same.mean_abs,
        max_abs: against_same.max_abs,
        bias_signed: against_same.bias,
        mean_abs_truth: Errors::of(&found, &truth).mean_abs,
        exact_mean_abs_truth: exact_against_truth.mean_abs,
        exact_rms_255_truth: exact_against_truth.rms * 255.0,
        exact,
        found,
    })
}

pub(super) fn bounds_name(bounds: &BoundingEllipsoid) -> &'static str {
    if bounds.sphere_radius().is_some() { "sphere" } else { "ellipsoid" }
}

pub(super) fn aim_name(aim: Aim) -> &'static str {
    match aim {
        Aim::Plain => "plain",
        Aim::Point => "point",
    }
}

/// The share of occluded rays of each receiver.
pub(super) fn shares(occluded: &[bool], receivers: &[(Range<usize>, QueryOptions)]) -> Vec<f32> {
    let share = |range: &Range<usize>| {
        occluded[range.clone()].iter().filter(|&&hit| hit).count() as f32 / range.len().max(1) as f32
    };
    receivers.iter().map(|(range, _)| share(range)).collect()
}

/// Differences of two estimates over receivers.
pub(crate) struct Errors {
    pub(crate) rms: f64,
    pub(crate) mean_abs: f64,
    pub(crate) max_abs: f64,
    pub(crate) bias: f64,
}

impl Errors {
    /// The RMS is over all receivers; the others over those that either side finds occluded.
    pub(crate) fn of(found: &[f32], exact: &[f32]) -> Self {
        let (mut squared, mut absolute, mut signed, mut max_abs, mut occluded) = (0.0, 0.0, 0.0, 0.0_f64, 0_u32);
        for (&found, &exact) in found.iter().zip(exact) {
            let error = f64::from(found) - f64::from(exact);
            squared += error * error;
            if found.max(exact) > 1.0 / 255.0 {
                occluded += 1;
                absolute += error.abs();
                signed += error;
                max_abs = max_abs.max(error.abs());
            }
        }
        let count = f64::from(occluded.max(1));
        Self {
            rms: (squared / exact.len().max(1) as f64).sqrt(),
            mean_abs: absolute / count,
            max_abs,
            bias: signed / count,
        }
    }
}
