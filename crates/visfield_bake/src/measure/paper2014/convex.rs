//! §3.5: out of a convex solid through its inside, or from its bounds back.

use std::hint::black_box;

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use visfield::distance::sphere_trace::{SphereTracing, Traced, trace_out_of_convex};

use super::escape::inside;
use super::facets::{Beam, Facets};
use super::scenes::{Subject, TestRay};
use crate::measure::speed::race;

/// Most ways of light through a solid, from one facet to the next: the paper's bounces.
pub(super) const BOUNCES: usize = 8;

/// Rays from inside a solid to where they leave it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Convex {
    /// The solid.
    pub scene: String,
    /// ω, by the paper's rule; 1 for none.
    pub relaxation: f32,
    /// Rays.
    pub rays: u64,
    /// Distances asked for through the inside, per ray.
    pub inside_evaluations: f64,
    /// Distances asked for from the bounding sphere back, per ray.
    pub back_evaluations: f64,
    /// Seconds through the inside, of one thread.
    pub inside_seconds: f64,
    /// Seconds from the bounding sphere back.
    pub back_seconds: f64,
    /// Rays whose two ends are in different places.
    pub differ: u64,
}

/// The ways of light in a solid of glass that the rays of every `step`-th pixel both ways take.
pub(super) fn refraction_rays(subject: &Subject, facets: &Facets, step: u32) -> Vec<TestRay> {
    // As deep in as the dynamic ε starts at least (2014, §3.3).
    let depth = subject.plain.escape(0.0);
    let from = |ray: &TestRay| {
        let beam = Beam { position: ray.origin.as_dvec3(), direction: ray.direction.as_dvec3() };
        let (beams, _) = facets.path(beam, BOUNCES);
        let start = |beam: Beam| {
            let position = beam.position.as_vec3();
            let origin = position - facets.normal(position) * depth;
            TestRay { origin, ..subject.ray(origin, beam.direction.as_vec3()) }
        };
        beams.into_iter().map(start).collect::<Vec<_>>()
    };
    subject.camera(step).par_iter().flat_map_iter(from).collect()
}

/// From a point inside to where a ray leaves, backwards from the bounding sphere.
pub(super) fn back(subject: &Subject, ray: &TestRay, settings: &SphereTracing) -> Traced {
    let distance = |position: Vec3| subject.solid.distance(position);
    trace_out_of_convex(distance, ray.origin, ray.direction, ray.range.1, settings)
}

/// Measures both ways with each ω.
pub(super) fn compare(subject: &Subject, rays: &[TestRay], relaxations: &[f32]) -> Vec<Convex> {
    let of = |&relaxation: &f32| {
        let settings = SphereTracing { relaxation, ..inside(subject) };
        let through = subject.trace_all(rays, &settings);
        let backwards: Vec<Traced> = rays.par_iter().map(|ray| back(subject, ray, &settings)).collect();
        let mean = |traced: &[Traced]| {
            traced.iter().map(|ray| f64::from(ray.evaluations)).sum::<f64>() / traced.len().max(1) as f64
        };
        let differ = |(a, b): &(&Traced, &Traced)| a.hit != b.hit || (a.t - b.t).abs() > subject.apart;
        let mut go_through = || rays.iter().for_each(|ray| _ = black_box(subject.trace(ray, &settings)));
        let mut go_back = || rays.iter().for_each(|ray| _ = black_box(back(subject, ray, &settings)));
        let [inside_seconds, back_seconds] = race([&mut go_through, &mut go_back]);
        Convex {
            scene: subject.name.to_owned(),
            relaxation,
            rays: rays.len() as u64,
            inside_evaluations: mean(&through),
            back_evaluations: mean(&backwards),
            inside_seconds,
            back_seconds,
            differ: through.iter().zip(&backwards).filter(differ).count() as u64,
        }
    };
    relaxations.iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::paper2014::scenes::glass;

    #[test]
    fn both_ways_end_in_one_place() {
        let facets = Facets::dodecahedron();
        let subject = glass("dodecahedron", &facets, 1.0);
        let rays = refraction_rays(&subject, &facets, 80);
        assert!(rays.len() > 30, "{}", rays.len());
        assert!(rays.iter().all(|ray| subject.solid.distance(ray.origin) < 0.0));
        for row in compare(&subject, &rays, &[1.0, 1.4]) {
            // At edges, what is near differs from inside and from outside.
            assert!(row.differ * 20 < row.rays, "{row:?}");
            assert!(row.inside_evaluations > 2.0 && row.back_evaluations > 2.0);
        }
    }
}
