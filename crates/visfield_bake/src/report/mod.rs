//! Measurements as one HTML page that needs nothing else: tables, plots and pictures.

mod fields;
mod figures;
mod plot;

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::measure::document::MeasurementDocument;
use crate::measure::picture::Pictures;
use crate::measure::table::Cells;

/// One measurement of a report.
#[derive(Clone, Debug)]
pub struct ReportEntry {
    /// The file it is from.
    pub file: String,
    /// What was measured.
    pub document: MeasurementDocument,
}

/// Makes the page. All texts of the measurements are escaped.
///
/// ```
/// let page = visfield_bake::report::report(&[]);
/// assert!(page.starts_with("<!DOCTYPE html>"));
/// ```
pub fn report(entries: &[ReportEntry]) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title(entries)) }
                style { (PreEscaped(include_str!("style.css"))) }
            }
            body {
                h1 { (title(entries)) }
                p class="soft" {
                    "By visfield " (env!("CARGO_PKG_VERSION")) ". Errors are of occlusion: of tables and distances against the same rays through triangles, "
                    "of cap grids, which send none, against 4096 exact rays per receiver. "
                    "RMS \u{d7} 255 is their root mean square in steps of an 8-bit picture. Times are of one thread, but bakes use all."
                }
                (fields::comparison(entries))
                @for entry in entries { (section(entry)) }
            }
        }
    };
    page.into_string()
}

fn title(entries: &[ReportEntry]) -> String {
    let mut meshes: Vec<&str> = entries.iter().map(|entry| mesh(&entry.document)).collect();
    meshes.sort_unstable();
    meshes.dedup();
    format!("Visibility fields of {}", if meshes.is_empty() { "no mesh".to_owned() } else { meshes.join(", ") })
}

fn mesh(document: &MeasurementDocument) -> &str {
    match document {
        MeasurementDocument::Ambient { measurement, .. } => &measurement.mesh,
        MeasurementDocument::Shadow { measurement, .. } => &measurement.mesh,
        MeasurementDocument::Distance(distance) => &distance.mesh,
        MeasurementDocument::Paper2008(paper) => &paper.mesh,
        MeasurementDocument::Tradeoff(tradeoff) => &tradeoff.mesh,
        MeasurementDocument::Many(many) => &many.mesh,
        MeasurementDocument::Gpu(gpu) => &gpu.mesh,
        MeasurementDocument::Paper2010(paper) => &paper.mesh,
        MeasurementDocument::Paper2012(paper) => &paper.mesh,
        MeasurementDocument::Paper2014(paper) => &paper.mesh,
    }
}

fn section(entry: &ReportEntry) -> Markup {
    let (heading, body) = match &entry.document {
        MeasurementDocument::Ambient { measurement, pictures } => {
            ("Ambient occlusion", fields::ambient(measurement, pictures.as_deref()))
        }
        MeasurementDocument::Shadow { measurement, pictures } => {
            ("Soft shadow", fields::shadow(measurement, pictures.as_deref()))
        }
        MeasurementDocument::Distance(distance) => ("Distances", fields::distance(distance)),
        MeasurementDocument::Paper2008(paper) => ("The figures of the 2008 paper", figures::paper2008(paper)),
        MeasurementDocument::Tradeoff(tradeoff) => ("What accuracy costs", figures::tradeoff(tradeoff)),
        MeasurementDocument::Many(many) => ("Several objects", figures::many(many)),
        MeasurementDocument::Gpu(gpu) => ("On a GPU", figures::gpu(gpu)),
        MeasurementDocument::Paper2010(paper) => ("The figures of the 2010 paper", figures::paper2010(paper)),
        MeasurementDocument::Paper2012(paper) => ("The estimators of the 2012 thesis", figures::paper2012(paper)),
        MeasurementDocument::Paper2014(paper) => ("The claims of the 2014 paper", figures::paper2014(paper)),
    };
    html! {
        section {
            h2 { (heading) ": " (mesh(&entry.document)) }
            p class="soft" { (entry.file) }
            (body)
        }
    }
}

/// A table; the columns after the first one are numbers.
fn table(cells: &Cells) -> Markup {
    html! {
        div class="scroll" {
            table {
                thead { tr { @for name in &cells.header { th { (name) } } } }
                tbody {
                    @for row in &cells.rows {
                        tr class=[row[0].starts_with("paper: ").then_some("published")] { @for cell in row { td { (cell) } } }
                    }
                }
            }
        }
    }
}

/// Exact, field, and difference; or only what a field gave, where others show the exact picture.
fn pictures(pictures: &Pictures, what: &str, with_exact: bool) -> Markup {
    let picture = |png: &str, caption: &str| {
        html! {
            figure {
                img src={ "data:image/png;base64," (png) } alt=(caption) width=(pictures.width) height=(pictures.height);
                figcaption { (caption) }
            }
        }
    };
    html! {
        div class="pictures" {
            @if with_exact { (picture(&pictures.exact, "exact rays")) }
            (picture(&pictures.field, what))
            (picture(&pictures.difference, "difference \u{d7} 5"))
        }
    }
}
