//! The figures as text, each with what follows from it.

use std::fmt::Write;

use super::published::{FIGURE7_RMS_255, FIGURE8, figure6};
use super::{FieldResult, Finding, Paper2008};
use crate::measure::table::{Cells, bytes, count, seconds};

impl Paper2008 {
    /// The figures, the paper's own numbers beside ours, each followed by what its numbers say about the paper's claims.
    pub fn table(&self) -> String {
        let mut text = String::new();
        _ = writeln!(
            text,
            "{}, {} triangles; {} rays, one thread; bakes on {} threads. RMS is of occlusion \u{d7} 255\n\
             against the same rays, over all receivers and, as in the paper, over all pixels of a picture.",
            self.mesh,
            count(self.triangles.into()),
            count(self.rays),
            self.threads
        );
        let figures = [
            ("Figure 5: layouts of directions", self.figure5_table(), self.figure5_findings()),
            ("Figure 6: numbers of positions and directions", self.figure6_table(), self.figure6_findings()),
            ("Figure 7: one bit per direction", self.figure7_table(), self.figure7_findings()),
            ("Figure 8: models", self.figure8_table(), self.figure8_findings()),
        ];
        for (title, table, findings) in figures {
            _ = writeln!(text, "\n{title}\n{table}\n{}", list(&findings));
        }
        text
    }

    pub(crate) fn figure5_table(&self) -> Cells {
        let mut table = Cells::new(&["layout", "size", "RMS \u{d7} 255", "of the picture", "bias", "AO s"]);
        for row in &self.figure5 {
            table.row([
                format!("{:?}", row.map).to_lowercase(),
                row.measured.size.clone(),
                format!("{:.2}", row.measured.error.rms_255),
                format!("{:.2}", row.measured.picture_rms_255),
                format!("{:+.4}", row.measured.error.bias_signed),
                seconds(row.measured.ao_seconds),
            ]);
        }
        table
    }

    pub(crate) fn figure6_table(&self) -> Cells {
        let mut table = Cells::new(&[
            "maps",
            "bytes",
            "bake s",
            "paper's",
            "AO s",
            "paper's",
            "RMS \u{d7} 255",
            "of the picture",
            "paper's",
            "two-point",
            "bake s",
            "AO s",
            "RMS \u{d7} 255",
            "of the picture",
        ]);
        for row in &self.figure6 {
            let paper = figure6(row.positions, row.directions);
            let published = |value: Option<f64>| value.map_or("-".to_owned(), seconds);
            table.row([
                row.hemisphere.size.clone(),
                bytes(row.hemisphere.field_bytes),
                seconds(row.hemisphere.bake_seconds),
                published(paper.map(|cell| cell.bake_seconds)),
                seconds(row.hemisphere.ao_seconds),
                published(paper.map(|cell| cell.ao_seconds)),
                format!("{:.2}", row.hemisphere.error.rms_255),
                format!("{:.2}", row.hemisphere.picture_rms_255),
                paper.map_or("-".to_owned(), |cell| format!("{:.2}", cell.rms_255)),
                row.two_point.size.clone(),
                seconds(row.two_point.bake_seconds),
                seconds(row.two_point.ao_seconds),
                format!("{:.2}", row.two_point.error.rms_255),
                format!("{:.2}", row.two_point.picture_rms_255),
            ]);
        }
        table
    }

    pub(crate) fn figure7_table(&self) -> Cells {
        let mut table =
            Cells::new(&["stored", "maps", "bytes", "RMS \u{d7} 255", "of the picture", "paper's", "bias", "AO s"]);
        let byte_rms = figure6(self.figure7.positions, self.figure7.directions).map(|cell| cell.rms_255);
        let mut add = |name: &str, paper: Option<f64>, measured: &FieldResult| {
            table.row([
                name.to_owned(),
                measured.size.clone(),
                bytes(measured.field_bytes),
                format!("{:.2}", measured.error.rms_255),
                format!("{:.2}", measured.picture_rms_255),
                paper.map_or("-".to_owned(), |rms| format!("{rms:.2}")),
                format!("{:+.4}", measured.error.bias_signed),
                seconds(measured.ao_seconds),
            ]);
        };
        add("byte", byte_rms, &self.figure7.byte);
        add("bit", byte_rms.map(|_| FIGURE7_RMS_255), &self.figure7.bit);
        table
    }

    pub(crate) fn figure8_table(&self) -> Cells {
        let mut table = Cells::new(&[
            "model",
            "triangles",
            "rays",
            "exact s",
            "bake s",
            "AO s",
            "RMS \u{d7} 255",
            "two-point bake s",
            "AO s",
            "RMS \u{d7} 255",
        ]);
        for model in &self.figure8 {
            let [papers, ours] =
                [&model.hemisphere, &model.two_point].map(|m| (m.bake_seconds, m.ao_seconds, m.error.rms_255));
            table.row(row8(&model.mesh, model.triangles, model.rays, model.exact_seconds, [Some(papers), Some(ours)]));
        }
        if let Some(s) = &self.several {
            let papers = (s.hemisphere_bake_seconds, s.hemisphere_seconds, s.hemisphere_rms_255);
            let ours = (s.two_point_bake_seconds, s.two_point_seconds, s.two_point_rms_255);
            let names = s.meshes.join(" + ");
            table.row(row8(&names, s.triangles, s.rays, s.exact_seconds, [Some(papers), Some(ours)]));
        }
        for paper in &FIGURE8 {
            let name = format!("paper: {}", paper.name);
            let papers = (paper.bake_seconds, paper.ao_seconds, f64::NAN);
            table.row(row8(&name, paper.triangles, paper.rays, paper.exact_seconds, [Some(papers), None]));
        }
        table
    }
}

/// Name, triangles, rays, exact seconds, and seconds of bake, of rays, and RMS of two methods.
fn row8(name: &str, triangles: u32, rays: u64, exact: f64, methods: [Option<(f64, f64, f64)>; 2]) -> Vec<String> {
    let mut row = vec![name.to_owned(), count(triangles.into()), count(rays), seconds(exact)];
    for method in methods {
        let (bake, ask, rms) = method.unwrap_or((f64::NAN, f64::NAN, f64::NAN));
        row.extend([seconds(bake), seconds(ask), if rms.is_nan() { "-".to_owned() } else { format!("{rms:.2}") }]);
    }
    row
}

/// Findings as lines of text.
pub(in crate::measure) fn list(findings: &[Finding]) -> String {
    findings.iter().fold(String::new(), |mut list, finding| {
        let verdict = if finding.agrees { "agrees" } else { "differs" };
        _ = writeln!(list, "  [{verdict}] {}", finding.text);
        list
    })
}
