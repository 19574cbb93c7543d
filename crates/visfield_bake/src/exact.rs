//! Ambient occlusion and sun visibility by exact rays: the reference for the estimators of `visfield`.
//!
//! They take the same settings and the same sample patterns as `visfield::estimate`, so that a difference between the two
//! is an error of the field and not of the sampling.

use glam::{DAffine3, DVec3, Vec3};
use visfield::estimate::sampling::sphere_samples;
use visfield::estimate::{AmbientOcclusion, DirectionalShadow, Receiver, cosine_direction};

use crate::mesh::{Mesh, MeshError};
use crate::triangles::TriangleBvh;

/// The triangles of all instances of a scene, in world space.
///
/// ```
/// use glam::{DAffine3, DVec3, Vec3, dvec3};
/// use visfield::estimate::{AmbientOcclusion, Receiver};
/// use visfield_bake::{ExactScene, Mesh, exact};
/// let roof = Mesh {
///     name: "roof".to_owned(),
///     positions: vec![[-1e3, 1.0, -1e3], [1e3, 1.0, -1e3], [0.0, 1.0, 1e3]],
///     indices: vec![[0, 1, 2]],
/// };
/// let scene = ExactScene::new(&[(&roof, DAffine3::IDENTITY)], DVec3::ZERO)?;
/// let below = Receiver { position: DVec3::ZERO, normal: Vec3::Y };
/// assert_eq!(exact::ambient_occlusion(&scene, &below, &AmbientOcclusion::default()), 1.0);
/// # Ok::<(), visfield_bake::MeshError>(())
/// ```
pub struct ExactScene {
    triangles: TriangleBvh,
    origin: DVec3,
}

impl ExactScene {
    /// How far rays of [`ambient_occlusion`] and [`directional_visibility`] start above the receiver, along its normal:
    /// relative to the largest coordinate of the scene or the receiver, seen from the scene's origin. A hundred times the
    /// rounding of `f32`, so that a surface does not shadow itself, and below anything that a field resolves.
    pub const SURFACE_OFFSET: f32 = 1.0e-5;

    /// Places meshes in a world. The triangles are kept in `f32` relative to `origin`: choose a point near the receivers.
    ///
    /// Instances whose transform is singular or not finite vanish, as they do from a `visfield` scene.
    ///
    /// # Errors
    /// [`MeshError`] if a mesh could not be baked either.
    pub fn new(instances: &[(&Mesh, DAffine3)], origin: DVec3) -> Result<Self, MeshError> {
        let mut world = Vec::new();
        for (mesh, world_from_mesh) in instances {
            let triangles = mesh.solid_triangles()?;
            let determinant = world_from_mesh.matrix3.determinant();
            if world_from_mesh.is_finite() && determinant.is_finite() && determinant != 0.0 {
                world.extend(triangles.iter().map(|t| t.map(|p| world_from_mesh.transform_point3(p) - origin)));
            }
        }
        Ok(Self { triangles: TriangleBvh::new(&world), origin })
    }

    /// One mesh as it is, relative to its own centre.
    pub(crate) fn of_mesh(mesh: &Mesh) -> Result<Self, MeshError> {
        let center = crate::bounds::bounding_sphere(mesh)?.center;
        Self::new(&[(mesh, DAffine3::IDENTITY)], DVec3::from(center.map(f64::from)))
    }

    /// The triangles, relative to the scene's origin.
    pub(crate) fn triangles(&self) -> &TriangleBvh {
        &self.triangles
    }

    /// The ray parameter t of the first hit of `origin + t·direction` in [0, `t_max`). `origin` is in the world.
    pub fn closest_hit(&self, origin: DVec3, direction: Vec3, t_max: f32) -> Option<f32> {
        self.triangles.closest_hit((origin - self.origin).as_vec3(), direction, t_max)
    }

    /// Whether anything is hit in [0, `t_max`). `origin` is in the world.
    pub fn occluded(&self, origin: DVec3, direction: Vec3, t_max: f32) -> bool {
        self.triangles.occluded((origin - self.origin).as_vec3(), direction, 0.0, t_max)
    }

    /// The point from which a receiver's rays start, relative to the scene's origin.
    pub(crate) fn start(&self, receiver: &Receiver) -> Vec3 {
        let position = (receiver.position - self.origin).as_vec3();
        let size = position.abs().max_element().max(self.triangles.extent());
        position + receiver.normal * (size * Self::SURFACE_OFFSET)
    }
}

/// The exact twin of `visfield::estimate::ambient_occlusion`, in [0, 1]. The settings' bias does not apply; rays start
/// [`ExactScene::SURFACE_OFFSET`] above the surface instead.
pub fn ambient_occlusion(scene: &ExactScene, receiver: &Receiver, settings: &AmbientOcclusion) -> f32 {
    let start = scene.start(receiver);
    let rays = settings.rays.max(1);
    let occluded = sphere_samples(rays)
        .into_iter()
        .filter(|&sample| {
            let direction = cosine_direction(receiver.normal, sample);
            scene.triangles.occluded(start, direction, 0.0, settings.max_distance)
        })
        .count();
    occluded as f32 / rays as f32
}

