//! What a point sees of the mesh.

use glam::{Quat, Vec3};
use visfield::estimate::sampling::sphere_samples;
use visfield::field::cap_grid::Falloff;
use visfield::field::cap_grid::harmonics::{MAX_COEFFICIENTS, harmonics};

use super::{Surroundings, WHOLE};

/// Share of occluded directions above which a point may lie inside the mesh. Many closed-looking meshes have holes that light
/// gets in by; what stands behind a sheet sees more than this.
const ENCLOSED: f32 = 0.9;
/// Rays that decide whether it does.
const INSIDE_RAYS: u32 = 64;

/// A point, and the harmonics of the directions in which it sees the mesh.
#[derive(Clone)]
pub(super) struct View {
    pub(super) position: Vec3,
    pub(super) coefficients: [f32; MAX_COEFFICIENTS],
    /// Whether the point lies in the solid that the mesh's triangles enclose, where nobody looks.
    pub(super) inside: bool,
}

impl View {
    pub(super) fn scale(&mut self, factor: f32) {
        self.coefficients = self.coefficients.map(|x| x * factor);
    }
}

impl Surroundings {
    /// Looks at the mesh along `rays` directions, a pattern that is turned by `turn`. From outside its bounding sphere all of
    /// them go towards that.
    pub(super) fn view(&self, position: Vec3, rays: u32, turn: Quat) -> View {
        let (directions, solid_angle) = self.directions(position, rays, turn);
        let mut coefficients = [0.0; MAX_COEFFICIENTS];
        let mut hit = 0.0;
        for &direction in &directions {
            let weight = self.weight(position, direction);
            if weight > 0.0 {
                hit += weight;
                coefficients.iter_mut().zip(harmonics(direction)).for_each(|(sum, y)| *sum += weight * y);
            }
        }
        let per_ray = solid_angle / rays as f32;
        coefficients = coefficients.map(|x| x * per_ray);
        let enclosed = hit * per_ray > ENCLOSED * WHOLE || self.falloff != Falloff::None;
        View { position, coefficients, inside: enclosed && self.is_inside(position) }
    }

    /// How much the mesh occludes in a direction.
    pub(super) fn weight(&self, position: Vec3, direction: Vec3) -> f32 {
        if self.falloff == Falloff::None {
            f32::from(u8::from(self.bvh.occluded(position, direction, 0.0, f32::INFINITY)))
        } else {
            let hit = self.bvh.closest_hit(position, direction, f32::INFINITY);
            hit.map_or(0.0, |distance| self.falloff.weight(distance * self.scale))
        }
    }

    /// An even pattern of directions that can meet the mesh, and the solid angle that they cover.
    pub(super) fn directions(&self, position: Vec3, rays: u32, turn: Quat) -> (Vec<Vec3>, f32) {
        let distance = position.length();
        let pattern = sphere_samples(rays).into_iter();
        if distance <= self.radius {
            return (pattern.map(|d| turn * d).collect(), WHOLE);
        }
        let sine = self.radius / distance;
        let lowest = (1.0 - sine * sine).max(0.0).sqrt();
        // 1 − cos without the cancellation that a distant mesh would suffer.
        let depth = sine * sine / (1.0 + lowest);
        let axis = -position / distance;
        let (tangent, bitangent) = axis.any_orthonormal_pair();
        let spin = (turn * Vec3::X).truncate().normalize_or(glam::Vec2::X);
        let in_cone = |d: Vec3| {
            // z of the pattern is even from −1 to 1, and so is the cosine to the axis between `lowest` and 1.
            let below = depth * 0.5 * (1.0 - d.z);
            let radius = (below * (2.0 - below)).sqrt();
            let around = spin.rotate(d.truncate().normalize_or(glam::Vec2::X)) * radius;
            axis * (1.0 - below) + tangent * around.x + bitangent * around.y
        };
        (pattern.map(in_cone).collect(), WHOLE * 0.5 * depth)
    }

    /// Whether a point is enclosed, and sees most of what encloses it from behind.
    pub(super) fn is_inside(&self, position: Vec3) -> bool {
        let (mut hits, mut behind) = (0, 0);
        for direction in sphere_samples(INSIDE_RAYS) {
            if let Some((_, normal)) = self.bvh.closest_hit_normal(position, direction, f32::INFINITY) {
                hits += 1;
                behind += u32::from(normal.dot(direction) > 0.0);
            }
        }
        hits as f32 > ENCLOSED * INSIDE_RAYS as f32 && behind * 2 > hits
    }
}
