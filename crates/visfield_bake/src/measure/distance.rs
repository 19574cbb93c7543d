//! A distance grid's own numbers against exact ones: distances to the nearest triangle, negative inside.

use glam::{Vec2, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use visfield::distance::{BYTE_REACH, DistanceGrid, DistanceGridFormat, DistancePrecision, GRID_THRESHOLD};

use super::names::precision_name;
use super::progress::Progress;
use super::table::{Cells, bytes, count, seconds};
use crate::bake::{BakeError, BakeSettings};
use crate::distance::GridPoints;
use crate::distance::closest::Surface;
use crate::distance::winding::WindingNumbers;
use crate::mesh::Mesh;

/// What is measured.
///
/// ```
/// let ask = visfield_bake::measure::distance::DistanceQuestion::default();
/// assert_eq!((ask.format.voxels, ask.points), (64, 1_000_000));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct DistanceQuestion {
    /// How the mesh is baked.
    pub format: DistanceGridFormat,
    /// Number of points in the grid, and as many on the surface, at least 1.
    pub points: u32,
}

impl Default for DistanceQuestion {
    fn default() -> Self {
        Self { format: DistanceGridFormat::DEFAULT, points: 1_000_000 }
    }
}

/// What was found. All distances are in voxels.
///
/// ```
/// use visfield_bake::{Mesh, measure::distance::{DistanceQuestion, measure_distance}};
/// let mesh = Mesh {
///     name: "tetrahedron".to_owned(),
///     positions: vec![[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0]],
///     indices: vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]],
/// };
/// let question = DistanceQuestion { points: 1000, ..DistanceQuestion::default() };
/// let found = measure_distance(&mesh, &question, |_share, _doing| ())?;
/// assert!(found.surface.max_above <= found.excess && found.near.rms < 0.1);
/// # Ok::<(), visfield_bake::BakeError>(())
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct DistanceMeasurement {
    /// Name of the mesh.
    pub mesh: String,
    /// Its triangles.
    pub triangles: u32,
    /// Points along the longest axis.
    pub voxels: u32,
    /// Points along each axis.
    pub grid: [u32; 3],
    /// How each distance is stored: `u8` or `u16`.
    pub encoding: String,
    /// Side of a voxel, in mesh units.
    pub voxel: f32,
    /// Size in memory.
    pub field_bytes: u64,
    /// Seconds for the whole bake, on all threads.
    pub bake_seconds: f64,
    /// What the grid states: how far a distance may exceed the true one at the surface.
    pub excess: f64,
    /// Points so far from the surface that bytes do not tell how far. Their distances are not compared.
    pub clamped: u64,
    /// All other points of the grid.
    pub all: DistanceErrors,
    /// Those of them within a voxel of the surface.
    pub near: DistanceErrors,
    /// Points of the surface itself.
    pub surface: DistanceErrors,
    /// Share of the surface at which rays do not stop that cross it straight: on it, and half a voxel before and behind it, all
    /// distances are above that at which rays stop.
    pub surface_missed: f64,
}

/// What is wrong with the distances at some points, in voxels.
///
/// ```
/// use visfield_bake::measure::distance::DistanceErrors;
/// assert_eq!(DistanceErrors::default().points, 0);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DistanceErrors {
    /// Number of points.
    pub points: u64,
    /// Root of the mean square error.
    pub rms: f64,
    /// Largest absolute error.
    pub max_abs: f64,
    /// How far a distance exceeds the true one, at most; below 0 if none does.
    pub max_above: f64,
    /// Points at which it does by more than the grid's stated excess. That is stated for the surface; elsewhere, interpolation
    /// between points adds to it.
    pub above_excess: u64,
    /// Points on the wrong side of the surface.
    pub wrong_side: u64,
    /// True distance of the farthest of them from the surface.
    pub max_wrong_side: f64,
}

impl DistanceErrors {
    /// Adds a point, with the distance that was found and the true one.
    fn add(&mut self, found: f64, exact: f64, excess: f64) {
        let error = found - exact;
        self.max_above = if self.points == 0 { error } else { self.max_above.max(error) };
        self.points += 1;
        // A sum of squares until all are known.
        self.rms += error * error;
        self.max_abs = self.max_abs.max(error.abs());
        self.above_excess += u64::from(error > excess);
        if (found < 0.0) != (exact < 0.0) {
            self.wrong_side += 1;
            self.max_wrong_side = self.max_wrong_side.max(exact.abs());
        }
    }

