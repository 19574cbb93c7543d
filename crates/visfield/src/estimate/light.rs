//! Lights with a size, as receivers see them: the twin of `shaders/light.wgsl`.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::cones::ConeDisc;
use super::sampling::DiscBasis;
use super::source::{Answers, LARGE_LIGHT, OcclusionSource, Wanted};
use crate::field::VisibilityField;

/// What shape a light has, as shaders know it.
///
/// ```
/// use visfield::estimate::light::{Light, LightKind};
/// assert_eq!(Light::directional(glam::Vec3::Y, 0.1).kind, LightKind::Directional);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum LightKind {
    /// A disc in the sky.
    Directional = 0,
    /// A ball that shines to all sides, or within a cone.
    Sphere = 1,
    /// A rectangle that shines to one side.
    Rectangle = 2,
}

/// A light with a size, at a place relative to the camera. What is computed of it is how much of its surface a receiver sees;
/// how bright it is there is the renderer's business.
///
/// ```
/// use glam::Vec3;
/// use visfield::estimate::light::Light;
/// let sun = Light::directional(Vec3::Y, 0.00465);
/// let bulb = Light::sphere(Vec3::new(0.0, 3.0, 0.0), 0.05, 20.0);
/// let view = bulb.seen_from(Vec3::ZERO);
/// assert!((view.sine - 0.05 / 3.0).abs() < 1e-6);
/// assert!(sun.shines_on(&sun.seen_from(Vec3::ZERO), Vec3::Y) && bulb.shines_on(&view, Vec3::Y));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Its shape.
    pub kind: LightKind,
    /// The unit vector towards it, of a directional light; otherwise its centre.
    pub origin: Vec3,
    /// Of a directional light, a tangent of its disc, as long as the disc's radius at distance 1; of a rectangle, half a side.
    pub tangent: Vec3,
    /// The other one.
    pub bitangent: Vec3,
    /// Sine of a disc's angular radius; radius of a ball; half the diagonal of a rectangle.
    pub radius: f32,
    /// How far it shines.
    pub range: f32,
    /// The direction in which spots and rectangles shine.
    pub emission: Vec3,
    /// Cosine of a disc's angular radius; of a spot's outer angle, −2 for a ball that shines to all sides; 0 for a rectangle.
    pub cosine: f32,
}

/// A light from one point.
///
/// ```
/// use glam::{Vec2, Vec3};
/// let view = visfield::estimate::light::Light::directional(Vec3::Y, 0.1).seen_from(Vec3::ZERO);
/// assert_eq!(view.direction(Vec2::ZERO), Vec3::Y);
/// assert!(view.meets(Vec3::Y * 5.0, 1.0) && !view.meets(Vec3::X * 5.0, 1.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightView {
    /// To its centre; towards directional lights it is 1 long.
    pub to_center: Vec3,
    /// From the centre to its edge.
    pub tangent: Vec3,
    /// From the centre to its edge, across.
    pub bitangent: Vec3,
    /// Where rays towards it end, as a multiple of their direction.
    pub t_max: f32,
    /// Axis of a cone that holds all of the light.
    pub axis: Vec3,
    /// Sine of the cone's half-angle.
    pub sine: f32,
    /// Its cosine. Below 0 means: the light may be anywhere.
    pub cosine: f32,
    /// Areas of a round disc with these radii that the light's is: 4/π of a rectangle.
    pub areas: f32,
    /// What is beyond it is not between the receiver and the light.
    pub distance: f32,
}

/// Largest sine of the cone that a ball is seen in; nearer receivers, and those in it, see a disc of that size.
pub(super) const WIDEST_SINE: f32 = 0.932_039_1;

/// Tangents of the half-angles of discs that stand for lights: none is so small that it is a point, nor a hemisphere.
const SMALLEST_TANGENT: f32 = 1.0e-3;
const LARGEST_TANGENT: f32 = 1.0e3;

/// Stands for no distance at all.
pub(super) const SMALLEST_DISTANCE: f32 = 1.0e-18;

/// Stands for infinity, which WGSL has no portable word for.
const ENDLESS: f32 = 3.0e38;

impl Light {
    /// A disc in the sky: the unit vector towards it, and half the angle that it covers, in radians, which is
    /// [clamped](DiscBasis::clamp_angular_radius).
    pub fn directional(to_light: Vec3, angular_radius: f32) -> Self {
        let angular_radius = DiscBasis::clamp_angular_radius(angular_radius);
        let disc = DiscBasis::new(to_light, angular_radius);
        let (sine, cosine) = angular_radius.sin_cos();
        Self {
            kind: LightKind::Directional,
            origin: to_light,
            tangent: disc.tangent,
            bitangent: disc.bitangent,
            radius: sine,
            range: ENDLESS,
            emission: Vec3::ZERO,
            cosine,
        }
    }

