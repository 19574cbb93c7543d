//! Each technique by itself, and all of them, on pictures as the paper's: at most 80 steps, and light that is bent and reflected in
//! glass.

use std::hint::black_box;

use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use visfield::distance::sphere_trace::{Exhausted, SphereTracing, Traced};

use super::convex::{BOUNCES, back};
use super::escape::inside;
use super::facets::{Beam, Facets, enter, leave};
use super::published::{MAX_STEPS, RELAXATION, SMOOTHING};
use super::scenes::{OWN_RELAXATION, Subject, TestRay};
use super::selection::same;
use crate::measure::speed::race_all;

/// Pixels of a scene by some of the techniques.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Technique {
    /// The scene.
    pub scene: String,
    /// Which techniques are on.
    pub technique: String,
    /// Pixels, with all the ways of their light.
    pub pixels: u64,
    /// Distances asked for, per pixel.
    pub evaluations: f64,
    /// Seconds for all pixels, of one thread.
    pub seconds: f64,
    /// Pixels that see another place than they would without a limit of steps; of glass, such whose light leaves it in another
    /// direction than it does exactly.
    pub wrong: u64,
}

/// What is on.
#[derive(Clone, Copy, Default)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of its own")]
struct Switches {
    /// ω, and whether it is by our rule.
    relaxation: Option<(f32, bool)>,
    selection: bool,
    escape: bool,
    smoothing: bool,
    convex: bool,
}

/// The constant ε in the place of the dynamic one, in thresholds: the best of those that are tried.
const EPSILON: f32 = 100.0;

const NOTHING: Switches =
    Switches { relaxation: None, selection: false, escape: false, smoothing: false, convex: false };
/// What is traced anywhere.
const ANYWHERE: [(&str, Switches); 5] = [
    ("none", NOTHING),
    ("over-relaxation, \u{3c9} = 1.2, the paper's", Switches { relaxation: Some((RELAXATION, false)), ..NOTHING }),
    ("over-relaxation, \u{3c9} = 1.4, ours", Switches { relaxation: Some((OWN_RELAXATION, true)), ..NOTHING }),
    ("nearest point", Switches { selection: true, ..NOTHING }),
    ("discontinuity reduction, 3 steps", Switches { smoothing: true, ..NOTHING }),
];
/// What matters in glass.
const IN_GLASS: [(&str, Switches); 2] = [
    ("dynamic \u{3b5}", Switches { escape: true, ..NOTHING }),
    ("convex, from the bounds back", Switches { convex: true, ..NOTHING }),
];
const ALL: Switches =
    Switches { relaxation: Some((OWN_RELAXATION, true)), selection: true, escape: true, smoothing: true, convex: true };

/// What a pixel sees: a place, or where its light goes. None if it is lost in the glass.
#[derive(Clone, Copy)]
enum Seen {
    Place(Traced),
    Light(Option<DVec3>),
}

/// Measures a scene, of glass if it has facets, on every `step`-th pixel both ways.
pub(super) fn combine(subject: &Subject, facets: Option<&Facets>, step: u32) -> Vec<Technique> {
    let rays = subject.camera(step);
    let exact: Vec<Seen> = rays.par_iter().map(|ray| exact(subject, facets, ray)).collect();
    let mut techniques = ANYWHERE.to_vec();
    if facets.is_some() {
        techniques.extend(IN_GLASS);
    }
    techniques.push(("all", ALL));
    let see = |switches: Switches| move |ray: &TestRay| switches.see(subject, facets, ray);
    let mut works: Vec<_> = techniques
        .iter()
        .map(|(_, switches)| {
            let see = see(*switches);
            let rays = &rays;
            move || rays.iter().for_each(|ray| _ = black_box(see(ray)))
        })
        .collect();
    let seconds = race_all(&mut works.iter_mut().map(|work| work as &mut dyn FnMut()).collect::<Vec<_>>());
    let row = |((name, switches), seconds): (&(&str, Switches), f64)| {
        let seen: Vec<(Seen, u32)> = rays.par_iter().map(see(*switches)).collect();
        let evaluations: u64 = seen.iter().map(|(_, evaluations)| u64::from(*evaluations)).sum();
        let wrong = seen.iter().zip(&exact).filter(|((seen, _), exact)| !agree(subject, *seen, **exact));
        Technique {
            scene: subject.name.to_owned(),
            technique: (*name).to_owned(),
            pixels: rays.len() as u64,
            evaluations: evaluations as f64 / rays.len().max(1) as f64,
            seconds,
            wrong: wrong.count() as u64,
        }
    };
    techniques.iter().zip(seconds).map(row).collect()
}

