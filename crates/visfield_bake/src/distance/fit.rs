//! Makes the interpolation between grid points meet the surface.

use glam::{DVec3, Vec3, Vec3A};
use rayon::prelude::*;

use super::GridPoints;

/// What [`fit_to_surface`] changed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Lowered {
    /// Points of the surface that were looked at.
    pub(crate) samples: u64,
    /// Samples whose value was above the bound.
    pub(crate) above: u64,
    /// Grid points whose value was lowered.
    pub(crate) points: u64,
    /// Mean of what they were lowered by, in voxels.
    pub(crate) mean: f32,
    /// The most that one of them was lowered by, in voxels.
    pub(crate) max: f32,
}

/// Distance between the rows of samples on a triangle, and between the samples of a row, in voxels. From any point of the
/// triangle a row is at most one such distance down, and a sample of it at most half the other away: √(0.16² + 0.12²) = 0.2
/// voxels.
const ROWS: f32 = 0.16;
const ALONG: f32 = 0.24;
/// Triangles whose corners are all this near to their centre, in voxels, have one sample: there.
const TINY: f32 = 0.2;
/// About the most samples. Beyond them, they are farther apart.
const MOST_SAMPLES: f64 = 16.0e6;
/// Sweeps over the samples that are above the bound, before the one that makes sure.
const SWEEPS: usize = 8;

/// How far above 0 the interpolation may be at the surface, in voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FitBounds {
    /// Where nothing behind the surface is inside: rays meet nothing else.
    pub(crate) sheet: f32,
    /// Where the inside is behind it, which rays meet even if they miss the surface.
    pub(crate) solid: f32,
}

/// Value half a voxel off the surface below which the inside is there.
const SOLID: f32 = -0.25;

/// Lowers grid values, in voxels, until their trilinear interpolation is within the bounds at every sample of the surface; no point of
/// the surface is farther than 0.2 voxels from a sample.
///
/// Exact distances do not do that: what is thinner than a voxel has no grid points inside, and between two points half a voxel
/// away on either side, the interpolation never falls below a half. Whoever walks along a ray by these distances passes
/// through unseen. Values are only lowered, so that they never exceed the distance, and as little as possible in the sense of least
/// squares (the method is Hildreth's, *A Quadratic Programming Procedure*, 1957: Kaczmarz' projections that may be
/// taken back in part). Thin sheets become up to about a voxel thick.
pub(crate) fn fit_to_surface(
    values: &mut [f32],
    grid: &GridPoints,
    triangles: &[[DVec3; 3]],
    bounds: FitBounds,
) -> Lowered {
    let triangles = grid.in_voxels(triangles);
    let sampling = Sampling::new(&triangles);
    let (samples, mut above) = above_bound(values, grid.points, &triangles, &sampling, bounds);
    let before = values.to_vec();
    for sweep in 0..=SWEEPS {
        // Nothing is taken back in the end.
        let last = sweep == SWEEPS;
        for sample in &mut above {
            let Cell { indices, weights } = sample.cell;
            let value: f32 = indices.iter().zip(weights).map(|(&i, weight)| values[i as usize] * weight).sum();
            let squares: f32 = weights.iter().map(|weight| weight * weight).sum();
            let least = if last { 0.0 } else { -sample.push };
            let push = ((value - sample.bound) / squares).max(least);
            sample.push += push;
            for (&i, weight) in indices.iter().zip(weights) {
                values[i as usize] -= push * weight;
            }
        }
    }
    let mut lowered = Lowered { samples, above: above.len() as u64, ..Lowered::default() };
    for (value, before) in values.iter_mut().zip(before) {
        // What was pushed and taken back may be off by its rounding.
        *value = value.min(before);
        if *value < before {
            lowered.points += 1;
            lowered.mean += before - *value;
            lowered.max = lowered.max.max(before - *value);
        }
    }
    lowered.mean /= lowered.points.max(1) as f32;
    lowered
}

/// The points that a value between them is interpolated from.
#[derive(Clone, Copy)]
pub(super) struct Cell {
    pub(super) indices: [u32; 8],
    pub(super) weights: [f32; 8],
}

