//! Ambient occlusion and the visibility of a directional light at a point, by many rays against a [`Scene`]: the estimator for
//! anything that is not a pixel (light probes, gameplay). [`frame`] has whole frames, and [`light`] lights of every kind.

pub mod caps;
pub mod cones;
mod falloff;
pub mod frame;
pub mod harmonic_visibility;
pub mod light;
pub mod sampling;
pub mod source;

use glam::{DVec3, Vec3};

use crate::field::VisibilityField;
use crate::field::query::{Bias, QueryOptions, Ray};
use crate::scene::{Placement, Scene};
use sampling::{DiscBasis, disc_samples, sphere_samples};

pub use falloff::Falloff;

/// A surface point that gets occlusion and shadows.
///
/// ```
/// use glam::{DVec3, Vec3};
/// let ground = visfield::estimate::Receiver { position: DVec3::ZERO, normal: Vec3::Y };
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receiver {
    /// Where it is, in the world.
    pub position: DVec3,
    /// Its unit normal.
    pub normal: Vec3,
}

/// How ambient occlusion is estimated.
///
/// ```
/// use visfield::estimate::AmbientOcclusion;
/// let nearby = AmbientOcclusion { max_distance: 2.0, ..AmbientOcclusion::default() };
/// assert_eq!(nearby.rays, 64);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AmbientOcclusion {
    /// Rays over the hemisphere, cosine-distributed, at least 1.
    pub rays: u32,
    /// Hits beyond this distance, in world units, do not count. Infinity counts all.
    pub max_distance: f32,
    /// How near to the receiver hits do not count.
    pub bias: Bias,
}

impl Default for AmbientOcclusion {
    fn default() -> Self {
        Self { rays: 64, max_distance: f32::INFINITY, bias: Bias::default() }
    }
}

/// How a directional light's soft shadow is estimated.
///
/// ```
/// use visfield::estimate::DirectionalShadow;
/// let sun = DirectionalShadow::new(glam::Vec3::Y, 0.00465);
/// assert_eq!(sun.rays, 64);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionalShadow {
    /// Unit vector towards the light.
    pub to_light: Vec3,
    /// Half of the angle that the light's disc covers in the sky, in radians, 0 to
    /// [`DiscBasis::MAX_ANGULAR_RADIUS`]. The sun's is 0.00465.
    pub angular_radius: f32,
    /// Rays over the disc, at least 1.
    pub rays: u32,
    /// How near to the receiver hits do not count.
    pub bias: Bias,
}

impl DirectionalShadow {
    /// A light with the default number of rays and bias.
    pub fn new(to_light: Vec3, angular_radius: f32) -> Self {
        Self { to_light, angular_radius, rays: 64, bias: Bias::default() }
    }

    /// The directions to the disc's samples that lie above the horizon of a receiver with this unit normal.
    pub fn rays_above(&self, normal: Vec3) -> Vec<Vec3> {
        let disc = DiscBasis::new(self.to_light, self.angular_radius);
        let directions = disc_samples(self.rays.max(1)).into_iter().map(|sample| disc.direction(sample));
        directions.filter(|direction| normal.dot(*direction) > 0.0).collect()
    }
}

/// The cosine-weighted fraction of the receiver's hemisphere that is occluded, in [0, 1] (2010, §2.1, as occlusion).
pub fn ambient_occlusion(scene: &Scene, receiver: &Receiver, settings: &AmbientOcclusion) -> f32 {
    let placements = scene.place(receiver.position);
    let occluders = facing(&placements, receiver.normal);
    let rays = settings.rays.max(1);
    let directions: Vec<Vec3> =
        sphere_samples(rays).into_iter().map(|sample| cosine_direction(receiver.normal, sample)).collect();
    blocked_share(&occluders, directions, settings.max_distance, settings.bias)
}

/// The fraction of the light's disc that the receiver sees, of what is above its horizon, in [0, 1]; 1 for receivers that
/// face away, which the light's own cosine already leaves dark.
pub fn directional_visibility(scene: &Scene, receiver: &Receiver, light: &DirectionalShadow) -> f32 {
    if receiver.normal.dot(light.to_light) <= 0.0 {
        return 1.0;
    }
    let placements = scene.place(receiver.position);
    let occluders = facing(&placements, receiver.normal);
    let rays = light.rays_above(receiver.normal);
    1.0 - blocked_share(&occluders, rays, f32::INFINITY, light.bias)
}

