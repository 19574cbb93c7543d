//! The measurements as text, each with what follows from it.

use std::fmt::Write;

use super::published::{CITY, DODECAHEDRON, JEWEL, JEWEL_LIT, PATHS, PublishedTimes};
use super::{Paper2014, Relaxation, Technique};
use crate::measure::paper2008::Finding;
use crate::measure::paper2008::table::list;
use crate::measure::table::{Cells, count};

impl Paper2014 {
    /// All tables, the paper's own numbers beside ours, each followed by what its numbers say about the paper's claims.
    pub fn table(&self) -> String {
        let mut text = self.summary() + "\n";
        for (title, table, findings) in self.figures() {
            _ = writeln!(text, "\n{title}\n{table}\n{}", list(&findings));
        }
        text
    }

    /// The mesh, and what is counted.
    pub(crate) fn summary(&self) -> String {
        format!(
            "{}, {} triangles, as a grid of {}; a city, a jewel and a dodecahedron in closed form. Pixels are of 1280 \u{d7} 720.\n\
             Evaluations are distances asked for, per ray or pixel; times are of one thread of the CPU, the paper's of a GPU.",
            self.mesh,
            count(self.triangles.into()),
            self.grid
        )
    }

    /// Titles, numbers and findings.
    pub(crate) fn figures(&self) -> Vec<(&'static str, Cells, Vec<Finding>)> {
        vec![
            ("\u{a7}3.1: over-relaxation", self.relaxation_cells(), self.relaxation_findings()),
            ("\u{a7}3.2: which point counts as hit", self.selection_cells(), self.selection_findings()),
            ("\u{a7}3.3: where the next ray starts", self.escape_cells(), self.escape_findings()),
            ("\u{a7}3.4: discontinuity reduction", self.smoothing_cells(), self.smoothing_findings()),
            ("\u{a7}3.5: convex solids", self.convex_cells(), self.convex_findings()),
            ("\u{a7}4: each by itself, and all", self.together_cells(), self.together_findings()),
        ]
    }

    fn relaxation_cells(&self) -> Cells {
        let mut table = Cells::new(&[
            "scene and rays",
            "rays",
            "\u{3c9}",
            "evaluations",
            "of \u{3c9} = 1",
            "time of \u{3c9} = 1",
            "flipped",
            "moved",
            "missed",
            "ours: evaluations",
            "of \u{3c9} = 1",
            "time of \u{3c9} = 1",
            "flipped",
            "moved",
            "missed",
        ]);
        for set in self.sets() {
            let half = |row: Option<&Relaxation>| match row {
                None => vec!["-".to_owned(); 6],
                Some(row) => vec![
                    format!("{:.2}", row.evaluations),
                    percent(row.evaluations / set[0].evaluations - 1.0),
                    percent(row.seconds / set[0].seconds - 1.0),
                    row.flipped.to_string(),
                    row.moved.to_string(),
                    row.missed.to_string(),
                ],
            };
            for row in set.iter().filter(|row| !row.adaptive) {
                let ours = set.iter().find(|ours| ours.adaptive && ours.relaxation == row.relaxation);
                let name = format!("{}, {}", row.scene, row.kind);
                let mut cells = vec![name, count(row.rays), format!("{:.1}", row.relaxation)];
                cells.extend(half(Some(row)));
                cells.extend(half(ours));
                table.row(cells);
            }
        }
        table
    }

    /// Rows of one scene and one kind of rays, in turn; the first is without over-relaxation.
    pub(super) fn sets(&self) -> impl Iterator<Item = &[Relaxation]> {
        self.relaxation.chunk_by(|a, b| a.scene == b.scene && a.kind == b.kind)
    }

    fn selection_cells(&self) -> Cells {
        let mut table = Cells::new(&[
            "scene",
            "steps",
            "counts as hit",
            "rays",
            "out of steps",
            "wrong",
            "wrong beside too",
            "pixels off",
        ]);
        for row in &self.selection {
            table.row([
                row.scene.clone(),
                row.max_steps.to_string(),
                row.choice.clone(),
                count(row.rays),
                count(row.exhausted),
                count(row.wrong),
                count(row.visible),
                row.pixels_off.map_or("-".to_owned(), |off| format!("{off:.2}")),
            ]);
        }
        table
    }

