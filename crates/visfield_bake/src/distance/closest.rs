//! How far a point is from the nearest of many triangles.

use std::array;

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

/// Points that are asked for together: a few neighbours of a row come to the same boxes.
struct Packet<'a, const N: usize> {
    surface: &'a Surface,
    x: [f32; N],
    y: f32,
    z: f32,
    /// Square of the distance to the nearest triangle so far, for each point.
    squared: [f64; N],
    /// The same for boxes, which are visited only if they are nearer.
    limit: [f32; N],
    /// The nearest triangle so far.
    nearest: [u32; N],
}

/// By how much more than its share of the rounding a box's distance may count: a box is left out only if it is certainly
/// farther away than the nearest triangle so far.
const SLACK: f64 = 1.0 + 1.0e-6;

/// Points of a row that are asked for together.
const LANES: usize = 8;

impl Surface {
    /// Builds the BVH over triangles with finite corners.
    pub(crate) fn new(triangles: &[[Vec3; 3]]) -> Self {
        Self { bvh: BinaryBvh::new(triangles) }
    }

    /// In the order of the leaves.
    pub(crate) fn triangles(&self) -> &[[Vec3; 3]] {
        &self.bvh.triangles
    }

    #[inline(always)]
    fn triangle(&self, index: u32) -> Triangle {
        Triangle::new(self.bvh.triangles[index as usize].map(Vec3::as_dvec3))
    }

    /// The root comes first.
    pub(crate) fn nodes(&self) -> &[BinaryNode] {
        &self.bvh.nodes
    }

    /// Distance to the nearest triangle; infinite without triangles.
    pub(crate) fn distance(&self, point: Vec3) -> f32 {
        let mut packet = Packet::new(self, [point.x], point.y, point.z);
        packet.search(&mut Vec::new());
        packet.squared[0].sqrt() as f32
    }

    /// Distances from all points with whole coordinates from 0 to below `points`, x fastest; infinite without triangles.
    /// `progress` gets the number of points done since the last call, from any thread.
    pub(crate) fn lattice_distances(&self, points: [u32; 3], progress: impl Fn(u64) + Sync) -> Vec<f32> {
        let [width, height, _] = points.map(|n| n as usize);
        let mut distances = vec![f32::INFINITY; points.iter().map(|&n| n as usize).product()];
        if distances.is_empty() || self.nodes().is_empty() {
            progress(distances.len() as u64);
            return distances;
        }
        distances.par_chunks_mut(width * height).enumerate().for_each(|(z, plane)| {
            let mut pending = Vec::new();
            // What was nearest to the points of the row before; any triangle will do at first.
            let mut before = vec![0; width];
            for (y, row) in plane.chunks_mut(width).enumerate() {
                for (start, (row, before)) in row.chunks_mut(LANES).zip(before.chunks_mut(LANES)).enumerate() {
                    // Lanes beyond the row's end repeat its last point.
                    let within = |lane: usize| lane.min(row.len() - 1);
                    let x = array::from_fn(|lane| (start * LANES + within(lane)) as f32);
                    let mut packet = Packet::<LANES>::new(self, x, y as f32, z as f32);
                    packet.try_hints(array::from_fn(|lane| before[within(lane)]));
                    packet.search(&mut pending);
                    for (lane, (distance, before)) in row.iter_mut().zip(before).enumerate() {
                        *distance = packet.squared[lane].sqrt() as f32;
                        *before = packet.nearest[lane];
                    }
                }
                progress(width as u64);
            }
        });
        distances
    }
}

impl<'a, const N: usize> Packet<'a, N> {
    fn new(surface: &'a Surface, x: [f32; N], y: f32, z: f32) -> Self {
        Self { surface, x, y, z, squared: [f64::INFINITY; N], limit: [f32::INFINITY; N], nearest: [0; N] }
    }

    /// Starts from triangles that may be near: the nearer they are, the less has to be searched.
    fn try_hints(&mut self, hints: [u32; N]) {
        for (lane, hint) in hints.into_iter().enumerate() {
            self.try_triangle(&self.surface.triangle(hint), hint, lane);
        }
        // What is near to a point is near to its neighbours.
        for (from, to) in (1..N).map(|lane| (lane - 1, lane)).chain((1..N).rev().map(|lane| (lane, lane - 1))) {
            if self.nearest[from] != self.nearest[to] {
                self.try_triangle(&self.surface.triangle(self.nearest[from]), self.nearest[from], to);
            }
        }
    }

