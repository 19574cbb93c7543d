//! What accuracy costs: many fields of one mesh, their errors, sizes and speeds, and which of them nothing beats.

use serde::{Deserialize, Serialize};
use visfield::distance::{DistanceGridFormat, DistancePrecision};
use visfield::field::directions::DirectionMap;
use visfield::field::lookup::Aim;
use visfield::{
    CapGrid, CapGridFormat, ChordTable, Encoding, FieldParts, QueryOptions, Representation, TableFormat,
    VisibilityField,
};

use super::caps::OneObject;
use super::names::Names;
use super::progress::Progress;
use super::reference::{OcclusionError, Reference};
use super::scene::MeasureScene;
use super::speed::{RaySet, median_seconds};
use super::table::{Cells, bytes, count, seconds};
use crate::bake::{BakeError, BakeSettings, table_of};
use crate::bounds::BoundsKind;
use crate::mesh::Mesh;

/// What is swept.
///
/// ```
/// use visfield_bake::measure::tradeoff::Sweep;
/// assert!(Sweep::quick().representations.len() < Sweep::default().representations.len());
/// ```
#[derive(Clone, Debug)]
pub struct Sweep {
    /// Kinds and sizes of tables. Two-point tables are asked aimed and plain, others plain.
    pub representations: Vec<Representation>,
    /// How tables are encoded.
    pub encodings: Vec<Encoding>,
    /// Cap grids, which send no rays.
    pub cap_grids: Vec<CapGridFormat>,
    /// Grids of distances: each for all rays, and most again beside each of the composite tables.
    pub distances: Vec<DistanceGridFormat>,
    /// Tables that are tried together with distances, in a sphere, aimed.
    pub composite_tables: Vec<TableFormat>,
    /// Most points along the longest axis of distances beside a table.
    pub composite_voxels: u32,
    /// What surrounds the mesh.
    pub bounds: Vec<BoundsKind>,
    /// Rays per receiver.
    pub rays: u32,
}

impl Default for Sweep {
    /// Tables from 74 kB to 17 MB in bytes, in all encodings and bounds, cap grids from 2 to 131 kB, distances of 32 to 128 voxels,
    /// and tables of bits and of bytes beside the smaller ones of them.
    fn default() -> Self {
        let two_point = [(17, 16), (17, 32), (33, 32), (33, 64), (65, 32), (65, 64)];
        let hemisphere = [(290, 16), (290, 32), (1090, 32), (1090, 64), (4226, 32), (4226, 64)];
        Self {
            representations: two_point.map(two_point_of).into_iter().chain(hemisphere.map(hemisphere_of)).collect(),
            encodings: Encoding::ALL.to_vec(),
            cap_grids: [8, 16, 24, 32].map(cap_grid_of).to_vec(),
            distances: [32, 48, 64, 96, 128].map(distances_of).to_vec(),
            composite_tables: composite_tables(&[(33, 32), (65, 32), (65, 64)]),
            composite_voxels: 64,
            bounds: vec![BoundsKind::Sphere, BoundsKind::Ellipsoid],
            rays: 256,
        }
    }
}

impl Sweep {
    /// A few small tables, a small cap grid and small distances.
    pub fn quick() -> Self {
        Self {
            representations: vec![two_point_of((17, 16)), two_point_of((33, 16)), hemisphere_of((290, 16))],
            encodings: vec![Encoding::Bit, Encoding::U8],
            cap_grids: vec![cap_grid_of(8)],
            distances: vec![distances_of(32)],
            composite_tables: composite_tables(&[(17, 16)]),
            rays: 64,
            ..Self::default()
        }
    }
}

fn two_point_of((entries, exits): (u32, u32)) -> Representation {
    Representation::TwoPoint { entries, exits }
}

fn hemisphere_of((positions, directions): (u32, u32)) -> Representation {
    Representation::Hemisphere { positions, directions, map: DirectionMap::Concentric }
}

fn cap_grid_of(points: u32) -> CapGridFormat {
    CapGridFormat { points, ..CapGridFormat::DEFAULT }
}

fn distances_of(voxels: u32) -> DistanceGridFormat {
    DistanceGridFormat { voxels, precision: DistancePrecision::U8 }
}

