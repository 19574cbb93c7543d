//! Which table entry stands for a ray, and where along the ray its fractions lie.

use glam::Vec3;

use super::chord::Chord;
use super::hemisphere::HemisphereGrid;
use super::octahedral::{octahedral_direction, octahedral_snap};

/// The chords that a table stores: `starts` × `chords_per_start` of them, row-major.
///
/// ```
/// use visfield::field::lookup::{ChordGrid, TwoPointGrid};
/// let grid = TwoPointGrid { entries: 65, exits: 32 };
/// assert_eq!((grid.starts(), grid.chords_per_start()), (65 * 65, 32 * 32));
/// ```
pub trait ChordGrid: Copy {
    /// Number of points on the unit sphere at which chords start.
    fn starts(&self) -> u32;
    /// Number of chords from each of them.
    fn chords_per_start(&self) -> u32;
    /// A start, as a unit vector.
    fn start(&self, cell: u32) -> Vec3;
    /// The start that stands for a point of the unit sphere, and where it is.
    fn snap_start(&self, point: Vec3) -> (u32, Vec3);
    /// Where a chord ends, as a unit vector; `None` if the grid does not use it.
    fn end(&self, start: Vec3, cell: u32) -> Option<Vec3>;
    /// The chord that stands for the one from `start`, as [`start`](Self::start) gave it, to `end` on the unit sphere, and
    /// where it ends.
    fn snap_end(&self, start: Vec3, end: Vec3) -> (u32, Vec3);
    /// The side of a square grid on the sphere with cells as wide as those of the ends.
    fn exit_side(&self) -> u32;
    /// Where a [plain](Aim::Plain) lookup of the chord from `start` to `end` ends, snapped to `snapped` at its start: `end`
    /// itself, or shifted in parallel.
    fn plain_end(&self, start: Vec3, end: Vec3, snapped: Vec3) -> Vec3;
}

/// The sides of a two-point table's octahedral grids: `entries`² × `exits`² cells.
///
/// ```
/// use visfield::field::lookup::{TwoPointGrid, table_index};
/// let grid = TwoPointGrid { entries: 65, exits: 32 };
/// assert_eq!(table_index(&grid, 2, 5), 2 * 32 * 32 + 5);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TwoPointGrid {
    /// Side of the grid of chord entries.
    pub entries: u32,
    /// Side of the grid of chord exits.
    pub exits: u32,
}

impl ChordGrid for TwoPointGrid {
    #[inline(always)]
    fn starts(&self) -> u32 {
        self.entries * self.entries
    }

    #[inline(always)]
    fn chords_per_start(&self) -> u32 {
        self.exits * self.exits
    }

    #[inline(always)]
    fn start(&self, cell: u32) -> Vec3 {
        octahedral_direction(cell, self.entries)
    }

    #[inline(always)]
    fn snap_start(&self, point: Vec3) -> (u32, Vec3) {
        octahedral_snap(point, self.entries)
    }

    #[inline(always)]
    fn end(&self, _start: Vec3, cell: u32) -> Option<Vec3> {
        Some(octahedral_direction(cell, self.exits))
    }

    #[inline(always)]
    fn snap_end(&self, _start: Vec3, end: Vec3) -> (u32, Vec3) {
        octahedral_snap(end, self.exits)
    }

    #[inline(always)]
    fn exit_side(&self) -> u32 {
        self.exits
    }

    #[inline(always)]
    fn plain_end(&self, _start: Vec3, end: Vec3, _snapped: Vec3) -> Vec3 {
        end
    }
}

/// The grid of any representation.
///
/// ```
/// use visfield::field::lookup::{ChordGrid, Grid};
/// # let field = visfield::field::example_field();
/// let grid = field.table().unwrap().grid();
/// assert!(matches!(grid, Grid::TwoPoint(two_point) if two_point.entries * two_point.entries == grid.starts()));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grid {
    /// Octahedral cells at both ends.
    TwoPoint(TwoPointGrid),
    /// The papers' positions and directions.
    Hemisphere(HemisphereGrid),
}

/// Calls a method of whichever grid it is.
macro_rules! each_grid {
    ($grid:expr, $name:ident => $call:expr) => {
        match $grid {
            Grid::TwoPoint($name) => $call,
            Grid::Hemisphere($name) => $call,
        }
    };
}

impl ChordGrid for Grid {
    fn starts(&self) -> u32 {
        each_grid!(self, grid => grid.starts())
    }

