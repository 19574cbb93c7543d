//! Sphere tracing: along a ray by steps that the distance to the nearest surface allows (Hart 1996; the 2012 thesis, §2.2.2),
//! with the enhancements of Keinert et al., *Enhanced Sphere Tracing* (2014), each of which can be left out.
//!
//! Twin: `shaders/sphere_trace.wgsl`, same names. Lengths are those of the distance field's own space.

use glam::Vec3;

/// How rays are traced.
///
/// ```
/// use visfield::distance::sphere_trace::SphereTracing;
/// let classical = SphereTracing { relaxation: 1.0, ..SphereTracing::default() };
/// assert!(classical.threshold > 0.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereTracing {
    /// ω of over-relaxation, 1 (none) to below 2 (2014, §3.1).
    pub relaxation: f32,
    /// Whether each step is relaxed by as much as, at the rate at which the distance changed over the last one, spheres still
    /// overlap, and at most by ω: and so again, too, after a step had to be taken back. Otherwise rays are relaxed by ω until that
    /// happens and never after, as in the paper, which leaves this to future work (2014, §5).
    pub adaptive: bool,
    /// Most evaluations of the distance.
    pub max_steps: u32,
    /// Distance below which a surface is met.
    pub threshold: f32,
    /// Radius of a pixel at t = 1: a surface is met as well where it is nearer than that times t. 0 for rays that are no pixels.
    pub pixel: f32,
    /// What becomes of rays that run out of steps.
    pub exhausted: Exhausted,
    /// Steps of the fixed-point iteration that evens out how near to the surface rays end (2014, §3.4); three suffice, 0 leaves
    /// it out.
    pub smoothing: u32,
    /// Whether a ray that starts inside a solid goes on to where it leaves it, as light does in glass. Otherwise it has hit at once.
    pub from_inside: bool,
    /// How far below the threshold a distance has to be to count as a surface where the ray starts, because it leaves one that the
    /// distances show only so accurately; and over how long a way that ends.
    pub slack: f32,
    /// See [`slack`](Self::slack); above 0.
    pub slack_reach: f32,
    /// No step is shorter, so that grazing rays arrive: less than what is to be hit is thick. 0 for none.
    pub least_step: f32,
}

/// What becomes of a ray that runs out of steps before it meets anything.
///
/// ```
/// use visfield::distance::sphere_trace::Exhausted;
/// assert_eq!(Exhausted::default(), Exhausted::Missed);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Exhausted {
    /// It hits nothing (2014, listing 1).
    #[default]
    Missed,
    /// It hits where it is: in mid-air, behind edges that it grazes.
    Last,
    /// It hits where it was nearest to a surface, in pixels (2014, §3.2, `forceHit`).
    Nearest,
}

impl Default for SphereTracing {
    /// For rays that only ask whether something is in the way.
    fn default() -> Self {
        Self {
            relaxation: 1.6,
            adaptive: true,
            max_steps: 64,
            threshold: 0.05,
            pixel: 0.0,
            exhausted: Exhausted::Missed,
            smoothing: 0,
            from_inside: false,
            slack: 0.0,
            slack_reach: 1.0,
            least_step: 0.0,
        }
    }
}

impl SphereTracing {
    /// Distance below which a surface is met at t.
    #[inline(always)]
    fn tolerance(&self, t: f32) -> f32 {
        self.threshold.max(self.pixel * t)
    }

    /// Whether a ray that has come to t has met a surface at this distance.
    #[inline(always)]
    fn meets(&self, radius: f32, t: f32) -> bool {
        radius < self.tolerance(t) - self.slack * (1.0 - t / self.slack_reach).max(0.0)
    }

    /// How far from the surface that a ray has met the next one starts, to meet another: ε of 2014, §3.3, with the threshold as
    /// its least.
    ///
    /// ```
    /// use visfield::distance::sphere_trace::SphereTracing;
    /// let settings = SphereTracing { threshold: 0.01, ..SphereTracing::default() };
    /// assert_eq!((settings.escape(-0.3), settings.escape(0.001)), (0.6, 0.02));
    /// ```
    pub fn escape(&self, distance: f32) -> f32 {
        2.0 * self.threshold.max(distance.abs())
    }
}

/// The rate at which the distance is taken to change before the first step: rays come nearer.
const FIRST_RATE: f32 = -0.5;

/// Where a ray ended.
///
/// ```
/// use glam::Vec3;
/// use visfield::distance::sphere_trace::{SphereTracing, sphere_trace};
/// let ball = |position: Vec3| position.length() - 1.0;
/// let traced = sphere_trace(ball, Vec3::X * -3.0, Vec3::X, (0.0, 10.0), &SphereTracing::default());
/// assert!(traced.hit && (traced.t - 2.0).abs() < 0.1 && traced.evaluations < 10);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Traced {
    /// Whether a surface was met.
    pub hit: bool,
    /// Where: a multiple of the direction. Without a hit, how far the ray came.
    pub t: f32,
    /// The signed distance from the surface there.
    pub distance: f32,
    /// How often the distance was asked for.
    pub evaluations: u32,
}

