//! Bakes cap grids: what each point of a grid sees of the mesh, fitted so that what lies between the points is right.
//!
//! 1. [`View`] projects the directions in which a point sees the mesh onto spherical harmonics,
//! 2. [`fit`] moves the values of a coarse grid so that its interpolation meets views from between its points,
//! 3. [`error`] asks the grid at fresh points and says how far off it is.

mod error;
mod fit;
mod view;

use std::f32::consts::{PI, TAU};

use glam::{DVec3, Quat, Vec2, Vec3};
use rayon::prelude::*;
use visfield::field::cap_grid::warp::storage_scale;
use visfield::field::cap_grid::{CapGridHeader, Falloff};
use visfield::{CapGrid, CapGridFormat, FieldError};

use crate::triangles::TriangleBvh;
use view::View;

/// Rays of a view that has to look all around, or at the whole mesh from near, and the fewest far from the mesh.
type ViewRays = (u32, u32);
/// Of a grid point whose value is stored as it is.
const RAW_RAYS: ViewRays = (1024, 256);
/// Of what is fitted: many views share a point, and even out each other's noise. More rays for the points alone change
/// nothing, fewer for the views raise the error.
const FITTED_RAYS: ViewRays = (256, 64);
/// From this number of points on, fitting makes no grid better.
const FITTED_BELOW: u32 = 24;

/// Largest number of rays that a bake traces.
pub(crate) fn rays(format: &CapGridFormat) -> u64 {
    let (per_point, views) =
        if is_fitted(format) { (FITTED_RAYS.0, fit::views(format.points)) } else { (RAW_RAYS.0, 0) };
    (u64::from(format.points).pow(3) + views) * u64::from(per_point) + error::rays()
}

fn is_fitted(format: &CapGridFormat) -> bool {
    format.points < FITTED_BELOW
}

/// Bakes the cap grid of triangles in mesh space. `progress` gets the number of rays traced since the last call, from any
/// thread; the sum is at most [`rays`].
///
/// # Errors
/// [`FieldError`] if a setting is out of range, or the box is too small or too large for single precision.
pub(crate) fn bake_cap_grid(
    triangles: &[[DVec3; 3]],
    format: CapGridFormat,
    progress: impl Fn(u64) + Sync,
) -> Result<CapGrid, FieldError> {
    let corners = triangles.as_flattened();
    let low = corners.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
    let high = corners.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
    let coefficients = format.order.coefficients();
    let mut header = CapGridHeader {
        format,
        center: ((low + high) * 0.5).as_vec3().to_array(),
        half_extents: ((high - low) * 0.5).as_vec3().to_array(),
        low: vec![0.0; coefficients],
        range: vec![0.0; coefficients],
        error: None,
    };
    header.validate()?;
    let cap_from_mesh = header.mesh_from_cap().inverse();
    let in_cap_space: Vec<[DVec3; 3]> =
        triangles.iter().map(|t| t.map(|p| cap_from_mesh.transform_point3(p))).collect();
    let surroundings = Surroundings::new(&header, &in_cap_space);

    let point_rays = if is_fitted(&format) { FITTED_RAYS } else { RAW_RAYS };
    let mut points: Vec<View> = header
        .positions()
        .par_iter()
        .map(|&position| {
            let rays = surroundings.rays_from(position, point_rays);
            progress(rays.into());
            surroundings.view(position, rays, Quat::IDENTITY)
        })
        .collect();
    if is_fitted(&format) {
        fit::fit(&header, &surroundings, &mut points, &progress);
    } else {
        for view in &mut points {
            view.scale(storage_scale(view.position));
        }
    }
    let scaled: Vec<_> = points.iter().map(|view| view.coefficients).collect();
    let unmeasured = CapGrid::encode(header.clone(), &scaled)?;
    header.error = Some(error::measure(&unmeasured, &surroundings, &progress));
    CapGrid::encode(header, &scaled)
}

/// The mesh in cap space, as it is looked at.
struct Surroundings {
    bvh: TriangleBvh,
    triangles: Vec<[Vec3; 3]>,
    /// Radius of a sphere around the origin that holds the mesh.
    radius: f32,
    half_extents: Vec3,
    falloff: Falloff,
    /// Mesh units per unit of cap space.
    scale: f32,
}

impl Surroundings {
    fn new(header: &CapGridHeader, triangles: &[[DVec3; 3]]) -> Self {
        let half_extents = header.half_extents_in_cap_space();
        Self {
            bvh: TriangleBvh::new(triangles),
            triangles: triangles.iter().map(|t| t.map(DVec3::as_vec3)).collect(),
            // A little more, so that rounding leaves no corner outside.
            radius: half_extents.length() * 1.001,
            half_extents,
            falloff: header.format.falloff,
            scale: header.scale(),
        }
    }

    /// How many rays a view from here deserves.
    fn rays_from(&self, position: Vec3, (near, far): ViewRays) -> u32 {
        // The solid angle of the bounding sphere shrinks with the square of the distance.
        let share = self.radius * self.radius / position.length_squared().max(self.radius * self.radius);
        ((near as f32 * share) as u32).clamp(far, near)
    }
}

/// Item `index` of an even sequence over the unit cube (Roberts, *The Unreasonable Effectiveness of Quasirandom Sequences*, 2018).
fn in_cube(index: usize) -> Vec3 {
    const STEPS: [f64; 3] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3];
    Vec3::from(STEPS.map(|step| ((index as f64 + 0.5) * step).fract() as f32))
}

/// Rotation `index` of an even sequence of rotations (Shoemake, *Uniform Random Rotations*, Graphics Gems III).
fn rotation(index: usize) -> Quat {
    let Vec3 { x, y, z } = in_cube(index);
    let (one, other) = (Vec2::from_angle(TAU * y) * (1.0 - x).sqrt(), Vec2::from_angle(TAU * z) * x.sqrt());
    Quat::from_xyzw(one.x, one.y, other.x, other.y).normalize()
}

/// Solid angle of the whole sphere.
const WHOLE: f32 = 4.0 * PI;
