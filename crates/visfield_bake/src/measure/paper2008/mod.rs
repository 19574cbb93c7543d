//! The experiments of the 2008 paper, Figures 5 to 8, on any mesh, beside the paper's own numbers.
//!
//! Its representation is [`Hemisphere`](Representation::Hemisphere), asked plainly, in bytes; beside it stands a two-point
//! table of the same size, asked by aimed lookups.

mod findings;
pub mod published;
pub(super) mod several;
pub(super) mod table;

use std::time::Instant;

use serde::{Deserialize, Serialize};
use visfield::field::directions::DirectionMap;
use visfield::field::lookup::Aim;
use visfield::{Encoding, QueryOptions, Representation, TableFormat};

pub use self::findings::Finding;
pub use self::several::SeveralObjects;
use super::picture::{CornerView, Pictures};
use super::progress::Progress;
use super::reference::{OcclusionError, Reference};
use super::scene::MeasureScene;
use super::speed::RaySet;
use crate::bake::{BakeError, BakeSettings, table_of};
use crate::bounds::BoundsKind;
use crate::mesh::Mesh;

/// Positions and directions of a hemisphere table: `positions` maps of `directions`².
pub type Maps = (u32, u32);

/// Which tables are baked.
///
/// ```
/// use visfield_bake::measure::paper2008::Paper2008Question;
/// assert_eq!(Paper2008Question::new(true).directions, [32, 64]);
/// ```
#[derive(Clone, Debug)]
pub struct Paper2008Question {
    /// The maps of Figure 5, which compares direction maps.
    pub sampling: Maps,
    /// Rows of Figure 6.
    pub positions: Vec<u32>,
    /// Columns of Figure 6.
    pub directions: Vec<u32>,
    /// The maps of Figure 7, which are of one bit.
    pub bits: Maps,
    /// The maps of Figure 8, which compares models.
    pub models: Maps,
    /// Rays per receiver, at least 1; 0 counts as 1.
    pub rays: u32,
    /// Each of several objects has up to three times the square of this of receivers, at the centres of its triangles.
    pub own_side: usize,
}

impl Paper2008Question {
    /// The paper's tables, all of them or, `quick`, without the 128² and 256² maps, of which the largest table has 277
    /// million rays.
    pub fn new(quick: bool) -> Self {
        let directions: &[u32] = if quick { &[32, 64] } else { &[32, 64, 128, 256] };
        Self {
            sampling: (1090, 64),
            positions: vec![290, 1090, 4226],
            directions: directions.to_vec(),
            bits: (4226, 64),
            models: (4226, 32),
            rays: 256,
            own_side: if quick { 40 } else { 129 },
        }
    }
}

/// What was found. Bakes use all threads; times of rays are of one.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Paper2008 {
    /// Name of the mesh of Figures 5 to 7.
    pub mesh: String,
    /// Its triangles.
    pub triangles: u32,
    /// Threads that bakes had.
    pub threads: usize,
    /// Rays of all receivers of the corner.
    pub rays: u64,
    /// Layouts of directions.
    pub figure5: Vec<DirectionSampling>,
    /// RMS × 255 of exact rays that are uniform over the hemisphere, against the reference's cosine-distributed ones.
    pub uniform_rays_rms_255: f64,
    /// Sizes of tables.
    pub figure6: Vec<TableSize>,
    /// One bit per direction.
    pub figure7: OneBit,
    /// Models, from few to many triangles.
    pub figure8: Vec<Model>,
    /// Several objects that cast on each other, if there were three meshes.
    pub several: Option<SeveralObjects>,
}

/// One table and what it gave.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FieldResult {
    /// The numbers of the representation, as 65² × 32².
    pub size: String,
    /// Size of the table in memory.
    pub field_bytes: u64,
    /// Seconds of the bake.
    pub bake_seconds: f64,
    /// Seconds for all rays.
    pub ao_seconds: f64,
    /// Error in the corner.
    pub error: OcclusionError,
    /// RMS × 255 over all pixels of the corner's picture, as in the paper: receivers are interpolated, and where neither
    /// floor nor wall is seen there is no error.
    pub picture_rms_255: f64,
}

/// Figure 5: one way to lay out directions.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct DirectionSampling {
    /// The layout.
    pub map: DirectionMap,
    /// What it gave.
    pub measured: FieldResult,
    /// How it looks.
    pub pictures: Pictures,
}