    fn chords_per_start(&self) -> u32 {
        each_grid!(self, grid => grid.chords_per_start())
    }

    fn start(&self, cell: u32) -> Vec3 {
        each_grid!(self, grid => grid.start(cell))
    }

    fn snap_start(&self, point: Vec3) -> (u32, Vec3) {
        each_grid!(self, grid => grid.snap_start(point))
    }

    fn end(&self, start: Vec3, cell: u32) -> Option<Vec3> {
        each_grid!(self, grid => grid.end(start, cell))
    }

    fn snap_end(&self, start: Vec3, end: Vec3) -> (u32, Vec3) {
        each_grid!(self, grid => grid.snap_end(start, end))
    }

    fn exit_side(&self) -> u32 {
        each_grid!(self, grid => grid.exit_side())
    }

    fn plain_end(&self, start: Vec3, end: Vec3, snapped: Vec3) -> Vec3 {
        each_grid!(self, grid => grid.plain_end(start, end, snapped))
    }
}

/// How a lookup snaps a ray to a chord of the table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Aim {
    /// Each end is snapped to its cell by itself: the papers' lookup. Faster, less accurate.
    Plain,
    /// The snapped chord is made to pass through a point of the true ray (DESIGN §4, *aimed lookup*).
    #[default]
    Point,
}

/// One table entry, and the line it is read along: a hit at fraction `s` lies `s · length − before` past the aim point.
///
/// Lengths are in field space (bounding radii).
///
/// ```
/// use glam::vec3;
/// use visfield::field::{chord::chord, lookup::{Aim, TwoPointGrid, forward_lookup}};
/// let direction = vec3(1.0, 0.0, 0.0);
/// let c = chord(vec3(-3.0, 0.0, 0.0), direction).unwrap();
/// let lookup = forward_lookup(&TwoPointGrid { entries: 65, exits: 32 }, direction, &c, Aim::Point);
/// assert!((lookup.before - 1.0).abs() < 0.05 && (lookup.length - 2.0).abs() < 0.05);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lookup {
    /// Position in the table.
    pub index: u32,
    /// Distance from the start of the stored chord to the aim point.
    pub before: f32,
    /// Length of the stored chord.
    pub length: f32,
    /// Where the stored chord starts, as a unit vector.
    pub start: Vec3,
    /// Where the stored chord ends, as a unit vector.
    pub end: Vec3,
}

impl Lookup {
    /// The point at a fraction of the chord that the table position stands for, from cell centre to cell centre.
    #[inline(always)]
    pub fn point_on_chord(&self, fraction: f32) -> Vec3 {
        self.start + (self.end - self.start) * fraction
    }
}

/// The lookup of the chord from `start` to `end`, both on the unit sphere; `aim` is a point of it.
#[inline(always)]
pub fn lookup<G: ChordGrid>(grid: &G, start: Vec3, end: Vec3, aim: Vec3, how: Aim) -> Lookup {
    match how {
        Aim::Plain => plain_lookup(grid, start, end, aim),
        Aim::Point => aimed_lookup(grid, start, end, aim),
    }
}

/// Aims at `aim`, a point of the true ray, from the centre of the cell that contains `start`.
///
/// The snapped start is not on the true ray, so keeping the true exit would shift the whole chord sideways. The papers
/// keep the *direction* instead, a parallel shift; shooting through a point of the ray leaves no error there at all (DESIGN
/// §4, *aimed lookup*). `end` is the true far end of the chord: it serves grazing rays, whose aimed chord would leave the
/// sphere at once.
#[inline(always)]
pub fn aimed_lookup<G: ChordGrid>(grid: &G, start: Vec3, end: Vec3, aim: Vec3) -> Lookup {
    let (entry, center) = grid.snap_start(start);
    let to_aim = aim - center;
    let inward = -center.dot(to_aim);
    let squared = to_aim.dot(to_aim);
    // Both cases are computed and one is chosen, so that many rays can be looked up at once.
    let aimed = inward > GRAZING * squared.sqrt();
    let stretch = 2.0 * inward / squared;
    let far_end = if aimed { center + to_aim * stretch } else { end };
    let before = if aimed { squared.sqrt() } else { (aim - start).length() };
    let length = if aimed { stretch * before } else { (end - start).length() };
    let (exit, end) = grid.snap_end(center, far_end);
    Lookup { index: table_index(grid, entry, exit), before, length, start: center, end }
}

