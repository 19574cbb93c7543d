//! Instances of fields, placed in a world.

use std::sync::Arc;

use glam::{Affine3A, DAffine3, DMat3, DVec3, Vec3, vec3};

use crate::field::{BoundingEllipsoid, VisibilityField};

/// Which of a [`Scene`]'s fields an instance uses; [`Scene::add_field`] gives it.
///
/// ```
/// # let (a, b) = (visfield::field::example_field(), visfield::field::example_field());
/// let mut scene = visfield::scene::Scene::default();
/// assert_ne!(scene.add_field(a), scene.add_field(b));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FieldId(usize);

/// One placement of a field: a rigid object, or any other invertible affine image of its mesh.
///
/// ```
/// use glam::{DAffine3, DVec3, dvec3};
/// use visfield::scene::{Instance, Scene};
/// # let field = visfield::field::example_field();
/// let mut scene = Scene::default();
/// let id = scene.add_field(field);
/// scene.instances.push(Instance::new(id, DAffine3::from_scale(dvec3(1.0, 5.0, -1.0)))); // stretched and mirrored
/// scene.instances.push(Instance::new(id, DAffine3::from_scale(dvec3(1.0, 0.0, 1.0)))); // flattened: vanishes
/// assert_eq!(scene.place(DVec3::ZERO).len(), 1);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Instance {
    /// The field that this instance uses.
    pub field: FieldId,
    /// The map from the mesh's space to the world, in double precision so that large worlds keep their detail.
    pub world_from_mesh: DAffine3,
}

impl Instance {
    /// Places a field.
    pub fn new(field: FieldId, world_from_mesh: DAffine3) -> Self {
        Self { field, world_from_mesh }
    }
}

/// Fields and their instances.
///
/// See [`Instance`] for an example.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    fields: Vec<Arc<VisibilityField>>,
    /// The objects that occlude, in any order.
    pub instances: Vec<Instance>,
}

impl Scene {
    /// Adds a field that instances can share.
    pub fn add_field(&mut self, field: impl Into<Arc<VisibilityField>>) -> FieldId {
        self.fields.push(field.into());
        FieldId(self.fields.len() - 1)
    }

    /// The instances as rays see them, relative to `origin`, leaving out those whose transform is not invertible.
    ///
    /// Relative to the camera (or the receiver), single precision suffices at any distance from the world's origin.
    pub fn place(&self, origin: DVec3) -> Vec<(Placement, &VisibilityField)> {
        self.place_indexed(origin).map(|(_, placement, field)| (placement, field)).collect()
    }

    /// The same with each instance's position in the list.
    pub(crate) fn place_indexed(&self, origin: DVec3) -> impl Iterator<Item = (usize, Placement, &VisibilityField)> {
        self.instances.iter().enumerate().filter_map(move |(index, instance)| {
            let field = &*self.fields[instance.field.0];
            Some((index, Placement::new(&field.header().bounds, instance.world_from_mesh, origin)?, field))
        })
    }
}

/// An instance as rays see it: the map into field space, and a bounding sphere to cull by.
///
/// ```
/// use glam::{DAffine3, DVec3, Vec3, dvec3};
/// use visfield::{BoundingEllipsoid, scene::Placement};
/// let bounds = BoundingEllipsoid::sphere([1.0, 0.0, 0.0], 2.0);
/// let placement = Placement::new(&bounds, DAffine3::from_translation(dvec3(1e7, 0.0, 0.0)), dvec3(1e7, 0.0, 0.0)).unwrap();
/// assert_eq!(placement.center, Vec3::X);
/// assert_eq!(placement.field_from_world.transform_point3(Vec3::X * 3.0), Vec3::X);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// From world positions relative to the scene's chosen origin to field space.
    pub field_from_world: Affine3A,
    /// Centre of a bounding sphere, relative to the chosen origin.
    pub center: Vec3,
    /// Radius of that sphere, in world units.
    pub radius: f32,
}

impl Placement {
    /// Places `bounds` by `world_from_mesh`, relative to `origin`; `None` if the transform is singular or not finite, or
    /// so extreme that single precision cannot hold the result.
    pub fn new(bounds: &BoundingEllipsoid, world_from_mesh: DAffine3, origin: DVec3) -> Option<Self> {
        let world_from_field = world_from_mesh * bounds.mesh_from_field();
        let relative = DAffine3 { translation: world_from_field.translation - origin, ..world_from_field };
        let inverse = relative.inverse();
        let stretch = largest_stretch(relative.matrix3);
        // Relative to the stretch, so that tiny objects are not taken for flat ones.
        let thinness = 1.0 / (stretch * largest_stretch(inverse.matrix3));
        // The inverse of a needle without any width is made of rounding alone, and shows no thinness.
        let volume = relative.matrix3.determinant().abs() / stretch.powi(3);
        // NaN is not above.
        let solid = thinness > SINGULAR && volume > SINGULAR * SINGULAR;
        if !solid {
            return None;
        }
        let placement = Self {
            field_from_world: inverse.as_affine3a(),
            center: relative.translation.as_vec3(),
            radius: stretch as f32,
        };
        let usable =
            placement.field_from_world.is_finite() && placement.center.is_finite() && placement.radius.is_normal();
        usable.then_some(placement)
    }
}