/// A cell of Figure 6.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TableSize {
    /// Number of maps.
    pub positions: u32,
    /// Side of each map.
    pub directions: u32,
    /// The paper's representation.
    pub hemisphere: FieldResult,
    /// A two-point table of about the same size, by aimed lookups.
    pub two_point: FieldResult,
}

/// Figure 7: bits beside bytes.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct OneBit {
    /// Number of maps.
    pub positions: u32,
    /// Side of each map.
    pub directions: u32,
    /// One bit for each direction.
    pub bit: FieldResult,
    /// One byte.
    pub byte: FieldResult,
    /// Receivers of the corner that lie in the bounding sphere, where distances matter.
    pub receivers_inside: usize,
    /// Receivers for which bits and bytes differ.
    pub receivers_that_differ: usize,
    /// How the bits look.
    pub pictures: Pictures,
}

/// A column of Figure 8.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Model {
    /// Name of the mesh.
    pub mesh: String,
    /// Its triangles.
    pub triangles: u32,
    /// Rays that were sent.
    pub rays: u64,
    /// Seconds for them through the triangles.
    pub exact_seconds: f64,
    /// The paper's representation.
    pub hemisphere: FieldResult,
    /// A two-point table of about the same size, by aimed lookups.
    pub two_point: FieldResult,
}

/// Repeats the paper's experiments on `mesh`; Figure 8 has `others` too, and if there are two of them, all three cast on
/// each other. `progress` gets the share of the work that is done, from 0 to 1, and what is being done, from any thread.
///
/// # Errors
/// [`BakeError`] if a mesh or a setting cannot be baked.
pub fn paper2008(
    mesh: &Mesh,
    others: &[Mesh],
    question: &Paper2008Question,
    progress: impl Fn(f64, &str) + Sync,
) -> Result<Paper2008, BakeError> {
    let question = &Paper2008Question { rays: question.rays.max(1), ..question.clone() };
    let progress = Progress::new(question.work(1 + others.len()), &progress);
    let mut bench = Bench::new(mesh, question.rays, &progress)?;
    let figure5 = figure5(&mut bench, question.sampling)?;
    let uniform_rays_rms_255 = bench.reference.error(&bench.reference.trace_uniform()).rms_255;
    let figure6 = figure6(&mut bench, question)?;
    let figure7 = figure7(&mut bench, question.bits)?;
    let mut figure8 = vec![model(&mut bench, question.models)?];
    let (rays, triangles) = (bench.reference.rays(), figure8[0].triangles);
    drop(bench);
    for other in others {
        figure8.push(model(&mut Bench::new(other, question.rays, &progress)?, question.models)?);
    }
    figure8.sort_by_key(|model| model.triangles);
    let several = match others {
        [second, third, ..] => Some(several::several_objects([mesh, second, third], question, &progress)?),
        _ => None,
    };
    let threads = rayon::current_num_threads();
    Ok(Paper2008 {
        mesh: mesh.name.clone(),
        triangles,
        threads,
        rays,
        figure5,
        uniform_rays_rms_255,
        figure6,
        figure7,
        figure8,
        several,
    })
}

impl Paper2008Question {
    /// In rays of bakes, with which all other work is in proportion.
    fn work(&self, models: usize) -> u64 {
        let rays = |(positions, directions): Maps| u64::from(positions) * u64::from(directions).pow(2);
        let sizes = self.positions.iter().flat_map(|&p| self.directions.iter().map(move |&d| (p, d)));
        let several = if models > 2 { 6 } else { 0 };
        4 * rays(self.sampling)
            + 2 * sizes.map(rays).sum::<u64>()
            + 2 * rays(self.bits)
            + (2 * models as u64 + several) * rays(self.models)
    }
}

/// A mesh in its corner, and all that its tables share.
struct Bench<'a> {
    mesh: &'a Mesh,
    progress: &'a Progress<'a>,
    reference: Reference,
    view: CornerView,
    /// As fields with bounding spheres are asked: made with the first of them.
    set: Option<RaySet>,
}

impl<'a> Bench<'a> {
    fn new(mesh: &'a Mesh, rays: u32, progress: &'a Progress<'a>) -> Result<Self, BakeError> {
        let mesh_error = |source| BakeError::Mesh { name: mesh.name.clone(), source };
        let reference = Reference::new(mesh, MeasureScene::Corner, rays).map_err(mesh_error)?;
        let view = CornerView::new(mesh).map_err(mesh_error)?;
        Ok(Self { mesh, progress, reference, view, set: None })
    }

