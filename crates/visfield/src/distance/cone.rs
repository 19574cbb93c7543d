//! How much of a small light a surface sees, by one march towards its centre: soft shadows without noise (DESIGN §4). The
//! penumbra factor of the 2012 thesis (algorithm 3.3) is the uncalibrated ancestor.
//!
//! Twin: `shaders/cone.wgsl`, same names.

use glam::Vec3;

use super::DistanceField;

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

impl DistanceField {
    /// The share of a disc of the sky that the object hides from a position, without noise. `direction` is the unit vector to its
    /// centre, `tangent` the tangent of its half-angle, both in the space of the distances; `t_light` is how far the light is.
    pub fn cone_occlusion(&self, position: Vec3, direction: Vec3, tangent: f32, t_light: f32) -> f32 {
        let (low, high) = self.bounds();
        let (center, radius) = ((low + high) * 0.5, (high - low).length() * 0.5);
        // Where the cone comes near the bounds, and leaves them.
        let along = (center - position).dot(direction);
        let t_end = (along + radius).min(t_light);
        let mut t = START.max(along - radius);
        let mut visible = 1.0_f32;
        for _ in 0..MAX_STEPS {
            if t >= t_end {
                break;
            }
            let distance = self.distance(position + direction * t);
            visible = visible.min(distance / (t * tangent));
            if visible < -1.0 {
                break;
            }
            t += distance.abs().max(LEAST_STEP * radius);
        }
        disc_occlusion(visible)
    }
}
