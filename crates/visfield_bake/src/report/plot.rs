//! Plots with logarithmic axes, as SVG that takes its text colour from the page.

use maud::{Markup, PreEscaped, html};
use plotters::coord::combinators::WithKeyPoints;
use plotters::prelude::*;
use plotters::series::DashedLineSeries;

/// Colours that can be told apart on a light and on a dark page.
const COLORS: [RGBColor; 6] = [
    RGBColor(59, 130, 246),
    RGBColor(234, 115, 23),
    RGBColor(16, 165, 120),
    RGBColor(168, 85, 247),
    RGBColor(225, 70, 90),
    RGBColor(130, 130, 130),
];

/// Width and height in pixels, before the page scales it.
const SIZE: (u32, u32) = (720, 420);

/// Share by which axes are longer than the data.
const MARGIN: f64 = 1.25;

/// How a series is drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Mark {
    Dots,
    /// Circles around what another series shows.
    Rings,
    Line,
    Dashes,
}

pub(super) struct Series {
    pub(super) name: String,
    /// Index of a colour.
    pub(super) color: usize,
    pub(super) mark: Mark,
    pub(super) points: Vec<(f64, f64)>,
}

pub(super) struct Plot<'a> {
    pub(super) x: &'a str,
    pub(super) y: &'a str,
    pub(super) series: Vec<Series>,
}

impl Plot<'_> {
    /// The plot and its legend; nothing if there is nothing to see.
    pub(super) fn figure(&self, caption: &str) -> Markup {
        let svg = self.svg();
        html! {
            @if let Some(svg) = svg {
                figure {
                    figcaption { (caption) }
                    div class="scroll" role="img" aria-label=(caption) { (PreEscaped(svg)) }
                    ul class="legend" {
                        @for series in &self.series {
                            li { span class={ "swatch " (series.mark.class()) } style={ "color:" (series.css_color()) } {} (series.name) }
                        }
                    }
                }
            }
        }
    }

    fn svg(&self) -> Option<String> {
        let mut svg = String::new();
        self.draw(&mut svg)?;
        // Black is the text, and the text follows the page.
        Some(svg.replace("#000000", "currentColor"))
    }

    /// `None` if the data leave no axes to draw.
    fn draw(&self, svg: &mut String) -> Option<()> {
        let x = range(self.points().map(|(x, _)| x))?;
        let y = range(self.points().map(|(_, y)| y))?;
        let area = SVGBackend::with_string(svg, SIZE).into_drawing_area();
        let mut chart = ChartBuilder::on(&area)
            .margin(12)
            .x_label_area_size(52)
            .y_label_area_size(76)
            .build_cartesian_2d(axis(x), axis(y))
            .ok()?;
        let text = ("sans-serif", 15).into_font();
        chart
            .configure_mesh()
            .x_desc(self.x)
            .y_desc(self.y)
            .axis_desc_style(text.clone())
            .label_style(text)
            .x_label_formatter(&|x| tick(*x))
            .y_label_formatter(&|y| tick(*y))
            .axis_style(BLACK.mix(0.6))
            .bold_line_style(BLACK.mix(0.18))
            .draw()
            .ok()?;
        for series in &self.series {
            let color = series.rgb();
            let points = series.points.iter().copied().filter(|&(x, y)| is_drawable(x) && is_drawable(y));
            match series.mark {
                Mark::Dots => chart.draw_series(points.map(|p| Circle::new(p, 4, color.filled()))).ok().map(drop),
                Mark::Rings => {
                    chart.draw_series(points.map(|p| Circle::new(p, 8, color.stroke_width(2)))).ok().map(drop)
                }
                Mark::Line => {
                    let dots = points.clone().map(|p| Circle::new(p, 4, color.filled()));
                    chart.draw_series(dots).ok()?;
                    chart.draw_series(LineSeries::new(points, color.stroke_width(2))).ok().map(drop)
                }
                Mark::Dashes => {
                    chart.draw_series(DashedLineSeries::new(points, 6, 5, color.stroke_width(2))).ok().map(drop)
                }
            }?;
        }
        area.present().ok()
    }

    fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        self.series.iter().flat_map(|series| series.points.iter().copied())
    }
}

