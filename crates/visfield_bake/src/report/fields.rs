//! Single fields: ambient occlusion and soft shadows.

use maud::{Markup, html};

use super::plot::{Mark, Plot, Series};
use super::{ReportEntry, pictures, table};
use crate::measure::ambient::{AmbientMeasurement, AmbientSpeed};
use crate::measure::distance::DistanceMeasurement;
use crate::measure::document::MeasurementDocument;
use crate::measure::picture::Pictures;
use crate::measure::scene::MeasureScene;
use crate::measure::shadow::ShadowMeasurement;
use crate::measure::table::{Cells, bytes, count, mega, seconds};

type Quantities = Vec<(&'static str, String)>;

pub(super) fn ambient(m: &AmbientMeasurement, drawn: Option<&Pictures>) -> Markup {
    let mut all: Quantities = vec![
        ("mesh", format!("{}, {} triangles", m.mesh, count(m.triangles.into()))),
        ("field", field(&m.representation, &m.size, &m.encoding, &m.bounds)),
        ("look-ups", m.aim.clone()),
        ("in memory", bytes(m.field_bytes)),
        ("bake", format!("{} s, {}", seconds(m.bake_seconds), mega(m.bake_rays_per_second))),
        ("receivers", format!("{} of the scene {}", count(m.receivers as u64), m.scene)),
        ("rays", rays(m.rays, m.rays_meeting_bounds, m.occluded_fraction)),
    ];
    all.extend(speed(m.speed.as_ref()));
    all.extend(errors([m.rms_255, m.mean_abs, m.max_abs, m.bias_signed, m.mean_abs_truth, m.exact_mean_abs_truth]));
    html! {
        (quantities(&all))
        @if let Some(drawn) = drawn { (pictures(drawn, "the field", true)) }
    }
}

pub(super) fn shadow(m: &ShadowMeasurement, drawn: Option<&Pictures>) -> Markup {
    let mut all: Quantities = vec![
        ("mesh", format!("{}, {} triangles", m.mesh, count(m.triangles.into()))),
        ("light", format!("angular radius {:.4} rad", m.angular_radius)),
        ("field", field(&m.representation, &m.size, &m.encoding, &m.bounds)),
        ("look-ups", m.aim.clone()),
        ("in memory", bytes(m.field_bytes)),
        ("bake", format!("{} s, {}", seconds(m.bake_seconds), mega(m.bake_rays_per_second))),
        (
            "receivers",
            format!(
                "{} of the scene {}, {} partly lit",
                count(m.receivers as u64),
                m.scene,
                count(m.partly_lit as u64)
            ),
        ),
        ("rays", rays(m.rays, m.rays_meeting_bounds, m.occluded_fraction)),
    ];
    all.extend(speed(m.speed.as_ref()));
    all.extend(errors([m.rms_255, m.mean_abs, m.max_abs, m.bias_signed, m.mean_abs_truth, m.exact_mean_abs_truth]));
    html! {
        (quantities(&all))
        @if let Some(drawn) = drawn { (pictures(drawn, "the field", true)) }
    }
}

pub(super) fn distance(m: &DistanceMeasurement) -> Markup {
    html! {
        p { (m.summary()) }
        (table(&m.cells()))
    }
}

fn quantities(all: &Quantities) -> Markup {
    html! {
        table class="quantities" {
            tbody { @for (name, value) in all { tr { td { (name) } td { (value) } } } }
        }
    }
}

fn field(representation: &str, size: &str, encoding: &str, bounds: &str) -> String {
    format!("{representation} {size}, {encoding}, {bounds}")
}

fn rays(all: u64, meeting: u64, occluded: f64) -> String {
    format!(
        "{}, {:.1} % meet the bounds, {:.1} % are occluded",
        count(all),
        100.0 * meeting as f64 / all.max(1) as f64,
        100.0 * occluded
    )
}

fn speed(speed: Option<&AmbientSpeed>) -> Quantities {
    let Some(speed) = speed else { return Vec::new() };
    let (field, triangles) = (mega(speed.lookups_per_second), mega(speed.bvh_rays_per_second));
    let times = format!(
        "field {} s, triangles {} s: {:.1}\u{d7} faster",
        seconds(speed.field_seconds),
        seconds(speed.bvh_seconds),
        speed.speedup
    );
    let meeting = speed.speedup_meeting_bounds;
    let random = ("random bytes of the field", mega(speed.gather_limit_lookups_per_second));
    match speed.caps {
        None => vec![
            ("all rays", times),
            ("rays that meet the bounds", format!("field {field}, triangles {triangles}: {meeting:.1}\u{d7} faster")),
            random,
        ],
        Some(caps) => vec![
            (
                "a receiver and object",
                format!(
                    "{:.1} ns; 64 rays through a 65\u{b2} \u{d7} 32\u{b2} table {:.0} ns: {:.1}\u{d7} as much",
                    caps.nanoseconds_per_receiver_and_object,
                    caps.table_nanoseconds_per_receiver,
                    caps.ratio()
                ),
            ),
            ("all receivers", times),
            ("receivers", field),
            (
                "rays that meet the bounds",
                format!("triangles {triangles}: {meeting:.1}\u{d7} the time of all receivers"),
            ),
            random,
        ],
    }
}

fn errors([rms, mean, max, bias, truth, exact]: [f64; 6]) -> Quantities {
    vec![
        ("RMS \u{d7} 255", format!("{rms:.2}")),
        ("mean absolute error", format!("{mean:.4}, largest {max:.3}")),
        ("bias", format!("{bias:+.4} (above 0: too dark)")),
        ("against many more rays", format!("{truth:.4}; the exact rays themselves {exact:.4}")),
    ]
}

/// A row of the comparison.
struct Compared<'a> {
    mesh: &'a str,
    /// Of the light; without one it is ambient occlusion.
    angular_radius: Option<f32>,
    scene: MeasureScene,
    field: String,
    aim: &'a str,
    field_bytes: u64,
    rms_255: f64,
    mean_abs: f64,
    mean_abs_truth: f64,
    speed: Option<AmbientSpeed>,
}