fn exact(subject: &Subject, facets: Option<&Facets>, ray: &TestRay) -> Seen {
    let Some(facets) = facets else { return Seen::Place(subject.trace(ray, &subject.plain)) };
    let beam = Beam { position: ray.origin.as_dvec3(), direction: ray.direction.as_dvec3() };
    Seen::Light(facets.path(beam, BOUNCES).1)
}

fn agree(subject: &Subject, seen: Seen, exact: Seen) -> bool {
    match (seen, exact) {
        (Seen::Place(here), Seen::Place(there)) => same(subject, &here, &there),
        (Seen::Light(Some(here)), Seen::Light(Some(there))) => here.distance(there) < 1.0e-3,
        (Seen::Light(here), Seen::Light(there)) => here.is_none() && there.is_none(),
        _ => false,
    }
}

impl Switches {
    fn settings(self, plain: SphereTracing) -> SphereTracing {
        let (relaxation, adaptive) = self.relaxation.unwrap_or((1.0, false));
        SphereTracing {
            relaxation,
            adaptive,
            max_steps: MAX_STEPS,
            exhausted: if self.selection { Exhausted::Nearest } else { Exhausted::Missed },
            smoothing: if self.smoothing { SMOOTHING } else { 0 },
            ..plain
        }
    }

    /// What a ray sees, and how many distances that takes.
    fn see(self, subject: &Subject, facets: Option<&Facets>, ray: &TestRay) -> (Seen, u32) {
        let traced = subject.trace(ray, &self.settings(subject.plain));
        match facets {
            None => (Seen::Place(traced), traced.evaluations),
            Some(facets) => {
                let (light, evaluations) = self.walk(subject, facets, ray, traced);
                (Seen::Light(light), traced.evaluations + evaluations)
            }
        }
    }

    /// Where light goes that meets glass, or passes it by.
    fn walk(self, subject: &Subject, facets: &Facets, ray: &TestRay, traced: Traced) -> (Option<DVec3>, u32) {
        if !traced.hit {
            return (Some(ray.direction.as_dvec3()), 0);
        }
        let settings = self.settings(inside(subject));
        let (mut ray, mut traced, mut evaluations) = (*ray, traced, 0);
        for bounce in 0..=BOUNCES {
            let position = ray.at(traced.t);
            let normal = facets.normal(position);
            let direction = if bounce == 0 {
                enter(ray.direction.as_dvec3(), normal.as_dvec3())
            } else {
                match leave(ray.direction.as_dvec3(), normal.as_dvec3()) {
                    Ok(out) => return (Some(out), evaluations),
                    Err(reflected) => reflected,
                }
            };
            let epsilon = if self.escape { settings.escape(traced.distance) } else { EPSILON * settings.threshold };
            ray = subject.ray(position - normal * epsilon, direction.as_vec3());
            traced = if self.convex { back(subject, &ray, &settings) } else { subject.trace(&ray, &settings) };
            evaluations += traced.evaluations;
            if !traced.hit {
                return (None, evaluations);
            }
        }
        (None, evaluations)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::paper2014::scenes::{CONVERGED, city, glass};

    #[test]
    fn light_goes_through_glass_as_it_should() {
        let facets = Facets::dodecahedron();
        let subject = glass("dodecahedron", &facets, 1.0);
        let rows = combine(&subject, Some(&facets), 60);
        assert_eq!(rows.len(), ANYWHERE.len() + IN_GLASS.len() + 1);
        let all = &rows[rows.len() - 1];
        assert!(all.wrong * 12 < all.pixels, "{all:?}");
        assert!(all.evaluations < rows[0].evaluations, "{rows:?}");
    }

    #[test]
    fn without_a_limit_nothing_is_wrong() {
        let subject = city();
        let ray = subject.pixel(640, 400);
        let settings = SphereTracing { max_steps: CONVERGED, ..NOTHING.settings(subject.plain) };
        assert_eq!(settings, subject.plain);
        let Seen::Place(traced) = exact(&subject, None, &ray) else { unreachable!() };
        assert!(agree(&subject, Seen::Place(traced), exact(&subject, None, &ray)));
        assert!(!agree(&subject, Seen::Place(Traced { hit: !traced.hit, ..traced }), Seen::Place(traced)));
    }
}