    fn of(pairs: impl Iterator<Item = (f64, f64)>, excess: f64) -> Self {
        let mut errors = Self::default();
        pairs.for_each(|(found, exact)| errors.add(found, exact, excess));
        Self { rms: (errors.rms / errors.points.max(1) as f64).sqrt(), ..errors }
    }
}

/// Points that are asked for between two reports of progress.
const CHUNK: u32 = 1 << 14;

/// Bakes a mesh and measures its distances. `progress` gets the share of the work that is done, from 0 to 1, and what is being
/// done, from any thread.
///
/// # Errors
/// [`BakeError`] if the mesh or the format cannot be baked.
///
/// # Panics
/// Never: a bake of distances has distances.
pub fn measure_distance(
    mesh: &Mesh,
    question: &DistanceQuestion,
    progress: impl Fn(f64, &str) + Sync,
) -> Result<DistanceMeasurement, BakeError> {
    let settings = BakeSettings::of_distance(question.format);
    let points = question.points.max(1);
    let progress = Progress::new(settings.rays() + 2 * u64::from(points), &progress);
    let start = std::time::Instant::now();
    let field = progress.bake(mesh, &settings)?;
    let bake_seconds = start.elapsed().as_secs_f64();
    let grid = field.distance_field().and_then(|distance| distance.grid()).expect("it was baked");
    let header = grid.header();
    let excess = f64::from(header.excess);

    let triangles = mesh.solid_triangles().map_err(|source| BakeError::Mesh { name: mesh.name.clone(), source })?;
    let surface = Surface::new(&GridPoints::of(header).in_voxels(&triangles));
    let windings = WindingNumbers::new(&surface);
    let pair = |place: Vec3| {
        let inside = windings.at(place).abs() >= 0.5;
        let distance = f64::from(surface.distance(place));
        (f64::from(grid.distance(place)), if inside { -distance } else { distance })
    };
    let in_grid = |index| r3(index) * grid.last();
    let in_grid = in_parallel(points, &progress, "points of the grid", |index| pair(in_grid(index)));
    let on_surface = AreaSamples::new(surface.triangles());
    let on_surface = in_parallel(points, &progress, "points of the surface", |index| {
        let (place, normal) = on_surface.place(index, points);
        let across = [-0.5, -0.25, 0.0, 0.25, 0.5].map(|way| grid.distance(place + normal * way));
        ((f64::from(across[2]), 0.0), across.into_iter().all(|distance| distance > GRID_THRESHOLD))
    });
    let missed = on_surface.iter().filter(|(_, missed)| *missed).count();
    let on_surface = on_surface.into_iter().map(|(pair, _)| pair);

    let told = told_by_codes(grid);
    let compared = || in_grid.iter().copied().filter(|(_, exact)| told.contains(exact));
    let near = compared().filter(|(_, exact)| exact.abs() <= 1.0);
    Ok(DistanceMeasurement {
        mesh: mesh.name.clone(),
        triangles: field.header().triangles,
        voxels: header.format.voxels,
        grid: header.points,
        encoding: precision_name(header.format.precision).to_owned(),
        voxel: header.voxel,
        field_bytes: header.bytes(),
        bake_seconds,
        excess,
        clamped: u64::from(points) - compared().count() as u64,
        all: DistanceErrors::of(compared(), excess),
        near: DistanceErrors::of(near, excess),
        // Nothing is on either side of it.
        surface: DistanceErrors { wrong_side: 0, ..DistanceErrors::of(on_surface, excess) },
        surface_missed: missed as f64 / f64::from(points),
    })
}

/// Distances that are certainly told: of those beyond the reach of the codes, none is within a cell.
fn told_by_codes(grid: &DistanceGrid) -> std::ops::RangeInclusive<f64> {
    let header = grid.header();
    if header.format.precision == DistancePrecision::U16 {
        return f64::NEG_INFINITY..=f64::INFINITY;
    }
    let diagonal = 3.0_f64.sqrt();
    let (low, high) = (header.low, header.low + header.range);
    // A grid that holds nothing beyond the reach tells all that it holds.
    let told_low = if low > -BYTE_REACH.1 { f64::NEG_INFINITY } else { f64::from(low) + diagonal };
    let told_high = if high < BYTE_REACH.0 { f64::INFINITY } else { f64::from(high) - diagonal };
    told_low..=told_high
}

