//! Cones through the [distances](crate::distance) of instances: small lights, and ambient occlusion where no cap grid answers,
//! without rays and without noise.
//!
//! Twin of `shaders/cone.wgsl`, function by function.

use glam::{Affine3A, Vec3};

use crate::distance::DistanceField;
use crate::distance::cone::LightCone;
use crate::field::VisibilityField;
use crate::field::cap_grid::cap::{CONTACT_REACH, contact_occlusion};
use crate::field::query::Bias;
use crate::scene::{Placement, mapped_normal, scaled_rows};

/// Reach of the differences that tell where a surface faces, in units of the distances: a voxel of a grid.
const GRADIENT_REACH: f32 = 1.0;

/// A receiver, relative to the origin that occluders were placed by.
///
/// ```
/// use glam::Vec3;
/// let ground = visfield::estimate::cones::ConeReceiver { position: Vec3::ZERO, normal: Vec3::Y };
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ConeReceiver {
    /// Where it is.
    pub position: Vec3,
    /// Its unit normal.
    pub normal: Vec3,
}

/// A disc of the sky.
///
/// ```
/// use glam::Vec3;
/// use visfield::estimate::cones::ConeDisc;
/// let sun = ConeDisc { direction: Vec3::Y, tangent: 0.00465, distance: f32::INFINITY };
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ConeDisc {
    /// The unit vector to its centre.
    pub direction: Vec3,
    /// The tangent of its half-angle.
    pub tangent: f32,
    /// How far it is; infinite for the sky.
    pub distance: f32,
}

/// An instance with distances.
///
/// ```
/// use glam::{DAffine3, DVec3, Vec3, dvec3};
/// use visfield::estimate::cones::{ConeDisc, ConeOccluder, ConeReceiver};
/// use visfield::field::query::Bias;
/// use visfield::{VisibilityField, scene::Placement, shape::Shape};
/// let ball = VisibilityField::of_shape(Shape::Sphere { radius: 1.0 })?;
/// let above = DAffine3::from_translation(dvec3(0.0, 3.0, 0.0));
/// let placement = Placement::new(&ball.header().bounds, above, DVec3::ZERO).unwrap();
/// let occluder = ConeOccluder::new(&placement, &ball).unwrap();
/// let sun = ConeDisc { direction: Vec3::Y, tangent: 0.01, distance: f32::INFINITY };
/// let hidden = |x| occluder.occlusion(&ConeReceiver { position: Vec3::X * x, normal: Vec3::Y }, &sun, Bias::default());
/// assert_eq!((hidden(0.0), hidden(2.0)), (1.0, 0.0));
/// # Ok::<(), visfield::FieldError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ConeOccluder<'a> {
    distance_from_world: Affine3A,
    distance: &'a DistanceField,
}

impl<'a> ConeOccluder<'a> {
    /// An instance of a field that is placed; `None` if the field has no distances.
    pub fn new(placement: &Placement, field: &'a VisibilityField) -> Option<Self> {
        let distance_from_world = field.distance_from_field()? * placement.field_from_world;
        Some(Self { distance_from_world, distance: field.distance_field()? })
    }

    /// How much of a disc it hides, of what is above the receiver's horizon, from 0 to 1. Where the scale is uneven, the disc is
    /// taken for a round one that is as large.
    pub fn occlusion(&self, receiver: &ConeReceiver, disc: &ConeDisc, bias: Bias) -> f32 {
        let (position, normal, cone) = self.seen(receiver, disc);
        self.distance.cone_occlusion(position, normal, &cone, bias)
    }

    /// The same by one edge, for ambient occlusion.
    pub(super) fn edge_occlusion(&self, receiver: &ConeReceiver, disc: &ConeDisc, bias: Bias) -> f32 {
        let (position, normal, cone) = self.seen(receiver, disc);
        self.distance.edge_occlusion(position, normal, &cone, bias)
    }

    /// Receiver and disc in the space of the distances.
    fn seen(&self, receiver: &ConeReceiver, disc: &ConeDisc) -> (Vec3, Vec3, LightCone) {
        let map = &self.distance_from_world;
        let along = map.transform_vector3(disc.direction);
        let length = along.length();
        // Neither depends on the scale, whose cube would leave the range of `f32`.
        let [x, y, z] = scaled_rows(map);
        let shape = Vec3::new(x.dot(disc.direction), y.dot(disc.direction), z.dot(disc.direction)).length();
        let volume = x.dot(y.cross(z)).abs();
        let tangent = disc.tangent * (volume / (shape * shape * shape)).sqrt();
        let cone = LightCone { direction: along / length, tangent, t_light: disc.distance * length };
        (map.transform_point3(receiver.position), mapped_normal(map, receiver.normal), cone)
    }

    /// The contact term of a receiver: what a cap grid's few numbers miss where the surface is near (DESIGN §4).
    pub fn contact(&self, position: Vec3, normal: Vec3) -> f32 {
        let local = self.distance_from_world.transform_point3(position);
        let (low, high) = self.distance.bounds();
        let radius = (high - low).length() * 0.5;
        let reach = CONTACT_REACH * radius;
        let beyond = local - local.clamp(low, high);
        if beyond.dot(beyond) >= reach * reach {
            return 0.0;
        }
        let distance = self.distance.distance(local).max(0.0);
        if distance >= reach {
            return 0.0;
        }
        // How fast the surface recedes along the normal: the gradient in that direction alone.
        let ahead = mapped_normal(&self.distance_from_world, normal) * GRADIENT_REACH;
        let facing =
            (self.distance.distance(local + ahead) - self.distance.distance(local - ahead)) / (2.0 * GRADIENT_REACH);
        contact_occlusion(distance, radius, facing)
    }
}
