//! Many fields: the figures of the 2008 paper, the trade-off of accuracy against size and time, and several objects at once.

use maud::{Markup, html};

use super::plot::{Mark, Plot, Series};
use super::{pictures, table};
use crate::measure::gpu::GpuMeasurement;
use crate::measure::many::Many;
use crate::measure::paper2008::published::{FIGURE6, FIGURE8, PublishedCell};
use crate::measure::paper2008::{Finding, Model, Paper2008, TableSize};
use crate::measure::paper2010::Paper2010;
use crate::measure::paper2012::Paper2012;
use crate::measure::paper2014::Paper2014;
use crate::measure::table::count;
use crate::measure::tradeoff::{FOOTNOTE, Tradeoff, TradeoffPoint};

pub(super) fn tradeoff(tradeoff: &Tradeoff) -> Markup {
    let front: Vec<&TradeoffPoint> = tradeoff.points.iter().filter(|point| point.pareto).collect();
    let against = |x: fn(&TradeoffPoint) -> f64, y: fn(&TradeoffPoint) -> f64| {
        let place = |point: &&TradeoffPoint| (x(point), y(point));
        let mut families: Vec<String> = tradeoff.points.iter().map(TradeoffPoint::family).collect();
        families.sort_unstable();
        families.dedup();
        let mut series: Vec<Series> = families
            .into_iter()
            .enumerate()
            .map(|(color, name)| {
                let points = tradeoff.points.iter().filter(|point| point.family() == name).map(|p| place(&p)).collect();
                Series { name, color, mark: Mark::Dots, points }
            })
            .collect();
        let points = front.iter().map(place).collect();
        series.push(Series { name: "Pareto front".to_owned(), color: 4, mark: Mark::Rings, points });
        series
    };
    let rms = |point: &TradeoffPoint| point.corner.rms_255;
    let by_bytes = Plot { x: "bytes", y: "RMS \u{d7} 255", series: against(|p| p.field_bytes as f64, rms) };
    let by_time =
        Plot { x: "seconds for all receivers", y: "RMS \u{d7} 255", series: against(|p| p.field_seconds, rms) };
    let noise_included = Plot {
        x: "seconds for all receivers",
        y: "mean absolute error",
        series: against(|p| p.field_seconds, |p| p.mean_abs_truth),
    };
    html! {
        p {
            (tradeoff.points.len()) " ways to answer the " (count(tradeoff.rays)) " rays of the paper's corner around a mesh of "
            (count(tradeoff.triangles.into())) " triangles; exact rays take " (format!("{:.3}", tradeoff.exact_seconds)) " s. On the Pareto front "
            "is what nothing else beats: no other point that answers as much is at least as good in error, size and time, and better in one of them. Bits alone know no distances, and serve \
             receivers away from the mesh only; distances beside a table answer the rays that start inside the bounds."
        }
        p { (FOOTNOTE) }
        (by_bytes.figure("Error against size: lower and further left is better"))
        (by_time.figure("Error against time: lower and further left is better"))
        (noise_included.figure("Error against time, the noise of the rays included: lower and further left is better"))
        h3 { "The Pareto front" }
        (table(&tradeoff.cells(true)))
        details {
            summary { "All " (tradeoff.points.len()) " points" }
            (table(&tradeoff.cells(false)))
        }
    }
}

pub(super) fn many(many: &Many) -> Markup {
    html! {
        p { (many.summary()) }
        (table(&many.cells()))
        @if let Some(drawn) = &many.pictures { (pictures(drawn, Many::SHOWN, true)) }
    }
}

pub(super) fn gpu(gpu: &GpuMeasurement) -> Markup {
    html! {
        p { (gpu.summary()) }
        (table(&gpu.cells()))
    }
}

pub(super) fn paper2010(paper: &Paper2010) -> Markup {
    html! {
        p { (paper.summary()) }
        @for (title, cells, found) in paper.figures() {
            h3 { (title) }
            (table(&cells))
            (findings(&found))
        }
    }
}

pub(super) fn paper2012(paper: &Paper2012) -> Markup {
    html! {
        p { (paper.summary()) }
        @for (title, cells, found) in paper.figures() {
            h3 { (title) }
            (table(&cells))
            (findings(&found))
        }
        @for drawn in &paper.pictures {
            (pictures(&drawn.pictures, &format!("{}: {}", drawn.scene, drawn.estimator), true))
        }
    }
}

pub(super) fn paper2014(paper: &Paper2014) -> Markup {
    html! {
        p { (paper.summary()) }
        @for (title, cells, found) in paper.figures() {
            h3 { (title) }
            (table(&cells))
            (findings(&found))
        }
        div class="pictures" {
            @for picture in &paper.pictures {
                figure {
                    img src={ "data:image/png;base64," (picture.png) } alt=(picture.caption) width=(picture.width) height=(picture.height);
                    figcaption { (picture.caption) }
                }
            }
        }
    }
}

