//! What rays ask a field, in field space (the bounding ellipsoid is the unit sphere).

use glam::Vec3;

use super::VisibilityField;
use super::lookup::Aim;
use super::query::{QueryOptions, Ray, finite};
use super::table::ChordTable;
use crate::distance::DistanceField;
use crate::scene::mapped_normal;

/// What answers some rays.
enum Answering<'a> {
    Table(&'a ChordTable),
    Distance(&'a DistanceField),
    Nothing,
}

/// Rays are answered by the field's [table](Self::table), or by its [distances](Self::distance_field). If it has both, it is a
/// *composite*: rays that start outside the bounds ask the table, which is faster, and those that start inside ask the
/// distances, which are more accurate there. A field with neither [answers none](Self::answers_rays): they all pass unhindered.
impl VisibilityField {
    /// Whether rays can hit this field: whether it has a [table](Self::table) or [distances](Self::distance_field).
    ///
    /// ```
    /// # let field = visfield::field::example_field();
    /// assert_eq!(field.answers_rays(), field.table().is_some());
    /// ```
    pub fn answers_rays(&self) -> bool {
        self.table().is_some() || self.distance_field().is_some()
    }

    /// What answers rays that start inside the bounds, or outside.
    #[inline(always)]
    fn answering(&self, inside: bool) -> Answering<'_> {
        match (self.table(), self.distance_field()) {
            (Some(table), None) => Answering::Table(table),
            (Some(table), Some(_)) if !inside => Answering::Table(table),
            (_, Some(distance)) => Answering::Distance(distance),
            (None, None) => Answering::Nothing,
        }
    }

    /// A ray in the space of the distances, and how many of its directions make one of the ray's.
    #[inline(always)]
    fn distance_ray(&self, ray: &Ray) -> (Ray, f32) {
        let map = self.distance_from_field().unwrap_or_default();
        // Neither too short nor too long to be transformed.
        let (Ray { origin, direction, t_max }, scale) = ray.rescaled();
        let (origin, direction) = (map.transform_point3(origin), map.transform_vector3(direction));
        (Ray { origin, direction, t_max }, scale)
    }

    #[inline(always)]
    fn distance_normal(&self, options: &QueryOptions) -> Vec3 {
        self.distance_from_field().map_or(Vec3::ZERO, |map| mapped_normal(&map, options.normal))
    }

    /// The ray parameter t of the first known hit along a ray.
    ///
    /// From outside the bounds this is the first hit. From inside, a table knows the first and the last hit of the whole
    /// line and nothing between them: if there is a surface behind the origin too, the answer is the last hit ahead, at or
    /// beyond the nearest one.
    ///
    /// ```
    /// use visfield::{Ray, field::query::QueryOptions};
    /// # let field = visfield::field::example_field();
    /// let ray = Ray::new(glam::vec3(0.0, 0.0, 4.0), glam::vec3(0.0, 0.0, -2.0));
    /// let t = field.hit(&ray, &QueryOptions::default()).unwrap();
    /// assert!((t - 1.75).abs() < 0.05); // a ball of radius 1/2; t counts direction vectors
    /// ```
    #[inline]
    pub fn hit(&self, ray: &Ray, options: &QueryOptions) -> Option<f32> {
        match self.answering(starts_inside(ray)) {
            Answering::Table(table) => table.hit(ray, options),
            Answering::Distance(distance) => {
                let (in_distance, scale) = self.distance_ray(ray);
                let t = distance.hit(&in_distance, self.distance_normal(options), options.bias)?;
                Some(finite(t / scale).min(ray.t_max.next_down()))
            }
            Answering::Nothing => None,
        }
    }

    /// The length of the ray up to its [first known hit](Self::hit), in field-space units (bounding radii if the bounds are
    /// a sphere); infinite if it hits nothing.
    ///
    /// ```
    /// use visfield::{Ray, field::query::QueryOptions};
    /// # let field = visfield::field::example_field();
    /// let ray = Ray::new(glam::vec3(0.0, 0.0, 4.0), glam::vec3(0.0, 0.0, -2.0));
    /// assert!((field.distance(&ray, &QueryOptions::default()) - 3.5).abs() < 0.1);
    /// ```
    #[inline]
    pub fn distance(&self, ray: &Ray, options: &QueryOptions) -> f32 {
        match self.answering(starts_inside(ray)) {
            Answering::Table(table) => table.distance(ray, options),
            Answering::Distance(distance) => {
                let hit = distance.hit(&self.distance_ray(ray).0, self.distance_normal(options), options.bias);
                hit.map_or(f32::INFINITY, |t| finite(t * ray.rescaled().0.direction.length()))
            }
            Answering::Nothing => f32::INFINITY,
        }
    }

    /// Whether anything lies along the ray before its end.
    ///
    /// An origin outside the bounds asks forwards. An origin inside asks backwards, from the far side: the ray is occluded
    /// iff the last hit lies beyond the bias (2010, §3.2, *intra-object occlusion*). For a *segment* that ends before the
    /// last hit, the forward lookup decides; from inside it is blocked by whatever lies behind the origin, so that a short
    /// segment from the mesh's own surface may miss what it should hit. A table knows lines, not points within them.
    ///
    /// ```
    /// use glam::{Vec3, vec3};
    /// use visfield::{Ray, field::query::QueryOptions};
    /// # let field = visfield::field::example_field();
    /// let occluded = |x: f32, t_max: f32| {
    ///     field.occluded(&Ray { origin: vec3(x, 0.0, 0.0), direction: Vec3::X, t_max }, &QueryOptions::default())
    /// };
    /// assert!(occluded(-3.0, f32::INFINITY)); // outside, the ball ahead
    /// assert!(!occluded(-3.0, 2.0)); // too short to reach it
    /// assert!(occluded(-0.8, f32::INFINITY)); // inside the bounding sphere, the ball ahead
    /// assert!(!occluded(0.8, f32::INFINITY)); // and behind
    /// ```
    #[inline]
    pub fn occluded(&self, ray: &Ray, options: &QueryOptions) -> bool {
        match self.answering(starts_inside(ray)) {
            Answering::Table(table) => table.occluded(ray, options),
            Answering::Distance(distance) => {
                distance.occluded(&self.distance_ray(ray).0, self.distance_normal(options), options.bias)
            }
            Answering::Nothing => false,
        }
    }

    /// Where the line through the ray last meets the mesh before leaving the bounds, as the ray parameter t, behind the
    /// origin too: the reversed lookup of the 2010 paper (§3.2).
    #[inline]
    pub fn last_hit(&self, ray: &Ray, aim: Aim) -> Option<f32> {
        self.table()?.last_hit(ray, aim)
    }

    /// [`hit`](Self::hit) for many rays at once, several times faster; infinity stands for none.
    ///
    /// ```
    /// use glam::{Vec3, vec3};
    /// use visfield::{Ray, field::query::QueryOptions};
    /// # let field = visfield::field::example_field();
    /// let rays = [0.0, 0.9].map(|height| Ray::new(vec3(-3.0, height, 0.0), Vec3::X));
    /// let mut hits = [0.0; 2];
    /// field.hit_batch(&rays, &QueryOptions::default(), &mut hits);
    /// assert!(hits[0] < 3.0 && hits[1] == f32::INFINITY);
    /// ```
    ///
    /// # Panics
    /// If there are not as many `hits` as `rays`.
    pub fn hit_batch(&self, rays: &[Ray], options: &QueryOptions, hits: &mut [f32]) {
        assert_eq!(rays.len(), hits.len(), "one answer per ray");
        self.batch(rays, hits, |answering, rays, hits| match answering {
            Answering::Table(table) => table.hit_batch(rays, options, hits),
            Answering::Distance(distance) => {
                let (in_distance, scales): (Vec<Ray>, Vec<f32>) = rays.iter().map(|ray| self.distance_ray(ray)).unzip();
                distance.hit_batch(&in_distance, self.distance_normal(options), options.bias, hits);
                for ((hit, ray), scale) in hits.iter_mut().zip(rays).zip(scales) {
                    *hit = if *hit < f32::INFINITY { finite(*hit / scale).min(ray.t_max.next_down()) } else { *hit };
                }
            }
            Answering::Nothing => hits.fill(f32::INFINITY),
        });
    }

    /// [`distance`](Self::distance) for many rays at once, several times faster.
    ///
    /// # Panics
    /// If there are not as many `distances` as `rays`.
    pub fn distance_batch(&self, rays: &[Ray], options: &QueryOptions, distances: &mut [f32]) {
        assert_eq!(rays.len(), distances.len(), "one answer per ray");
        self.batch(rays, distances, |answering, rays, distances| match answering {
            Answering::Table(table) => table.distance_batch(rays, options, distances),
            Answering::Distance(distance) => {
                let in_distance: Vec<Ray> = rays.iter().map(|ray| self.distance_ray(ray).0).collect();
                distance.hit_batch(&in_distance, self.distance_normal(options), options.bias, distances);
                for (t, ray) in distances.iter_mut().zip(rays).filter(|(t, _)| **t < f32::INFINITY) {
                    *t = finite(*t * ray.rescaled().0.direction.length());
                }
            }
            Answering::Nothing => distances.fill(f32::INFINITY),
        });
    }

    /// [`occluded`](Self::occluded) for many rays at once, many times faster.
    ///
    /// ```
    /// use glam::{Vec3, vec3};
    /// use visfield::{Ray, field::query::QueryOptions};
    /// # let field = visfield::field::example_field();
    /// let rays = [0.0, 0.9].map(|height| Ray::new(vec3(-3.0, height, 0.0), Vec3::X));
    /// let mut occluded = [false; 2];
    /// field.occluded_batch(&rays, &QueryOptions::default(), &mut occluded);
    /// assert_eq!(occluded, [true, false]);
    /// ```
    ///
    /// # Panics
    /// If there are not as many `occluded` as `rays`.
    pub fn occluded_batch(&self, rays: &[Ray], options: &QueryOptions, occluded: &mut [bool]) {
        assert_eq!(rays.len(), occluded.len(), "one answer per ray");
        self.batch(rays, occluded, |answering, rays, occluded| match answering {
            Answering::Table(table) => table.occluded_batch(rays, options, occluded),
            Answering::Distance(distance) => {
                let in_distance: Vec<Ray> = rays.iter().map(|ray| self.distance_ray(ray).0).collect();
                distance.occluded_batch(&in_distance, self.distance_normal(options), options.bias, occluded);
            }
            Answering::Nothing => occluded.fill(false),
        });
    }

    /// Has all rays answered by what answers them: of a composite, those that start inside and the others by themselves.
    fn batch<A: Copy + Default>(&self, rays: &[Ray], answers: &mut [A], ask: impl Fn(Answering, &[Ray], &mut [A])) {
        let inside: Vec<bool> = match (self.table(), self.distance_field()) {
            (Some(_), Some(_)) => rays.iter().map(starts_inside).collect(),
            _ => Vec::new(),
        };
        let first = inside.first().copied().unwrap_or_default();
        if inside.iter().all(|other| *other == first) {
            return ask(self.answering(first), rays, answers);
        }
        for side in [false, true] {
            let own: Vec<usize> = (0..rays.len()).filter(|&i| inside[i] == side).collect();
            let own_rays: Vec<Ray> = own.iter().map(|&i| rays[i]).collect();
            let mut own_answers = vec![A::default(); own.len()];
            ask(self.answering(side), &own_rays, &mut own_answers);
            own.into_iter().zip(own_answers).for_each(|(i, answer)| answers[i] = answer);
        }
    }
}

