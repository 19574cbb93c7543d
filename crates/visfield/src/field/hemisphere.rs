//! The papers' own grid: positions on the sphere, and for each a map of the directions inwards (2008, §3; 2010, §3.1).

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::MAX_SIDE;
use super::directions::DirectionMap;
use super::lookup::{ChordGrid, GRAZING};

/// Positions × directions of a hemisphere table.
///
/// Positions lie in rings: the pole of each hemisphere, then 4k points in ring k, so that n rings make 2n² + 2n + 1 of them
/// and both hemispheres together (2n + 1)² + 1. These are the vertices of an octahedron whose faces were cut into n rows,
/// the triangle subdivision of Slater, *Constant Time Queries on Uniformly Distributed Points on a Hemisphere* (2002), for
/// any n and not only powers of two. Two deviations: the rings are spaced for equal areas, and the nearest position is found
/// in closed form, where Slater draws the hemisphere into a frame buffer and reads a colour.
///
/// ```
/// use visfield::field::hemisphere::HemisphereGrid;
/// let grid = HemisphereGrid::new(4226, 32, Default::default()).unwrap();
/// let position = grid.position(1000);
/// assert_eq!(grid.nearest_position(position), 1000);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HemisphereGrid {
    rings: u32,
    directions: u32,
    map: DirectionMap,
}

impl HemisphereGrid {
    /// The papers' numbers of positions: 8, 16, 32 and 64 rings.
    pub const POSITIONS: [u32; 4] = [290, 1090, 4226, 16642];

    /// A grid of `positions` × `directions`² chords, with 1 to [`MAX_SIDE`] directions a side, or `None` if no number of rings
    /// makes `positions` or the directions are out of range.
    pub fn new(positions: u32, directions: u32, map: DirectionMap) -> Option<Self> {
        let rings = positions.checked_sub(1)?.isqrt().checked_sub(1)? / 2;
        (rings > 0 && (2 * rings + 1).pow(2) + 1 == positions && (1..=MAX_SIDE).contains(&directions)).then_some(Self {
            rings,
            directions,
            map,
        })
    }

    fn hemisphere_positions(self) -> u32 {
        2 * self.rings * (self.rings + 1) + 1
    }

    /// A position as a unit vector. The upper hemisphere comes first, from its pole to the equator, which both hemispheres
    /// have.
    pub fn position(self, cell: u32) -> Vec3 {
        let within = cell % self.hemisphere_positions();
        // The ring is the last one that starts at or before the cell; ring k starts at 1 + 2k(k − 1).
        let ring = if within == 0 { 0 } else { u32::midpoint((2 * within - 1).isqrt(), 1) };
        let height = 1.0 - (ring as f32 / self.rings as f32).powi(2);
        let turn = if ring == 0 { 0.0 } else { (within - ring_start(ring)) as f32 / (4 * ring) as f32 };
        let disc = Vec2::from_angle(turn * TAU) * (1.0 - height * height).sqrt();
        disc.extend(if within == cell { height } else { -height })
    }

    /// The position that stands for a unit vector: the nearest in its nearest ring. Constant time.
    ///
    /// Any other vector, NaN included, gives some valid position.
    #[inline]
    pub fn nearest_position(self, point: Vec3) -> u32 {
        let ring = (((1.0 - point.z.abs()).max(0.0).sqrt() * self.rings as f32).round() as u32).min(self.rings);
        let around = 4 * ring;
        let turn = point.y.atan2(point.x) / TAU;
        let step = ((if turn < 0.0 { turn + 1.0 } else { turn }) * around as f32).round() as u32;
        let within = if ring == 0 { 0 } else { ring_start(ring) + step % around };
        if point.z < 0.0 { self.hemisphere_positions() + within } else { within }
    }
}

fn ring_start(ring: u32) -> u32 {
    1 + 2 * ring * (ring - 1)
}