pub(super) fn paper2008(paper: &Paper2008) -> Markup {
    html! {
        p {
            "A. Gaitatzes, Y. Chrysanthou, G. Papaioannou: " i { "Presampled Visibility for Ambient Occlusion" } ", WSCG 2008. "
            "Its experiments with a mesh of " (count(paper.triangles.into())) " triangles, " (count(paper.rays)) " rays, bakes on " (paper.threads) " threads; "
            "its own numbers stand beside ours where it prints any. Two-point tables are of the same size, asked by aimed look-ups."
        }
        h3 { "Figure 5: layouts of directions" }
        (table(&paper.figure5_table()))
        (findings(&paper.figure5_findings()))
        @for (index, row) in paper.figure5.iter().enumerate() {
            (pictures(&row.pictures, &format!("{:?}", row.map).to_lowercase(), index == 0))
        }
        h3 { "Figure 6: numbers of positions and directions" }
        (table(&paper.figure6_table()))
        (figure6_errors(paper).figure("Error against directions (solid: ours, dashed: the paper's)"))
        (figure6_times(paper).figure("Time for all rays against the size of the table (solid: ours, dashed: the paper's)"))
        (findings(&paper.figure6_findings()))
        h3 { "Figure 7: one bit per direction" }
        (table(&paper.figure7_table()))
        (findings(&paper.figure7_findings()))
        (pictures(&paper.figure7.pictures, "one bit", true))
        h3 { "Figure 8: models" }
        (table(&paper.figure8_table()))
        (figure8_times(paper).figure("Time for one object's rays against its triangles (solid: ours, dashed: the paper's)"))
        (findings(&paper.figure8_findings()))
    }
}

fn findings(findings: &[Finding]) -> Markup {
    html! {
        ul class="findings" {
            @for finding in findings {
                li class=(if finding.agrees { "agrees" } else { "differs" }) {
                    b { (if finding.agrees { "agrees" } else { "differs" }) } (finding.text)
                }
            }
        }
    }
}

fn positions(paper: &Paper2008) -> Vec<u32> {
    let mut positions: Vec<u32> = paper.figure6.iter().map(|row| row.positions).collect();
    positions.dedup();
    positions
}

/// A line and a dashed line for each number of positions: ours, and the paper's.
fn figure6(
    paper: &Paper2008,
    ours: impl Fn(&TableSize) -> (f64, f64),
    theirs: impl Fn(&PublishedCell) -> (f64, f64),
) -> Vec<Series> {
    let mut series = Vec::new();
    for (color, count) in positions(paper).into_iter().enumerate() {
        let points = paper.figure6.iter().filter(|row| row.positions == count).map(&ours).collect();
        series.push(Series { name: format!("{count} maps"), color, mark: Mark::Line, points });
        let points: Vec<_> = FIGURE6.iter().filter(|cell| cell.positions == count).map(&theirs).collect();
        if !points.is_empty() {
            series.push(Series { name: format!("{count} maps, the paper's"), color, mark: Mark::Dashes, points });
        }
    }
    series
}

fn figure6_errors(paper: &Paper2008) -> Plot<'static> {
    let mut series = figure6(
        paper,
        |row| (row.directions.into(), row.hemisphere.picture_rms_255),
        |cell| (cell.directions.into(), cell.rms_255),
    );
    if let Some(&most) = positions(paper).last() {
        let rows = paper.figure6.iter().filter(|row| row.positions == most);
        let points = rows.map(|row| (row.directions.into(), row.two_point.picture_rms_255)).collect();
        series.push(Series { name: format!("two-point, as large as {most} maps"), color: 3, mark: Mark::Line, points });
    }
    Plot { x: "side of the map of directions", y: "RMS \u{d7} 255 of the picture", series }
}

fn figure6_times(paper: &Paper2008) -> Plot<'static> {
    let size = |positions: u32, directions: u32| f64::from(positions) * f64::from(directions).powi(2);
    let mut series = figure6(
        paper,
        |row| (row.hemisphere.field_bytes as f64, row.hemisphere.ao_seconds),
        |cell| (size(cell.positions, cell.directions), cell.ao_seconds),
    );
    let points = paper.figure6.iter().map(|row| (row.two_point.field_bytes as f64, row.two_point.ao_seconds)).collect();
    series.push(Series { name: "two-point, all sizes".to_owned(), color: 3, mark: Mark::Dots, points });
    Plot { x: "table in bytes", y: "seconds", series }
}

fn figure8_times(paper: &Paper2008) -> Plot<'static> {
    let ours = |name: &str, color, seconds: fn(&Model) -> f64| Series {
        name: name.to_owned(),
        color,
        mark: Mark::Line,
        points: paper.figure8.iter().map(|model| (model.triangles.into(), seconds(model))).collect(),
    };
    // The last one is several objects.
    let models = &FIGURE8[..FIGURE8.len() - 1];
    let theirs = |name: &str, color, points| Series { name: name.to_owned(), color, mark: Mark::Dashes, points };
    let series = vec![
        ours("exact rays", 4, |model| model.exact_seconds),
        theirs("ray casting, the paper's", 4, models.iter().map(|m| (m.triangles.into(), m.exact_seconds)).collect()),
        ours("maps", 0, |model| model.hemisphere.ao_seconds),
        theirs("maps, the paper's", 0, models.iter().map(|m| (m.triangles.into(), m.ao_seconds)).collect()),
        ours("two-point", 3, |model| model.two_point.ao_seconds),
    ];
    Plot { x: "triangles", y: "seconds", series }
}