impl Series {
    fn rgb(&self) -> RGBColor {
        COLORS[self.color % COLORS.len()]
    }

    fn css_color(&self) -> String {
        let RGBColor(r, g, b) = self.rgb();
        format!("rgb({r},{g},{b})")
    }
}

impl Mark {
    fn class(self) -> &'static str {
        match self {
            Self::Dots => "dot",
            Self::Rings => "ring",
            Self::Line => "line",
            Self::Dashes => "dashes",
        }
    }
}

/// Whether a logarithmic axis shows a number. Anyone can write what is read here, and an axis has ticks for each decade.
fn is_drawable(x: f64) -> bool {
    (1e-30..=1e30).contains(&x)
}

/// Around all values that are drawn.
fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let (least, most) = values
        .filter(|&x| is_drawable(x))
        .fold((f64::INFINITY, 0.0), |(least, most): (f64, f64), x| (least.min(x), most.max(x)));
    (most > 0.0).then(|| (least / MARGIN, most * MARGIN))
}

/// A logarithmic axis with ticks at 1, 2 and 5 of each decade, or at decades only if there are many.
fn axis((least, most): (f64, f64)) -> WithKeyPoints<LogCoord<f64>> {
    let steps: &[f64] = if most / least < 200.0 { &[1.0, 2.0, 5.0] } else { &[1.0] };
    let decades = least.log10().floor() as i32..=most.log10().ceil() as i32;
    let ticks = decades.flat_map(|decade| steps.iter().map(move |step| step * 10.0_f64.powi(decade)));
    let ticks = ticks.filter(|tick| (least..=most).contains(tick)).collect();
    (least..most).log_scale().with_key_points(ticks)
}

/// A number in few characters: 4.3 M, 0.012.
fn tick(x: f64) -> String {
    let (scale, prefix) = match x {
        x if x >= 1e9 => (1e9, " G"),
        x if x >= 1e6 => (1e6, " M"),
        x if x >= 1e3 => (1e3, " k"),
        _ => (1.0, ""),
    };
    let digits = format!("{:.5}", x / scale);
    format!("{}{prefix}", digits.trim_end_matches('0').trim_end_matches('.'))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(points: Vec<(f64, f64)>) -> Option<String> {
        let series = Series { name: String::new(), color: 0, mark: Mark::Line, points };
        Plot { x: "x", y: "y", series: vec![series] }.svg()
    }

    #[test]
    fn what_a_logarithm_cannot_show_is_left_out() {
        assert!(plot(vec![]).is_none());
        assert!(plot(vec![(0.0, 1.0), (f64::NAN, 2.0), (1.0, -3.0)]).is_none_or(|svg| !svg.contains("<circle")));
        let svg = plot(vec![(1.0, 1.0), (0.0, 1.0), (1e9, f64::INFINITY), (1e3, 10.0)]).unwrap();
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(!svg.contains("NaN") && !svg.contains("#000000"));
        assert!(plot(vec![(5.0, 5.0)]).is_some(), "a single point has axes too");
    }

    #[test]
    fn numbers_beyond_all_measurements_are_left_out() {
        let svg = plot(vec![(1.0, 1.0), (1.5e308, 1.0), (1.0, f64::MAX), (f64::MIN_POSITIVE, 5e-324)]).unwrap();
        assert_eq!(svg.matches("<circle").count(), 1);
        let svg = plot(vec![(1e-30, 1e30), (1e30, 1e-30)]).unwrap();
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(svg.len() < 100_000, "{} bytes for as many decades as there can be", svg.len());
    }

    #[test]
    fn ticks_are_short() {
        assert_eq!([0.002, 1.5, 1e6, 4.3e6, 100.0].map(tick), ["0.002", "1.5", "1 M", "4.3 M", "100"]);
    }
}