/// Traces a ray with a unit direction between two parameters.
#[inline(always)]
pub fn sphere_trace(
    distance: impl Fn(Vec3) -> f32,
    origin: Vec3,
    direction: Vec3,
    (t_min, t_max): (f32, f32),
    settings: &SphereTracing,
) -> Traced {
    let mut relaxation = settings.relaxation;
    let mut traced = Traced { hit: false, t: t_min, distance: 0.0, evaluations: 0 };
    let (mut t, mut previous, mut step) = (t_min, 0.0, 0.0);
    // −1 on the way out.
    let mut sign = 1.0;
    // The nearest that the ray came, in multiples of what counts as met.
    let mut nearest = f32::MAX;
    while traced.evaluations < settings.max_steps && t < t_max {
        let signed = distance(origin + direction * t);
        traced.evaluations += 1;
        if settings.from_inside && traced.evaluations == 1 && signed < 0.0 {
            sign = -1.0;
        }
        let radius = sign * signed;
        if step > previous && previous + radius < step && step > settings.least_step {
            // The spheres around this point and the one before do not meet: something may be between them. Back to where the
            // last one ends; the paper goes back to a little before that (2014, §3.1).
            t += previous - step;
            step = previous;
            relaxation = 1.0;
            continue;
        }
        if settings.adaptive {
            relaxation = adapted(radius, previous, step, settings.relaxation);
        }
        let relative = radius / settings.tolerance(t);
        if relative < nearest || settings.exhausted == Exhausted::Last {
            nearest = relative;
            (traced.t, traced.distance) = (t, signed);
        }
        if settings.meets(radius, t) {
            // Where the ray was slack it may have been nearer before.
            (traced.hit, traced.t, traced.distance) = (true, t, signed);
            break;
        }
        step = (radius * relaxation).max(settings.least_step);
        previous = radius;
        t += step;
    }
    if !traced.hit {
        // Out of steps, not of length.
        traced.hit = t < t_max && settings.exhausted != Exhausted::Missed;
        if !traced.hit {
            traced.t = t.min(t_max);
            return traced;
        }
    }
    for _ in 0..settings.smoothing {
        // 2014, eq. 3.
        traced.t += sign * traced.distance - settings.tolerance(traced.t);
        traced.distance = distance(origin + direction * traced.t);
        traced.evaluations += 1;
    }
    traced
}

/// How much to relax a step after a last one over which the distance changed from `previous` to `radius`, from 1 to `most`: where the
/// distance goes on to change at that rate, spheres relaxed by 2/(1 − rate) just meet. A little less, for it seldom does.
#[inline(always)]
pub(super) fn adapted(radius: f32, previous: f32, step: f32, most: f32) -> f32 {
    let rate = if step > 0.0 { (radius - previous) / step } else { FIRST_RATE };
    let fitting = 1.9 / (1.0 - rate).max(0.5);
    fitting.max(1.0).min(most)
}

