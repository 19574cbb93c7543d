//! Ambient occlusion by a field against exact rays: by a table or distances against the same rays, by a cap grid against very many.

use std::hint::black_box;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use visfield::distance::{DistanceField, DistanceGrid};
use visfield::estimate::Receiver;
use visfield::estimate::caps::CapAmbient;
use visfield::field::cap_grid::Falloff;
use visfield::{CapGrid, QueryOptions, VisibilityField};

use super::caps::{AskedCaps, CapSpeed, OneObject, TABLE_RAYS};
use super::names::Names;
use super::scene::{MeasureScene, hemisphere_directions};
use super::speed::{RaySet, gather_limit, race};
use crate::bake::{BakeError, BakeSettings, bake, check_rays};
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
    /// How the mesh is baked. What is measured is what answers rays, if anything does; otherwise the cap grid.
    pub bake: BakeSettings,
    /// Where the receivers are.
    pub scene: MeasureScene,
    /// Rays per receiver: what a table or distances are asked, and what a cap grid is raced against.
    pub rays: u32,
    /// How a table is asked; its normal is the receiver's.
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
///
/// A cap grid sends no rays. What is said here of *the same rays* means [`TRUTH_RAYS`] exact rays for it, with its falloff if it
/// has one; and the rays that are counted are those of the triangles that it is raced against.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct AmbientMeasurement {
    /// Name of the mesh.
    pub mesh: String,
    /// Its triangles.
    pub triangles: u32,
    /// Where the receivers are.
    pub scene: MeasureScene,
    /// `two-point`, `hemisphere`, `distance`, `cap-grid`, or as `two-point + distance` what answers rays together.
    pub representation: String,
    /// The numbers of the representation, as 65² × 32², 64 voxels or 16³.
    pub size: String,
    /// How it is encoded: a table as `bit`, `u8`, `u16` or `f32`, distances as `u8` or `u16`, a cap grid as `rgba8` or `rgba16f`.
    pub encoding: String,
    /// `sphere` or `ellipsoid`; `box` for distances alone and for a cap grid.
    pub bounds: String,
    /// `point` or `plain`; `traced` for distances alone, `none` for a cap grid.
    pub aim: String,
    /// Size in memory of what was measured.
    pub field_bytes: u64,
    /// Seconds for the whole bake, on all threads.
    pub bake_seconds: f64,
    /// Rays per second of the bake; of distances, points.
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
    /// Seconds for all rays through the field; of a cap grid, for all receivers.
    pub field_seconds: f64,
    /// Seconds for all rays through the triangles.
    pub bvh_seconds: f64,
    /// Their ratio.
    pub speedup: f64,
    /// The ratio over the rays that meet the field's bounds. A cap grid does not tell them apart: it answers all receivers, in the
    /// time of which the triangles answer these rays alone.
    pub speedup_meeting_bounds: f64,
    /// Random bytes per second of what was measured.
    pub gather_limit_lookups_per_second: f64,
    /// Rays that meet the bounds, per second, through the field; of a cap grid, receivers per second.
    pub lookups_per_second: f64,
    /// Rays that meet the bounds, per second, through the triangles.
    pub bvh_rays_per_second: f64,
    /// What only cap grids tell.
    #[serde(flatten)]
    pub caps: Option<CapSpeed>,
}

impl AmbientSpeed {
    /// Times all rays, and those that meet the bounds.
    pub(super) fn race(set: &RaySet, meeting: &RaySet, field: &VisibilityField, triangles: &TriangleBvh) -> Self {
        let (field_seconds, bvh_seconds) = set.race(field, triangles);
        let (field_meeting, bvh_meeting) = meeting.race(field, triangles);
        Self {
            field_seconds,
            bvh_seconds,
            speedup: bvh_seconds / field_seconds,
            speedup_meeting_bounds: bvh_meeting / field_meeting,
            gather_limit_lookups_per_second: gather_limit(&bytes_for_rays(field)),
            lookups_per_second: meeting.field.len() as f64 / field_meeting,
            bvh_rays_per_second: meeting.field.len() as f64 / bvh_meeting,
            caps: None,
        }
    }

