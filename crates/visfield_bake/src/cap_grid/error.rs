//! How far off a baked grid is, by points that it has not seen.

use glam::Vec3;
use rayon::prelude::*;
use visfield::field::cap_grid::{CapGrid, CapGridError};

use super::{Surroundings, in_cube, rotation};

/// Points outside the box, and most of those inside it.
const POINTS: usize = 300;
/// Points around the surface, of which those count that are inside the box and outside the mesh.
const AROUND_SURFACE: usize = 3 * POINTS;
/// Rays per point.
const RAYS: u32 = 512;
/// How far from the surface points inside the box lie, in units of cap space: where receivers stand.
const NEAR: f32 = 0.15;
/// Apart from the sequences that the fit draws its points from.
const FRESH: usize = 1 << 20;

/// Largest number of rays that a measurement traces.
pub(super) fn rays() -> u64 {
    (POINTS + AROUND_SURFACE) as u64 * u64::from(RAYS)
}

/// Mean absolute errors of occlusion outside and inside the mesh's bounding box. The exact occlusion is that of the same
/// directions for all normals, weighted by their cosine.
pub(super) fn measure(grid: &CapGrid, surroundings: &Surroundings, progress: &(impl Fn(u64) + Sync)) -> CapGridError {
    let half_extents = surroundings.half_extents;
    let is_inside_box = |p: &Vec3| p.abs().cmplt(half_extents).all();
    // Up to about the mesh's size away from its faces.
    let reach = half_extents + 1.0;
    let around_box = (0..).map(|index| (in_cube(FRESH + index) * 2.0 - 1.0) * reach);
    let outside: Vec<Vec3> = around_box.filter(|p| !is_inside_box(p)).take(POINTS).collect();
    let inside = surroundings.near_surface(AROUND_SURFACE, NEAR).into_iter().filter(is_inside_box).collect();
    let [outside, inside] = [outside, inside].map(|points| {
        let errors = points.par_iter().enumerate().filter(|(_, point)| !surroundings.is_inside(**point));
        let errors: Vec<f32> = errors
            .map(|(index, &point)| {
                progress(RAYS.into());
                error_at(grid, surroundings, point, index)
            })
            .collect();
        // Where nobody can stand, nothing is wrong.
        errors.iter().fold(0.0, |sum, error| sum + error) / errors.len().max(1) as f32
    });
    CapGridError { outside, inside }
}

/// The mean over six normals of the absolute error of occlusion.
fn error_at(grid: &CapGrid, surroundings: &Surroundings, position: Vec3, index: usize) -> f32 {
    let (directions, solid_angle) = surroundings.directions(position, RAYS, rotation(FRESH + index));
    let normals = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z].map(|n| rotation(index) * n);
    let mut exact = [0.0; 6];
    for direction in directions {
        let weight = surroundings.weight(position, direction);
        if weight > 0.0 {
            exact.iter_mut().zip(&normals).for_each(|(sum, n)| *sum += weight * n.dot(direction).max(0.0));
        }
    }
    let per_ray = solid_angle / (RAYS as f32 * std::f32::consts::PI);
    let error = |(exact, normal): (&f32, &Vec3)| (grid.ambient_occlusion(position, *normal) - exact * per_ray).abs();
    exact.iter().zip(&normals).map(error).sum::<f32>() / 6.0
}