/// Traces a ray that starts inside a convex solid to where it leaves it: from the end of its bounds, `t_bounds`, back to the
/// solid, through space in which distances are large, in the place of the inside, where they are not (2014, §3.5).
///
/// ```
/// use glam::Vec3;
/// use visfield::distance::sphere_trace::{SphereTracing, trace_out_of_convex};
/// let ball = |position: Vec3| position.length() - 1.0;
/// let traced = trace_out_of_convex(ball, Vec3::ZERO, Vec3::X, 1.5, &SphereTracing::default());
/// assert!(traced.hit && (traced.t - 1.0).abs() < 0.1);
/// ```
#[inline(always)]
pub fn trace_out_of_convex(
    distance: impl Fn(Vec3) -> f32,
    origin: Vec3,
    direction: Vec3,
    t_bounds: f32,
    settings: &SphereTracing,
) -> Traced {
    let end = origin + direction * t_bounds;
    let traced = sphere_trace(distance, end, -direction, (0.0, t_bounds), settings);
    Traced { t: t_bounds - traced.t, ..traced }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::sampling::sphere_samples;
    use glam::vec3;

    fn ball(position: Vec3) -> f32 {
        position.length() - 1.0
    }

    /// A slab that is thinner than a relaxed step is long, behind a ball.
    fn slab_behind_ball(position: Vec3) -> f32 {
        ball(position).min((position.x - 3.0).abs() - 0.01)
    }

    const FINE: SphereTracing = SphereTracing {
        relaxation: 1.0,
        adaptive: true,
        max_steps: 1000,
        threshold: 1e-4,
        pixel: 0.0,
        exhausted: Exhausted::Missed,
        smoothing: 0,
        from_inside: true,
        slack: 0.0,
        slack_reach: 1.0,
        least_step: 0.0,
    };

    #[test]
    fn relaxation_passes_through_nothing() {
        for sample in sphere_samples(400) {
            let (origin, direction) =
                (vec3(-4.0, sample.x * 1.5, sample.y * 1.5), vec3(1.0, sample.z * 0.1, 0.0).normalize());
            let exact = sphere_trace(slab_behind_ball, origin, direction, (0.0, 20.0), &FINE);
            assert!(exact.hit);
            for (relaxation, adaptive) in [(1.2, true), (1.6, true), (1.9, true), (1.6, false)] {
                let fast = sphere_trace(
                    slab_behind_ball,
                    origin,
                    direction,
                    (0.0, 20.0),
                    &SphereTracing { relaxation, adaptive, ..FINE },
                );
                assert!((fast.t - exact.t).abs() < 0.02, "relaxation {relaxation}: {} and {}", fast.t, exact.t);
            }
        }
    }

    #[test]
    fn relaxation_saves_steps_of_grazing_rays() {
        let evaluations = |relaxation| {
            let settings = SphereTracing { relaxation, ..FINE };
            let graze = |i: i32| vec3(-4.0, 1.0 + 0.005 * i as f32, 0.0);
            (1..40).map(|i| sphere_trace(ball, graze(i), Vec3::X, (0.0, 20.0), &settings).evaluations).sum::<u32>()
        };
        for (relaxation, percent) in [(1.2, 95), (1.4, 90), (1.6, 85)] {
            assert!(
                evaluations(relaxation) < evaluations(1.0) * percent / 100,
                "relaxation {relaxation}: {}",
                evaluations(relaxation)
            );
        }
    }

    #[test]
    fn rays_find_their_way_out() {
        let out = sphere_trace(ball, vec3(0.5, 0.0, 0.0), Vec3::NEG_X, (0.0, 10.0), &FINE);
        assert!(out.hit && (out.t - 1.5).abs() < 1e-3, "{out:?}");
        let around = trace_out_of_convex(ball, vec3(0.5, 0.0, 0.0), Vec3::NEG_X, 4.0, &FINE);
        assert!(around.hit && (around.t - out.t).abs() < 1e-3, "{around:?}");
    }

    #[test]
    fn what_runs_out_of_steps_ends_as_it_is_told() {
        // Grazing: a hundredth above the ball.
        let trace = |exhausted| {
            let settings = SphereTracing { max_steps: 12, exhausted, ..FINE };
            sphere_trace(ball, vec3(-3.0, 1.01, 0.0), Vec3::X, (0.0, 100.0), &settings)
        };
        assert!(!trace(Exhausted::Missed).hit);
        let (last, nearest) = (trace(Exhausted::Last), trace(Exhausted::Nearest));
        assert!(last.hit && nearest.hit);
        assert!(nearest.distance <= last.distance, "{nearest:?} {last:?}");
        // Nearest in pixels, not in space.
        let settings = SphereTracing { max_steps: 12, exhausted: Exhausted::Nearest, pixel: 0.001, ..FINE };
        let before = sphere_trace(ball, vec3(-3.0, 1.01, 0.0), Vec3::X, (0.0, 100.0), &settings);
        assert!(before.hit);
        // What leaves the segment hits nothing, however near it came.
        let settings = SphereTracing { exhausted: Exhausted::Nearest, ..FINE };
        assert!(!sphere_trace(ball, vec3(-3.0, 1.01, 0.0), Vec3::X, (0.0, 5.0), &settings).hit);
    }

    #[test]
    fn smoothing_evens_out_how_near_rays_end() {
        let settings = SphereTracing { pixel: 0.01, ..FINE };
        let largest_step = |smoothing| {
            let ends = (0..200).map(|i| {
                let direction = vec3(1.0, 0.002 * i as f32, 0.0).normalize();
                sphere_trace(
                    ball,
                    vec3(-3.0, -0.2, 0.0),
                    direction,
                    (0.0, 10.0),
                    &SphereTracing { smoothing, ..settings },
                )
            });
            let distances: Vec<f32> = ends.filter(|end| end.hit).map(|end| end.distance).collect();
            distances.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f32::max)
        };
        assert!(largest_step(3) < 0.3 * largest_step(0), "{} {}", largest_step(3), largest_step(0));
    }

    #[test]
    fn nothing_hangs_on_what_is_no_number() {
        for wrong in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let traced = sphere_trace(|_| wrong, Vec3::ZERO, Vec3::X, (0.0, 10.0), &SphereTracing::default());
            assert!(traced.evaluations <= 64);
            let traced = sphere_trace(ball, Vec3::splat(wrong), Vec3::X, (0.0, wrong), &SphereTracing::default());
            assert!(traced.evaluations <= 64);
        }
    }
}