    /// Times all receivers through a cap grid, and the rays that they would have to send otherwise: through the triangles, those
    /// of them that meet the bounds, and few through a table.
    fn race_caps(
        [set, meeting]: [&RaySet; 2],
        receivers: &[Receiver],
        (grid, caps): (&CapGrid, &AskedCaps),
        (table, few): (&VisibilityField, &RaySet),
        triangles: &TriangleBvh,
    ) -> Self {
        let mut ambient = vec![CapAmbient::UNOCCLUDED; receivers.len()];
        let [mut all, mut some, mut fewest] = [set, meeting, few].map(RaySet::unanswered);
        let [field_seconds, bvh_seconds, bvh_meeting, table_seconds] = race([
            &mut || caps.ask(receivers, black_box(&mut ambient)),
            &mut || set.ask_triangles(triangles, black_box(&mut all)),
            &mut || meeting.ask_triangles(triangles, black_box(&mut some)),
            &mut || few.ask_field(table, black_box(&mut fewest)),
        ]);
        let count = receivers.len() as f64;
        Self {
            field_seconds,
            bvh_seconds,
            speedup: bvh_seconds / field_seconds,
            speedup_meeting_bounds: bvh_meeting / field_seconds,
            gather_limit_lookups_per_second: gather_limit(&grid.bytes()),
            lookups_per_second: count / field_seconds,
            bvh_rays_per_second: meeting.field.len() as f64 / bvh_meeting,
            caps: Some(CapSpeed {
                nanoseconds_per_receiver_and_object: field_seconds / count * 1e9,
                table_nanoseconds_per_receiver: table_seconds / count * 1e9,
            }),
        }
    }
}

/// Everything that rays may read.
fn bytes_for_rays(field: &VisibilityField) -> Vec<u8> {
    let mut bytes = field.table().map_or_else(Vec::new, |table| table.bytes().to_vec());
    bytes.extend(field.distance_field().and_then(DistanceField::grid).map(DistanceGrid::bytes).unwrap_or_default());
    bytes
}

/// Bakes a mesh and measures ambient occlusion with it.
///
/// # Errors
/// [`BakeError`] if the mesh or the settings cannot be baked.
pub fn measure_ambient(mesh: &Mesh, question: &AmbientQuestion) -> Result<AmbientMeasurement, BakeError> {
    let start = Instant::now();
    // A cap grid takes fewer rays than it may.
    let rays = AtomicU64::new(0);
    let field = bake(mesh, &question.bake, |traced| {
        rays.fetch_add(traced, Ordering::Relaxed);
    })?;
    let bake_seconds = start.elapsed().as_secs_f64();
    let mut measurement = measure_ambient_of(mesh, &field, question)?;
    measurement.bake_seconds = bake_seconds;
    measurement.bake_rays_per_second = rays.into_inner() as f64 / bake_seconds;
    Ok(measurement)
}

/// The part of a field that is measured.
enum Part<'a> {
    Rays,
    CapGrid(&'a CapGrid),
}

impl<'a> Part<'a> {
    fn of(field: &'a VisibilityField) -> Result<Self, BakeError> {
        match field.cap_grid() {
            Some(grid) if !field.answers_rays() => Ok(Self::CapGrid(grid)),
            _ => check_rays(field).map(|()| Self::Rays),
        }
    }

    /// What exact rays have to be weighted with.
    fn falloff(&self) -> Falloff {
        match self {
            Self::Rays => Falloff::None,
            Self::CapGrid(grid) => grid.header().format.falloff,
        }
    }
}

