//! How much of a small light a surface sees, by a few marches towards it: soft shadows without noise (DESIGN §4). The penumbra
//! factor of the 2012 thesis (algorithm 3.3, [`penumbra_shadow`](super::estimators::penumbra_shadow)) is the uncalibrated ancestor.
//!
//! One march gives the distance from the light's centre to the nearest edge of what hides it, in radii of the light's disc. A
//! straight edge at that distance hides a known share. That is right for large occluders and wrong for what is smaller than the
//! penumbra, such as a leg or an ear: it would hide half of the light however thin it is. So where the first march finds a
//! penumbra, the light is divided into seven smaller discs, each with an edge of its own: the one in the middle is known from the
//! first march, the ring of six is marched to. The mean error falls to about a third (`visfield measure paper2012`), and only
//! penumbrae cost more than one march.
//!
//! Twin: `shaders/cone.wgsl`, same names.

use std::f32::consts::FRAC_1_SQRT_2;

use glam::{Vec2, Vec3};

use super::query::{LEAST_REACH, SLACK, SLACK_REACH, lifted};
use super::sphere_trace::SphereTracing;
use super::{DistanceField, GRID_THRESHOLD};
use crate::estimate::light::orthonormal_pair;
use crate::field::query::Bias;

/// Most steps of each march.
pub const MAX_STEPS: u32 = 32;
/// Where a march starts, in voxels: at the surface itself nothing would be seen of the light.
pub const START: f32 = 0.25;
/// Least step, as a share of the radius of the bounds.
pub const LEAST_STEP: f32 = 0.02;

/// Most that the least step may be, in the field's units: the bounds of shapes without end say nothing of their size.
pub const WIDEST_STEP: f32 = 5.0;

/// Radius of each of the seven discs, in radii of the light: together they are as large as the light, 1/√7.
pub const PART_RADIUS: f32 = 0.377_964_5;
/// The centres of the six discs around the middle one, in radii of the light: as far out, √½, as the seven discs need to be as
/// spread as the light (equal second moments).
pub const RING: [Vec2; 6] = [
    Vec2::new(FRAC_1_SQRT_2, 0.0),
    Vec2::new(0.353_553_4, 0.612_372_4),
    Vec2::new(-0.353_553_4, 0.612_372_4),
    Vec2::new(-FRAC_1_SQRT_2, 0.0),
    Vec2::new(-0.353_553_4, -0.612_372_4),
    Vec2::new(0.353_553_4, -0.612_372_4),
];

/// The directions to a round light, as the field sees them.
///
/// ```
/// use glam::Vec3;
/// use visfield::distance::cone::LightCone;
/// let sun = LightCone { direction: Vec3::Y, tangent: 0.004_65, t_light: f32::INFINITY };
/// assert!(sun.tangent < 0.01);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightCone {
    /// The unit vector to its centre.
    pub direction: Vec3,
    /// The tangent of its half-angle, above 0.
    pub tangent: f32,
    /// How far it is; what is behind it hides nothing.
    pub t_light: f32,
}

/// The share of a disc that is hidden behind a straight edge whose signed distance from the disc's centre is `visible` radii, −1 to
/// 1: by a cubic, where the 2012 thesis (eq. 5.4, [`disc_coverage`](super::covers::disc_coverage)) has the exact segment of the
/// circle. They differ by less than 0.04. The cubic's wider ends make up for some of what an edge that is not straight lets
/// through: with the exact segment the errors of large lights were larger.
#[inline(always)]
pub fn disc_occlusion(visible: f32) -> f32 {
    let v = visible.clamp(-1.0, 1.0);
    1.0 - (1.0 + v) * (1.0 + v) * (2.0 - v) * 0.25
}

/// How far above a surface a direction is, in radii of a disc around it: what is below −1 the surface itself hides. Without a
/// normal nothing is hidden.
#[inline(always)]
fn horizon(normal: Vec3, direction: Vec3, tangent: f32) -> f32 {
    if normal == Vec3::ZERO { 1.0 } else { normal.dot(direction) / tangent }
}