impl Placement {
    /// The unit normal in field space of a surface with this normal in the world: by the cofactors of the linear map, which
    /// are its inverse transpose up to a factor.
    ///
    /// ```
    /// use glam::{DAffine3, DVec3, Vec3, dvec3};
    /// use visfield::{BoundingEllipsoid, scene::Placement};
    /// let bounds = BoundingEllipsoid::sphere([0.0; 3], 1.0);
    /// let mirrored = Placement::new(&bounds, DAffine3::from_scale(dvec3(1.0, -2.0, 5.0)), DVec3::ZERO).unwrap();
    /// assert_eq!(mirrored.field_normal(Vec3::Y), -Vec3::Y);
    /// ```
    pub fn field_normal(&self, normal: Vec3) -> Vec3 {
        mapped_normal(&self.field_from_world, normal)
    }
}

/// The unit normal of a surface with this normal after an affine map.
pub(crate) fn mapped_normal(map: &Affine3A, normal: Vec3) -> Vec3 {
    let [x, y, z] = scaled_rows(map);
    let cofactors = vec3(y.cross(z).dot(normal), z.cross(x).dot(normal), x.cross(y).dot(normal));
    let orientation = if x.dot(y.cross(z)) < 0.0 { -1.0 } else { 1.0 };
    cofactors.normalize_or_zero() * orientation
}

/// The linear part of an affine map, scaled to a largest component of 1: products of three components of tiny or huge objects
/// would leave the range of `f32`.
pub(crate) fn scaled_rows(map: &Affine3A) -> [Vec3; 3] {
    let rows = [0, 1, 2].map(|i| Vec3::from(map.matrix3.row(i)));
    let largest = rows.iter().map(|row| row.abs().max_element()).fold(0.0, f32::max);
    rows.map(|row| row / largest)
}

/// How thin a transform may squeeze the unit sphere, relative to its widest, before it counts as singular: to between once and
/// three times this. From as far as such a disc is wide, single precision hardly tells before it from behind it; and a flat
/// transform that was multiplied with rotations, even in single precision, is no thicker than its rounding.
const SINGULAR: f64 = 1.0e-6;

/// An upper bound of how much a linear map lengthens any vector: the square root of the largest absolute row sum of the Gram
/// matrix `MᵀM`,
/// which bounds its largest eigenvalue. Exact for rotations with uniform scale.
fn largest_stretch(m: DMat3) -> f64 {
    let gram = m.transpose() * m;
    let row_sum = |i: usize| gram.row(i).abs().element_sum();
    row_sum(0).max(row_sum(1)).max(row_sum(2)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, EulerRot, dvec3};

    const UNIT: BoundingEllipsoid = BoundingEllipsoid::sphere([0.0; 3], 1.0);

    #[test]
    fn singular_and_non_finite_transforms_vanish() {
        let flat = dvec3(1.0, 1e-19, 1.0);
        for scale in
            [DVec3::ZERO, flat, dvec3(1.0, 1.0, 0.0), dvec3(f64::NAN, 1.0, 1.0), dvec3(f64::INFINITY, 1.0, 1.0)]
        {
            assert_eq!(Placement::new(&UNIT, DAffine3::from_scale(scale), DVec3::ZERO), None, "{scale}");
        }
        let nowhere = DAffine3::from_translation(dvec3(f64::NAN, 0.0, 0.0));
        assert_eq!(Placement::new(&UNIT, nowhere, DVec3::ZERO), None);
    }

    #[test]
    fn extreme_scales_stay() {
        for scale in [1e-6, 1e-3, 1.0, 1e3, 1e6] {
            let placement = Placement::new(&UNIT, DAffine3::from_scale(DVec3::splat(scale)), DVec3::ZERO).unwrap();
            assert!((f64::from(placement.radius) / scale - 1.0).abs() < 1e-6);
        }
        let needle = DAffine3::from_scale(dvec3(1.0, 1e-3, 1e-3));
        assert!(Placement::new(&UNIT, needle, DVec3::ZERO).is_some());
    }

    #[test]
    fn the_bounding_sphere_contains_the_mesh() {
        let rotation = DQuat::from_euler(EulerRot::XYZ, 0.3, 1.1, -2.0);
        let squeezed = DAffine3::from_scale_rotation_translation(dvec3(1.0, 4.0, -0.2), rotation, dvec3(5.0, 6.0, 7.0));
        let placement = Placement::new(&UNIT, squeezed, DVec3::ZERO).unwrap();
        for point in crate::estimate::sampling::sphere_samples(500) {
            let world = squeezed.transform_point3(point.as_dvec3()).as_vec3();
            assert!(world.distance(placement.center) <= placement.radius * 1.0001);
            let back = placement.field_from_world.transform_point3(world);
            assert!(back.distance(point) < 1e-4);
        }
    }

    #[test]
    fn normals_survive_extreme_and_mirrored_transforms() {
        for scale in [1e-12, 1e-6, 1.0, 1e6, 1e12] {
            let squeezed = DAffine3::from_scale(dvec3(1.0, -2.0, 3.0) * scale);
            let placement = Placement::new(&UNIT, squeezed, DVec3::ZERO).unwrap();
            // The plane x + y = 0 of the mesh: its normal in the world is (1, −1/2, 0).
            let normal = placement.field_normal(vec3(1.0, -0.5, 0.0).normalize());
            let expected = vec3(1.0, 1.0, 0.0).normalize();
            assert!(normal.distance(expected) < 1e-5, "scale {scale}: {normal}");
        }
    }

    #[test]
    fn places_far_from_the_origin_keep_their_detail() {
        let far = dvec3(1e7, -1e7, 1e7);
        let placement = Placement::new(&UNIT, DAffine3::from_translation(far + dvec3(0.001, 0.0, 0.0)), far).unwrap();
        assert!((placement.center - Vec3::X * 0.001).length() < 1e-7);
    }
}
