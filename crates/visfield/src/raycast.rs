//! Rays against a whole scene, for a game's own purposes: line of sight, picking, contact. The papers name collision
//! detection and ray casting among the uses of their fields.
//!
//! Answers are as accurate as the fields: a hit is off by about a cell. Ask many rays in one batch: that is faster.

use glam::DVec3;

use crate::field::VisibilityField;
use crate::field::query::{QueryOptions, Ray, finite};
use crate::scene::{Placement, Scene};

/// Where a ray hits which instance.
///
/// ```
/// let hit = visfield::raycast::SceneHit { t: 2.0, instance: 0 };
/// assert!(hit.t >= 0.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneHit {
    /// The ray parameter: how many direction vectors from the origin.
    pub t: f32,
    /// Position in [`Scene::instances`].
    pub instance: usize,
}

/// A scene whose instances are placed once for many rays.
///
/// Rays are in the world's axes and units, relative to the origin given to [`RayCaster::new`]. A normal in the
/// [`QueryOptions`] is the unit normal in the world of the surface that the rays leave.
///
/// ```
/// use glam::{DAffine3, DVec3, Vec3, dvec3};
/// use visfield::{QueryOptions, Ray, raycast::RayCaster, scene::{Instance, Scene}};
/// # let field = visfield::field::example_field(); // a ball of radius 1/2
/// let mut scene = Scene::default();
/// let id = scene.add_field(field);
/// scene.instances.push(Instance::new(id, DAffine3::from_translation(dvec3(5.0, 0.0, 0.0))));
/// scene.instances.push(Instance::new(id, DAffine3::from_translation(dvec3(9.0, 0.0, 0.0))));
///
/// let caster = RayCaster::new(&scene, DVec3::ZERO);
/// let (ahead, options) = (Ray::new(Vec3::ZERO, Vec3::X), QueryOptions::default());
/// let hit = caster.hit(&ahead, &options).unwrap();
/// assert!((hit.t - 4.5).abs() < 0.05 && hit.instance == 0);
/// assert!(!caster.occluded(&Ray { t_max: 4.0, ..ahead }, &options));
/// let mut distances = [0.0; 2];
/// caster.distance_batch(&[ahead, Ray::new(Vec3::ZERO, Vec3::Y * 3.0)], &options, &mut distances);
/// assert!((distances[0] - 4.5).abs() < 0.05 && distances[1] == f32::INFINITY);
/// ```
#[derive(Debug)]
pub struct RayCaster<'a> {
    instances: Vec<PlacedInstance<'a>>,
}

#[derive(Debug)]
struct PlacedInstance<'a> {
    index: usize,
    placement: Placement,
    field: &'a VisibilityField,
}

impl PlacedInstance<'_> {
    /// The ray in field space, with the same ray parameter.
    fn ray(&self, ray: &Ray) -> Ray {
        let map = self.placement.field_from_world;
        Ray {
            origin: map.transform_point3(ray.origin),
            direction: map.transform_vector3(ray.direction),
            t_max: ray.t_max,
        }
    }

    fn options(&self, options: &QueryOptions) -> QueryOptions {
        QueryOptions { normal: self.placement.field_normal(options.normal), ..*options }
    }
}

impl<'a> RayCaster<'a> {
    /// Places the instances relative to `origin`, leaving out those whose transform is not invertible and those whose field
    /// [answers no rays](VisibilityField::answers_rays). Choose a point near the rays: they are in single precision.
    pub fn new(scene: &'a Scene, origin: DVec3) -> Self {
        let placed = scene.place_indexed(origin).filter(|(_, _, field)| field.answers_rays());
        let instances = placed.map(|(index, placement, field)| PlacedInstance { index, placement, field }).collect();
        Self { instances }
    }

    /// The nearest [hit](VisibilityField::hit) of any instance.
    pub fn hit(&self, ray: &Ray, options: &QueryOptions) -> Option<SceneHit> {
        let (ray, scale) = ray.rescaled();
        let hit = self.hit_rescaled(&ray, options)?;
        Some(SceneHit { t: finite(hit.t / scale), ..hit })
    }