/// Answers for so many points, in their order.
fn in_parallel<T: Send>(points: u32, progress: &Progress, doing: &str, ask: impl Fn(u32) -> T + Sync) -> Vec<T> {
    let chunks: Vec<Vec<T>> = (0..points.div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let range = chunk * CHUNK..points.min((chunk + 1) * CHUNK);
            progress.add(range.len().try_into().unwrap_or_default(), doing);
            range.map(&ask).collect()
        })
        .collect();
    chunks.into_iter().flatten().collect()
}

/// Points of the unit cube, evenly spread (Roberts, *The Unreasonable Effectiveness of Quasirandom Sequences*, 2018).
fn r3(index: u32) -> Vec3 {
    // Powers of 1/φ₃, where φ₃⁴ = φ₃ + 1.
    let steps = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_2];
    Vec3::from(steps.map(|step: f64| (0.5 + step * f64::from(index)).fract() as f32))
}

/// Points spread over triangles by area.
struct AreaSamples<'a> {
    triangles: &'a [[Vec3; 3]],
    /// For each triangle the sum of the areas up to it, itself included.
    sums: Vec<f64>,
}

impl<'a> AreaSamples<'a> {
    fn new(triangles: &'a [[Vec3; 3]]) -> Self {
        let area = |[a, b, c]: &[Vec3; 3]| f64::from((b - a).cross(c - a).length());
        let mut sum = 0.0;
        let sums = triangles.iter().map(|triangle| {
            sum += area(triangle);
            sum
        });
        Self { triangles, sums: sums.collect() }
    }

    /// The point with this index of so many, and its triangle's normal.
    fn place(&self, index: u32, count: u32) -> (Vec3, Vec3) {
        let total = self.sums.last().copied().unwrap_or_default();
        let area = (f64::from(index) + 0.5) / f64::from(count) * total;
        let triangle = self.sums.partition_point(|sum| *sum < area).min(self.triangles.len() - 1);
        let [a, b, c] = self.triangles[triangle];
        let place = r3(index);
        let Vec2 { x, y } = Vec2::new(place.x, place.y);
        let (x, y) = if x + y > 1.0 { (1.0 - x, 1.0 - y) } else { (x, y) };
        (a + (b - a) * x + (c - a) * y, (b - a).cross(c - a).normalize_or_zero())
    }
}

impl DistanceMeasurement {
    /// What was measured, in words, and a row for each kind of points.
    pub fn table(&self) -> String {
        format!("{}\n{}\n", self.summary(), self.cells())
    }

    pub(crate) fn summary(&self) -> String {
        let [x, y, z] = self.grid;
        let share = |part: u64| 100.0 * part as f64 / (part + self.all.points).max(1) as f64;
        let clamped = match self.clamped {
            0 => String::new(),
            clamped => format!(
                " {} points ({:.1} %) are farther from the surface than bytes tell, and are left out.",
                count(clamped),
                share(clamped)
            ),
        };
        format!(
            "{}, {} triangles: {x} \u{d7} {y} \u{d7} {z} distances in {}, {}, baked in {} s. All errors are in voxels, of {} mesh \
             units each.{clamped} At the surface, no distance is more than {:.3} too large, as the grid states; elsewhere, \
             interpolation adds to it, and so does what became of holes. Rays that cross the surface straight miss {:.2} % of it.",
            self.mesh,
            count(self.triangles.into()),
            self.encoding,
            bytes(self.field_bytes),
            seconds(self.bake_seconds),
            self.voxel,
            self.excess,
            100.0 * self.surface_missed,
        )
    }

    pub(crate) fn cells(&self) -> Cells {
        let mut cells = Cells::new(&[
            "points",
            "number",
            "RMS",
            "largest error",
            "most too large",
            "beyond the excess",
            "wrong side",
            "farthest of them",
        ]);
        let rows = [("of the grid", &self.all), ("within a voxel", &self.near), ("of the surface", &self.surface)];
        for (name, errors) in rows {
            cells.row([
                name.to_owned(),
                count(errors.points),
                format!("{:.4}", errors.rms),
                format!("{:.3}", errors.max_abs),
                format!("{:+.3}", errors.max_above),
                count(errors.above_excess),
                count(errors.wrong_side),
                format!("{:.3}", errors.max_wrong_side),
            ]);
        }
        cells
    }
}
