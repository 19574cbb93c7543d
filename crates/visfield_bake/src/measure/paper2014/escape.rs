//! §3.3: how far from the surface the next ray of light starts.

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use visfield::distance::sphere_trace::{SphereTracing, Traced};

use super::facets::{Beam, Facets, enter};
use super::published::MAX_STEPS;
use super::scenes::{Subject, TestRay, glass};

/// Rays of light into a jewel of one size, with one ε.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Escape {
    /// How many times as large as 1 the jewel is.
    pub scale: f32,
    /// The constant ε; none for the paper's dynamic one, with the threshold, 10⁻⁴ jewels, as its least.
    pub epsilon: Option<f32>,
    /// Rays that enter it.
    pub rays: u64,
    /// Those that end on the facet that they enter by: self-intersections.
    pub stuck: u64,
    /// Those that do not end where they leave it, nor on the first facet: they run out of steps, or go through it.
    pub leaked: u64,
    /// Distances asked for, per ray.
    pub evaluations: f64,
}

/// Constant values of ε, in units of the scenes.
pub(super) const CONSTANTS: [f32; 5] = [1.0e-5, 1.0e-4, 1.0e-3, 1.0e-2, 1.0e-1];

/// How far the end of a ray may be off, in jewels: far more than half a pixel.
const OFF: f64 = 0.03;
/// Shorter ways through the jewel, in jewels, are left out: their ends could not be told apart.
const SHORTEST: f64 = 4.0 * OFF;

/// How light goes on in the jewel, once for each ray that meets it.
struct Entering {
    /// Where the tracer has it enter, and how far from the surface that is.
    position: Vec3,
    distance: f32,
    normal: Vec3,
    /// How it truly goes on, and how far.
    beam: Beam,
    length: f64,
}

/// Measures every ε in jewels of one size, on every `step`-th pixel both ways.
pub(super) fn escapes(scale: f32, step: u32) -> Vec<Escape> {
    let facets = Facets::jewel(f64::from(scale));
    let subject = glass("jewel", &facets, scale);
    let rays = subject.camera(step);
    let entering: Vec<Entering> = rays.par_iter().filter_map(|ray| entering(&subject, &facets, ray)).collect();
    let settings = inside(&subject);
    let dynamic = |entering: &Entering| settings.escape(entering.distance);
    let constant = |epsilon: f32| measure(&subject, scale, &entering, Some(epsilon), |_| epsilon);
    std::iter::once(measure(&subject, scale, &entering, None, dynamic)).chain(CONSTANTS.map(constant)).collect()
}

/// How rays inside of glass are traced when nothing is enhanced.
pub(super) fn inside(subject: &Subject) -> SphereTracing {
    SphereTracing { pixel: 0.0, from_inside: true, max_steps: MAX_STEPS, ..subject.plain }
}

fn entering(subject: &Subject, facets: &Facets, ray: &TestRay) -> Option<Entering> {
    let traced = subject.trace(ray, &subject.plain);
    let beam = Beam { position: ray.origin.as_dvec3(), direction: ray.direction.as_dvec3() };
    let (t, normal) = facets.entry(beam)?;
    let position = beam.position + beam.direction * t;
    let beam = Beam { position, direction: enter(beam.direction, normal) };
    let (length, _) = facets.exit(beam);
    let long = length > SHORTEST * f64::from(subject.radius);
    let (position, normal) = (ray.at(traced.t), normal.as_vec3());
    (traced.hit && long).then_some(Entering { position, distance: traced.distance, normal, beam, length })
}

fn measure(
    subject: &Subject,
    scale: f32,
    all: &[Entering],
    epsilon: Option<f32>,
    offset: impl Fn(&Entering) -> f32 + Sync,
) -> Escape {
    let settings = inside(subject);
    let ended = |entering: &Entering| {
        let origin = entering.position - entering.normal * offset(entering);
        let ray = TestRay { origin, direction: entering.beam.direction.as_vec3(), range: (0.0, 2.0 * subject.radius) };
        let traced = subject.trace(&ray, &settings);
        (end(subject, entering, &ray, &traced), u64::from(traced.evaluations))
    };
    let ends: Vec<(End, u64)> = all.par_iter().map(ended).collect();
    let of = |kind: End| ends.iter().filter(|(end, _)| *end == kind).count() as u64;
    let evaluations: u64 = ends.iter().map(|(_, evaluations)| evaluations).sum();
    Escape {
        scale,
        epsilon,
        rays: all.len() as u64,
        stuck: of(End::Stuck),
        leaked: of(End::Leaked),
        evaluations: evaluations as f64 / all.len().max(1) as f64,
    }
}

#[derive(Clone, Copy, PartialEq)]
enum End {
    Right,
    Stuck,
    Leaked,
}

fn end(subject: &Subject, entering: &Entering, ray: &TestRay, traced: &Traced) -> End {
    let Beam { position, direction } = entering.beam;
    let found = ray.at(traced.t).as_dvec3();
    let near = |place: DVec3| traced.hit && found.distance(place) < OFF * f64::from(subject.radius);
    if near(position + direction * entering.length) {
        End::Right
    } else if near(position) {
        End::Stuck
    } else {
        End::Leaked
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_depend_on_the_scale_and_the_dynamic_one_does_not() {
        for scale in [1.0e-2, 1.0, 1.0e2] {
            let rows = escapes(scale, 40);
            let share = |count: u64| count as f64 / rows[0].rays as f64;
            assert!(rows[0].rays > 80, "{:?}", rows[0]);
            assert!(share(rows[0].stuck + rows[0].leaked) < 0.05, "{:?}", rows[0]);
        }
        let rows = escapes(1.0, 40);
        assert!(rows[1].stuck > rows[1].rays / 2, "too short to get in: {:?}", rows[1]);
        let rows = escapes(1.0e-2, 40);
        assert!(rows[5].leaked > rows[5].rays / 2, "across all of it: {:?}", rows[5]);
    }
}
