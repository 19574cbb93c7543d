//! What can matter within a part of the viewport: the twin of the tests in `shaders/tiles.wgsl`.
//!
//! They may let through what does not matter, but never drop what does: a ray that an instance blocks is blocked with lists as it
//! is without.

use glam::Vec3;

use crate::estimate::light::{Light, LightKind, SMALLEST_DISTANCE, WIDEST_SINE};
use crate::field::cap_grid::cap::CUTOFF;

/// Boxes around the positions and the normals of a few receivers.
///
/// ```
/// use glam::Vec3;
/// use visfield::estimate::frame::tiles::Bounds;
/// let ground = Bounds::EMPTY.with(Vec3::ZERO, Vec3::Y).with(Vec3::X, Vec3::Y);
/// assert!(ground.above_surface(Vec3::Y * 3.0, 1.0) && !ground.above_surface(Vec3::Y * -3.0, 1.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates of the positions.
    pub low: Vec3,
    /// Largest coordinates of the positions.
    pub high: Vec3,
    /// Smallest components of the normals.
    pub normal_low: Vec3,
    /// Largest components of the normals.
    pub normal_high: Vec3,
}

impl Bounds {
    /// Around no receivers.
    pub const EMPTY: Self = Self {
        low: Vec3::INFINITY,
        high: Vec3::NEG_INFINITY,
        normal_low: Vec3::INFINITY,
        normal_high: Vec3::NEG_INFINITY,
    };

    /// Around one more receiver.
    #[must_use]
    pub fn with(self, position: Vec3, normal: Vec3) -> Self {
        Self {
            low: self.low.min(position),
            high: self.high.max(position),
            normal_low: self.normal_low.min(normal),
            normal_high: self.normal_high.max(normal),
        }
    }

    /// Whether a sphere can block any ray of the hemisphere of any of the receivers: the largest that its centre's height above
    /// a receiver's surface can be, by intervals.
    pub fn above_surface(&self, center: Vec3, radius: f32) -> bool {
        let (nearest, farthest) = (center - self.high, center - self.low);
        let largest = |offset: Vec3| (offset * self.normal_low).max(offset * self.normal_high);
        largest(nearest).max(largest(farthest)).element_sum() > -radius
    }

    /// Whether a sphere is near enough to occlude ambient light of any of the receivers.
    pub fn reached(&self, center: Vec3, radius: f32, max_distance: f32) -> bool {
        let outside = (self.low - center).max(center - self.high).max(Vec3::ZERO);
        within_reach(outside, radius, max_distance)
    }

    /// Whether a sphere can block any ray from any of the receivers to a light. Such rays lie in the hull of a ball around the
    /// receivers and one around the light, or in the cone of a directional light around the first.
    pub fn meet_light(&self, light: &Light, center: Vec3, radius: f32) -> bool {
        let middle = (self.low + self.high) * 0.5;
        let spread = (self.high - self.low).length() * 0.5;
        let (to_center, grown) = (center - middle, radius + spread);
        if light.kind == LightKind::Directional {
            return light.seen_from(middle).meets(to_center, grown);
        }
        let to_light = light.origin - middle;
        let distance = to_light.length();
        // The disc that a sphere shows is a little larger than the sphere.
        let shown = (light.radius / (distance - spread).max(SMALLEST_DISTANCE)).min(WIDEST_SINE);
        let ball = light.radius / (1.0 - shown * shown).sqrt();
        let sine = (ball - spread) / distance;
        // One ball within the other, or no distance at all, where it is not a number.
        let apart = sine.abs() < 1.0;
        if !apart {
            return true;
        }
        let along = to_center.dot(to_light) / distance;
        let across = (to_center - to_light * (along / distance)).length();
        distance - spread < light.range
            && along > -grown
            && along < distance + ball + radius
            && across * (1.0 - sine * sine).sqrt() - along * sine < grown
    }
}

