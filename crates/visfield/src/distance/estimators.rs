//! The cheap estimators of the 2012 thesis over any distance function: shadows of a point of light with a made-up penumbra, ambient
//! occlusion from a few distances along the normal, and obscurance by rays.
//!
//! They are here to be compared with (`visfield measure paper2012`): the thesis itself found the first two unreliable, and so do
//! the measurements. What this crate draws with are [cones](super::cone) and [rays](super::query).
//!
//! All of them take the distance as a closure, so that a scene may be the union of several fields and shapes, and give occlusion,
//! 0 to 1, where the thesis has visibility. Lengths are those of the distances' space.
//!
//! A [`DistanceGrid`](super::DistanceGrid) gives a lower bound of the distance outside its box. The thesis' grid gave the distance
//! to the box instead (algorithm 4.1), which darkens whatever comes near it, and had to be left out of ambient occlusion by hand
//! (algorithm 4.2); here both are the same function, whose bound leaves a soft and small rest: at most 0.17 of occlusion beside a
//! ball's grid, where the thesis' function is wrong by 0.98.
//!
//! Normals are [`DistanceField::gradient`](super::DistanceField::gradient) (algorithm 3.1).
//!
//! Twin: `shaders/estimators.wgsl`, same names, but for [`ray_occlusion`].

use glam::Vec3;

use super::sphere_trace::{SphereTracing, sphere_trace};
use crate::estimate::Falloff;

/// How shadow rays are marched.
///
/// ```
/// use visfield::distance::estimators::ShadowMarch;
/// let fine = ShadowMarch { max_steps: 256, ..ShadowMarch::default() };
/// assert!(fine.start > fine.threshold);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadowMarch {
    /// Where a ray starts, so that the surface does not shadow itself: much more than `threshold`.
    pub start: f32,
    /// Distance below which a surface is met: ε.
    pub threshold: f32,
    /// Most steps; a ray that needs more is as lit as it is by then. The thesis has no limit.
    pub max_steps: u32,
}

impl Default for ShadowMarch {
    /// For grids, in voxels.
    fn default() -> Self {
        Self { start: 1.0, threshold: 0.05, max_steps: 64 }
    }
}

/// Whether a point of light is hidden, 0 or 1 (algorithm 3.2). `direction` is the unit vector to it, `t_light` how far it is.
///
/// ```
/// use glam::Vec3;
/// use visfield::distance::estimators::{ShadowMarch, hard_shadow};
/// let ball = |position: Vec3| (position - Vec3::Y * 10.0).length() - 4.0;
/// let shadow = |x: f32| hard_shadow(ball, Vec3::X * x, Vec3::Y, 100.0, &ShadowMarch::default());
/// assert_eq!((shadow(3.9), shadow(4.2)), (1.0, 0.0));
/// ```
#[inline(always)]
pub fn hard_shadow(
    distance: impl Fn(Vec3) -> f32,
    position: Vec3,
    direction: Vec3,
    t_light: f32,
    march: &ShadowMarch,
) -> f32 {
    // Without a penumbra: any distance that is not met is as good as another.
    penumbra_shadow(distance, position, direction, t_light, f32::INFINITY, march)
}

/// How much of a light seems hidden by how near a ray towards it comes to a surface: 1 − min(scale·d/t) (algorithm 3.3).
///
/// A scale of 1 over the tangent of a light's half-angle makes the outer half of its penumbra as wide as it is; the inner half,
/// where less than all of the light is hidden though its centre is, is always dark. 4 to 64 in the thesis.
///
/// ```
/// use glam::Vec3;
/// use visfield::distance::estimators::{ShadowMarch, penumbra_shadow};
/// let ball = |position: Vec3| (position - Vec3::Y * 10.0).length() - 4.0;
/// let shadow = |x: f32| penumbra_shadow(ball, Vec3::X * x, Vec3::Y, 100.0, 4.0, &ShadowMarch::default());
/// assert_eq!((shadow(3.9), shadow(8.0)), (1.0, 0.0));
/// assert!((0.3..0.7).contains(&shadow(5.2)));
/// ```
#[inline(always)]
pub fn penumbra_shadow(
    distance: impl Fn(Vec3) -> f32,
    position: Vec3,
    direction: Vec3,
    t_light: f32,
    scale: f32,
    march: &ShadowMarch,
) -> f32 {
    let mut t = march.start;
    let mut lit = 1.0_f32;
    for _ in 0..march.max_steps {
        if t >= t_light {
            break;
        }
        let nearest = distance(position + direction * t);
        if nearest < march.threshold {
            return 1.0;
        }
        lit = lit.min(scale * nearest / t);
        t += nearest;
    }
    1.0 - lit
}