/// The exact twin of `visfield::estimate::directional_visibility`, in [0, 1]; 1 for receivers that face away. The light's bias does not apply; rays start
/// [`ExactScene::SURFACE_OFFSET`] above the surface instead.
pub fn directional_visibility(scene: &ExactScene, receiver: &Receiver, light: &DirectionalShadow) -> f32 {
    if receiver.normal.dot(light.to_light) <= 0.0 {
        return 1.0;
    }
    let start = scene.start(receiver);
    let rays = light.rays_above(receiver.normal);
    let occluded = rays.iter().filter(|&&ray| scene.triangles.occluded(start, ray, 0.0, f32::INFINITY)).count();
    1.0 - occluded as f32 / rays.len().max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, dvec3, vec3};

    /// A disc of 64 triangles with radius 1 in the plane y = 0.
    fn disc() -> Mesh {
        let rim = |i: u32| {
            let (sin, cos) = (std::f32::consts::TAU * i as f32 / 64.0).sin_cos();
            [cos, 0.0, sin]
        };
        Mesh {
            name: "disc".to_owned(),
            positions: std::iter::once([0.0; 3]).chain((0..64).map(rim)).collect(),
            indices: (0..64).map(|i| [0, 1 + i, 1 + (i + 1) % 64]).collect(),
        }
    }

    const GROUND: Receiver = Receiver { position: DVec3::ZERO, normal: Vec3::Y };

    #[test]
    fn a_disc_overhead_occludes_its_share() {
        // A disc of radius r at height h covers r²/(r² + h²) of the cosine-weighted hemisphere; at any place in the world.
        for (height, shift) in [(0.5, 0.0), (1.0, 1e7), (3.0, -1e5)] {
            let receiver = Receiver { position: DVec3::splat(shift), ..GROUND };
            let above = DAffine3::from_translation(receiver.position + dvec3(0.0, height, 0.0));
            let scene = ExactScene::new(&[(&disc(), above)], receiver.position).unwrap();
            let settings = AmbientOcclusion { rays: 4096, ..AmbientOcclusion::default() };
            let occlusion = ambient_occlusion(&scene, &receiver, &settings);
            let exact = (1.0 / (1.0 + height * height)) as f32;
            assert!((occlusion - exact).abs() < 0.005, "height {height}: {occlusion}, exactly {exact}");
            let near = AmbientOcclusion { max_distance: height as f32 * 0.99, ..settings };
            assert!(ambient_occlusion(&scene, &receiver, &near) <= 0.0, "nothing is near");
        }
    }

    #[test]
    fn an_edge_through_the_sun_hides_half_of_it() {
        let scene =
            ExactScene::new(&[(&disc(), DAffine3::from_translation(dvec3(1.0, 2.0, 0.0)))], DVec3::ZERO).unwrap();
        let visibility = |x: f64| {
            let receiver = Receiver { position: dvec3(x, 0.0, 0.0), normal: Vec3::Y };
            directional_visibility(&scene, &receiver, &DirectionalShadow::new(Vec3::Y, 0.01))
        };
        assert!((visibility(0.0) - 0.5).abs() < 0.05, "{}", visibility(0.0));
        assert_eq!((visibility(-0.1), visibility(0.1)), (1.0, 0.0));
    }

    #[test]
    fn a_flat_surface_does_not_shadow_itself() {
        let turned = DAffine3::from_rotation_translation(DQuat::from_rotation_z(0.7), dvec3(0.1, 0.2, 0.3));
        let scene = ExactScene::new(&[(&disc(), turned)], DVec3::ZERO).unwrap();
        let normal = turned.transform_vector3(DVec3::Y).as_vec3();
        for i in 0..50 {
            let position = turned.transform_point3(dvec3(0.013 * f64::from(i), 0.0, 0.007 * f64::from(i)));
            let receiver = Receiver { position, normal };
            assert!(ambient_occlusion(&scene, &receiver, &AmbientOcclusion::default()) <= 0.0, "point {i}");
        }
    }

    #[test]
    fn what_vanishes_from_a_scene_vanishes_here() {
        let nowhere = [
            DAffine3::from_scale(DVec3::ZERO),
            DAffine3::from_scale(dvec3(1.0, f64::NAN, 1.0)),
            DAffine3::from_translation(DVec3::INFINITY),
        ];
        let disc = disc();
        let scene = ExactScene::new(&nowhere.map(|place| (&disc, place)), DVec3::ZERO).unwrap();
        assert!(!scene.occluded(dvec3(0.0, 1.0, 0.0), vec3(0.0, -1.0, 0.0), f32::INFINITY));
    }
}