/// How marches go along the axes of cones: `threshold`, `slack`, `slack_reach`, `least_step` and `max_steps` are those of
/// [`SphereTracing`].
#[derive(Clone, Copy)]
struct ConeMarch {
    settings: SphereTracing,
    start: f32,
    center: Vec3,
    radius: f32,
    t_light: f32,
}

impl ConeMarch {
    /// The signed distance from the axis of a cone to the nearest edge of what hides its light, in radii of the cone there.
    #[inline(always)]
    fn visible(&self, distance: &impl Fn(Vec3) -> f32, origin: Vec3, direction: Vec3, tangent: f32) -> f32 {
        // Where the cone comes near the bounds, and leaves them.
        let along = (self.center - origin).dot(direction);
        let t_end = (along + self.radius).min(self.t_light);
        let mut t = self.start.max(along - self.radius);
        let mut visible = f32::MAX;
        for _ in 0..self.settings.max_steps {
            if t >= t_end {
                break;
            }
            // Surfaces are as thick as for rays, and as thin where the receiver's own one is not to be met.
            let slack = self.settings.slack * (1.0 - t / self.settings.slack_reach).max(0.0);
            let from_surface = distance(origin + direction * t) - self.settings.threshold;
            visible = visible.min((from_surface + slack) / (t * tangent));
            if visible < -1.0 {
                break;
            }
            t += from_surface.abs().max(self.settings.least_step);
        }
        visible
    }

    /// The share of the light that is hidden, of what is above the horizon, by one edge.
    #[inline(always)]
    fn edge_occlusion(&self, distance: &impl Fn(Vec3) -> f32, origin: Vec3, normal: Vec3, cone: &LightCone) -> f32 {
        let above = 1.0 - disc_occlusion(horizon(normal, cone.direction, cone.tangent));
        let visible = self.visible(distance, origin, cone.direction, cone.tangent);
        let seen = (1.0 - disc_occlusion(visible)).min(above);
        if above > 0.0 { 1.0 - seen / above } else { 0.0 }
    }

    /// The share of the light that is hidden, of what is above the horizon.
    #[inline(always)]
    fn occlusion(&self, distance: &impl Fn(Vec3) -> f32, origin: Vec3, normal: Vec3, cone: &LightCone) -> f32 {
        let visible = self.visible(distance, origin, cone.direction, cone.tangent);
        if visible >= 1.0 {
            return 0.0;
        }
        if visible <= -1.0 {
            return 1.0;
        }
        let tangent = cone.tangent * PART_RADIUS;
        let mut above = 1.0 - disc_occlusion(horizon(normal, cone.direction, tangent));
        // The same march, for a narrower cone.
        let mut seen = (1.0 - disc_occlusion(visible / PART_RADIUS)).min(above);
        let [across, along] = orthonormal_pair(cone.direction);
        for point in RING {
            let place = point * cone.tangent;
            let direction = (cone.direction + across * place.x + along * place.y).normalize();
            let part_above = 1.0 - disc_occlusion(horizon(normal, direction, tangent));
            if part_above > 0.0 {
                let visible = self.visible(distance, origin, direction, tangent);
                seen += (1.0 - disc_occlusion(visible)).min(part_above);
                above += part_above;
            }
        }
        if above > 0.0 { 1.0 - seen / above } else { 0.0 }
    }
}

impl DistanceField {
    /// The share of a disc of the sky that the object hides from a position, of what is above the horizon of a surface with this
    /// unit normal, or of all of it if that is zero. Without noise. All are in the space of the distances.
    ///
    /// A receiver on the object's own surface is lifted out of it, and its surroundings are forgiven, as for
    /// [rays](crate::VisibilityField::occluded) with the same bias.
    ///
    /// ```
    /// use glam::Vec3;
    /// use visfield::distance::{DistanceField, cone::LightCone, example_ball};
    /// use visfield::field::query::Bias;
    /// let ball = DistanceField::Grid(example_ball());
    /// let (low, high) = ball.bounds();
    /// let below = (low + high) * 0.5 - Vec3::Y * (high - low);
    /// let cone = LightCone { direction: Vec3::Y, tangent: 0.1, t_light: f32::INFINITY };
    /// assert_eq!(ball.cone_occlusion(below, Vec3::ZERO, &cone, Bias::NONE), 1.0);
    /// let away = LightCone { direction: Vec3::NEG_Y, ..cone };
    /// assert_eq!(ball.cone_occlusion(below, Vec3::ZERO, &away, Bias::NONE), 0.0);
    /// ```
    pub fn cone_occlusion(&self, position: Vec3, normal: Vec3, cone: &LightCone, bias: Bias) -> f32 {
        let (march, origin) = self.cone_march(position, normal, cone.t_light, bias);
        march.occlusion(&|position| self.distance(position), origin, normal, cone)
    }

