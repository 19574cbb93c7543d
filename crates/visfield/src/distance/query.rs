//! Rays of a [`VisibilityField`](crate::VisibilityField) against its distances.
//!
//! Twin of the functions of the same names in `shaders/distance.wgsl`. Rays are in the space of the distances.

use glam::Vec3;

use super::sphere_trace::{Exhausted, SphereTracing, Traced, sphere_trace};
use super::{DistanceField, GRID_THRESHOLD, SHAPE_THRESHOLD};
use crate::field::query::{Bias, Ray, finite};

/// How far below a grid's threshold distances near the origin must be to count, in multiples of [`Bias::height`] and voxels: 0.3
/// voxels by default, about what a grid rounds off a crease.
pub const SLACK: f32 = 2.0;
/// Over how long a way that ends, in multiples of [`Bias::along`] and voxels: 1.2 voxels by default.
pub const SLACK_REACH: f32 = 4.8;
/// Least length over which slack ends: a bias of nothing has no slack to end.
pub const LEAST_REACH: f32 = 1.0e-6;
/// Least step of rays that only ask whether something is in the way: less than a grid shows to be thick.
pub const LEAST_STEP: f32 = 0.25;
/// Most steps of such a ray.
pub const MAX_STEPS: u32 = 64;
/// ω of their over-relaxation.
pub const RELAXATION: f32 = 1.6;

/// A ray whose direction has length 1, and the part of it that can hit anything.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    pub(super) origin: Vec3,
    pub(super) direction: Vec3,
    pub(super) t_min: f32,
    /// Not above `t_min` if there is nothing to hit.
    pub(super) t_max: f32,
    /// [`SphereTracing::slack`]
    pub(super) slack: f32,
}

/// The part of a ray with a unit direction inside a box.
#[inline(always)]
pub(super) fn box_segment(origin: Vec3, direction: Vec3, low: Vec3, high: Vec3) -> (f32, f32) {
    let inverse = Vec3::new(inverse(direction.x), inverse(direction.y), inverse(direction.z));
    let (a, b) = ((low - origin) * inverse, (high - origin) * inverse);
    let (near, far) = (a.min(b), a.max(b));
    (near.x.max(near.y).max(near.z), far.x.min(far.y).min(far.z))
}

/// 1 over a component of a direction; finite for zero.
#[inline(always)]
fn inverse(x: f32) -> f32 {
    let least = 1.0e-20;
    1.0 / if x.abs() > least { x } else { least }
}

/// An origin on a surface with this unit normal, or none if it is zero: one that is below the surface, as the distances have it, is
/// lifted out along the normal. Twice, for within sheets distances do not grow right away; each time by no more than the slack.
#[inline(always)]
pub(super) fn lifted(mut origin: Vec3, normal: Vec3, slack: f32, distance: impl Fn(Vec3) -> f32) -> Vec3 {
    if slack > 0.0 && normal != Vec3::ZERO {
        for _ in 0..2 {
            origin += normal * (-distance(origin)).clamp(0.0, slack);
        }
    }
    origin
}

/// The segment of a ray in a box. `lift` is asked for the place of origins in it, where the ray is slack.
#[inline(always)]
pub(super) fn segment(ray: &Ray, slack: f32, (low, high): (Vec3, Vec3), lift: impl Fn(Vec3) -> Vec3) -> Segment {
    let length = ray.direction.dot(ray.direction).sqrt();
    let direction = ray.direction * (1.0 / length);
    let inside = ray.origin.clamp(low, high) == ray.origin;
    let (slack, origin) = if inside { (slack, lift(ray.origin)) } else { (0.0, ray.origin) };
    let (t_entry, t_exit) = box_segment(origin, direction, low, high);
    let end = ray.t_max * length;
    // An end that is no number is before everything.
    let t_max = if t_exit < end { t_exit } else { end };
    Segment { origin, direction, t_min: t_entry.max(0.0), t_max, slack }
}

impl DistanceField {
    /// How rays are traced that ask whether something is in the way.
    fn any_hit(&self, bias: Bias) -> SphereTracing {
        let finer = self.threshold() / GRID_THRESHOLD;
        SphereTracing {
            relaxation: RELAXATION,
            adaptive: true,
            max_steps: MAX_STEPS,
            threshold: self.threshold(),
            pixel: 0.0,
            exhausted: Exhausted::Missed,
            smoothing: 0,
            from_inside: false,
            slack: bias.height * (SLACK * finer),
            slack_reach: (bias.along * (SLACK_REACH * finer)).max(LEAST_REACH),
            least_step: self.least_step(),
        }
    }

    /// The least step of such rays: shapes may be as thin as they like, and are inflated by the threshold on both sides.
    fn least_step(&self) -> f32 {
        match self {
            Self::Grid(_) => LEAST_STEP,
            Self::Shape(_) => 1.9 * SHAPE_THRESHOLD,
        }
    }

    fn traced(&self, ray: &Ray, normal: Vec3, bias: Bias) -> Traced {
        let settings = self.any_hit(bias);
        let distance = |position| self.distance(position);
        let lift = |origin| lifted(origin, normal, settings.slack, distance);
        let Segment { origin, direction, t_min, t_max, slack } = segment(ray, settings.slack, self.bounds(), lift);
        sphere_trace(distance, origin, direction, (t_min, t_max), &SphereTracing { slack, ..settings })
    }

    /// [`VisibilityField::hit`](crate::VisibilityField::hit), for a ray, a normal and a bias in the space of the distances.
    pub(crate) fn hit(&self, ray: &Ray, normal: Vec3, bias: Bias) -> Option<f32> {
        let (rescaled, scale) = ray.rescaled();
        let traced = self.traced(&rescaled, normal, bias);
        let t = traced.t / rescaled.direction.length() / scale;
        traced.hit.then(|| finite(t).min(ray.t_max.next_down()))
    }