    /// The same for a ray whose direction is neither too short nor too long to be transformed.
    fn hit_rescaled(&self, ray: &Ray, options: &QueryOptions) -> Option<SceneHit> {
        let mut nearest = None;
        let mut rest = *ray;
        for instance in &self.instances {
            if let Some(t) = instance.field.hit(&instance.ray(&rest), &instance.options(options)) {
                nearest = Some(SceneHit { t, instance: instance.index });
                rest.t_max = t;
            }
        }
        nearest
    }

    /// Whether any instance [occludes](VisibilityField::occluded) the ray.
    pub fn occluded(&self, ray: &Ray, options: &QueryOptions) -> bool {
        let (ray, _) = ray.rescaled();
        let blocks =
            |instance: &PlacedInstance| instance.field.occluded(&instance.ray(&ray), &instance.options(options));
        self.instances.iter().any(blocks)
    }

    /// The length of the ray up to its nearest hit, in world units; infinite if it hits nothing.
    pub fn distance(&self, ray: &Ray, options: &QueryOptions) -> f32 {
        let (ray, _) = ray.rescaled();
        self.hit_rescaled(&ray, options).map_or(f32::INFINITY, |hit| finite(hit.t * ray.direction.length()))
    }

    /// [`hit`](Self::hit) for many rays at once.
    ///
    /// # Panics
    /// If there are not as many `hits` as `rays`.
    pub fn hit_batch(&self, rays: &[Ray], options: &QueryOptions, hits: &mut [Option<SceneHit>]) {
        assert_eq!(rays.len(), hits.len(), "one answer per ray");
        self.hit_batch_rescaled(&mut rescaled(rays), options, hits);
        for (hit, ray) in hits.iter_mut().zip(rays) {
            if let Some(hit) = hit {
                hit.t = finite(hit.t / ray.rescaled().1);
            }
        }
    }

    /// The same for rays whose directions are neither too short nor too long to be transformed. They end at their hits.
    fn hit_batch_rescaled(&self, rest: &mut [Ray], options: &QueryOptions, hits: &mut [Option<SceneHit>]) {
        hits.fill(None);
        let mut found = vec![0.0; rest.len()];
        for instance in &self.instances {
            let in_field: Vec<Ray> = rest.iter().map(|ray| instance.ray(ray)).collect();
            instance.field.hit_batch(&in_field, &instance.options(options), &mut found);
            for ((hit, ray), &t) in hits.iter_mut().zip(&mut *rest).zip(&found) {
                if t < ray.t_max {
                    *hit = Some(SceneHit { t, instance: instance.index });
                    ray.t_max = t;
                }
            }
        }
    }

    /// [`occluded`](Self::occluded) for many rays at once.
    ///
    /// # Panics
    /// If there are not as many `occluded` as `rays`.
    pub fn occluded_batch(&self, rays: &[Ray], options: &QueryOptions, occluded: &mut [bool]) {
        assert_eq!(rays.len(), occluded.len(), "one answer per ray");
        occluded.fill(false);
        let rays = rescaled(rays);
        let mut found = vec![false; rays.len()];
        for instance in &self.instances {
            let in_field: Vec<Ray> = rays.iter().map(|ray| instance.ray(ray)).collect();
            instance.field.occluded_batch(&in_field, &instance.options(options), &mut found);
            occluded.iter_mut().zip(&found).for_each(|(occluded, found)| *occluded |= found);
        }
    }

    /// [`distance`](Self::distance) for many rays at once.
    ///
    /// # Panics
    /// If there are not as many `distances` as `rays`.
    pub fn distance_batch(&self, rays: &[Ray], options: &QueryOptions, distances: &mut [f32]) {
        assert_eq!(rays.len(), distances.len(), "one answer per ray");
        let mut hits = vec![None; rays.len()];
        let mut rays = rescaled(rays);
        self.hit_batch_rescaled(&mut rays, options, &mut hits);
        for ((distance, hit), ray) in distances.iter_mut().zip(hits).zip(rays) {
            *distance = hit.map_or(f32::INFINITY, |hit| finite(hit.t * ray.direction.length()));
        }
    }
}

