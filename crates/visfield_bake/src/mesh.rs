//! Triangle soups, and what makes them fit for a bake.

use glam::DVec3;
use thiserror::Error;

/// Smallest and largest bounding radius that can be baked, in mesh units. Beyond them, squares leave single precision.
pub const RADIUS_RANGE: (f32, f32) = (1.0e-18, 1.0e18);

/// A triangle soup in its own units and axes. It may be open, self-intersecting, or of several parts; winding does not
/// matter.
///
/// ```
/// use visfield_bake::{Mesh, MeshError};
/// let mut mesh = Mesh {
///     name: "Mesh0/Primitive0".to_owned(),
///     positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
///     indices: vec![[0, 1, 2]],
/// };
/// assert_eq!(mesh.validate(), Ok(()));
/// mesh.positions[2] = [2.0, 0.0, 0.0];
/// assert_eq!(mesh.validate(), Err(MeshError::ZeroArea));
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Which mesh of its source file this is, named as Bevy names it: `Mesh0/Primitive0`.
    pub name: String,
    /// Vertex positions in mesh units. Vertices that no triangle uses are ignored.
    pub positions: Vec<[f32; 3]>,
    /// Three positions in [`positions`](Self::positions) per triangle. Degenerate triangles are ignored.
    pub indices: Vec<[u32; 3]>,
}

/// Why a mesh cannot be baked.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum MeshError {
    /// There is nothing to bake.
    #[error("it has no triangles, only points, lines or nothing; export it as a triangle mesh")]
    NoTriangles,
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} refers to vertex {vertex}, but there are {vertices} vertices; export the mesh again")]
    IndexOutOfRange {
        /// The triangle, from 0.
        triangle: usize,
        /// The vertex it asks for, from 0.
        vertex: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A triangle uses a vertex with a NaN or infinite coordinate.
    #[error("vertex {vertex} of triangle {triangle} is {position:?}, not finite; repair the mesh and export it again")]
    NotFinite {
        /// The triangle, from 0.
        triangle: usize,
        /// The vertex, from 0.
        vertex: u32,
        /// Its position.
        position: [f32; 3],
    },
    /// Every triangle is a line or a point.
    #[error("all its triangles have zero area, so that nothing can be hit; was it scaled by zero?")]
    ZeroArea,
    /// The bounding radius is outside [`RADIUS_RANGE`].
    #[error("its radius of {radius:e} units is outside {:e} to {:e}; export it in other units", RADIUS_RANGE.0, RADIUS_RANGE.1)]
    Extent {
        /// The bounding radius in mesh units.
        radius: f32,
    },
}

impl Mesh {
    /// Checks that the mesh can be baked.
    ///
    /// # Errors
    /// [`MeshError`] names the first thing that is wrong.
    pub fn validate(&self) -> Result<(), MeshError> {
        let triangles = self.solid_triangles()?;
        crate::bounds::bounds_of(&triangles, crate::bounds::BoundsKind::Sphere).map(|_| ())
    }

    /// The corners of the triangles that have an area, in double precision.
    ///
    /// # Errors
    /// [`MeshError`] if any triangle is broken, or if none remains.
    pub fn solid_triangles(&self) -> Result<Vec<[DVec3; 3]>, MeshError> {
        if self.indices.is_empty() {
            return Err(MeshError::NoTriangles);
        }
        let mut solid = Vec::with_capacity(self.indices.len());
        for triangle in 0..self.indices.len() {
            let corners = self.corners(triangle)?;
            if has_area(corners) {
                solid.push(corners);
            }
        }
        if solid.is_empty() { Err(MeshError::ZeroArea) } else { Ok(solid) }
    }

    fn corners(&self, triangle: usize) -> Result<[DVec3; 3], MeshError> {
        let mut corners = [DVec3::ZERO; 3];
        for (corner, &vertex) in corners.iter_mut().zip(&self.indices[triangle]) {
            let vertices = self.positions.len();
            let Some(&position) = self.positions.get(vertex as usize) else {
                return Err(MeshError::IndexOutOfRange { triangle, vertex, vertices });
            };
            *corner = DVec3::from(position.map(f64::from));
            if !corner.is_finite() {
                return Err(MeshError::NotFinite { triangle, vertex, position });
            }
        }
        Ok(corners)
    }
}

/// Whether the corners span an area. Differences and products of `f32` coordinates are exact in `f64`, or nearly so: thin
/// triangles stay apart from lines.
fn has_area([a, b, c]: [DVec3; 3]) -> bool {
    (b - a).cross(c - a) != DVec3::ZERO
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(corners: [[f32; 3]; 3]) -> Mesh {
        Mesh { name: "t".to_owned(), positions: corners.to_vec(), indices: vec![[0, 1, 2]] }
    }

    const GOOD: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

    #[test]
    fn each_defect_is_named() {
        assert_eq!(triangle(GOOD).validate(), Ok(()));
        assert_eq!(Mesh::default().validate(), Err(MeshError::NoTriangles));
        let mut short = triangle(GOOD);
        short.indices.push([0, 1, 3]);
        assert_eq!(short.validate(), Err(MeshError::IndexOutOfRange { triangle: 1, vertex: 3, vertices: 3 }));
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut mesh = triangle(GOOD);
            mesh.positions[1][2] = bad;
            assert!(matches!(mesh.validate(), Err(MeshError::NotFinite { triangle: 0, vertex: 1, .. })));
        }
        assert_eq!(triangle([[0.1; 3], [0.2; 3], [0.7; 3]]).validate(), Err(MeshError::ZeroArea));
        assert_eq!(triangle([[5.0; 3]; 3]).validate(), Err(MeshError::ZeroArea));
        for scale in [1e-25, 1e25] {
            let mesh = triangle(GOOD.map(|p| p.map(|c| c * scale)));
            assert!(matches!(mesh.validate(), Err(MeshError::Extent { .. })), "{scale}");
        }
    }

    #[test]
    fn degenerate_triangles_and_unused_vertices_are_ignored() {
        let mut mesh = triangle(GOOD);
        mesh.positions.push([f32::NAN; 3]);
        mesh.indices.extend([[0, 0, 1], [2, 2, 2]]);
        assert_eq!(mesh.solid_triangles().unwrap().len(), 1);
    }

    #[test]
    fn needles_have_area() {
        assert_eq!(triangle([[0.0; 3], [1.0, 0.0, 0.0], [0.5, 1e-7, 0.0]]).validate(), Ok(()));
    }
}
