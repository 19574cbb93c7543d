//! How far above 0 a finished grid is at the surface, at most: not at samples, but anywhere.

use glam::Vec3;
use rayon::prelude::*;
use visfield::distance::DistanceGrid;

/// By how much the bound may exceed the largest value that was found, in voxels.
const TOLERANCE: f32 = 0.02;
/// Parts of triangles whose corners are this near to their centre, in voxels, are not divided further.
const SMALLEST: f32 = 0.005;
/// Larger parts are divided before they are looked at: they would meet too many cells.
const LARGEST: f32 = 0.75;
/// Triangles that share what they have found; as many for any number of threads.
const CHUNK: usize = 1024;

/// An upper bound of the grid's interpolation over all points of all triangles, which are in voxels from its first point; 0 if it is
/// below that everywhere.
///
/// Branch and bound: over a part of a triangle, the value is at most that at its centre, and what the steepest way from there
/// to its farthest corner adds. Only ways along the triangle count: of a flat surface, they are hardly steep at all.
pub(super) fn largest_at_surface(grid: &DistanceGrid, triangles: &[[Vec3; 3]]) -> f32 {
    let at_centers = triangles.par_iter().map(|&triangle| grid.distance(center(triangle)));
    let largest = at_centers.reduce(|| 0.0, f32::max);
    let bounds = triangles.par_chunks(CHUNK).map(|triangles| {
        let mut search = Search { grid, largest, bound: largest, pending: Vec::new() };
        for triangle in triangles {
            search.add(*triangle);
        }
        search.bound
    });
    bounds.reduce(|| largest, f32::max)
}

fn center([a, b, c]: [Vec3; 3]) -> Vec3 {
    (a + b + c) / 3.0
}

struct Search<'a> {
    grid: &'a DistanceGrid,
    /// The largest value so far, and what no value exceeds so far.
    largest: f32,
    bound: f32,
    pending: Vec<[Vec3; 3]>,
}

impl Search<'_> {
    fn add(&mut self, triangle: [Vec3; 3]) {
        let [a, b, c] = triangle;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        self.pending.push(triangle);
        while let Some(part) = self.pending.pop() {
            let center = center(part);
            let radius = part.iter().map(|corner| corner.distance(center)).fold(0.0, f32::max);
            if radius <= LARGEST {
                let value = self.grid.distance(center);
                self.largest = self.largest.max(value);
                let upper = value + radius * self.steepest(part, normal);
                if upper <= self.largest + TOLERANCE || radius <= SMALLEST {
                    self.bound = self.bound.max(upper);
                    continue;
                }
            }
            self.pending.extend(halves(part));
        }
    }

    /// Largest slope along the plane with this normal, in all cells that a small part of a triangle may meet. In a cell, the gradient
    /// is interpolated between those at its corners, and so steepest at one of them.
    fn steepest(&self, part: [Vec3; 3], normal: Vec3) -> f32 {
        let last_cell = self.grid.last() - 1.0;
        let cell = |place: Vec3| place.floor().clamp(Vec3::ZERO, last_cell);
        let [low, high] = [part[0].min(part[1]).min(part[2]), part[0].max(part[1]).max(part[2])].map(cell);
        let mut steepest = 0.0_f32;
        let cells = (high - low).to_array().map(|cells| 0..=cells as u32);
        let [across, up, deep] = cells;
        for z in deep {
            for y in up.clone() {
                for x in across.clone() {
                    let first = low + Vec3::new(x as f32, y as f32, z as f32);
                    let value = |i: usize| self.grid.distance(first + corner(i));
                    let values: [f32; 8] = std::array::from_fn(value);
                    for i in 0..8 {
                        let along = |bit: usize| values[i | bit] - values[i & !bit];
                        let gradient = Vec3::new(along(1), along(2), along(4));
                        steepest = steepest.max((gradient - normal * gradient.dot(normal)).length_squared());
                    }
                }
            }
        }
        steepest.sqrt()
    }
}

/// A corner of a cell, x fastest.
fn corner(index: usize) -> Vec3 {
    Vec3::from([index & 1, index >> 1 & 1, index >> 2].map(|bit| bit as f32))
}

/// Both sides of the middle of the longest edge.
fn halves([a, b, c]: [Vec3; 3]) -> [[Vec3; 3]; 2] {
    let edges = [[a, b, c], [b, c, a], [c, a, b]];
    let length = |[start, end, _]: &[Vec3; 3]| start.distance_squared(*end);
    let [start, end, apex] = edges.into_iter().max_by(|x, y| length(x).total_cmp(&length(y))).unwrap_or(edges[0]);
    let middle = (start + end) * 0.5;
    [[start, middle, apex], [middle, end, apex]]
}
