//! How much of a small light a surface sees, by one march towards its centre: soft shadows without noise (DESIGN §4). The
//! penumbra factor of the 2012 thesis (algorithm 3.3) is the uncalibrated ancestor.
//!
//! Twin: `shaders/cone.wgsl`, same names.

use glam::Vec3;

use super::{DistanceField, GRID_THRESHOLD};

/// Most steps of a march.
pub const MAX_STEPS: u32 = 24;
/// Where a march starts, in the field's units: at the surface itself nothing would be seen of the light.
pub const START: f32 = 0.25;
/// Least step, as a share of the radius of the bounds.
pub const LEAST_STEP: f32 = 0.03;

/// The share of a disc that is hidden behind a straight edge whose signed distance from the disc's centre is `visible` radii, −1 to
/// 1: by a cubic, where the 2012 thesis (eq. 5.4) has the exact segment of the circle.
#[inline(always)]
pub fn disc_occlusion(visible: f32) -> f32 {
    let v = visible.clamp(-1.0, 1.0);
    1.0 - (1.0 + v) * (1.0 + v) * (2.0 - v) * 0.25
}

/// How far above the surface a march starts at least, in voxels of a grid: what a grid rounds off the surface does not reach it.
pub const LIFT: f32 = 0.3;

/// The visible share of a disc of which only what is above a flat horizon counts, `horizon` radii below its centre: what the
/// share of the whole disc is to be divided by. Not 0.
#[inline(always)]
pub fn horizon_share(horizon: f32) -> f32 {
    (1.0 - disc_occlusion(horizon)).max(1.0e-3)
}

impl DistanceField {
    /// How far the centre of a disc of the sky is from the edge of what hides it, in radii of the disc: −1 and less if all of it is
    /// hidden, 1 and more if nothing is. `direction` is the unit vector to its centre, `tangent` the tangent of its half-angle,
    /// `normal` the receiver's, all in the space of the distances; `t_light` is how far the light is.
    pub fn cone_visible(&self, position: Vec3, normal: Vec3, direction: Vec3, tangent: f32, t_light: f32) -> f32 {
        let finer = self.threshold() / GRID_THRESHOLD;
        let (low, high) = self.bounds();
        let (center, radius) = ((low + high) * 0.5, (high - low).length() * 0.5);
        let mut origin = position;
        if position.clamp(low, high) == position {
            let lift = LIFT * finer;
            origin += normal * (lift - self.distance(position)).clamp(0.0, 2.0 * lift);
        }
        // Where the cone comes near the bounds, and leaves them.
        let along = (center - origin).dot(direction);
        let t_end = (along + radius).min(t_light);
        let mut t = (START * finer).max(along - radius);
        let mut visible = 1.0_f32;
        for _ in 0..MAX_STEPS {
            if !(t < t_end) || visible < -1.0 {
                break;
            }
            let distance = self.distance(origin + direction * t);
            visible = visible.min(distance / (t * tangent));
            t += distance.abs().max(LEAST_STEP * radius);
        }
        visible
    }
}
