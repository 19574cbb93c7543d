//! The estimators as text, and what follows from them.

use std::fmt::Write;

use super::{EstimatorError, Paper2012, Place};
use crate::measure::paper2008::Finding;
use crate::measure::paper2008::table::list;
use crate::measure::table::{Cells, count};

impl Paper2012 {
    /// Tables of errors, each followed by what its numbers say about the thesis' claims.
    pub fn table(&self) -> String {
        let mut text = self.summary() + "\n";
        for (title, table, findings) in self.figures() {
            _ = writeln!(text, "\n{title}\n{table}\n{}", list(&findings));
        }
        text
    }

    /// What was measured, and against what.
    pub(crate) fn summary(&self) -> String {
        format!(
            "{}, {} triangles; distances: {}. Against {} exact rays a receiver; rays over distances are {}.\nThe light covers \
             {:.1}\u{b0} to each side. Errors are of occlusion, over receivers that are occluded by more than 1/255.",
            self.mesh,
            count(self.triangles.into()),
            self.distance,
            self.rays,
            self.few_rays,
            self.angular_radius.to_degrees()
        )
    }

    /// Titles, numbers and findings.
    pub(crate) fn figures(&self) -> Vec<(&'static str, Cells, Vec<Finding>)> {
        vec![
            ("Sections 3.5 and 4: ambient occlusion", cells(&self.ambient), self.ambient_findings()),
            ("Settings with the least error", self.settings_cells(), self.settings_findings()),
            ("Section 3.4: shadows", cells(&self.shadows), self.shadow_findings()),
        ]
    }

    fn settings_cells(&self) -> Cells {
        let mut table = Cells::new(&["scene", "estimator", "step", "strength"]);
        for row in &self.settings {
            table.row([row.scene.clone(), row.estimator.clone(), row.step.to_string(), row.strength.to_string()]);
        }
        table
    }
}

/// A row for the ground and what stands there.
fn cells(errors: &[EstimatorError]) -> Cells {
    let mut table = Cells::new(&[
        "scene",
        "estimator",
        "ground: mean",
        "RMS",
        "bias",
        "max",
        "objects: mean",
        "RMS",
        "bias",
        "max",
    ]);
    for pair in errors.chunks_exact(2) {
        debug_assert!(pair[0].place == Place::Ground && pair[1].place == Place::Objects, "one of each");
        let numbers = pair.iter().flat_map(|error| {
            [
                format!("{:.4}", error.mean_abs),
                format!("{:.4}", error.rms),
                format!("{:+.4}", error.bias_signed),
                format!("{:.2}", error.max_abs),
            ]
        });
        table.row([pair[0].scene.clone(), pair[0].estimator.clone()].into_iter().chain(numbers));
    }
    table
}
