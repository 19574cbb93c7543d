//! What accuracy costs: many fields of one mesh, their errors, sizes and speeds, and which of them nothing beats.

use serde::{Deserialize, Serialize};
use visfield::field::directions::DirectionMap;
use visfield::field::lookup::Aim;
use visfield::{Encoding, QueryOptions, Representation, TableFormat, VisibilityField};

use super::ambient::{aim_name, bounds_name};
use super::progress::Progress;
use super::reference::{OcclusionError, Reference};
use super::scene::MeasureScene;
use super::speed::RaySet;
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
    /// What surrounds the mesh.
    pub bounds: Vec<BoundsKind>,
    /// Rays per receiver.
    pub rays: u32,
}

impl Default for Sweep {
    /// Tables from 74 kB to 17 MB in bytes, in all encodings and bounds.
    fn default() -> Self {
        let two_point = [(17, 16), (17, 32), (33, 32), (33, 64), (65, 32), (65, 64)];
        let hemisphere = [(290, 16), (290, 32), (1090, 32), (1090, 64), (4226, 32), (4226, 64)];
        Self {
            representations: two_point.map(two_point_of).into_iter().chain(hemisphere.map(hemisphere_of)).collect(),
            encodings: Encoding::ALL.to_vec(),
            bounds: vec![BoundsKind::Sphere, BoundsKind::Ellipsoid],
            rays: 256,
        }
    }
}

impl Sweep {
    /// A few small tables.
    pub fn quick() -> Self {
        Self {
            representations: vec![two_point_of((17, 16)), two_point_of((33, 16)), hemisphere_of((290, 16))],
            encodings: vec![Encoding::Bit, Encoding::U8],
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

/// One field, and one way to ask it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TradeoffPoint {
    /// `two-point` or `hemisphere`.
    pub representation: String,
    /// The numbers of the representation, as 65² × 32².
    pub size: String,
    /// How the table is encoded.
    pub encoding: Encoding,
    /// `sphere` or `ellipsoid`.
    pub bounds: String,
    /// `point` or `plain`.
    pub aim: String,
    /// Size of the table in memory.
    pub field_bytes: u64,
    /// Seconds of one thread for all rays of the corner.
    pub field_seconds: f64,
    /// The same as rays per second, those included that pass the bounds by.
    pub rays_per_second: f64,
    /// Error in the corner.
    pub corner: OcclusionError,
    /// Error on the mesh's own surface; bits, which know no distances, have none.
    pub own_surface: Option<OcclusionError>,
    /// Whether no other point is at least as good in error (in the corner), size and time, and better in one.
    pub pareto: bool,
}

/// Times that differ by less count as equal: they are measured.
const TIME_TOLERANCE: f64 = 1.05;

impl TradeoffPoint {
    /// What a table's curves are told apart by: its representation, and how it is asked.
    pub fn family(&self) -> String {
        let aim = if self.aim == "point" { "aimed" } else { &self.aim };
        format!("{}, {aim}", self.representation)
    }

    fn beats(&self, other: &Self) -> bool {
        let [mine, others] = [self, other].map(|p| (p.corner.rms_255, p.field_bytes));
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
    let scenes = Scenes { corner, own };
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
                    points.push(scenes.measure(sets, &field, TableFormat { encoding, ..format }, aim));
                    progress.add(work_per_point(scenes.corner.rays()), &format!("asking {representation}"));
                }
            }
        }
    }
    mark_pareto(&mut points);
    Ok(Tradeoff { mesh: mesh.name.clone(), triangles, rays: scenes.corner.rays(), exact_seconds, points })
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
        self.bounds.len() as u64 * self.representations.iter().map(of).sum::<u64>()
    }
}

struct Scenes {
    corner: Reference,
    own: Reference,
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

    fn measure(&self, sets: &Sets, field: &VisibilityField, format: TableFormat, aim: Aim) -> TradeoffPoint {
        let field_seconds = Reference::field_seconds(&sets.corner, field);
        TradeoffPoint {
            representation: format.representation.name().to_owned(),
            size: format.representation.to_string(),
            encoding: format.encoding,
            bounds: bounds_name(&field.header().bounds).to_owned(),
            aim: aim_name(aim).to_owned(),
            field_bytes: format.bytes(),
            field_seconds,
            rays_per_second: self.corner.rays() as f64 / field_seconds,
            corner: self.corner.error(&Reference::found(&sets.corner, field)),
            own_surface: (format.encoding != Encoding::Bit)
                .then(|| self.own.error(&Reference::found(&sets.own, field))),
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

impl Tradeoff {
    /// The points from small to large, those on the Pareto front marked.
    pub fn table(&self) -> String {
        format!(
            "{}, {} triangles: {} rays of the corner, one thread; exact rays take {} s.\n{}\n\
             * nothing else is at least as good in error, size and time, and better in one of them.\n",
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
            "table",
            "size",
            "encoding",
            "bounds",
            "bytes",
            "RMS \u{d7} 255",
            "own surface",
            "AO s",
            "M rays/s",
            "front",
        ]);
        for point in points {
            cells.row([
                point.family(),
                point.size.clone(),
                point.encoding.name().to_owned(),
                point.bounds.clone(),
                bytes(point.field_bytes),
                format!("{:.2}", point.corner.rms_255),
                point.own_surface.map_or("-".to_owned(), |error| format!("{:.2}", error.rms_255)),
                seconds(point.field_seconds),
                format!("{:.1}", point.rays_per_second * 1e-6),
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
            encoding: Encoding::U8,
            bounds: String::new(),
            aim: String::new(),
            field_bytes,
            field_seconds,
            rays_per_second: 0.0,
            corner: OcclusionError { rms_255, mean_abs: 0.0, bias_signed: 0.0 },
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
