//! Signed distances to triangles, on a grid: what a distance field is baked from.
//!
//! 1. [`closest`] finds how far each grid point is from the nearest triangle,
//! 2. [`winding`] tells inside from outside,
//! 3. [`signs`] asks it for as few points as it can,
//! 4. [`fit`] lowers values until their interpolation misses no surface.
//!
//! All of them work in voxels: the grid's points have whole coordinates, and neither the mesh's units nor its place matter.

mod closest;
mod fit;
mod signs;
#[cfg(test)]
mod tests;
mod winding;

use glam::{DVec3, Vec3};
use visfield::FieldError;
use visfield::distance::{DistanceGrid, DistanceGridFormat, DistanceGridHeader, GRID_THRESHOLD};

use self::closest::Surface;
use self::fit::{FitBounds, fit_to_surface};
use self::signs::apply_signs;
use self::winding::WindingNumbers;

/// Where the points of a grid are, in mesh space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct GridPoints {
    /// The point with the lowest coordinates.
    pub(crate) low: DVec3,
    /// Distance between neighbouring points, above 0.
    pub(crate) voxel: f64,
    /// Number of points along each axis.
    pub(crate) points: [u32; 3],
}

impl GridPoints {
    /// Number of points.
    pub(crate) fn count(&self) -> usize {
        self.points.iter().map(|&n| n as usize).product()
    }

    /// Triangles in voxels from the lowest point: rounded only now that they are small and near.
    fn in_voxels(&self, triangles: &[[DVec3; 3]]) -> Vec<[Vec3; 3]> {
        triangles.iter().map(|t| t.map(|p| ((p - self.low) / self.voxel).as_vec3())).collect()
    }
}

/// How far above 0 a grid's interpolation may be at the surface, in voxels: sheets, which are missed otherwise, less than where
/// rays stop. The less, the more the fit thickens.
const BOUNDS: FitBounds = FitBounds { sheet: 0.9 * GRID_THRESHOLD, solid: 0.12 };

/// Bakes a grid; `progress` hears of every point once.
pub(crate) fn bake_distance_grid(
    triangles: &[[DVec3; 3]],
    format: DistanceGridFormat,
    progress: impl Fn(u64) + Sync,
) -> Result<DistanceGrid, FieldError> {
    format.validate()?;
    let corners = triangles.as_flattened();
    let low = corners.iter().fold(DVec3::INFINITY, |low, p| low.min(*p)).as_vec3().to_array();
    let high = corners.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p)).as_vec3().to_array();
    let header = DistanceGridHeader { excess: BOUNDS.solid, ..DistanceGridHeader::around(low, high, format) };
    header.validate()?;
    let grid = GridPoints {
        low: DVec3::from(header.first.map(f64::from)),
        voxel: f64::from(header.voxel),
        points: header.points,
    };
    let mut distances = signed_distances(triangles, &grid, progress);
    fit_to_surface(&mut distances, &grid, triangles, BOUNDS);
    DistanceGrid::from_distances(header, &distances)
}

/// Signed distances from a grid's points to the nearest triangle, in voxels, x fastest: negative inside, where a surface
/// winds around the point at least half a time in either sense. Infinite without triangles.
///
/// Triangles have finite corners, and may be as they like otherwise. What has no inside, such as a plate, has positive distances
/// all around. [`winding`] says what counts as inside, and [`signs`] what becomes of holes. Where bodies overlap, the distance
/// inside is still that to the nearest triangle, and may touch 0 there.
///
/// `progress` is called now and then, from any thread, with the number of points done since the last call; the sum is the
/// number of points.
pub(crate) fn signed_distances(triangles: &[[DVec3; 3]], grid: &GridPoints, progress: impl Fn(u64) + Sync) -> Vec<f32> {
    let surface = Surface::new(&grid.in_voxels(triangles));
    let mut distances = surface.lattice_distances(grid.points, progress);
    let windings = WindingNumbers::new(&surface);
    apply_signs(&mut distances, grid.points, |place| windings.at(Vec3::from(place.map(|x| x as f32))).abs() >= 0.5);
    distances
}
