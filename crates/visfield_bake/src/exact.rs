//! Ambient occlusion and sun visibility by exact rays: the reference for the estimators of `visfield`.
//!
//! They take the same settings and the same sample patterns as `visfield::estimate`, so that a difference between the two
//! is an error of the field and not of the sampling.

use glam::{DAffine3, DVec3, Vec3};
use visfield::estimate::sampling::{DiscBasis, disc_samples, sphere_samples};
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

    /// The ray parameter t of the first hit of `origin + t·direction` in [0, `t_max`). `origin` is in the world.
    pub fn closest_hit(&self, origin: DVec3, direction: Vec3, t_max: f32) -> Option<f32> {
        self.triangles.closest_hit((origin - self.origin).as_vec3(), direction, t_max)
    }

    /// Whether anything is hit in [0, `t_max`). `origin` is in the world.
    pub fn occluded(&self, origin: DVec3, direction: Vec3, t_max: f32) -> bool {
        self.triangles.occluded((origin - self.origin).as_vec3(), direction, 0.0, t_max)
    }

    /// The point from which a receiver's rays start, relative to the scene's origin.
    fn start(&self, receiver: &Receiver) -> Vec3 {
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

/// The exact twin of `visfield::estimate::directional_visibility`, in [0, 1]. The light's bias does not apply; rays start
/// [`ExactScene::SURFACE_OFFSET`] above the surface instead.
pub fn directional_visibility(scene: &ExactScene, receiver: &Receiver, light: &DirectionalShadow) -> f32 {
    let start = scene.start(receiver);
    let rays = light.rays.max(1);
    let basis = DiscBasis::new(light.to_light, light.angular_radius);
    let occluded = disc_samples(rays)
        .into_iter()
        .filter(|&sample| scene.triangles.occluded(start, basis.direction(sample), 0.0, f32::INFINITY))
        .count();
    1.0 - occluded as f32 / rays as f32
}