    /// The same by one edge alone, for cones of which many make up what is asked, as those that fill a hemisphere.
    pub fn edge_occlusion(&self, position: Vec3, normal: Vec3, cone: &LightCone, bias: Bias) -> f32 {
        let (march, origin) = self.cone_march(position, normal, cone.t_light, bias);
        march.edge_occlusion(&|position| self.distance(position), origin, normal, cone)
    }

    /// How cones from a position are marched, and where from.
    fn cone_march(&self, position: Vec3, normal: Vec3, t_light: f32, bias: Bias) -> (ConeMarch, Vec3) {
        let (low, high) = self.bounds();
        let (center, radius) = ((low + high) * 0.5, (high - low).length() * 0.5);
        let voxel = self.threshold() / GRID_THRESHOLD;
        let settings = SphereTracing {
            max_steps: MAX_STEPS,
            threshold: self.threshold(),
            slack: bias.height * SLACK * voxel,
            slack_reach: (bias.along * SLACK_REACH * voxel).max(LEAST_REACH),
            least_step: (LEAST_STEP * radius).min(WIDEST_STEP),
            ..SphereTracing::default()
        };
        let origin = lifted(position, normal, settings.slack, |position| self.distance(position));
        (ConeMarch { settings, start: START * voxel, center, radius, t_light }, origin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distance::{DistanceGridFormat, ball_grid};
    use crate::estimate::sampling::{DiscBasis, disc_samples, sphere_samples};
    use crate::field::query::Ray;

    const TANGENT: f32 = 0.1;

    fn march(slack: f32) -> ConeMarch {
        let settings =
            SphereTracing { max_steps: 200, threshold: 0.0, slack, least_step: 0.01, ..SphereTracing::default() };
        ConeMarch { settings, start: 0.1, center: Vec3::Y * 10.0, radius: 5.0, t_light: f32::INFINITY }
    }

    /// Of a light overhead, 0.1 radii wide for each unit of the way.
    fn overhead(distance: impl Fn(Vec3) -> f32, normal: Vec3) -> f32 {
        let cone = LightCone { direction: Vec3::Y, tangent: TANGENT, t_light: f32::INFINITY };
        march(0.0).occlusion(&distance, Vec3::ZERO, normal, &cone)
    }

    #[test]
    fn a_straight_edge_hides_its_segment_of_the_disc() {
        for i in -12..=12 {
            let height = i as f32 / 10.0;
            // Solid from a height of 10 on, and on one side of a plane through the receiver.
            let side = Vec3::new(-1.0, height * TANGENT, 0.0).normalize();
            let solid = |p: Vec3| p.dot(side).max(10.0 - p.y);
            let expected = super::super::covers::disc_coverage(height);
            let found = overhead(solid, Vec3::ZERO);
            assert!((found - expected).abs() < 0.06, "{height}: {found}, not {expected}");
        }
    }

    #[test]
    fn what_is_smaller_than_the_penumbra_hides_no_more_than_it_covers() {
        for radius in [0.2, 0.4, 0.7] {
            let ball = |p: Vec3| (p - Vec3::Y * 10.0).length() - radius;
            let (found, covered) = (overhead(ball, Vec3::ZERO), radius * radius);
            assert!((found - covered).abs() < 0.12, "{radius}: {found}, not {covered}");
            // One edge alone takes it for something large.
            let one = disc_occlusion(march(0.0).visible(&ball, Vec3::ZERO, Vec3::Y, TANGENT));
            assert!(one > 2.0 * covered - 0.1, "{radius}: {one}");
        }
    }

    #[test]
    fn light_below_the_horizon_is_not_counted() {
        // Tilted so far that the horizon goes through the disc's centre; a surface that is nothing but its own plane.
        for tilt in [-0.05_f32, 0.0, 0.05] {
            let normal = Vec3::new((1.0 - tilt * tilt).sqrt(), tilt, 0.0);
            let plane = |p: Vec3| p.dot(normal);
            assert!(overhead(plane, normal) < 0.01, "{tilt}: {}", overhead(plane, normal));
            // And half of what is above it behind a wall across: less, as each part of the light knows but one edge.
            let with_wall = |p: Vec3| plane(p).min(p.z.max(3.0 - p.y));
            assert!((overhead(with_wall, normal) - 0.5).abs() < 0.12, "{tilt}: {}", overhead(with_wall, normal));
        }
    }

    #[test]
    fn a_balls_surface_does_not_shadow_itself() {
        let field = DistanceField::Grid(ball_grid(1.0, DistanceGridFormat::DEFAULT));
        let grid = field.grid().expect("it is a grid");
        let (middle, radius) = ((field.bounds().0 + field.bounds().1) * 0.5, 1.0 / grid.header().voxel);
        for tangent in [0.005, 0.1] {
            let cone = LightCone { direction: Vec3::Y, tangent, t_light: f32::INFINITY };
            let share = |normal: Vec3| field.cone_occlusion(middle + normal * radius, normal, &cone, Bias::default());
            for normal in sphere_samples(2000) {
                // In between the light is lower than the grid is rough.
                if normal.y > 0.06 + 0.5 * tangent {
                    assert!(share(normal) < 0.02, "{tangent}, {normal}: {}", share(normal));
                } else if normal.y < -0.15 {
                    let without = field.cone_occlusion(middle + normal * radius, Vec3::ZERO, &cone, Bias::default());
                    assert_eq!((without, share(normal)), (1.0, 1.0), "{tangent}, {normal}");
                }
            }
        }
    }

    #[test]
    fn cones_agree_with_rays() {
        let field = DistanceField::Grid(ball_grid(1.0, DistanceGridFormat::DEFAULT));
        let grid = field.grid().expect("it is a grid");
        let (middle, radius) = ((field.bounds().0 + field.bounds().1) * 0.5, 1.0 / grid.header().voxel);
        let direction = Vec3::new(0.3, 0.9, 0.2).normalize();
        let disc = DiscBasis::new(direction, TANGENT.atan());
        let cone = LightCone { direction, tangent: TANGENT, t_light: f32::INFINITY };
        let (mut errors, mut partly) = (0.0, 0);
        for i in 0..400 {
            let place = Vec3::new((i % 20) as f32 - 10.0, -20.0, (i / 20) as f32 - 10.0) * 0.14 - direction * 0.3;
            let position = middle + place * radius;
            let hidden =
                |point: &Vec2| field.occluded(&Ray::new(position, disc.direction(*point)), Vec3::ZERO, Bias::NONE);
            let rays = disc_samples(256).iter().filter(|point| hidden(point)).count() as f32 / 256.0;
            let found = field.cone_occlusion(position, Vec3::ZERO, &cone, Bias::NONE);
            if rays.max(found) > 0.0 && rays.min(found) < 1.0 {
                (errors, partly) = (errors + (rays - found).abs(), partly + 1);
            }
        }
        assert!(partly > 40 && errors / partly as f32 <= 0.02, "{} of {partly}", errors / partly as f32);
        // What the light is in front of hides nothing.
        let below = middle - direction * (3.0 * radius);
        let near = LightCone { t_light: radius, ..cone };
        assert_eq!(field.cone_occlusion(below, Vec3::ZERO, &cone, Bias::NONE), 1.0);
        assert_eq!(field.cone_occlusion(below, Vec3::ZERO, &near, Bias::NONE), 0.0);
    }

    #[test]
    fn nothing_hangs_on_what_is_no_number() {
        for wrong in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let found = overhead(|_| wrong, Vec3::Y);
            assert!((0.0..=1.0).contains(&found), "{wrong}: {found}");
        }
    }
}