impl<'a> Compared<'a> {
    fn of(document: &'a MeasurementDocument) -> Option<Self> {
        match document {
            MeasurementDocument::Ambient { measurement: m, .. } => Some(Self {
                mesh: &m.mesh,
                angular_radius: None,
                scene: m.scene,
                field: field(&m.representation, &m.size, &m.encoding, &m.bounds),
                aim: &m.aim,
                field_bytes: m.field_bytes,
                rms_255: m.rms_255,
                mean_abs: m.mean_abs,
                mean_abs_truth: m.mean_abs_truth,
                speed: m.speed,
            }),
            MeasurementDocument::Shadow { measurement: m, .. } => Some(Self {
                mesh: &m.mesh,
                angular_radius: Some(m.angular_radius),
                scene: m.scene,
                field: field(&m.representation, &m.size, &m.encoding, &m.bounds),
                aim: &m.aim,
                field_bytes: m.field_bytes,
                rms_255: m.rms_255,
                mean_abs: m.mean_abs,
                mean_abs_truth: m.mean_abs_truth,
                speed: m.speed,
            }),
            MeasurementDocument::Distance(_)
            | MeasurementDocument::Paper2008(_)
            | MeasurementDocument::Tradeoff(_)
            | MeasurementDocument::Many(_)
            | MeasurementDocument::Gpu(_)
            | MeasurementDocument::Paper2010(_)
            | MeasurementDocument::Paper2012(_)
            | MeasurementDocument::Paper2014(_) => None,
        }
    }
}

/// Two fields or more beside each other.
pub(super) fn comparison(entries: &[ReportEntry]) -> Markup {
    let mut cells = Cells::new(&[
        "file",
        "mesh",
        "of",
        "receivers",
        "field",
        "look-ups",
        "bytes",
        "RMS \u{d7} 255",
        "mean error",
        "against the truth",
        "field s",
        "triangles s",
    ]);
    let (mut ambient, mut caps, mut shadow) = (Vec::new(), Vec::new(), Vec::new());
    for entry in entries {
        let Some(row) = Compared::of(&entry.document) else { continue };
        let points = match row.angular_radius {
            Some(_) => &mut shadow,
            None if row.aim == "none" => &mut caps,
            None => &mut ambient,
        };
        points.push((row.field_bytes as f64, row.rms_255));
        let time = |time: fn(&AmbientSpeed) -> f64| seconds(row.speed.as_ref().map_or(f64::NAN, time));
        cells.row([
            entry.file.clone(),
            row.mesh.to_owned(),
            row.angular_radius.map_or("ambient".to_owned(), |radius| format!("shadow, {radius:.4} rad")),
            row.scene.to_string(),
            row.field,
            row.aim.to_owned(),
            bytes(row.field_bytes),
            format!("{:.2}", row.rms_255),
            format!("{:.4}", row.mean_abs),
            format!("{:.4}", row.mean_abs_truth),
            time(|s| s.field_seconds),
            time(|s| s.bvh_seconds),
        ]);
    }
    let dots = |name: &str, color, points| Series { name: name.to_owned(), color, mark: Mark::Dots, points };
    let series = vec![
        dots("ambient occlusion by rays", 0, ambient),
        dots("ambient occlusion by cap grids, against 4096 rays", 2, caps),
        dots("soft shadow", 1, shadow),
    ];
    let series = series.into_iter().filter(|series| !series.points.is_empty()).collect();
    let plot = Plot { x: "bytes", y: "RMS \u{d7} 255", series };
    html! {
        @if cells.rows.len() > 1 {
            section {
                h2 { "Compared" }
                (table(&cells))
                (plot.figure("Error against size"))
            }
        }
    }
}