/// The papers' lookup (2008, §3.2 *Displacement Field Indexing*): both ends snapped by themselves. Fractions count along
/// the true chord, or along its parallel for the papers' own grid, which keeps the direction.
#[inline(always)]
pub fn plain_lookup<G: ChordGrid>(grid: &G, start: Vec3, end: Vec3, aim: Vec3) -> Lookup {
    let (entry, center) = grid.snap_start(start);
    let far_end = grid.plain_end(start, end, center);
    let shift = far_end - end;
    let shifted_start = if shift == Vec3::ZERO { start } else { center };
    let (before, length) = ((aim - start).length(), (far_end - shifted_start).length());
    let (exit, end) = grid.snap_end(center, far_end);
    Lookup { index: table_index(grid, entry, exit), before, length, start: center, end }
}

/// Sine of the angle to the sphere's surface below which an aimed chord counts as grazing.
pub(crate) const GRAZING: f32 = 1.0e-3;

/// The lookup for the first hit of a ray that starts outside the sphere: aimed at the chord's middle.
#[inline(always)]
pub fn forward_lookup<G: ChordGrid>(grid: &G, direction: Vec3, chord: &Chord, how: Aim) -> Lookup {
    let half = direction * chord.t_half;
    lookup(grid, chord.middle - half, chord.middle + half, chord.middle, how)
}

/// The lookup for the last hit of a ray that starts inside the sphere: the reversed ray, aimed at the origin.
#[inline(always)]
pub fn reversed_lookup<G: ChordGrid>(grid: &G, origin: Vec3, direction: Vec3, chord: &Chord, how: Aim) -> Lookup {
    let half = direction * chord.t_half;
    lookup(grid, chord.middle + half, chord.middle - half, origin, how)
}

/// Position of a chord in the table.
#[inline(always)]
pub fn table_index<G: ChordGrid>(grid: &G, entry: u32, exit: u32) -> u32 {
    entry * grid.chords_per_start() + exit
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::chord::chord;
    use crate::field::directions::DirectionMap;
    use glam::vec3;

    const GRID: TwoPointGrid = TwoPointGrid { entries: 65, exits: 32 };

    fn grids() -> [Grid; 2] {
        let hemisphere = HemisphereGrid::new(4226, 32, DirectionMap::default()).unwrap();
        [Grid::TwoPoint(GRID), Grid::Hemisphere(hemisphere)]
    }

    #[test]
    fn the_aimed_chord_passes_through_the_aim_point() {
        let (origin, direction) = (vec3(-2.0, 0.3, 0.1), vec3(1.0, 0.05, -0.2));
        let c = chord(origin, direction).unwrap();
        for grid in grids() {
            let lookup = forward_lookup(&grid, direction, &c, Aim::Point);
            let start = grid.start(lookup.index / (32 * 32));
            assert_eq!(start, lookup.start);
            let along = (c.middle - start).normalize();
            assert!((start + along * lookup.before).distance(c.middle) < 1e-6);
            assert!(((start + along * lookup.length).length() - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn plain_lookups_keep_what_their_grid_keeps() {
        let (origin, direction) = (vec3(-2.0, 0.3, 0.1), vec3(1.0, 0.05, -0.2));
        let c = chord(origin, direction).unwrap();
        let end = c.middle + direction * c.t_half;
        for grid in grids() {
            let lookup = forward_lookup(&grid, direction, &c, Aim::Plain);
            let start = grid.start(lookup.index / (32 * 32));
            let stored_end = grid.end(start, lookup.index % (32 * 32)).unwrap();
            assert_eq!(stored_end, lookup.point_on_chord(1.0));
            match grid {
                Grid::TwoPoint(_) => assert!(stored_end.distance(end) < 0.1, "the far end"),
                Grid::Hemisphere(_) => {
                    let angle = (stored_end - start).angle_between(direction);
                    assert!(angle < 0.05, "the direction: {angle}");
                }
            }
        }
    }

    #[test]
    fn grazing_rays_stay_in_the_table() {
        for (grid, how) in grids().into_iter().flat_map(|grid| [(grid, Aim::Point), (grid, Aim::Plain)]) {
            for i in 0..1000 {
                let height = 0.99 + 0.01 * (i as f32 / 1000.0);
                let direction = vec3(1.0, 0.0, 0.0);
                if let Some(c) = chord(vec3(-2.0, height, 0.0), direction) {
                    let lookup = forward_lookup(&grid, direction, &c, how);
                    assert!(lookup.index < grid.starts() * grid.chords_per_start());
                    assert!(lookup.before.is_finite() && lookup.length.is_finite());
                }
            }
        }
    }
}