/// Bits and bytes of these sizes.
fn composite_tables(sizes: &[(u32, u32)]) -> Vec<TableFormat> {
    let both = |&size| [Encoding::Bit, Encoding::U8].map(|encoding| (two_point_of(size), encoding));
    let formats = sizes.iter().flat_map(both);
    formats.map(|(representation, encoding)| TableFormat { representation, encoding }).collect()
}

/// What was found.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Tradeoff {
    /// Name of the mesh.
    pub mesh: String,
    /// Its triangles.
    pub triangles: u32,
    /// Rays that were sent by all receivers of the corner.
    pub rays: u64,
    /// Seconds of one thread for these rays through the triangles.
    pub exact_seconds: f64,
    /// One for each field, and way to ask it.
    pub points: Vec<TradeoffPoint>,
}

/// One field, and one way to ask it. Errors of a cap grid, which sends no rays, are all against the truth; those of others are
/// against the same rays, but for [`mean_abs_truth`](Self::mean_abs_truth).
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TradeoffPoint {
    /// `two-point`, `hemisphere`, `distance`, `two-point + distance` or `cap-grid`.
    pub representation: String,
    /// The numbers of the representation, as 65² × 32², 64 voxels or 16³.
    pub size: String,
    /// How it is encoded: a table as `bit`, `u8`, `u16` or `f32`, distances as `u8`, a cap grid as `rgba8`.
    pub encoding: String,
    /// `sphere` or `ellipsoid`; `box` for distances alone and for a cap grid.
    pub bounds: String,
    /// `point` or `plain`; `traced` for distances alone, `none` for a cap grid.
    pub aim: String,
    /// Size in memory.
    pub field_bytes: u64,
    /// Seconds of one thread for all rays of the corner, or for all its receivers if there are no rays.
    pub field_seconds: f64,
    /// The same as rays per second, those included that pass the bounds by; nothing for a cap grid.
    pub rays_per_second: Option<f64>,
    /// Error in the corner.
    pub corner: OcclusionError,
    /// Mean absolute error in the corner against [`TRUTH_RAYS`](super::ambient::TRUTH_RAYS) exact rays per receiver: what the
    /// number of rays costs is charged to those who send them.
    pub mean_abs_truth: f64,
    /// Error on the mesh's own surface; bits alone, which know no distances, have none.
    pub own_surface: Option<OcclusionError>,
    /// Whether no other point is at least as good in error (in the corner), size and time, and better in one. What answers rays is compared
    /// by its errors against the same rays, and all else by errors against the truth. A cap grid never beats what answers rays:
    /// it does not, which shadows and the mesh's own surface need.
    pub pareto: bool,
}

/// Times that differ by less count as equal: they are measured.
const TIME_TOLERANCE: f64 = 1.05;

impl TradeoffPoint {
    /// What curves are told apart by: the representation, and how it is asked.
    pub fn family(&self) -> String {
        let how = match self.aim.as_str() {
            "point" => "aimed",
            "none" => "no rays",
            other => other,
        };
        format!("{}, {how}", self.representation)
    }

    fn beats(&self, other: &Self) -> bool {
        let answers_rays = |p: &Self| p.rays_per_second.is_some();
        if answers_rays(other) && !answers_rays(self) {
            return false;
        }
        // Where both send the same rays, only what differs between them counts: the noise of the rays would hide it.
        let error = |p: &Self| if answers_rays(other) { p.corner.rms_255 } else { p.mean_abs_truth };
        let [mine, others] = [self, other].map(|p| (error(p), p.field_bytes));
        let no_worse =
            mine.0 <= others.0 && mine.1 <= others.1 && self.field_seconds <= other.field_seconds * TIME_TOLERANCE;
        let better =
            mine.0 < others.0 || mine.1 < others.1 || self.field_seconds * TIME_TOLERANCE < other.field_seconds;
        no_worse && better
    }
}