    fn escape_cells(&self) -> Cells {
        let mut table = Cells::new(&["scale of the jewel", "\u{3b5}", "rays", "stuck", "leaked", "evaluations"]);
        for row in &self.escape {
            let share = |of: u64| format!("{:.2} %", 100.0 * of as f64 / row.rays.max(1) as f64);
            table.row([
                format!("{:e}", row.scale),
                row.epsilon.map_or("dynamic".to_owned(), |epsilon| format!("{epsilon:e}")),
                count(row.rays),
                share(row.stuck),
                share(row.leaked),
                format!("{:.2}", row.evaluations),
            ]);
        }
        table
    }

    fn smoothing_cells(&self) -> Cells {
        let mut table =
            Cells::new(&["scene", "steps", "pairs", "mean f(p)", "mean difference", "99th percentile", "largest"]);
        for row in &self.smoothing {
            table.row([
                row.scene.clone(),
                row.smoothing.to_string(),
                count(row.pairs),
                format!("{:.3}", row.mean),
                format!("{:.4}", row.mean_step),
                format!("{:.3}", row.percentile_step),
                format!("{:.2}", row.largest_step),
            ]);
        }
        table
    }

    fn convex_cells(&self) -> Cells {
        let mut table = Cells::new(&[
            "solid",
            "\u{3c9}",
            "rays",
            "evaluations inside",
            "from the bounds",
            "ratio",
            "ns a ray inside",
            "from the bounds",
            "speed-up",
            "differ",
        ]);
        for row in &self.convex {
            let nanoseconds = |seconds: f64| format!("{:.0}", seconds / row.rays.max(1) as f64 * 1e9);
            table.row([
                row.scene.clone(),
                format!("{:.1}", row.relaxation),
                count(row.rays),
                format!("{:.2}", row.inside_evaluations),
                format!("{:.2}", row.back_evaluations),
                format!("{:.2}", row.inside_evaluations / row.back_evaluations),
                nanoseconds(row.inside_seconds),
                nanoseconds(row.back_seconds),
                times(row.inside_seconds / row.back_seconds),
                count(row.differ),
            ]);
        }
        table
    }

    fn together_cells(&self) -> Cells {
        let mut table = Cells::new(&["scene", "on", "evaluations", "of none", "ms", "speed-up", "wrong"]);
        for scene in self.pictured() {
            for row in scene {
                table.row([
                    row.scene.clone(),
                    row.technique.clone(),
                    format!("{:.2}", row.evaluations),
                    percent(row.evaluations / scene[0].evaluations - 1.0),
                    milliseconds(row.seconds),
                    times(scene[0].seconds / row.seconds),
                    format!("{:.2} %", 100.0 * row.wrong as f64 / row.pixels.max(1) as f64),
                ]);
            }
        }
        for paper in [CITY, JEWEL, JEWEL_LIT, PATHS, DODECAHEDRON] {
            table.row(published(&paper));
        }
        table
    }

    /// Rows of one scene in turn; the first is without any technique.
    pub(super) fn pictured(&self) -> impl Iterator<Item = &[Technique]> {
        self.together.chunk_by(|a, b| a.scene == b.scene)
    }
}

fn published(paper: &PublishedTimes) -> [String; 7] {
    let none = || "-".to_owned();
    let name = format!("paper: {}", paper.name);
    [name, none(), none(), none(), format!("{:.2}", paper.with), times(paper.speedup()), none()]
}

fn percent(change: f64) -> String {
    format!("{:+.1} %", 100.0 * change)
}

fn times(ratio: f64) -> String {
    format!("{ratio:.2}\u{d7}")
}

fn milliseconds(seconds: f64) -> String {
    format!("{:.2}", seconds * 1e3)
}