    /// A ball that shines to all sides, up to a distance.
    pub fn sphere(center: Vec3, radius: f32, range: f32) -> Self {
        Self {
            kind: LightKind::Sphere,
            origin: center,
            tangent: Vec3::ZERO,
            bitangent: Vec3::ZERO,
            radius: radius.max(0.0),
            range: range.min(ENDLESS),
            emission: Vec3::ZERO,
            cosine: -2.0,
        }
    }

    /// A ball that shines within `outer_angle` (radians) of a unit direction.
    pub fn spot(center: Vec3, radius: f32, range: f32, direction: Vec3, outer_angle: f32) -> Self {
        Self { emission: direction, cosine: outer_angle.cos(), ..Self::sphere(center, radius, range) }
    }

    /// A rectangle: half its sides, and the unit vector that it shines along, up to a distance.
    pub fn rectangle(center: Vec3, half_width: Vec3, half_height: Vec3, direction: Vec3, range: f32) -> Self {
        Self {
            kind: LightKind::Rectangle,
            tangent: half_width,
            bitangent: half_height,
            emission: direction,
            cosine: 0.0,
            ..Self::sphere(center, (half_width + half_height).length().max((half_width - half_height).length()), range)
        }
    }

    /// Whether cap grids can hide it: a disc of [`LARGE_LIGHT`] or more.
    pub fn is_large(&self) -> bool {
        self.kind == LightKind::Directional && self.cosine <= LARGE_LIGHT.cos()
    }

    /// The part of a field to ask for it.
    pub fn source(&self, field: &VisibilityField, wanted: Wanted) -> OcclusionSource {
        let answers = Answers::of(field);
        if self.is_large() { answers.large_lights(wanted) } else { answers.small_lights(wanted) }
    }

    /// Whether it is one that passes can compute with; others are to be left out.
    pub fn is_finite(&self) -> bool {
        let vectors = [self.origin, self.tangent, self.bitangent, self.emission];
        vectors.iter().all(|v| v.is_finite()) && [self.radius, self.range, self.cosine].iter().all(|x| x.is_finite())
    }

    /// The light as a receiver at a position sees it.
    pub fn seen_from(&self, position: Vec3) -> LightView {
        if self.kind == LightKind::Directional {
            return LightView {
                to_center: self.origin,
                tangent: self.tangent,
                bitangent: self.bitangent,
                t_max: ENDLESS,
                axis: self.origin,
                sine: self.radius,
                cosine: self.cosine,
                areas: 1.0,
                distance: ENDLESS,
            };
        }
        let to_center = self.origin - position;
        let distance = to_center.length().max(SMALLEST_DISTANCE);
        let axis = to_center / distance;
        let sine = (self.radius / distance).min(WIDEST_SINE);
        let cosine = (1.0 - sine * sine).sqrt();
        let farthest = distance + self.radius;
        if self.kind == LightKind::Sphere {
            // The disc that the ball shows.
            let radius = distance * sine / cosine;
            let [tangent, bitangent] = orthonormal_pair(axis).map(|tangent| tangent * radius);
            return LightView {
                to_center,
                tangent,
                bitangent,
                t_max: 1.0,
                axis,
                sine,
                cosine,
                areas: 1.0,
                distance: farthest,
            };
        }
        let all = self.radius >= distance * WIDEST_SINE;
        LightView {
            to_center,
            tangent: self.tangent,
            bitangent: self.bitangent,
            t_max: 1.0,
            axis,
            sine: if all { 0.0 } else { sine },
            cosine: if all { -1.0 } else { cosine },
            areas: 4.0 / PI,
            distance: farthest,
        }
    }

    /// Whether any of its light falls on a surface with this unit normal, as seen from there: balls and discs count by their
    /// centre, as renderers shade them.
    pub fn shines_on(&self, view: &LightView, normal: Vec3) -> bool {
        let mut above = normal.dot(view.to_center);
        if self.kind == LightKind::Rectangle {
            above += normal.dot(view.tangent).abs() + normal.dot(view.bitangent).abs();
        }
        let directional = self.kind == LightKind::Directional;
        let emitted = directional || self.emission.dot(-view.axis) > self.cosine;
        let within = directional || view.distance - self.radius < self.range;
        above > 0.0 && emitted && within
    }
}

impl LightView {
    /// The direction to a point of the light, given as a point of the unit disc or, for rectangles, of the square from −1 to 1.
    /// It is as long as the way there is; for directional lights that is of no meaning.
    pub fn direction(&self, point: Vec2) -> Vec3 {
        self.to_center + self.tangent * point.x + self.bitangent * point.y
    }

    /// The round disc that stands for the light to a surface with this unit normal: as large as it shows itself, of a rectangle by the
    /// area that it shows. Of one whose centre is below the surface's horizon, the highest quarter stands for what is above.
    pub fn disc(&self, normal: Vec3) -> ConeDisc {
        let raise = |side: Vec3| side * if normal.dot(side) < 0.0 { -0.5 } else { 0.5 };
        let below = normal.dot(self.to_center) <= 0.0;
        let raised = self.to_center + raise(self.tangent) + raise(self.bitangent);
        let (to_disc, share) = if below { (raised, 0.25) } else { (self.to_center, 1.0) };
        let distance = to_disc.length().max(SMALLEST_DISTANCE);
        let direction = to_disc / distance;
        let area = self.tangent.cross(self.bitangent).dot(direction).abs() * self.areas * share;
        let tangent = (area.sqrt() / distance).clamp(SMALLEST_TANGENT, LARGEST_TANGENT);
        ConeDisc { direction, tangent, distance: if self.t_max == ENDLESS { ENDLESS } else { distance } }
    }