    /// [`VisibilityField::occluded`](crate::VisibilityField::occluded), likewise.
    pub(crate) fn occluded(&self, ray: &Ray, normal: Vec3, bias: Bias) -> bool {
        let (ray, _) = ray.rescaled();
        self.traced(&ray, normal, bias).hit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distance::{
        DistanceGrid, DistanceGridFormat, DistanceGridHeader, DistancePrecision, Solid, ball_grid, grid_positions,
    };
    use crate::estimate::sampling::sphere_samples;
    use crate::shape::Shape;
    use glam::Vec3Swizzles;

    fn ball(voxels: u32, precision: DistancePrecision) -> DistanceField {
        DistanceField::Grid(ball_grid(1.0, DistanceGridFormat { voxels, precision }))
    }

    /// Rays from around and within a ball's box, in the space of its grid.
    fn rays(field: &DistanceField) -> Vec<Ray> {
        let middle = (field.bounds().0 + field.bounds().1) * 0.5;
        let samples = sphere_samples(4000).into_iter().enumerate();
        let ray = |(i, p): (usize, Vec3)| Ray {
            origin: middle + p.zxy() * (0.3 + (i % 7) as f32 * 0.4) * middle,
            direction: p * if i % 5 == 0 { 0.01 } else { 30.0 },
            t_max: if i % 3 == 0 { 1.0 } else { f32::INFINITY },
        };
        samples.map(ray).collect()
    }

    #[test]
    fn batches_answer_as_single_rays_do() {
        for precision in [DistancePrecision::U8, DistancePrecision::U16] {
            let field = ball(24, precision);
            let rays = rays(&field);
            for (normal, bias) in [(Vec3::ZERO, Bias::NONE), (Vec3::Y, Bias::default())] {
                let (mut hits, mut occluded) = (vec![0.0; rays.len()], vec![false; rays.len()]);
                field.hit_batch(&rays, normal, bias, &mut hits);
                field.occluded_batch(&rays, normal, bias, &mut occluded);
                for (ray, (hit, occluded)) in rays.iter().zip(hits.into_iter().zip(occluded)) {
                    assert_eq!(field.hit(ray, normal, bias).unwrap_or(f32::INFINITY), hit, "{ray:?}");
                    assert_eq!(field.occluded(ray, normal, bias), occluded, "{ray:?}");
                }
            }
        }
    }

    #[test]
    fn rays_across_a_hollow_end_at_the_other_side() {
        // The wall that a ray leaves is nearer than the one that it meets.
        let hollow = Shape::Box { half_extents: [1.0; 3] }.difference(Shape::Sphere { radius: 0.9 });
        let shape = DistanceField::Shape(Solid::new(hollow).unwrap());
        let header = DistanceGridHeader::around([-1.0; 3], [1.0; 3], DistanceGridFormat::DEFAULT);
        let sampled: Vec<f32> = grid_positions(&header)
            .map(|p| {
                let outside = p.abs().max_element() - 1.0;
                (outside.max(0.9 - p.length()) / f64::from(header.voxel)) as f32
            })
            .collect();
        let grid = DistanceField::Grid(DistanceGrid::from_distances(header, &sampled).unwrap());
        for field in [shape, grid] {
            let map = field.distance_from_mesh().as_affine3a();
            for sample in sphere_samples(200) {
                let (origin, direction) = (sample * 0.9, Vec3::new(sample.y, sample.z, sample.x) * 0.9 - sample * 0.9);
                let normal = -sample;
                if direction.length() < 0.4 {
                    continue;
                }
                let ray = Ray::new(map.transform_point3(origin), map.transform_vector3(direction));
                let hit = field.hit(&ray, normal, Bias::default()).expect("the other side is ahead");
                assert!((hit - 1.0).abs() < 0.08, "{field:?} at {sample}: {hit}");
                let mut batch = [0.0];
                field.hit_batch(&[ray], normal, Bias::default(), &mut batch);
                assert_eq!(batch, [hit]);
            }
        }
    }

    #[test]
    fn what_is_no_ray_hits_nothing() {
        for field in
            [ball(24, DistancePrecision::U8), DistanceField::Shape(Solid::new(Shape::Sphere { radius: 1.0 }).unwrap())]
        {
            let middle = (field.bounds().0 + field.bounds().1) * 0.5;
            let ray = Ray::new(middle - Vec3::X * 90.0, Vec3::X);
            assert!(field.occluded(&ray, Vec3::ZERO, Bias::NONE));
            for wrong in [
                Ray { t_max: f32::NAN, ..ray },
                Ray { direction: Vec3::ZERO, ..ray },
                Ray { direction: Vec3::NAN, ..ray },
                Ray { origin: Vec3::NAN, ..ray },
                Ray { origin: Vec3::splat(f32::INFINITY), ..ray },
            ] {
                let (mut hit, mut occluded) = ([0.0], [true]);
                field.hit_batch(&[wrong], Vec3::Y, Bias::default(), &mut hit);
                field.occluded_batch(&[wrong], Vec3::Y, Bias::NONE, &mut occluded);
                assert!(
                    !field.occluded(&wrong, Vec3::ZERO, Bias::NONE)
                        && field.hit(&wrong, Vec3::Y, Bias::default()).is_none()
                );
                assert_eq!((hit, occluded), ([f32::INFINITY], [false]), "{wrong:?}");
            }
        }
    }
}