impl Cell {
    /// `None` outside the grid.
    pub(super) fn around(points: [u32; 3], place: Vec3) -> Option<Self> {
        let mut low = [0; 3];
        let mut fraction = [0.0; 3];
        for axis in 0..3 {
            let last = points[axis].checked_sub(2)?;
            let end = (last + 1) as f32;
            // A little more, for what was rounded on the grid's faces.
            if !(-1.0e-3..=end + 1.0e-3).contains(&place[axis]) {
                return None;
            }
            low[axis] = (place[axis].max(0.0) as u32).min(last);
            fraction[axis] = (place[axis] - low[axis] as f32).clamp(0.0, 1.0);
        }
        let corner = |i: usize| [i & 1, i >> 1 & 1, i >> 2];
        let indices = std::array::from_fn(|i| {
            let [x, y, z] = corner(i).map(|bit| bit as u32);
            ((low[2] + z) * points[1] + low[1] + y) * points[0] + low[0] + x
        });
        let weights = std::array::from_fn(|i| {
            let bits = corner(i);
            (0..3).map(|axis| if bits[axis] == 1 { fraction[axis] } else { 1.0 - fraction[axis] }).product()
        });
        Some(Self { indices, weights })
    }

    pub(super) fn value(&self, values: &[f32]) -> f32 {
        self.indices.iter().zip(self.weights).map(|(&i, weight)| values[i as usize] * weight).sum()
    }
}

/// A point of the surface whose value is too high.
struct Above {
    cell: Cell,
    bound: f32,
    /// How far it has pushed the values down so far.
    push: f32,
}

/// Number of samples in the grid, and those of them that are above the bound. The order does not depend on the threads.
fn above_bound(
    values: &[f32],
    points: [u32; 3],
    triangles: &[[Vec3; 3]],
    sampling: &Sampling,
    bounds: FitBounds,
) -> (u64, Vec<Above>) {
    let of_chunk = |triangles: &[[Vec3; 3]]| {
        let (mut samples, mut above) = (0, Vec::new());
        for triangle in triangles {
            let normal = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]).normalize_or_zero();
            sampling.for_each(triangle, |place| {
                let Some(cell) = Cell::around(points, place) else { return };
                samples += 1;
                let value = cell.value(values);
                if value <= bounds.sheet.min(bounds.solid) {
                    return;
                }
                let beside = |side: f32| Cell::around(points, place + normal * (0.5 * side));
                let is_solid = [-1.0, 1.0].into_iter().filter_map(beside).any(|cell| cell.value(values) < SOLID);
                let bound = if is_solid { bounds.solid } else { bounds.sheet };
                if value > bound {
                    above.push(Above { cell, bound, push: 0.0 });
                }
            });
        }
        (samples, above)
    };
    let chunks: Vec<_> = triangles.par_chunks(1024).map(of_chunk).collect();
    let mut all = (0, Vec::new());
    for (samples, above) in chunks {
        all.0 += samples;
        all.1.extend(above);
    }
    all
}

/// How far apart samples are.
pub(super) struct Sampling {
    rows: f32,
    along: f32,
}

impl Sampling {
    pub(super) fn new(triangles: &[[Vec3; 3]]) -> Self {
        let per_area = 0.5 / f64::from(ROWS * ALONG);
        let estimate = |&[a, b, c]: &[Vec3; 3]| {
            let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a)).sqrt();
            1.0 + f64::from(longest / ALONG) + f64::from((b - a).cross(c - a).length()) * per_area
        };
        let wider = (triangles.iter().map(estimate).sum::<f64>() / MOST_SAMPLES).max(1.0).sqrt() as f32;
        Self { rows: ROWS * wider, along: ALONG * wider }
    }

    /// Rows of points parallel to the longest edge. The angles at that edge are acute, so that straight down from any point
    /// of the triangle there is one of the row below.
    pub(super) fn for_each(&self, &[a, b, c]: &[Vec3; 3], mut sample: impl FnMut(Vec3)) {
        let center = (a + b + c) / 3.0;
        if [a, b, c].iter().all(|p| p.distance_squared(center) <= TINY * TINY) {
            sample(center);
            return;
        }
        let edges = [(a, b, c), (b, c, a), (c, a, b)];
        let length = |(start, end, _): &(Vec3, Vec3, Vec3)| start.distance_squared(*end);
        let (start, end, apex) = edges.into_iter().max_by(|x, y| length(x).total_cmp(&length(y))).unwrap_or(edges[0]);
        let [start, end, apex] = [start, end, apex].map(Vec3A::from);
        let base = start.distance(end);
        let height = (end - start).cross(apex - start).length() / base;
        let rows = (height / self.rows).ceil().max(1.0) as u32;
        for row in 0..=rows {
            let up = row as f32 / rows as f32;
            let (from, to) = (start.lerp(apex, up), end.lerp(apex, up));
            let steps = (base * (1.0 - up) / self.along).ceil() as u32;
            for step in 0..=steps {
                sample(from.lerp(to, step as f32 / steps.max(1) as f32).into());
            }
        }
    }
}