    /// Whether a sphere, by its centre relative to the receiver, can block any ray towards the light.
    pub fn meets(&self, to_center: Vec3, radius: f32) -> bool {
        let along = to_center.dot(self.axis);
        let across = (to_center - self.axis * along).length();
        let in_cone = along > -radius && across * self.cosine - along * self.sine < radius;
        (in_cone || self.cosine < 0.0) && along - radius < self.distance
    }
}

/// Two unit vectors across a unit vector and each other (Duff et al. 2017, *Building an Orthonormal Basis, Revisited*).
pub(crate) fn orthonormal_pair(axis: Vec3) -> [Vec3; 2] {
    let sign = if axis.z >= 0.0 { 1.0 } else { -1.0 };
    let a = -1.0 / (sign + axis.z);
    let b = axis.x * axis.y * a;
    [
        Vec3::new(1.0 + sign * axis.x * axis.x * a, sign * b, -sign * axis.x),
        Vec3::new(b, sign + axis.y * axis.y * a, -axis.y),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::sampling::{disc_samples, sphere_samples, square_samples};
    use glam::vec3;

    fn lights() -> [Light; 5] {
        [
            Light::directional(vec3(0.6, 0.8, 0.0), 0.1),
            Light::sphere(vec3(0.5, 2.0, 0.3), 0.4, 10.0),
            Light::spot(vec3(0.5, 2.0, 0.3), 0.0, 10.0, -Vec3::Y, 0.6),
            Light::rectangle(vec3(0.0, 2.0, 0.0), Vec3::X * 1.5, Vec3::Z * 0.2, -Vec3::Y, 10.0),
            Light::sphere(Vec3::ZERO, 1.0, 10.0),
        ]
    }

    #[test]
    fn a_sphere_that_a_ray_meets_is_never_passed_over() {
        for light in lights() {
            for position in sphere_samples(40) {
                let view = light.seen_from(position * 1.3);
                let points = if light.kind == LightKind::Rectangle { square_samples(64) } else { disc_samples(64) };
                for to_center in sphere_samples(60).into_iter().map(|p| p * 1.7) {
                    let nearest = |point: &Vec2| {
                        let direction = view.direction(*point);
                        let end = if light.kind == LightKind::Directional { 1.0e6 } else { 1.0 };
                        let t = (to_center.dot(direction) / direction.length_squared()).clamp(0.0, end);
                        (to_center - direction * t).length()
                    };
                    let radius = points.iter().map(nearest).fold(f32::INFINITY, f32::min) * 1.001;
                    assert!(view.meets(to_center, radius), "{light:?} from {position}, {to_center}");
                }
            }
        }
    }

    #[test]
    fn a_ball_is_seen_as_the_disc_that_it_shows() {
        let view = Light::sphere(Vec3::Y * 2.0, 0.5, 10.0).seen_from(Vec3::ZERO);
        let edge = view.direction(Vec2::X).angle_between(Vec3::Y);
        assert!((edge.sin() - 0.25).abs() < 1e-5, "{edge}");
        assert!(view.tangent.dot(view.bitangent).abs() < 1e-6);
        // From within, and from its very centre, directions stay finite.
        for position in [Vec3::Y * 2.0, vec3(0.0, 2.1, 0.0)] {
            let view = Light::sphere(Vec3::Y * 2.0, 0.5, 10.0).seen_from(position);
            assert!(view.direction(Vec2::ONE).is_finite() && view.meets(Vec3::ZERO, 0.1));
        }
    }

    #[test]
    fn light_falls_where_it_is_aimed() {
        let [_, ball, spot, rectangle, _] = lights();
        let falls = |light: &Light, x: f32, y: f32, normal| light.shines_on(&light.seen_from(vec3(x, y, 0.3)), normal);
        assert!(falls(&ball, 0.5, 0.0, Vec3::Y) && !falls(&ball, 0.5, 0.0, -Vec3::Y));
        assert!(!falls(&ball, 0.5, -9.0, Vec3::Y), "beyond its range");
        assert!(falls(&spot, 1.5, 0.0, Vec3::Y) && !falls(&spot, 2.5, 0.0, Vec3::Y));
        assert!(falls(&rectangle, 0.0, 0.0, Vec3::Y) && !falls(&rectangle, 0.0, 3.0, -Vec3::Y), "it has a back");
        // Its centre is below this horizon, a corner is not.
        assert!(falls(&rectangle, 0.5, 0.0, vec3(0.97, 0.1, 0.0)) && falls(&rectangle, 1.0, 1.9, vec3(0.97, 0.1, 0.0)));
    }
}