    #[inline(always)]
    fn try_triangle(&mut self, triangle: &Triangle, index: u32, lane: usize) {
        let squared = triangle.squared_distance(Vec3::new(self.x[lane], self.y, self.z).as_dvec3());
        if squared < self.squared[lane] {
            self.squared[lane] = squared;
            self.limit[lane] = (squared * SLACK) as f32;
            self.nearest[lane] = index;
        }
    }

    /// Finds the nearest triangles. `pending` is kept between searches for its memory.
    fn search(&mut self, pending: &mut Vec<u32>) {
        let nodes = self.surface.nodes();
        pending.clear();
        pending.extend((!nodes.is_empty()).then_some(0));
        while let Some(index) = pending.pop() {
            let node = &nodes[index as usize];
            let squares = self.box_squares(node);
            if !self.any_within(&squares) {
                continue;
            }
            if node.count > 0 {
                for index in node.first..node.first + node.count {
                    let triangle = self.surface.triangle(index);
                    for (lane, square) in squares.iter().enumerate() {
                        if *square < self.limit[lane] {
                            self.try_triangle(&triangle, index, lane);
                        }
                    }
                }
                continue;
            }
            // The nearer child first: it finds a near triangle early.
            let middle = Vec3A::new(self.x[N / 2], self.y, self.z);
            let [one, other] = [node.first, node.first + 1].map(|i| box_squared(&nodes[i as usize], middle));
            let swap = u32::from(other < one);
            pending.extend([node.first + 1 - swap, node.first + swap]);
        }
    }

    #[inline(always)]
    fn any_within(&self, squares: &[f32; N]) -> bool {
        // Without a branch for each, so that it becomes vector instructions.
        squares.iter().zip(&self.limit).map(|(square, limit)| u32::from(square < limit)).sum::<u32>() > 0
    }

    /// Squares of the distances to a box.
    #[inline(always)]
    fn box_squares(&self, node: &BinaryNode) -> [f32; N] {
        let y = (node.low.y - self.y).max(self.y - node.high.y).max(0.0);
        let z = (node.low.z - self.z).max(self.z - node.high.z).max(0.0);
        let (low, high, rest) = (node.low.x, node.high.x, y * y + z * z);
        self.x.map(|x| {
            let x = (low - x).max(x - high).max(0.0);
            x * x + rest
        })
    }
}

/// Square of the distance to a box.
#[inline(always)]
fn box_squared(node: &BinaryNode, point: Vec3A) -> f32 {
    (node.low - point).max(point - node.high).max(Vec3A::ZERO).length_squared()
}

/// A triangle, ready to be asked how far away points are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Triangle {
    corners: [DVec3; 3],
    /// From each corner to the next.
    edges: [DVec3; 3],
    /// Reciprocals of the edges' squared lengths; 0 without a length, which leaves the corner.
    edge_scales: [f64; 3],
    normal: DVec3,
    /// Reciprocal of the normal's squared length; infinite without an area.
    normal_scale: f64,
}

impl Triangle {
    #[inline(always)]
    pub(crate) fn new(corners: [DVec3; 3]) -> Self {
        let [a, b, c] = corners;
        let edges = [b - a, c - b, a - c];
        let normal = edges[2].cross(edges[0]);
        let edge_scales = edges.map(|edge| {
            let squared = edge.length_squared();
            if squared > 0.0 { 1.0 / squared } else { 0.0 }
        });
        Self { corners, edges, edge_scales, normal, normal_scale: 1.0 / normal.length_squared() }
    }

    /// Square of the distance: to the triangle's plane if the point is above the triangle, otherwise to the nearest edge.
    ///
    /// No region is told from another by what is left of products that cancel, as in Ericson, *Real-Time Collision Detection*
    /// (2005, §5.1.5): no point is above a triangle that is a line or a point, and its edges remain.
    #[inline(always)]
    pub(crate) fn squared_distance(&self, point: DVec3) -> f64 {
        let Self { corners, edges, edge_scales, normal, normal_scale } = self;
        let to_point = corners.map(|corner| point - corner);
        #[expect(clippy::manual_clamp, reason = "with `clamp`, the whole search takes a tenth longer")]
        let edge_squared = |i: usize| {
            let along = (edges[i].dot(to_point[i]) * edge_scales[i]).max(0.0).min(1.0);
            (to_point[i] - edges[i] * along).length_squared()
        };
        let inward = |i: usize| normal.cross(edges[i]).dot(to_point[i]);
        let height = normal.dot(to_point[0]);
        let plane_squared = height * height * normal_scale;
        let above = (inward(0) >= 0.0) & (inward(1) >= 0.0) & (inward(2) >= 0.0) & normal_scale.is_finite();
        let edge_squared = edge_squared(0).min(edge_squared(1)).min(edge_squared(2));
        if above { plane_squared } else { edge_squared }
    }
}