/// Bakes and measures every field of a sweep. `progress` gets the share of the work that is done, from 0 to 1, and what is
/// being done, from any thread.
///
/// # Errors
/// [`BakeError`] if the mesh or a setting cannot be baked.
pub fn tradeoff(mesh: &Mesh, sweep: &Sweep, progress: impl Fn(f64, &str) + Sync) -> Result<Tradeoff, BakeError> {
    let mesh_error = |source| BakeError::Mesh { name: mesh.name.clone(), source };
    let corner = Reference::new(mesh, MeasureScene::Corner, sweep.rays).map_err(mesh_error)?;
    let own = Reference::new(mesh, MeasureScene::OwnSurface, sweep.rays).map_err(mesh_error)?;
    let scenes = Scenes { corner_truth: corner.truth(), own_truth: own.truth(), corner, own };
    let progress = Progress::new(sweep.work(scenes.corner.rays()), &progress);
    let mut points = Vec::new();
    let (mut exact_seconds, mut triangles) = (0.0, 0);
    for &bounds in &sweep.bounds {
        // The same for all fields with these bounds.
        let mut sets = None;
        for &representation in &sweep.representations {
            let format = TableFormat { representation, encoding: Encoding::F32 };
            let best = progress.bake(mesh, &BakeSettings::of_table(format, bounds))?;
            let sets = sets.get_or_insert_with(|| scenes.ray_sets(&best));
            if exact_seconds == 0.0 {
                exact_seconds = scenes.corner.exact_seconds(&sets.corner);
                triangles = best.header().triangles;
            }
            for &encoding in &sweep.encodings {
                let field = best.clone().with_table(table_of(&best)?.with_encoding(encoding)?);
                for &aim in aims(representation) {
                    sets.aim(aim);
                    points.push(scenes.measure(sets, &field, aim));
                    progress.add(work_per_point(scenes.corner.rays()), &format!("asking {representation}"));
                }
            }
        }
    }
    for &format in &sweep.cap_grids {
        let field = progress.bake(mesh, &BakeSettings::of_cap_grid(format))?;
        points.extend(field.cap_grid().map(|grid| scenes.measure_caps(&field, grid)));
        progress.add(work_per_point(scenes.corner.rays()), &format!("asking {format}"));
    }
    points.extend(with_distances(mesh, sweep, &scenes, &progress)?);
    mark_pareto(&mut points);
    Ok(Tradeoff { mesh: mesh.name.clone(), triangles, rays: scenes.corner.rays(), exact_seconds, points })
}

/// Distances alone, and beside tables.
fn with_distances(
    mesh: &Mesh,
    sweep: &Sweep,
    scenes: &Scenes,
    progress: &Progress,
) -> Result<Vec<TradeoffPoint>, BakeError> {
    let mut points = Vec::new();
    // The same for all fields here: their bounds are spheres.
    let mut sets = None;
    let mut measure = |field: &VisibilityField| {
        let sets = sets.get_or_insert_with(|| scenes.ray_sets(field));
        points.push(scenes.measure(sets, field, Aim::Point));
        progress.add(work_per_point(scenes.corner.rays()), "asking distances");
    };
    let mut beside = Vec::new();
    for &format in &sweep.distances {
        let field = progress.bake(mesh, &BakeSettings::of_distance(format))?;
        measure(&field);
        beside.extend((format.voxels <= sweep.composite_voxels).then(|| field.parts().distance.clone()));
    }
    for &format in &sweep.composite_tables {
        let field = progress.bake(mesh, &BakeSettings::of_table(format, BoundsKind::Sphere))?;
        for distance in &beside {
            let parts = FieldParts { distance: distance.clone(), ..field.parts().clone() };
            measure(&VisibilityField::new(field.header().clone(), parts)?);
        }
    }
    Ok(points)
}

fn aims(representation: Representation) -> &'static [Aim] {
    if matches!(representation, Representation::TwoPoint { .. }) { &[Aim::Point, Aim::Plain] } else { &[Aim::Plain] }
}

/// Lookups are some ten times cheaper than the rays of a bake, and repeated.
fn work_per_point(rays: u64) -> u64 {
    rays
}

impl Sweep {
    /// In rays of a bake.
    fn work(&self, rays: u64) -> u64 {
        let of = |&representation: &Representation| {
            // The number of chords is the same in every encoding.
            let chords = TableFormat { representation, encoding: Encoding::F32 }.chords();
            chords + (self.encodings.len() * aims(representation).len()) as u64 * work_per_point(rays)
        };
        let cap_grid = |&format: &CapGridFormat| BakeSettings::of_cap_grid(format).rays() + work_per_point(rays);
        self.bounds.len() as u64 * self.representations.iter().map(of).sum::<u64>()
            + self.cap_grids.iter().map(cap_grid).sum::<u64>()
            + self.work_with_distances(rays)
    }

