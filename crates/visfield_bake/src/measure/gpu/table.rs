//! What was found, as text.

use std::fmt::Write;

use super::{GpuField, GpuMeasurement};
use crate::measure::table::{Cells, bytes, count, mega};

impl GpuMeasurement {
    /// The numbers of both fields, with the ratios that matter, and what the triangles do.
    pub fn table(&self) -> String {
        let mut text = self.summary();
        _ = writeln!(text, "\n\n{}", self.cells());
        text
    }

    /// The adapter, the mesh, its rays and its triangles.
    pub(crate) fn summary(&self) -> String {
        format!(
            "{} ({}, {}), {}\n{}, {} triangles: {} rays that meet the bounds, of {} receivers in the 2008 paper's corner\n\
             through a CWBVH of {}: {}, {:.3} % of the answers are the processor's",
            self.adapter,
            self.backend,
            self.driver,
            self.timer,
            self.mesh,
            count(self.triangles.into()),
            count(self.rays),
            count(self.receivers as u64),
            bytes(self.bvh_bytes),
            mega(self.bvh_rays_per_second),
            self.bvh_parity * 100.0
        )
    }

    /// The numbers of both fields.
    pub(crate) fn cells(&self) -> Cells {
        let mut table = Cells::new(&["field", "small", "large"]);
        let mut row = |name: &str, value: fn(&GpuField) -> String| {
            table.row([name.to_owned(), value(&self.small), value(&self.large)]);
        };
        row("size", |field| field.size.clone());
        row("in memory", |field| bytes(field.field_bytes));
        row("aimed look-ups", |field| mega(field.lookups_per_second));
        row("gather limit", |field| mega(field.gather_limit_lookups_per_second));
        row("arithmetic limit", |field| mega(field.arithmetic_limit_lookups_per_second));
        row("look-ups \u{f7} lower limit", |field| format!("{:.2}", field.share_of_limit()));
        row("rays as frames ask", |field| mega(field.field_rays_per_second));
        row("rays \u{f7} CWBVH", |field| format!("{:.1}\u{d7}", field.speedup_bvh));
        row("same index as the twin", |field| format!("{:.4} %", field.index_parity * 100.0));
        row("same answer", |field| format!("{:.4} %", field.answer_parity * 100.0));
        row("mean absolute error", |field| format!("{:.4}", field.mean_abs));
        row("RMS \u{d7} 255", |field| format!("{:.2}", field.rms_255));
        table
    }
}