fn rescaled(rays: &[Ray]) -> Vec<Ray> {
    rays.iter().map(|ray| ray.rescaled().0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::sampling::sphere_samples;
    use crate::field::ball_field;
    use crate::scene::Instance;
    use glam::{DAffine3, DQuat, Vec3, Vec3Swizzles, dvec3};

    /// Three balls of radius 0.9, scaled by 1, 2 and 0.5, and one that vanishes.
    fn balls() -> Scene {
        let mut scene = Scene::default();
        let ball = scene.add_field(ball_field(0.9, 65, 32));
        let far = dvec3(1e6, 0.0, 0.0);
        for (scale, at) in [(0.0, DVec3::ZERO), (1.0, DVec3::X * 3.0), (2.0, DVec3::X * 7.0), (0.5, DVec3::Y * -4.0)] {
            let turned = DQuat::from_rotation_z(scale);
            let place = DAffine3::from_scale_rotation_translation(DVec3::splat(scale), turned, far + at);
            scene.instances.push(Instance::new(ball, place));
        }
        scene
    }

    const ORIGIN: DVec3 = dvec3(1e6, 0.0, 0.0);

    #[test]
    fn the_nearest_of_several_instances_is_hit() {
        let scene = balls();
        let caster = RayCaster::new(&scene, ORIGIN);
        let free = QueryOptions::default();
        for (ray, t, instance) in [
            (Ray::new(Vec3::ZERO, Vec3::X), 2.1, 1),
            (Ray::new(Vec3::X * 20.0, Vec3::X * -2.0), 5.6, 2),
            (Ray::new(Vec3::ZERO, Vec3::NEG_Y), 3.55, 3),
        ] {
            let hit = caster.hit(&ray, &free).expect("a ball is ahead");
            assert!((hit.t - t).abs() < 0.05 && hit.instance == instance, "{hit:?}");
            let distance = caster.distance(&ray, &free);
            assert!((distance - t * ray.direction.length()).abs() < 0.1, "{distance}");
            assert!(caster.occluded(&ray, &free));
            assert!(!caster.occluded(&Ray { t_max: t - 0.1, ..ray }, &free));
        }
        assert_eq!(caster.hit(&Ray::new(Vec3::ZERO, Vec3::Z), &free), None);
    }

    #[test]
    fn any_direction_has_a_sane_distance() {
        let scene = balls();
        let caster = RayCaster::new(&scene, ORIGIN);
        let free = QueryOptions::default();
        for length in [1e-40, 1e-30, 1.0, 1e25, 1e38] {
            let ray = Ray::new(Vec3::ZERO, Vec3::X * length);
            let (distance, hit) = (caster.distance(&ray, &free), caster.hit(&ray, &free).expect("a ball is ahead"));
            assert!((distance - 2.1).abs() < 0.05, "length {length}: {distance}");
            assert!(hit.t.is_finite() && caster.occluded(&ray, &free), "length {length}: {hit:?}");
            let (mut distances, mut hits) = ([0.0], [None]);
            caster.distance_batch(&[ray], &free, &mut distances);
            caster.hit_batch(&[ray], &free, &mut hits);
            assert_eq!((distances[0], hits[0]), (distance, Some(hit)));
        }
        for direction in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY] {
            assert_eq!(caster.distance(&Ray::new(Vec3::ZERO, direction), &free), f32::INFINITY);
        }
    }

    #[test]
    fn batches_answer_as_single_rays_do() {
        let scene = balls();
        let caster = RayCaster::new(&scene, ORIGIN);
        let free = QueryOptions::default();
        // Many of these start inside the second ball's bounds.
        let rays: Vec<Ray> = sphere_samples(500)
            .into_iter()
            .enumerate()
            .map(|(i, p)| Ray {
                origin: p * 3.0,
                direction: Vec3::X * 5.0 + p.zxy() * 2.0 - p * 3.0,
                t_max: if i % 2 == 0 { 1.0 } else { f32::INFINITY },
            })
            .collect();
        let (mut hits, mut occluded, mut distances) = (vec![None; 500], vec![false; 500], vec![0.0; 500]);
        caster.hit_batch(&rays, &free, &mut hits);
        caster.occluded_batch(&rays, &free, &mut occluded);
        caster.distance_batch(&rays, &free, &mut distances);
        for (i, ray) in rays.iter().enumerate() {
            assert_eq!(hits[i], caster.hit(ray, &free));
            assert_eq!(occluded[i], caster.occluded(ray, &free));
            assert_eq!(distances[i], caster.distance(ray, &free));
        }
        assert!(occluded.iter().filter(|hit| **hit).count() > 100);
    }
}