    fn work_with_distances(&self, rays: u64) -> u64 {
        let distances = |&format: &DistanceGridFormat| BakeSettings::of_distance(format).rays() + work_per_point(rays);
        let beside = self.distances.iter().filter(|format| format.voxels <= self.composite_voxels).count() as u64;
        let composite = |table: &TableFormat| table.chords() + beside * work_per_point(rays);
        self.distances.iter().map(distances).sum::<u64>() + self.composite_tables.iter().map(composite).sum::<u64>()
    }
}

struct Scenes {
    corner: Reference,
    own: Reference,
    /// What very many rays find, in the corner and on the mesh itself.
    corner_truth: Vec<f32>,
    own_truth: Vec<f32>,
}

/// The rays of both scenes.
struct Sets {
    corner: RaySet,
    own: RaySet,
}

impl Sets {
    fn aim(&mut self, aim: Aim) {
        let receivers = self.corner.receivers.iter_mut().chain(&mut self.own.receivers);
        receivers.for_each(|(_, options)| options.aim = aim);
    }
}

impl Scenes {
    fn ray_sets(&self, field: &VisibilityField) -> Sets {
        let [corner, own] = [&self.corner, &self.own].map(|scene| scene.ray_set(field, QueryOptions::default()));
        Sets { corner, own }
    }

    fn measure(&self, sets: &Sets, field: &VisibilityField, aim: Aim) -> TradeoffPoint {
        let is_blind = |table: &ChordTable| table.encoding() == Encoding::Bit && field.distance_field().is_none();
        let field_seconds = Reference::field_seconds(&sets.corner, field);
        let found = Reference::found(&sets.corner, field);
        TradeoffPoint {
            rays_per_second: Some(self.corner.rays() as f64 / field_seconds),
            corner: self.corner.error(&found),
            own_surface: (!field.table().is_some_and(is_blind))
                .then(|| self.own.error(&Reference::found(&sets.own, field))),
            ..self.point(Names::of_rays(field, aim), field_seconds, &found)
        }
    }

    fn measure_caps(&self, field: &VisibilityField, grid: &CapGrid) -> TradeoffPoint {
        let one_object = OneObject::new(field);
        let caps = one_object.caps();
        let own = caps.found(self.own.receivers());
        let found = caps.found(self.corner.receivers());
        let field_seconds = median_seconds(|| caps.found(self.corner.receivers()));
        TradeoffPoint {
            own_surface: Some(OcclusionError::of(&own, &self.own_truth)),
            ..self.point(Names::of_cap_grid(grid), field_seconds, &found)
        }
    }

    /// With errors against the truth.
    fn point(&self, names: Names, field_seconds: f64, found: &[f32]) -> TradeoffPoint {
        let corner = OcclusionError::of(found, &self.corner_truth);
        TradeoffPoint {
            representation: names.representation,
            size: names.size,
            encoding: names.encoding,
            bounds: names.bounds,
            aim: names.aim,
            field_bytes: names.bytes,
            field_seconds,
            rays_per_second: None,
            corner,
            mean_abs_truth: corner.mean_abs,
            own_surface: None,
            pareto: false,
        }
    }
}

fn mark_pareto(points: &mut [TradeoffPoint]) {
    let best: Vec<bool> = points.iter().map(|point| !points.iter().any(|other| other.beats(point))).collect();
    for (point, best) in points.iter_mut().zip(best) {
        point.pareto = best;
    }
}

/// What the columns mean for what sends no rays.
pub(crate) const FOOTNOTE: &str = "Tables and distances: RMS \u{d7} 255 and own surface against the same rays. Cap grids send none: all their errors are \
     against 4096 exact rays per receiver, and their time is that of all receivers. Mean error is against those 4096 for all, the noise of \
     few rays included. By it they can beat a cap grid; a cap grid beats none of them, since shadows and the mesh's own surface need rays.";

