//! The figures as text, each with what follows from it.

use std::fmt::Write;

use super::published::{FIGURE3, FIGURE5, FIGURE6_MILLISECONDS, FIGURE7, PublishedTable, published};
use super::{Paper2010, TableTime};
use crate::measure::paper2008::Finding;
use crate::measure::paper2008::table::list;
use crate::measure::table::{Cells, bytes, count, mega};

impl Paper2010 {
    /// The figures, the paper's own numbers beside ours, each followed by what its numbers say about the paper's claims.
    pub fn table(&self) -> String {
        let mut text = self.summary() + "\n";
        for (title, table, findings) in self.figures() {
            _ = writeln!(text, "\n{title}\n{table}\n{}", list(&findings));
        }
        text
    }

    /// The adapter, the mesh and its receivers.
    pub(crate) fn summary(&self) -> String {
        format!(
            "{}, {}\n{}, {} triangles; {} receivers, the paper has about 200,000 pixels.\nRMS is \u{d7} 255, over all receivers.",
            self.adapter,
            self.timer,
            self.mesh,
            count(self.triangles.into()),
            count(self.receivers as u64)
        )
    }

    /// Titles, numbers and findings.
    pub(crate) fn figures(&self) -> Vec<(&'static str, Cells, Vec<Finding>)> {
        let mut figures = vec![
            ("Figure 3: sizes of tables, ambient occlusion", cells(&self.figure3, &FIGURE3), self.figure3_findings()),
            ("Figure 4: rays per pixel", self.figure4_cells(), self.figure4_findings()),
            ("Figure 5: models that shade themselves, 121 rays", self.figure5_cells(), self.figure5_findings()),
        ];
        if self.figure6.is_some() {
            figures.push(("Figure 6: several models at once", self.figure6_cells(), self.figure6_findings()));
        }
        figures.extend([
            (
                "Figure 7: soft shadows, 3 lights of 20 rays against 256",
                cells(&self.figure7, &FIGURE7),
                self.figure7_findings(),
            ),
            ("Figure 8: soft shadows of all models", self.figure8_cells(), self.figure8_findings()),
        ]);
        figures
    }

    fn figure4_cells(&self) -> Cells {
        let mut table = Cells::new(&["table", "bytes", "rays", "ms", "ns a ray"]);
        for row in &self.figure4 {
            let rays = self.receivers as f64 * f64::from(row.rays);
            table.row([
                row.size.clone(),
                bytes(row.field_bytes),
                row.rays.to_string(),
                milliseconds(row.seconds),
                format!("{:.2}", row.seconds / rays * 1e9),
            ]);
        }
        table
    }

    fn figure5_cells(&self) -> Cells {
        let mut table = Cells::new(&["model", "triangles", "table", "receivers", "ms", "rays", "RMS", "in its corner"]);
        for model in &self.figure5 {
            table.row([
                model.mesh.clone(),
                count(model.triangles.into()),
                model.size.clone(),
                count(model.receivers as u64),
                milliseconds(model.seconds),
                mega(model.rays_per_second),
                format!("{:.2}", model.rms_255),
                milliseconds(model.corner_seconds),
            ]);
        }
        for model in &FIGURE5 {
            table.row([
                format!("paper: {}", model.name),
                count(model.triangles.into()),
                "16642 \u{d7} 64\u{b2}".to_owned(),
                "-".to_owned(),
                format!("{:.1}", model.milliseconds),
                mega(model.rays_per_second),
                "-".to_owned(),
                "-".to_owned(),
            ]);
        }
        table
    }

    fn figure6_cells(&self) -> Cells {
        let mut table = Cells::new(&["models", "triangles", "rays", "one pass, ms", "a pass for each, ms", "RMS"]);
        if let Some(several) = &self.figure6 {
            table.row([
                several.meshes.join(" + "),
                count(several.triangles.into()),
                several.rays.to_string(),
                milliseconds(several.seconds),
                several.single_seconds.iter().map(|s| milliseconds(*s)).collect::<Vec<_>>().join(" + "),
                format!("{:.2}", several.rms_255),
            ]);
        }
        let none = || "-".to_owned();
        table.row([
            "paper: Bunny + Cow + Elephant".to_owned(),
            count(38_889 + 92_864 + 157_160),
            none(),
            none(),
            format!("{FIGURE6_MILLISECONDS:.0} in all"),
            none(),
        ]);
        table
    }

    fn figure8_cells(&self) -> Cells {
        let mut table = Cells::new(&["lights", "shadow rays", "ms", "rays", "rays through a CWBVH", "RMS"]);
        for row in &self.figure8 {
            table.row([
                row.lights.to_string(),
                count(row.shadow_rays),
                milliseconds(row.seconds),
                mega(row.rays_per_second),
                mega(row.bvh_rays_per_second),
                format!("{:.2}", row.rms_255),
            ]);
        }
        table
    }
}

/// Tables beside those that the paper has.
fn cells(tables: &[TableTime], figure: &[PublishedTable]) -> Cells {
    let mut cells = Cells::new(&["maps", "table", "bytes", "ms", "paper's", "RMS", "paper's"]);
    for row in tables {
        let paper = published(figure, (row.positions, row.directions));
        let number = |value: Option<f64>, digits: usize| value.map_or("-".to_owned(), |x| format!("{x:.digits$}"));
        cells.row([
            format!("{} \u{d7} {}\u{b2}", row.positions, row.directions),
            row.size.clone(),
            bytes(row.field_bytes),
            milliseconds(row.seconds),
            number(paper.map(|table| table.milliseconds), 1),
            format!("{:.2}", row.rms_255),
            number(paper.map(|table| table.rms_255), 2),
        ]);
    }
    cells
}

fn milliseconds(seconds: f64) -> String {
    format!("{:.3}", seconds * 1e3)
}