/// Placements that were made relative to a receiver, as it sees them.
fn facing<'a>(placements: &'a [(Placement, &'a VisibilityField)], normal: Vec3) -> Vec<FacingOccluder<'a>> {
    placements.iter().map(|(placement, field)| FacingOccluder::new(placement, field, Vec3::ZERO, normal)).collect()
}

/// The share of rays that any of the occluders blocks.
fn blocked_share(occluders: &[FacingOccluder], directions: Vec<Vec3>, t_max: f32, bias: Bias) -> f32 {
    let count = directions.len();
    let mut unblocked = directions;
    for occluder in occluders {
        unblocked = occluder.unblocked(unblocked, t_max, bias);
    }
    (count - unblocked.len()) as f32 / count.max(1) as f32
}

/// A direction of the hemisphere around `normal`, cosine-distributed if `sample` is uniform on the unit sphere: the
/// tangent sphere's points seen from the surface. Needs no tangent frame.
#[inline]
pub fn cosine_direction(normal: Vec3, sample: Vec3) -> Vec3 {
    let direction = normal + sample;
    let squared = direction.dot(direction);
    // The one sample opposite to the normal has no direction of its own.
    if squared > 1.0e-8 { direction / squared.sqrt() } else { normal }
}

/// An occluder as one receiver sees it: the receiver in the occluder's field space.
struct FacingOccluder<'a> {
    placement: &'a Placement,
    field: &'a VisibilityField,
    origin: Vec3,
    normal: Vec3,
}

impl<'a> FacingOccluder<'a> {
    /// `position` is relative to the placement's chosen origin.
    fn new(placement: &'a Placement, field: &'a VisibilityField, position: Vec3, normal: Vec3) -> Self {
        let origin = placement.field_from_world.transform_point3(position);
        Self { placement, field, origin, normal: placement.field_normal(normal) }
    }

    /// Whether it blocks the ray from the receiver in a direction of the world.
    fn blocks(&self, direction: Vec3, t_max: f32, bias: Bias) -> bool {
        self.field.occluded(&self.ray(direction, t_max), &self.options(bias))
    }

    /// The directions that it does not block.
    fn unblocked(&self, mut directions: Vec<Vec3>, t_max: f32, bias: Bias) -> Vec<Vec3> {
        let rays: Vec<Ray> = directions.iter().map(|&direction| self.ray(direction, t_max)).collect();
        let mut occluded = vec![false; rays.len()];
        self.field.occluded_batch(&rays, &self.options(bias), &mut occluded);
        let mut occluded = occluded.into_iter();
        directions.retain(|_| occluded.next() == Some(false));
        directions
    }

    fn ray(&self, direction: Vec3, t_max: f32) -> Ray {
        Ray { origin: self.origin, direction: self.placement.field_from_world.transform_vector3(direction), t_max }
    }

    fn options(&self, bias: Bias) -> QueryOptions {
        QueryOptions { normal: self.normal, bias, ..QueryOptions::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::ball_field;
    use crate::scene::Instance;
    use glam::{DAffine3, DQuat, dvec3};

    fn ball_above_ground(height: f64) -> Scene {
        let mut scene = Scene::default();
        let ball = scene.add_field(ball_field(0.9, 65, 32));
        scene.instances.push(Instance::new(ball, DAffine3::from_translation(dvec3(0.0, height, 0.0))));
        scene
    }

    const GROUND: Receiver = Receiver { position: DVec3::ZERO, normal: Vec3::Y };

    #[test]
    fn a_ball_overhead_occludes_its_solid_angle() {
        // A sphere of radius r straight above at height h covers r²/h² of the cosine-weighted hemisphere.
        for height in [1.5, 2.0, 4.0] {
            let settings = AmbientOcclusion { rays: 4096, ..AmbientOcclusion::default() };
            let occlusion = ambient_occlusion(&ball_above_ground(height), &GROUND, &settings);
            let exact = (0.9 * 0.9 / (height * height)) as f32;
            assert!((occlusion - exact).abs() < 0.01, "height {height}: {occlusion}, exactly {exact}");
        }
    }

    #[test]
    fn max_distance_forgets_what_is_beyond() {
        let near = AmbientOcclusion { max_distance: 0.5, ..AmbientOcclusion::default() };
        assert_eq!(ambient_occlusion(&ball_above_ground(2.0), &GROUND, &near), 0.0);
        assert!(ambient_occlusion(&ball_above_ground(1.2), &GROUND, &near) > 0.2);
        // Here the bounding sphere begins within reach, and the ball in it does not.
        let mut scene = Scene::default();
        let small = scene.add_field(ball_field(0.5, 65, 32));
        scene.instances.push(Instance::new(small, DAffine3::from_translation(dvec3(0.0, 1.2, 0.0))));
        assert_eq!(ambient_occlusion(&scene, &GROUND, &near), 0.0);
        assert!(ambient_occlusion(&scene, &GROUND, &AmbientOcclusion::default()) > 0.1);
    }

    #[test]
    fn a_disc_behind_a_ball_has_a_penumbra() {
        let scene = ball_above_ground(4.0);
        let visibility = |x: f64, angular_radius: f32| {
            let receiver = Receiver { position: dvec3(x, 0.0, 0.0), normal: Vec3::Y };
            directional_visibility(&scene, &receiver, &DirectionalShadow::new(Vec3::Y, angular_radius))
        };
        assert_eq!(visibility(0.0, 0.1), 0.0, "umbra");
        assert!((0.2..0.8).contains(&visibility(0.9, 0.1)), "penumbra: {}", visibility(0.9, 0.1));
        assert_eq!(visibility(2.0, 0.1), 1.0, "lit");
    }

    #[test]
    fn a_convex_surface_does_not_shadow_itself() {
        let scene = ball_above_ground(0.0);
        let mut sum = 0.0;
        let points = sphere_samples(200);
        for point in &points {
            let receiver = Receiver { position: (*point * 0.9).as_dvec3(), normal: *point };
            sum += ambient_occlusion(&scene, &receiver, &AmbientOcclusion::default());
        }
        assert!(sum / 200.0 < 0.01, "mean self-occlusion of a ball: {}", sum / 200.0);
    }

    #[test]
    fn rigid_motion_of_everything_changes_little() {
        let still = ball_above_ground(1.6);
        let settings = AmbientOcclusion { rays: 1024, ..AmbientOcclusion::default() };
        let expected = ambient_occlusion(&still, &GROUND, &settings);
        let motion = DAffine3::from_rotation_translation(DQuat::from_rotation_z(0.7), dvec3(1e6, 5.0, -3.0));
        let mut moved = still.clone();
        moved.instances[0].world_from_mesh = motion * still.instances[0].world_from_mesh;
        let receiver = Receiver {
            position: motion.transform_point3(DVec3::ZERO),
            normal: motion.transform_vector3(DVec3::Y).as_vec3(),
        };
        let occlusion = ambient_occlusion(&moved, &receiver, &settings);
        assert!((occlusion - expected).abs() < 0.015, "{occlusion} after the motion, {expected} before");
    }
}