/// Whether a sphere is near enough, and large enough for its distance, to occlude ambient light.
pub(super) fn within_reach(to_center: Vec3, radius: f32, max_distance: f32) -> bool {
    let squared = to_center.dot(to_center);
    squared.sqrt() - radius < max_distance && radius * radius > CUTOFF * squared
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::frame::trace::above_surface;
    use crate::estimate::sampling::{disc_samples, sphere_samples, square_samples};
    use glam::{Vec2, vec3};

    /// A few receivers near a place, with like normals.
    fn receivers(place: Vec3, spread: f32) -> Vec<(Vec3, Vec3)> {
        let points = sphere_samples(12).into_iter();
        points.map(|p| (place + p * spread, (vec3(0.2, 1.0, 0.1) + p * 0.3).normalize())).collect()
    }

    #[test]
    fn what_matters_to_a_receiver_matters_to_its_tile() {
        let lights = [
            Light::directional(vec3(0.6, 0.8, 0.0), 0.3),
            Light::sphere(vec3(0.5, 2.0, 0.3), 0.4, 3.0),
            Light::sphere(vec3(0.1, 0.3, 0.1), 0.5, 3.0),
            Light::rectangle(vec3(0.0, 2.0, 0.0), Vec3::X * 1.5, Vec3::Z * 0.2, -Vec3::Y, 10.0),
        ];
        let (mut met, mut tests) = (0, 0);
        for (place, spread) in [(Vec3::ZERO, 0.2), (vec3(0.3, 1.2, 0.0), 0.6), (vec3(-4.0, 0.0, 1.0), 0.05)] {
            let receivers = receivers(place, spread);
            let bounds = receivers.iter().fold(Bounds::EMPTY, |bounds, (p, n)| bounds.with(*p, *n));
            for center in sphere_samples(200).into_iter().enumerate().map(|(i, p)| p * (0.3 + 0.02 * i as f32)) {
                let radius = 0.25;
                for (position, normal) in &receivers {
                    let to_center = center - *position;
                    if within_reach(to_center, radius, 1.5) {
                        assert!(bounds.reached(center, radius, 1.5));
                    }
                    if above_surface(to_center, radius, *normal) {
                        assert!(bounds.above_surface(center, radius));
                    }
                    for light in &lights {
                        let view = light.seen_from(*position);
                        let blocks = |point: &Vec2| {
                            let direction = view.direction(*point);
                            let t = (to_center.dot(direction) / direction.length_squared()).clamp(0.0, view.t_max);
                            (to_center - direction * t).length() < radius
                        };
                        let points =
                            if light.kind == LightKind::Rectangle { square_samples(32) } else { disc_samples(32) };
                        if light.shines_on(&view, *normal) && points.iter().any(blocks) {
                            assert!(bounds.meet_light(light, center, radius), "{light:?}, {position}, {center}");
                            met += 1;
                        }
                        tests += 1;
                    }
                }
            }
        }
        assert!(met > tests / 100, "{met} of {tests}");
    }

    #[test]
    fn much_does_not_matter() {
        let bounds = receivers(Vec3::ZERO, 0.1).iter().fold(Bounds::EMPTY, |bounds, (p, n)| bounds.with(*p, *n));
        let bulb = Light::sphere(Vec3::Y * 5.0, 0.1, 10.0);
        assert!(bounds.meet_light(&bulb, Vec3::Y * 3.0, 0.5));
        assert!(!bounds.meet_light(&bulb, vec3(1.0, 3.0, 0.0), 0.5), "beside the way");
        assert!(!bounds.meet_light(&bulb, Vec3::Y * 7.0, 0.5), "behind the light");
        assert!(!bounds.meet_light(&bulb, Vec3::Y * -2.0, 0.5), "behind the receivers");
        assert!(!bounds.meet_light(&Light::sphere(Vec3::Y * 5.0, 0.1, 4.0), Vec3::Y * 3.0, 0.5), "too dark");
        assert!(!bounds.reached(vec3(3.0, 0.0, 0.0), 0.5, 2.0) && bounds.reached(vec3(2.5, 0.0, 0.0), 0.5, 2.0));
        assert!(!bounds.reached(vec3(30.0, 0.0, 0.0), 0.5, f32::INFINITY), "too small for its distance");
        let wide = receivers(Vec3::ZERO, 40.0).iter().fold(Bounds::EMPTY, |bounds, (p, n)| bounds.with(*p, *n));
        assert!(wide.reached(Vec3::ZERO, 0.5, 2.0), "within the bounds");
    }
}
