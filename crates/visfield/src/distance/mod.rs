//! Signed distance fields: small, and accurate where tables are not, on an object's own surface and in its hollows; slower to ask.
//!
//! A [`DistanceField`] says at any point how far the nearest surface is, negative inside: a [`DistanceGrid`] that a mesh was baked
//! to, or a [shape](crate::shape) in closed form, which needs no baking. [`sphere_trace`] follows rays through either by steps that
//! the distance allows, [`query`] answers the rays of a [`VisibilityField`](crate::VisibilityField) so, and [`cone`] finds how
//! much of a small light a surface sees in one march, without noise.
//!
//! The method follows Tomczak, *GPU Ray Marching of Distance Fields* (2012), and Keinert et al., *Enhanced Sphere Tracing*
//! (2014); where this crate deviates, the item says so.
//!
//! A field's distances live in a space of their own, an even scale of the mesh's: of a grid the one in which a voxel is 1 and the
//! first point the origin. Rays are mapped there with the same ray parameter, under any affine transform of the instance; only
//! what is compared with the distance has to be scaled.

mod batch;
pub mod cone;
mod grid;
pub mod query;
mod solid;
pub mod sphere_trace;

use glam::{DAffine3, Vec3};

use crate::shape::Shape;

pub use solid::Solid;

pub use grid::{
    BYTE_REACH, DistanceGrid, DistanceGridFormat, DistanceGridHeader, DistancePrecision, MARGIN, MAX_VOXELS,
    MIN_VOXELS, ball_grid, example_ball, grid_positions,
};

/// What says how far the nearest surface of an object is.
///
/// ```
/// use glam::Vec3;
/// use visfield::distance::{DistanceField, example_ball};
/// let ball = DistanceField::Grid(example_ball());
/// let (low, high) = ball.bounds();
/// assert!(ball.distance((low + high) * 0.5) < 0.0);
/// assert!(ball.distance(high * 3.0) > 0.0);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum DistanceField {
    /// Sampled from a mesh.
    Grid(DistanceGrid),
    /// In closed form.
    Shape(Solid),
}

impl From<DistanceGrid> for DistanceField {
    fn from(grid: DistanceGrid) -> Self {
        Self::Grid(grid)
    }
}

impl From<Solid> for DistanceField {
    fn from(solid: Solid) -> Self {
        Self::Shape(solid)
    }
}

impl DistanceField {
    /// The grid, if it is one.
    pub fn grid(&self) -> Option<&DistanceGrid> {
        match self {
            Self::Grid(grid) => Some(grid),
            Self::Shape(_) => None,
        }
    }

    /// The shape, if it is one.
    pub fn shape(&self) -> Option<&Shape> {
        match self {
            Self::Grid(_) => None,
            Self::Shape(solid) => Some(solid.shape()),
        }
    }

    /// The signed distance at a position of its space; of a grid, in voxels. Never more than the true one, but for what the field
    /// states: the [excess](DistanceGridHeader::excess) of a grid.
    #[inline(always)]
    pub fn distance(&self, position: Vec3) -> f32 {
        match self {
            Self::Grid(grid) => grid.distance(position),
            Self::Shape(solid) => solid.program().distance(position),
        }
    }

    /// The lowest and the highest corner of a box of its space that holds the surface.
    #[inline]
    pub fn bounds(&self) -> (Vec3, Vec3) {
        match self {
            Self::Grid(grid) => (Vec3::ZERO, grid.last()),
            Self::Shape(solid) => solid.bounds(),
        }
    }

    /// Distance below which a ray has met the surface.
    #[inline]
    pub fn threshold(&self) -> f32 {
        match self {
            Self::Grid(_) => GRID_THRESHOLD,
            Self::Shape(_) => SHAPE_THRESHOLD,
        }
    }

    /// The map from the space of the mesh, or the shape's own, to that of the distances: an even scale and a shift.
    pub fn distance_from_mesh(&self) -> DAffine3 {
        match self {
            Self::Grid(grid) => grid.header().grid_from_mesh(),
            Self::Shape(solid) => solid.distance_from_mesh(),
        }
    }

    /// Size in memory, in bytes.
    pub fn bytes(&self) -> u64 {
        match self {
            Self::Grid(grid) => grid.header().bytes(),
            Self::Shape(solid) => size_of_val(solid.program().nodes()) as u64,
        }
    }

    /// The direction in which the distance grows fastest, of about unit length near a surface: there, its normal (2012, algorithm
    /// 3.1, by differences over `reach` both ways along each axis).
    #[inline]
    pub fn gradient(&self, position: Vec3, reach: f32) -> Vec3 {
        let along = |axis: Vec3| self.distance(position + axis * reach) - self.distance(position - axis * reach);
        Vec3::new(along(Vec3::X), along(Vec3::Y), along(Vec3::Z)) / (2.0 * reach)
    }
}

/// Distance in voxels below which a ray has met the surface of a grid: all surfaces are inflated by as much. DESIGN §7 found 0.1
/// for grids that were sampled; those that are fitted to the surface need less.
pub const GRID_THRESHOLD: f32 = 0.05;

/// Distance in a shape's units below which a ray has met its surface: a 3200th of its bounding radius.
pub const SHAPE_THRESHOLD: f32 = 0.01;
