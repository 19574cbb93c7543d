//! What rays ask a field, in field space (the bounding ellipsoid is the unit sphere).

use super::VisibilityField;
use super::lookup::Aim;
use super::query::{QueryOptions, Ray};

/// Rays are answered by the field's [table](Self::table). A field without one [answers none](Self::answers_rays): they all
/// pass unhindered.
impl VisibilityField {
    /// Whether rays can hit this field: whether it has a [table](Self::table).
    ///
    /// ```
    /// # let field = visfield::field::example_field();
    /// assert_eq!(field.answers_rays(), field.table().is_some());
    /// ```
    pub fn answers_rays(&self) -> bool {
        self.table().is_some()
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
        self.table()?.hit(ray, options)
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
        self.table().map_or(f32::INFINITY, |table| table.distance(ray, options))
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
        self.table().is_some_and(|table| table.occluded(ray, options))
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
        match self.table() {
            Some(table) => table.hit_batch(rays, options, hits),
            None => hits.fill(f32::INFINITY),
        }
    }

    /// [`distance`](Self::distance) for many rays at once, several times faster.
    ///
    /// # Panics
    /// If there are not as many `distances` as `rays`.
    pub fn distance_batch(&self, rays: &[Ray], options: &QueryOptions, distances: &mut [f32]) {
        assert_eq!(rays.len(), distances.len(), "one answer per ray");
        match self.table() {
            Some(table) => table.distance_batch(rays, options, distances),
            None => distances.fill(f32::INFINITY),
        }
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
        match self.table() {
            Some(table) => table.occluded_batch(rays, options, occluded),
            None => occluded.fill(false),
        }
    }
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
