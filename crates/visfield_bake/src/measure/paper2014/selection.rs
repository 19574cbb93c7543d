//! §3.2: which point counts as hit when a ray runs out of steps.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use visfield::distance::sphere_trace::{Exhausted, SphereTracing, Traced};

use super::published::PICTURE;
use super::scenes::{Subject, TestRay};

/// Pixels of a scene with one limit of steps and one choice of what counts as hit then.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Selection {
    /// The scene.
    pub scene: String,
    /// Most evaluations of a ray.
    pub max_steps: u32,
    /// What counts as hit: `missed`, `last` or `nearest`.
    pub choice: String,
    /// Pixels whose rays were traced.
    pub rays: u64,
    /// Those of them that ran out of steps.
    pub exhausted: u64,
    /// Those that hit or miss otherwise than without a limit, or hit in another place.
    pub wrong: u64,
    /// Those whose answer not even one of the eight pixels around them has without a limit: what is seen as an artifact.
    pub visible: u64,
    /// How far from a surface what counts as hit is, in pixels, on average over rays that ran out of steps; none if none hit.
    pub pixels_off: Option<f64>,
}

/// The choices, and their names.
pub(super) const CHOICES: [(Exhausted, &str); 3] =
    [(Exhausted::Missed, "missed"), (Exhausted::Last, "last"), (Exhausted::Nearest, "nearest")];

/// Measures every limit and every choice on every `step`-th pixel both ways.
pub(super) fn select(subject: &Subject, step: u32, limits: &[u32]) -> Vec<Selection> {
    let pixels: Vec<(u32, u32)> = (step / 2..PICTURE.1)
        .step_by(step as usize)
        .flat_map(|y| (step / 2..PICTURE.0).step_by(step as usize).map(move |x| (x, y)))
        .collect();
    let rays: Vec<TestRay> = pixels.iter().map(|&(x, y)| subject.pixel(x, y)).collect();
    let exact = subject.trace_all(&rays, &subject.plain);
    let of_choice = |max_steps: u32, (exhausted, name): (Exhausted, &str)| {
        let settings = SphereTracing { max_steps, exhausted, ..subject.plain };
        let traced = subject.trace_all(&rays, &settings);
        let wrong = |&i: &usize| !same(subject, &traced[i], &exact[i]);
        let wrong: Vec<usize> = (0..rays.len()).filter(wrong).collect();
        let visible = |&&i: &&usize| !beside(subject, pixels[i], &traced[i]);
        let ran_out = (0..rays.len()).filter(|&i| exact[i].evaluations > max_steps);
        let off = |i: usize| f64::from(traced[i].distance / (2.0 * subject.plain.pixel * traced[i].t));
        let off: Vec<f64> = ran_out.clone().filter(|&i| traced[i].hit).map(off).collect();
        Selection {
            scene: subject.name.to_owned(),
            max_steps,
            choice: name.to_owned(),
            rays: rays.len() as u64,
            exhausted: ran_out.count() as u64,
            wrong: wrong.len() as u64,
            visible: wrong.par_iter().filter(visible).count() as u64,
            pixels_off: (!off.is_empty()).then(|| off.iter().sum::<f64>() / off.len() as f64),
        }
    };
    limits.iter().flat_map(|&limit| CHOICES.map(|choice| of_choice(limit, choice))).collect()
}

/// Whether two answers are one: both miss, or hit in one place.
pub(super) fn same(subject: &Subject, here: &Traced, there: &Traced) -> bool {
    here.hit == there.hit && (!here.hit || (here.t - there.t).abs() < subject.apart.max(0.02 * there.t))
}

/// Whether one of the pixels around has this answer without a limit of steps.
fn beside(subject: &Subject, (x, y): (u32, u32), here: &Traced) -> bool {
    let around = |x: u32| x.saturating_sub(1)..=x + 1;
    let mut pixels = around(y).flat_map(|y| around(x).map(move |x| (x, y)));
    pixels.any(|(x, y)| same(subject, here, &subject.trace(&subject.pixel(x, y), &subject.plain)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::paper2014::scenes::city;

    #[test]
    fn enough_steps_make_no_choice() {
        let rows = select(&city(), 40, &[8, 4096]);
        for row in &rows[3..] {
            assert_eq!((row.exhausted, row.wrong, row.visible, row.pixels_off), (0, 0, 0, None), "{row:?}");
        }
        let [missed, last, nearest] = &rows[..3] else { unreachable!() };
        assert!(missed.exhausted > 100 && missed.exhausted == nearest.exhausted, "{missed:?}");
        assert_eq!(missed.pixels_off, None);
        assert!(nearest.pixels_off < last.pixels_off, "{nearest:?} {last:?}");
        for row in [missed, last, nearest] {
            assert!(row.visible <= row.wrong && row.wrong <= row.exhausted, "{row:?}");
        }
    }
}