/// The coordinates of `direction` in the frame whose z axis points inwards from `position`.
#[inline]
fn inward_coordinates(position: Vec3, direction: Vec3) -> Vec3 {
    let (tangent, bitangent) = position.any_orthonormal_pair();
    Vec3::new(tangent.dot(direction), bitangent.dot(direction), -position.dot(direction))
}

impl ChordGrid for HemisphereGrid {
    fn starts(&self) -> u32 {
        2 * self.hemisphere_positions()
    }

    fn chords_per_start(&self) -> u32 {
        self.directions * self.directions
    }

    fn start(&self, cell: u32) -> Vec3 {
        self.position(cell)
    }

    fn snap_start(&self, point: Vec3) -> (u32, Vec3) {
        let cell = self.nearest_position(point);
        (cell, self.position(cell))
    }

    fn end(&self, start: Vec3, cell: u32) -> Option<Vec3> {
        let local = self.map.direction(cell, self.directions)?;
        let (tangent, bitangent) = start.any_orthonormal_pair();
        let direction = tangent * local.x + bitangent * local.y - start * local.z;
        Some(start + direction * (2.0 * local.z))
    }

    fn snap_end(&self, start: Vec3, end: Vec3) -> (u32, Vec3) {
        let cell = self.map.cell(inward_coordinates(start, (end - start).normalize_or_zero()), self.directions);
        (cell, self.end(start, cell).unwrap_or(start))
    }

    fn exit_side(&self) -> u32 {
        self.directions
    }

    fn plain_end(&self, start: Vec3, end: Vec3, snapped: Vec3) -> Vec3 {
        let along = (end - start).normalize_or_zero();
        let inward = -snapped.dot(along);
        // A direction that leaves the hemisphere of the snapped position keeps the far end instead.
        if inward > GRAZING { snapped + along * (2.0 * inward) } else { end }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_numbers_of_positions() {
        for (rings, positions) in [8, 16, 32, 64].into_iter().zip(HemisphereGrid::POSITIONS) {
            assert_eq!(HemisphereGrid::new(positions, 32, DirectionMap::Concentric).unwrap().rings, rings);
        }
        for positions in [0, 1, 2, 289, 291, 1122, u32::MAX] {
            assert_eq!(HemisphereGrid::new(positions, 32, DirectionMap::Concentric), None, "{positions}");
        }
    }

    #[test]
    fn every_position_is_its_own_nearest() {
        for positions in HemisphereGrid::POSITIONS {
            let grid = HemisphereGrid::new(positions, 1, DirectionMap::Concentric).unwrap();
            for cell in 0..positions {
                let position = grid.position(cell);
                let nearest = grid.nearest_position(position);
                // The equator belongs to both hemispheres.
                let same = grid.position(nearest).distance(position) < 1e-6;
                assert!(nearest == cell || (same && position.z.abs() < 1e-6), "{cell} and {nearest} of {positions}");
            }
        }
    }

    #[test]
    fn positions_cover_the_sphere_evenly() {
        let grid = HemisphereGrid::new(4226, 1, DirectionMap::Concentric).unwrap();
        let points = crate::estimate::sampling::sphere_samples(50_000);
        // The nearest by search is at most a little nearer than the one found at once.
        let positions: Vec<Vec3> = (0..4226).map(|cell| grid.position(cell)).collect();
        for point in points.iter().step_by(97) {
            let found = grid.position(grid.nearest_position(*point)).distance(*point);
            let nearest = positions.iter().map(|p| p.distance(*point)).fold(f32::INFINITY, f32::min);
            assert!(found < 0.06 && found < nearest + 0.018, "{point}: {found}, nearest {nearest}");
        }
    }

    #[test]
    fn chords_end_where_their_cells_say() {
        let grid = HemisphereGrid::new(290, 16, DirectionMap::Concentric).unwrap();
        for start_cell in [0, 7, 144, 145, 289] {
            let start = grid.start(start_cell);
            for cell in 0..256 {
                let end = grid.end(start, cell).unwrap();
                assert!((end.length() - 1.0).abs() < 1e-5);
                assert_eq!(grid.snap_end(start, end), (cell, end));
            }
        }
    }
}