/// How ambient occlusion is told from distances along the normal.
///
/// ```
/// use glam::Vec3;
/// use visfield::distance::estimators::NormalOcclusion;
/// let bent = NormalOcclusion::bent(Vec3::Y);
/// assert_eq!((bent.bend, bent.base), (0.5, 1.1));
/// assert_eq!(NormalOcclusion::default().bend, 0.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalOcclusion {
    /// From one sample to the next, Δt, above 0.
    pub step: f32,
    /// Number of samples, at least 1: the thesis has about 5.
    pub samples: u32,
    /// Each sample counts 1/base of the one before; at least 1, which lets all count alike. The thesis has 2, and 1.1 with a bent
    /// normal.
    pub base: f32,
    /// How dark it gets, above 0: at 1 occlusion is 1 where the distance is 0 at all samples. The thesis' s is this over the
    /// largest sum that is possible, and so depends on units, steps and base.
    pub strength: f32,
    /// How much of `up` is added to the normal from one sample to the next: α of eq. 3.33, 0 for none.
    pub bend: f32,
    /// The unit vector to where the light comes from: u of eq. 3.33.
    pub up: Vec3,
}

impl Default for NormalOcclusion {
    /// Algorithm 3.4, for grids, in voxels.
    fn default() -> Self {
        Self { step: 2.0, samples: 5, base: 2.0, strength: 1.0, bend: 0.0, up: Vec3::Y }
    }
}

impl NormalOcclusion {
    /// Algorithm 3.7: the normal bends upwards, by what Evans had.
    pub fn bent(up: Vec3) -> Self {
        Self { base: 1.1, bend: 0.5, up, ..Self::default() }
    }

    /// Σ weight·(expected distance − distance) over the largest that it can be: the part of the way that is missing (eq. 3.31).
    #[inline(always)]
    fn shortfall(&self, distance: impl Fn(Vec3) -> f32, position: Vec3, normal: Vec3) -> f32 {
        let (mut missing, mut most, mut weight) = (0.0, 0.0, 1.0);
        let mut direction = normal;
        for k in 1..=self.samples {
            weight /= self.base;
            let t = self.step * k as f32;
            let expected = direction.dot(direction).sqrt() * t;
            // A distance inside something is no darker than one on it.
            missing += weight * (expected - distance(position + direction * t).max(0.0));
            most += weight * expected;
            direction += self.up * self.bend;
        }
        missing / most
    }
}

/// Ambient occlusion by what distances along the normal lack of those above an open plane: in algorithm 3.4 and, with a bent
/// normal, in 3.7.
///
/// Deviations: as printed, both algorithms forget to add up what the samples find and leave out the last one; here it is the sum
/// of eq. 3.31. In 3.7 the normal is longer after each step, as printed, so that samples are ever farther apart.
///
/// ```
/// use glam::Vec3;
/// use visfield::distance::estimators::{NormalOcclusion, normal_occlusion};
/// let settings = NormalOcclusion { step: 0.2, ..NormalOcclusion::default() };
/// let corner = |position: Vec3| position.x.min(position.y);
/// let occlusion = |x: f32| normal_occlusion(corner, Vec3::X * x, Vec3::Y, &settings);
/// assert_eq!(occlusion(2.0), 0.0);
/// assert!(occlusion(0.1) > occlusion(0.3) && occlusion(0.3) > 0.1);
/// ```
#[inline(always)]
pub fn normal_occlusion(
    distance: impl Fn(Vec3) -> f32,
    position: Vec3,
    normal: Vec3,
    settings: &NormalOcclusion,
) -> f32 {
    (settings.strength * settings.shortfall(distance, position, normal)).clamp(0.0, 1.0)
}

/// The same with Evans' exponential in the place of the clamp (eq. 3.26): 1 − e^(−strength·Σ), never all dark. His samples count
/// alike (`base` 1); the thesis prints the exponent without its sign.
///
/// ```
/// use glam::Vec3;
/// use visfield::distance::estimators::{NormalOcclusion, evans_occlusion};
/// let settings = NormalOcclusion { step: 0.2, base: 1.0, strength: 2.0, ..NormalOcclusion::default() };
/// let corner = |position: Vec3| position.x.min(position.y);
/// let occlusion = |x: f32| evans_occlusion(corner, Vec3::X * x, Vec3::Y, &settings);
/// assert!(occlusion(2.0) < 1e-6 && occlusion(0.0) < 0.9 && occlusion(0.0) > occlusion(0.3));
/// ```
#[inline(always)]
pub fn evans_occlusion(
    distance: impl Fn(Vec3) -> f32,
    position: Vec3,
    normal: Vec3,
    settings: &NormalOcclusion,
) -> f32 {
    1.0 - (-settings.strength * settings.shortfall(distance, position, normal).max(0.0)).exp()
}

