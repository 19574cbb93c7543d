//! Pictures as the paper's Figures 7 to 9: steps of rays, and how near to the surface they end.

use image::{GrayImage, Luma};
use serde::{Deserialize, Serialize};
use visfield::distance::sphere_trace::{Exhausted, SphereTracing, Traced};

use super::published::{MAX_STEPS, PICTURE, RELAXATION, SMOOTHING};
use super::scenes::Subject;
use crate::measure::picture::png;

/// A picture, and what it shows.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PaperPicture {
    /// What it shows.
    pub caption: String,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// A PNG file in base64.
    pub png: String,
}

/// Every so many of the paper's pixels is one of a picture.
const STEP: u32 = 4;

/// Steps with and without over-relaxation (Figure 7), the two choices where they run out (Figure 8), and distances where rays end
/// with and without discontinuity reduction (Figure 9).
pub(super) fn pictures(city: &Subject, jewel: &Subject) -> Vec<PaperPicture> {
    let plain = SphereTracing { max_steps: MAX_STEPS, ..city.plain };
    let few = SphereTracing { max_steps: MAX_STEPS / 4, ..plain };
    let steps = |traced: &Traced| traced.evaluations as f32 / MAX_STEPS as f32;
    let nearness = |traced: &Traced| if traced.hit { 4.0 / (4.0 + traced.t) } else { 0.0 };
    let rough = SphereTracing { max_steps: MAX_STEPS, ..jewel.plain };
    let smooth = SphereTracing { smoothing: SMOOTHING, ..rough };
    let error = |traced: &Traced| {
        let permitted = rough.threshold.max(rough.pixel * traced.t);
        if traced.hit { 0.5 * traced.distance / permitted } else { 0.0 }
    };
    vec![
        draw(city, &plain, "steps, white for 80", steps),
        draw(
            city,
            &SphereTracing { relaxation: RELAXATION, ..plain },
            "steps with over-relaxation, \u{3c9} = 1.2",
            steps,
        ),
        draw(
            city,
            &SphereTracing { exhausted: Exhausted::Last, ..few },
            "nearness, 20 steps and the last point",
            nearness,
        ),
        draw(
            city,
            &SphereTracing { exhausted: Exhausted::Nearest, ..few },
            "nearness, 20 steps and the nearest point",
            nearness,
        ),
        draw(jewel, &rough, "f(p), white for a pixel", error),
        draw(jewel, &smooth, "f(p) after 3 steps of discontinuity reduction", error),
    ]
}

fn draw(subject: &Subject, settings: &SphereTracing, what: &str, shade: impl Fn(&Traced) -> f32) -> PaperPicture {
    let traced = subject.trace_all(&subject.camera(STEP), settings);
    let (width, height) = (PICTURE.0 / STEP, PICTURE.1 / STEP);
    let level = |x: u32, y: u32| shade(&traced[(y * width + x) as usize]).clamp(0.0, 1.0);
    let picture = GrayImage::from_fn(width, height, |x, y| Luma([(level(x, y) * 255.0).round() as u8]));
    PaperPicture { caption: format!("{}: {what}", subject.name), width, height, png: png(&picture) }
}