/// Whether a ray starts inside the bounds.
#[inline(always)]
fn starts_inside(ray: &Ray) -> bool {
    ray.origin.dot(ray.origin) < 1.0
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::{FieldParts, example_field};
    use super::*;

    #[test]
    fn without_a_table_nothing_is_hit() {
        // No other part exists that a field could be made of.
        let field = VisibilityField { parts: FieldParts::default(), ..example_field() };
        let (ray, options) = (Ray::new(Vec3::X * -3.0, Vec3::X), QueryOptions::default());
        assert!(example_field().answers_rays() && example_field().occluded(&ray, &options));
        assert!(!field.answers_rays() && !field.occluded(&ray, &options));
        assert_eq!((field.hit(&ray, &options), field.last_hit(&ray, Aim::Point)), (None, None));
        assert_eq!(field.distance(&ray, &options), f32::INFINITY);
        let (mut hits, mut distances, mut occluded) = ([0.0; 2], [0.0; 2], [true; 2]);
        field.hit_batch(&[ray; 2], &options, &mut hits);
        field.distance_batch(&[ray; 2], &options, &mut distances);
        field.occluded_batch(&[ray; 2], &options, &mut occluded);
        assert_eq!((hits, distances, occluded), ([f32::INFINITY; 2], [f32::INFINITY; 2], [false; 2]));
    }
}
