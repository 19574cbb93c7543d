//! How far a point is from the nearest of many triangles.

use glam::{DVec3, Vec3, Vec3A};
use rayon::prelude::*;

use crate::triangles::{BinaryBvh, BinaryNode};

/// A triangle soup that knows how far points are from it, by branch and bound over a binary BVH.
///
/// Any triangles will do: open, intersecting, duplicate, needles, lines or points. Corners and boxes are `f32`, while
/// everything between a point and a triangle is computed in `f64`: the products cancel where triangles are needles.
#[derive(Debug)]
pub(crate) struct Surface {
    bvh: BinaryBvh,
}

/// The nearest triangle to a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nearest {
    /// In the order of [`Surface::triangles`].
    pub(crate) triangle: u32,
    /// Square of the distance.
    pub(crate) squared: f64,
}

/// Nodes that are still to be visited and the squares of their distances; kept between queries, for its memory.
pub(crate) type Pending = Vec<(u32, f32)>;

/// By how much more than its share of the rounding a box's distance may count: a box is left out only if it is certainly
/// farther away than the nearest triangle so far.
const SLACK: f64 = 1.0 + 1.0e-6;

impl Surface {
    /// Builds the BVH over triangles with finite corners.
    pub(crate) fn new(triangles: &[[Vec3; 3]]) -> Self {
        Self { bvh: BinaryBvh::new(triangles) }
    }

    /// In the order of the leaves.
    pub(crate) fn triangles(&self) -> &[[Vec3; 3]] {
        &self.bvh.triangles
    }

    /// The root comes first.
    pub(crate) fn nodes(&self) -> &[BinaryNode] {
        &self.bvh.nodes
    }

    /// The nearest triangle, `None` only without triangles. `hints` are triangles that may be near, such as those nearest to
    /// neighbouring points: the nearer they are, the less has to be searched.
    pub(crate) fn nearest(
        &self,
        point: Vec3,
        hints: impl IntoIterator<Item = u32>,
        pending: &mut Pending,
    ) -> Option<Nearest> {
        let nodes = self.nodes();
        let root = nodes.first()?;
        let exact_point = point.as_dvec3();
        let mut best = Nearest { triangle: 0, squared: f64::INFINITY };
        let try_triangle = |triangle: u32, best: &mut Nearest| {
            let squared = squared_distance(exact_point, self.bvh.triangles[triangle as usize].map(|p| p.as_dvec3()));
            if squared < best.squared {
                *best = Nearest { triangle, squared };
            }
        };
        for hint in hints {
            try_triangle(hint, &mut best);
        }

        let point = Vec3A::from(point);
        let limit = |best: &Nearest| (best.squared * SLACK) as f32;
        pending.clear();
        pending.push((0, box_squared(root, point)));
        while let Some((index, squared)) = pending.pop() {
            if squared >= limit(&best) {
                continue;
            }
            // Down along the nearer children, which find a near triangle early.
            let mut node = &nodes[index as usize];
            loop {
                if node.count > 0 {
                    for triangle in node.first..node.first + node.count {
                        try_triangle(triangle, &mut best);
                    }
                    break;
                }
                let [mut near, mut far] = [node.first, node.first + 1];
                let [mut near_squared, mut far_squared] = [near, far].map(|i| box_squared(&nodes[i as usize], point));
                if far_squared < near_squared {
                    (near, far) = (far, near);
                    (near_squared, far_squared) = (far_squared, near_squared);
                }
                let limit = limit(&best);
                if far_squared < limit {
                    pending.push((far, far_squared));
                }
                if near_squared >= limit {
                    break;
                }
                node = &nodes[near as usize];
            }
        }
        Some(best)
    }

    /// Distances from all points with whole coordinates from 0 to below `points`, x fastest; infinite without triangles.
    /// `progress` gets the number of points done since the last call, from any thread.
    pub(crate) fn lattice_distances(&self, points: [u32; 3], progress: impl Fn(u64) + Sync) -> Vec<f32> {
        let [width, height, _] = points.map(|n| n as usize);
        let mut distances = vec![f32::INFINITY; points.iter().map(|&n| n as usize).product()];
        if distances.is_empty() {
            return distances;
        }
        distances.par_chunks_mut(width * height).enumerate().for_each(|(z, plane)| {
            let mut pending = Pending::new();
            // What was nearest to the points of the row before.
            let mut below = vec![None; width];
            for (y, row) in plane.chunks_mut(width).enumerate() {
                let mut left = None;
                for (x, distance) in row.iter_mut().enumerate() {
                    let point = Vec3::new(x as f32, y as f32, z as f32);
                    let hints = left.into_iter().chain(below[x].filter(|_| below[x] != left));
                    let Some(nearest) = self.nearest(point, hints, &mut pending) else { continue };
                    *distance = nearest.squared.sqrt() as f32;
                    left = Some(nearest.triangle);
                    below[x] = left;
                }
                progress(width as u64);
            }
        });
        distances
    }
}

/// Square of the distance to a box.
#[inline(always)]
fn box_squared(node: &BinaryNode, point: Vec3A) -> f32 {
    (node.low - point).max(point - node.high).max(Vec3A::ZERO).length_squared()
}

/// Square of the distance to a triangle: to its plane if the point is above the triangle, otherwise to the nearest edge.
///
/// No region is told from another by what is left of products that cancel, as in Ericson, *Real-Time Collision Detection*
/// (2005, §5.1.5): a triangle that is a line or a point has no side that a point is above, and its edges remain.
pub(crate) fn squared_distance(point: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let (ab, bc, ca) = (b - a, c - b, a - c);
    let (ap, bp, cp) = (point - a, point - b, point - c);
    let normal = ca.cross(ab);
    let area_squared = normal.length_squared();
    let outside = |edge: DVec3, to_point: DVec3| edge.cross(to_point).dot(normal) < 0.0;
    if area_squared > 0.0 && !outside(ab, ap) && !outside(bc, bp) && !outside(ca, cp) {
        let height = normal.dot(ap);
        return height * height / area_squared;
    }
    let to_edge = |edge: DVec3, to_point: DVec3| {
        // An edge without a length gives NaN, which `max` turns into 0: its start.
        let along = (edge.dot(to_point) / edge.length_squared()).max(0.0).min(1.0);
        (to_point - edge * along).length_squared()
    };
    to_edge(ab, ap).min(to_edge(bc, bp)).min(to_edge(ca, cp))
}