impl Tradeoff {
    /// The points from small to large, those on the Pareto front marked.
    pub fn table(&self) -> String {
        format!(
            "{}, {} triangles: {} rays of the corner, one thread; exact rays take {} s.\n{}\n\
             * nothing else is at least as good in error, size and time, and better in one of them.\n{FOOTNOTE}\n",
            self.mesh,
            count(self.triangles.into()),
            count(self.rays),
            seconds(self.exact_seconds),
            self.cells(false)
        )
    }

    /// The points from small to large: all, or only those of the Pareto front.
    pub(crate) fn cells(&self, only_front: bool) -> Cells {
        let mut points: Vec<&TradeoffPoint> = self.points.iter().filter(|p| p.pareto || !only_front).collect();
        points.sort_by_key(|point| point.field_bytes);
        let mut cells = Cells::new(&[
            "field",
            "size",
            "encoding",
            "bounds",
            "bytes",
            "RMS \u{d7} 255",
            "mean error",
            "own surface",
            "AO s",
            "M rays/s",
            "front",
        ]);
        for point in points {
            cells.row([
                point.family(),
                point.size.clone(),
                point.encoding.clone(),
                point.bounds.clone(),
                bytes(point.field_bytes),
                format!("{:.2}", point.corner.rms_255),
                format!("{:.4}", point.mean_abs_truth),
                point.own_surface.map_or("-".to_owned(), |error| format!("{:.2}", error.rms_255)),
                seconds(point.field_seconds),
                point.rays_per_second.map_or("-".to_owned(), |rate| format!("{:.1}", rate * 1e-6)),
                if point.pareto { "*" } else { "" }.to_owned(),
            ]);
        }
        cells
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(rms_255: f64, field_bytes: u64, field_seconds: f64) -> TradeoffPoint {
        TradeoffPoint {
            representation: String::new(),
            size: String::new(),
            encoding: String::new(),
            bounds: String::new(),
            aim: String::new(),
            field_bytes,
            field_seconds,
            rays_per_second: Some(1.0),
            corner: OcclusionError { rms_255, mean_abs: 0.0, bias_signed: 0.0 },
            mean_abs_truth: 0.0,
            own_surface: None,
            pareto: false,
        }
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        let mut points = [
            point(1.0, 100, 1.0),
            point(2.0, 50, 1.0),
            point(2.0, 100, 1.0),
            point(1.5, 100, 0.9),
            point(1.5, 100, 0.98),
            point(1.0, 100, 1.04),
        ];
        mark_pareto(&mut points);
        // The last two pairs differ by less than times can be trusted.
        assert_eq!(points.map(|point| point.pareto), [true, true, false, true, false, true]);
    }

    #[test]
    fn a_table_beats_a_cap_grid_by_the_truth_and_never_the_other_way() {
        let of = |mean_abs_truth, point| TradeoffPoint { mean_abs_truth, ..point };
        let caps = |mean_abs_truth, point| TradeoffPoint { rays_per_second: None, ..of(mean_abs_truth, point) };
        let mut points = [
            of(0.02, point(1.0, 100, 1.0)),
            of(0.01, point(2.0, 100, 1.0)),
            caps(0.005, point(0.5, 10, 0.01)),
            caps(0.015, point(0.5, 100, 1.0)),
            caps(0.006, point(0.4, 10, 0.01)),
        ];
        mark_pareto(&mut points);
        // The first table beats the second by its rays, the second table beats the second cap grid by the truth, and the first cap
        // grid beats the third by the truth.
        assert_eq!(points.map(|point| point.pareto), [true, false, true, false, false]);
    }

    #[test]
    fn encoding_again_is_like_baking_again() {
        let mesh = Mesh {
            name: String::new(),
            positions: vec![[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0]],
            indices: vec![[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]],
        };
        for representation in [two_point_of((9, 8)), hemisphere_of((50, 8))] {
            let bake = |encoding| {
                let settings = BakeSettings::of_table(TableFormat { representation, encoding }, BoundsKind::Sphere);
                crate::bake::bake(&mesh, &settings, |_| ()).unwrap().table().unwrap().clone()
            };
            for encoding in Encoding::ALL {
                assert!(
                    bake(Encoding::F32).with_encoding(encoding).unwrap() == bake(encoding),
                    "{representation} {encoding:?}"
                );
            }
        }
    }
}