/// The same with a field that is baked already.
///
/// # Errors
/// [`BakeError`] if the mesh cannot be baked.
pub fn measure_ambient_of(
    mesh: &Mesh,
    field: &VisibilityField,
    question: &AmbientQuestion,
) -> Result<AmbientMeasurement, BakeError> {
    let part = Part::of(field)?;
    let mesh_error = |source| BakeError::Mesh { name: mesh.name.clone(), source };
    let receivers = question.scene.receivers(mesh).map_err(mesh_error)?;
    let exact_scene = ExactScene::of_mesh(mesh).map_err(mesh_error)?;
    let triangles = exact_scene.triangles();
    let rays_of = |field: &VisibilityField, rays: u32, options: QueryOptions| {
        let directions = |receiver: &Receiver, index: usize| hemisphere_directions(receiver, index, rays);
        RaySet::new(triangles, field, options, &receivers, directions, |receiver| exact_scene.start(receiver))
    };
    let set = rays_of(field, question.rays, question.options);
    let meeting = set.meeting_bounds();
    let one_object = OneObject::new(field);
    let caps = one_object.caps();

    let [exact, truth] =
        [question.rays, TRUTH_RAYS].map(|rays| exact_occlusion(&exact_scene, &receivers, rays, part.falloff()));
    let found = match part {
        Part::Rays => shares(&set.field_answers(field), &set.receivers),
        Part::CapGrid(_) => caps.found(&receivers),
    };
    let speed = match part {
        _ if !question.speed => None,
        Part::Rays => Some(AmbientSpeed::race(&set, &meeting, field, triangles)),
        Part::CapGrid(grid) => {
            let table = bake(mesh, &BakeSettings::two_point(65, 32), |_| ())?;
            let few = rays_of(&table, TABLE_RAYS, QueryOptions::default());
            let both = ([&set, &meeting], (&table, &few));
            Some(AmbientSpeed::race_caps(both.0, &receivers, (grid, &caps), both.1, triangles))
        }
    };
    let header = field.header();
    let occluded: f64 = exact.iter().map(|&x| f64::from(x)).sum::<f64>() / exact.len() as f64;
    let exact_against_truth = Errors::of(&exact, &truth);
    let against_truth = Errors::of(&found, &truth);
    let mean_abs_truth = against_truth.mean_abs;
    let (names, errors) = match part {
        Part::Rays => (Names::of_rays(field, question.options.aim), Errors::of(&found, &exact)),
        Part::CapGrid(grid) => (Names::of_cap_grid(grid), against_truth),
    };
    // There is nothing that a cap grid and few rays would have in common.
    let exact = if matches!(part, Part::CapGrid(_)) { truth } else { exact };
    Ok(AmbientMeasurement {
        mesh: mesh.name.clone(),
        triangles: header.triangles,
        scene: question.scene,
        representation: names.representation,
        size: names.size,
        encoding: names.encoding,
        bounds: names.bounds,
        aim: names.aim,
        field_bytes: names.bytes,
        bake_seconds: 0.0,
        bake_rays_per_second: 0.0,
        receivers: receivers.len(),
        rays: set.field.len() as u64,
        rays_meeting_bounds: meeting.field.len() as u64,
        occluded_fraction: occluded,
        speed,
        rms_255: errors.rms * 255.0,
        mean_abs: errors.mean_abs,
        max_abs: errors.max_abs,
        bias_signed: errors.bias,
        mean_abs_truth,
        exact_mean_abs_truth: exact_against_truth.mean_abs,
        exact_rms_255_truth: exact_against_truth.rms * 255.0,
        exact,
        found,
    })
}

/// Occlusion of every receiver by exact rays, each hit weighted by its distance.
pub(super) fn exact_occlusion(scene: &ExactScene, receivers: &[Receiver], rays: u32, falloff: Falloff) -> Vec<f32> {
    let of = |(index, receiver)| exact_occlusion_of(scene, receiver, index, rays, falloff);
    receivers.par_iter().enumerate().map(of).collect()
}

/// The same of the receiver with this index.
pub(super) fn exact_occlusion_of(
    scene: &ExactScene,
    receiver: &Receiver,
    index: usize,
    rays: u32,
    falloff: Falloff,
) -> f32 {
    let (start, triangles) = (scene.start(receiver), scene.triangles());
    let directions = hemisphere_directions(receiver, index, rays);
    let weight = |direction: &Vec3| match falloff {
        Falloff::None => f32::from(u8::from(triangles.occluded(start, *direction, 0.0, f32::INFINITY))),
        _ => triangles.closest_hit(start, *direction, f32::INFINITY).map_or(0.0, |t| falloff.weight(t)),
    };
    directions.iter().map(weight).sum::<f32>() / directions.len().max(1) as f32
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