/// Occlusion by sphere-traced rays: the mean over unit directions of the weight of what they hit, up to a distance. With
/// [`Falloff::Obscurance`] it is the thesis' obscurance (eq. 3.19 with 3.23) as occlusion, 1 − W = mean e^(−τt), with
/// [`Falloff::Binary`] its ambient occlusion (eq. 3.18), if directions are distributed as cosines are.
///
/// `start` is where rays start, so that the surface does not occlude itself.
///
/// ```
/// use glam::Vec3;
/// use visfield::distance::{estimators::ray_occlusion, sphere_trace::SphereTracing};
/// use visfield::estimate::{Falloff, cosine_direction, sampling::sphere_samples};
/// let roof = |position: Vec3| 2.0 - position.y;
/// let directions: Vec<Vec3> = sphere_samples(64).into_iter().map(|s| cosine_direction(Vec3::Y, s)).collect();
/// let tracing = SphereTracing { threshold: 0.01, ..SphereTracing::default() };
/// let occlusion =
///     |falloff| ray_occlusion(roof, Vec3::ZERO, &directions, 0.1, falloff, 100.0, &tracing);
/// assert!(occlusion(Falloff::Binary) > 0.9);
/// assert!((0.1..0.6).contains(&occlusion(Falloff::Obscurance { tau: 0.5 })));
/// ```
pub fn ray_occlusion(
    distance: impl Fn(Vec3) -> f32,
    position: Vec3,
    directions: &[Vec3],
    start: f32,
    falloff: Falloff,
    max_distance: f32,
    tracing: &SphereTracing,
) -> f32 {
    let weight = |direction: &Vec3| {
        let traced = sphere_trace(&distance, position, *direction, (start, max_distance), tracing);
        if traced.hit { falloff.weight(traced.t, max_distance) } else { 0.0 }
    };
    directions.iter().map(weight).sum::<f32>() / directions.len().max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distance::{BYTE_REACH, DistanceGridFormat, DistancePrecision, ball_grid};
    use crate::estimate::cosine_direction;
    use crate::estimate::sampling::sphere_samples;

    #[test]
    fn penumbrae_are_as_wide_as_their_scale_says() {
        // Below the edge of a wall that starts 10 above: the outer half of the penumbra of a light with tangent 0.1 is 1 wide.
        let wall = |p: Vec3| (-p.x).max(10.0 - p.y);
        let march = ShadowMarch { start: 0.01, threshold: 1e-4, max_steps: 1000 };
        let shadow = |x: f32, scale: f32| penumbra_shadow(wall, Vec3::X * x, Vec3::Y, 40.0, scale, &march);
        assert_eq!((shadow(0.1, 10.0), shadow(-4.1, 10.0)), (1.0, 0.0));
        for outside in [0.2, 0.5, 0.8] {
            // At most 40 away, where the light is.
            let expected = 1.0 - 10.0 * outside / 40.0;
            assert!((shadow(-outside, 10.0) - expected).abs() < 0.03, "{outside}: {}", shadow(-outside, 10.0));
            assert!(shadow(-outside, 20.0) < shadow(-outside, 10.0));
            assert_eq!(hard_shadow(wall, Vec3::X * -outside, Vec3::Y, 40.0, &march), 0.0);
        }
        assert_eq!(hard_shadow(wall, Vec3::X, Vec3::Y, 40.0, &march), 1.0);
        // What is behind the light hides nothing.
        assert_eq!(penumbra_shadow(wall, Vec3::X, Vec3::Y, 2.0, 10.0, &march), 0.0);
        for wrong in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let found = penumbra_shadow(|_| wrong, Vec3::ZERO, Vec3::Y, f32::INFINITY, 4.0, &march);
            assert!((0.0..=1.0).contains(&found), "{wrong}: {found}");
        }
    }

    #[test]
    fn samples_along_the_normal_are_summed() {
        // In a corner, x from the wall: each of the samples k·Δt lacks what it has beyond x.
        let corner = |p: Vec3| p.x.min(p.y);
        let settings =
            NormalOcclusion { step: 1.0, samples: 4, base: 2.0, strength: 0.5, ..NormalOcclusion::default() };
        let found = normal_occlusion(corner, Vec3::X * 1.5, Vec3::Y, &settings);
        let expected = 0.5 * (0.5 / 4.0 + 1.5 / 8.0 + 2.5 / 16.0) / (1.0 / 2.0 + 2.0 / 4.0 + 3.0 / 8.0 + 4.0 / 16.0);
        assert!((found - expected).abs() < 1e-6, "{found}, not {expected}");
        // Units do not matter, as long as steps have the same.
        let scaled = NormalOcclusion { step: 7.0, ..settings };
        assert!((normal_occlusion(corner, Vec3::X * 10.5, Vec3::Y, &scaled) - expected).abs() < 1e-6);
        let evans = evans_occlusion(corner, Vec3::X * 1.5, Vec3::Y, &settings);
        assert!((evans - (1.0 - (-expected).exp())).abs() < 1e-6, "{evans}");
        let dark = NormalOcclusion { strength: 100.0, ..settings };
        assert_eq!(normal_occlusion(corner, Vec3::X * 0.5, Vec3::Y, &dark), 1.0);
    }

    #[test]
    fn bent_normals_see_what_is_above() {
        // A vertical wall with a roof far over it.
        let roofed = |p: Vec3| p.x.min(6.0 - p.y);
        let settings = NormalOcclusion { step: 1.0, ..NormalOcclusion::default() };
        let bent = NormalOcclusion { step: 1.0, ..NormalOcclusion::bent(Vec3::Y) };
        let at = |y: f32, settings: &NormalOcclusion| normal_occlusion(roofed, Vec3::Y * y, Vec3::X, settings);
        assert_eq!(at(0.0, &settings), 0.0);
        assert!(at(0.0, &bent) > 0.2 && at(-20.0, &bent) < at(0.0, &bent), "{}, {}", at(0.0, &bent), at(-20.0, &bent));
    }

    #[test]
    fn obscurance_weighs_hits_by_their_distance() {
        let roof = |p: Vec3| 2.0 - p.y;
        let up = [Vec3::Y; 3];
        let tracing = SphereTracing { threshold: 1e-4, ..SphereTracing::default() };
        let occlusion = |falloff, far| ray_occlusion(roof, Vec3::ZERO, &up, 0.0, falloff, far, &tracing);
        let tau = 0.7;
        assert!((occlusion(Falloff::Obscurance { tau }, 9.0) - (-tau * 2.0_f32).exp()).abs() < 1e-3);
        assert_eq!((occlusion(Falloff::Binary, 9.0), occlusion(Falloff::Binary, 1.9)), (1.0, 0.0));
        assert_eq!(ray_occlusion(roof, Vec3::ZERO, &[], 0.0, Falloff::Binary, 9.0, &tracing), 0.0);
        let side: Vec<Vec3> = sphere_samples(256).into_iter().map(|s| cosine_direction(Vec3::NEG_Y, s)).collect();
        assert_eq!(ray_occlusion(roof, Vec3::ZERO, &side, 0.1, Falloff::Binary, 9.0, &tracing), 0.0);
    }

    /// The 2012 thesis' Figure 4.2b shows the grid's box on the ground, and 4.3 what it takes to get rid of it.
    #[test]
    fn ambient_occlusion_does_not_show_a_grids_box() {
        // Bytes tell distances up to a reach; steps beyond it would find it everywhere.
        let settings = NormalOcclusion { step: BYTE_REACH.0 / 5.0, ..NormalOcclusion::default() };
        for precision in [DistancePrecision::U8, DistancePrecision::U16] {
            let grid = ball_grid(1.0, DistanceGridFormat { precision, ..DistanceGridFormat::DEFAULT });
            let (middle, radius) = (grid.last() * 0.5, 1.0 / grid.header().voxel);
            let exact = |p: Vec3| (p - middle).length() - radius;
            // Algorithm 4.1.
            let thesis = |p: Vec3| {
                let beyond = (p - p.clamp(Vec3::ZERO, grid.last())).length();
                if beyond > 0.0 { beyond } else { grid.distance(p) }
            };
            let (mut worst, mut largest_step, mut worst_of_thesis) = (0.0_f32, 0.0_f32, 0.0_f32);
            // On grounds below the box, through it, and above it, along lines that cross its faces.
            for height in [-3.0, 0.5, middle.y, grid.last().y + 0.1] {
                for across in [5.0, middle.z] {
                    let mut last = None;
                    for i in 0..800 {
                        let position = Vec3::new(-40.0 + 0.175 * i as f32, height, across);
                        if exact(position) < 1.0 {
                            last = None;
                            continue;
                        }
                        let ground = |p: Vec3| p.y - height;
                        let from = |distance: &dyn Fn(Vec3) -> f32| {
                            normal_occlusion(|p| ground(p).min(distance(p)), position, Vec3::Y, &settings)
                        };
                        let error = from(&|p| grid.distance(p)) - from(&exact);
                        worst = worst.max(error.abs());
                        largest_step = largest_step.max((error - last.unwrap_or(error)).abs());
                        worst_of_thesis = worst_of_thesis.max((from(&thesis) - from(&exact)).abs());
                        last = Some(error);
                    }
                }
            }
            println!("{precision:?}: {worst}, {largest_step} from one to the next; algorithm 4.1 {worst_of_thesis}");
            assert!(worst < 0.2 && largest_step < 0.05, "{precision:?}: {worst}, {largest_step}");
            assert!(worst_of_thesis > 0.9, "{precision:?}: {worst_of_thesis}");
        }
    }
}
