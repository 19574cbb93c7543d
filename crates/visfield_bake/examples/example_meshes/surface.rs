//! A triangle mesh with a normal at each vertex.

use glam::DVec3;

/// In `f64` until it is written, so that rounding happens once.
#[derive(Default)]
pub(crate) struct Surface {
    pub(crate) positions: Vec<DVec3>,
    pub(crate) normals: Vec<DVec3>,
    pub(crate) triangles: Vec<[u16; 3]>,
}

impl Surface {
    /// Adds the two triangles of a quadrilateral whose corners run counter-clockwise.
    pub(crate) fn add_quad(&mut self, [a, b, c, d]: [usize; 4]) {
        self.add_triangle([a, b, c]);
        self.add_triangle([a, c, d]);
    }

    /// Adds a triangle whose corners run counter-clockwise. The examples stay far below 65,536 vertices.
    pub(crate) fn add_triangle(&mut self, corners: [usize; 3]) {
        self.triangles.push(corners.map(|corner| corner as u16));
    }

    /// Sets each normal to the mean of its triangles' normals, weighted by area.
    pub(crate) fn smooth_normals(&mut self) {
        let mut sums = vec![DVec3::ZERO; self.positions.len()];
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|corner| self.positions[usize::from(corner)]);
            for corner in triangle {
                sums[usize::from(*corner)] += (b - a).cross(c - a);
            }
        }
        self.normals = sums.into_iter().map(DVec3::normalize_or_zero).collect();
    }
}