    /// Bakes a table and asks it; the occlusion of each receiver comes too.
    fn measure(&mut self, settings: &BakeSettings, aim: Aim) -> Result<(FieldResult, Vec<f32>), BakeError> {
        let start = Instant::now();
        let field = self.progress.bake(self.mesh, settings)?;
        let bake_seconds = start.elapsed().as_secs_f64();
        let table = table_of(&field)?;
        let set = self.set.get_or_insert_with(|| self.reference.ray_set(&field, QueryOptions::default()));
        set.receivers.iter_mut().for_each(|(_, options)| options.aim = aim);
        let found = Reference::found(set, &field);
        let measured = FieldResult {
            size: table.representation().to_string(),
            field_bytes: table.format().bytes(),
            bake_seconds,
            ao_seconds: Reference::field_seconds(set, &field),
            error: self.reference.error(&found),
            picture_rms_255: self.view.rms_255(&self.reference.exact, &found),
        };
        Ok((measured, found))
    }

    fn pictures(&self, found: &[f32]) -> Pictures {
        self.view.pictures(&self.reference.exact, found)
    }

    /// Both representations of one size.
    fn both(&mut self, maps: Maps) -> Result<(FieldResult, FieldResult), BakeError> {
        let (hemisphere, _) = self.measure(&hemisphere(maps, DirectionMap::Concentric, Encoding::U8), Aim::Plain)?;
        let (two_point, _) = self.measure(&two_point(maps), Aim::Point)?;
        Ok((hemisphere, two_point))
    }
}

/// The paper's representation.
fn hemisphere((positions, directions): Maps, map: DirectionMap, encoding: Encoding) -> BakeSettings {
    let representation = Representation::Hemisphere { positions, directions, map };
    BakeSettings::of_table(TableFormat { representation, encoding }, BoundsKind::Sphere)
}

/// As many bytes, or as near as a square of entries comes: 290 positions are 17² entries and one more.
pub(super) fn two_point((positions, directions): Maps) -> BakeSettings {
    BakeSettings::two_point(positions.isqrt(), directions)
}

fn figure5(bench: &mut Bench, maps: Maps) -> Result<Vec<DirectionSampling>, BakeError> {
    let sampling = |map| {
        let (measured, found) = bench.measure(&hemisphere(maps, map, Encoding::U8), Aim::Plain)?;
        Ok(DirectionSampling { map, measured, pictures: bench.pictures(&found) })
    };
    DirectionMap::ALL.into_iter().map(sampling).collect()
}

fn figure6(bench: &mut Bench, question: &Paper2008Question) -> Result<Vec<TableSize>, BakeError> {
    let mut sizes = Vec::new();
    for &positions in &question.positions {
        for &directions in &question.directions {
            let (hemisphere, two_point) = bench.both((positions, directions))?;
            sizes.push(TableSize { positions, directions, hemisphere, two_point });
        }
    }
    Ok(sizes)
}

fn figure7(bench: &mut Bench, maps: Maps) -> Result<OneBit, BakeError> {
    let mut measure = |encoding| bench.measure(&hemisphere(maps, DirectionMap::Concentric, encoding), Aim::Plain);
    let (byte, by_bytes) = measure(Encoding::U8)?;
    let (bit, by_bits) = measure(Encoding::Bit)?;
    let inside = |(range, _): &&(std::ops::Range<usize>, QueryOptions)| {
        bench.set.as_ref().is_some_and(|set| set.field[range.start].origin.length_squared() < 1.0)
    };
    Ok(OneBit {
        positions: maps.0,
        directions: maps.1,
        bit,
        byte,
        receivers_inside: bench.set.iter().flat_map(|set| &set.receivers).filter(inside).count(),
        receivers_that_differ: by_bits.iter().zip(&by_bytes).filter(|(a, b)| a != b).count(),
        pictures: bench.pictures(&by_bits),
    })
}

fn model(bench: &mut Bench, maps: Maps) -> Result<Model, BakeError> {
    let (hemisphere, two_point) = bench.both(maps)?;
    let triangles = bench.mesh.solid_triangles().map_or(0, |solid| solid.len() as u32);
    let exact_seconds = bench.set.as_ref().map_or(0.0, |set| bench.reference.exact_seconds(set));
    let rays = bench.reference.rays();
    Ok(Model { mesh: bench.mesh.name.clone(), triangles, rays, exact_seconds, hemisphere, two_point })
}
