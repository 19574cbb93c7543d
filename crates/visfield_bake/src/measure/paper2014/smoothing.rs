//! §3.4: how evenly near to the surface the rays of neighbouring pixels end.

use serde::{Deserialize, Serialize};
use visfield::distance::sphere_trace::{SphereTracing, Traced};

use super::published::{MAX_STEPS, PICTURE};
use super::scenes::{Subject, TestRay};

/// Neighbouring pixels of a scene, with so many steps of the fixed-point iteration.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Smoothing {
    /// The scene.
    pub scene: String,
    /// Steps.
    pub smoothing: u32,
    /// Pairs of neighbours on one surface.
    pub pairs: u64,
    /// Mean of f(p) where rays end, in permitted errors: in half pixels, or the threshold if that is more.
    pub mean: f64,
    /// Mean absolute difference of f(p) between neighbours, likewise.
    pub mean_step: f64,
    /// The difference that one pair of a hundred exceeds.
    pub percentile_step: f64,
    /// The largest difference.
    pub largest_step: f64,
}

/// Measures neighbours in every `step`-th row.
pub(super) fn smooth(subject: &Subject, step: u32, iterations: &[u32]) -> Vec<Smoothing> {
    let rows = (step / 2..PICTURE.1).step_by(step as usize);
    let rays: Vec<TestRay> = rows.flat_map(|y| (0..PICTURE.0).map(move |x| subject.pixel(x, y))).collect();
    // As the paper draws: over-relaxation and all steps that it has.
    let settings = SphereTracing { max_steps: MAX_STEPS, ..subject.plain };
    let rough = subject.trace_all(&rays, &settings);
    let neighbours =
        |&i: &usize| (i + 1) % PICTURE.0 as usize != 0 && on_one_surface(subject, &rough[i], &rough[i + 1]);
    let pairs: Vec<usize> = (0..rays.len()).filter(neighbours).collect();
    let of = |&smoothing: &u32| {
        let traced = subject.trace_all(&rays, &SphereTracing { smoothing, ..settings });
        let error = |i: usize| f64::from(traced[i].distance / settings.threshold.max(settings.pixel * traced[i].t));
        let mut steps: Vec<f64> = pairs.iter().map(|&i| (error(i + 1) - error(i)).abs()).collect();
        steps.sort_by(f64::total_cmp);
        let count = pairs.len().max(1) as f64;
        Smoothing {
            scene: subject.name.to_owned(),
            smoothing,
            pairs: pairs.len() as u64,
            mean: pairs.iter().map(|&i| error(i)).sum::<f64>() / count,
            mean_step: steps.iter().sum::<f64>() / count,
            percentile_step: steps.get(steps.len() * 99 / 100).copied().unwrap_or(0.0),
            largest_step: steps.last().copied().unwrap_or(0.0),
        }
    };
    iterations.iter().map(of).collect()
}

/// Whether two hits are no farther apart than one surface may be between two pixels.
fn on_one_surface(subject: &Subject, a: &Traced, b: &Traced) -> bool {
    a.hit && b.hit && (a.t - b.t).abs() < subject.apart
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::paper2014::facets::Facets;
    use crate::measure::paper2014::scenes::glass;

    #[test]
    fn iterations_even_out() {
        let rows = smooth(&glass("jewel", &Facets::jewel(1.0), 1.0), 80, &[0, 3]);
        assert!(rows[0].pairs > 500 && rows[0].pairs == rows[1].pairs, "{rows:?}");
        assert!(rows[1].mean_step < 0.5 * rows[0].mean_step, "{rows:?}");
        assert!((0.0..1.0).contains(&rows[0].mean), "{rows:?}");
    }
}
