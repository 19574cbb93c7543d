//! Tables of numbers, for terminals and for reports, and how their numbers are written.

use std::fmt;

use comfy_table::{CellAlignment, Table, presets};
use indicatif::{DecimalBytes, HumanCount};

/// A header and rows of as many cells. The first column is text, the others mostly numbers.
#[derive(Clone, Debug)]
pub(crate) struct Cells {
    pub(crate) header: Vec<&'static str>,
    pub(crate) rows: Vec<Vec<String>>,
}

impl Cells {
    pub(crate) fn new(header: &[&'static str]) -> Self {
        Self { header: header.to_vec(), rows: Vec::new() }
    }

    pub(crate) fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        self.rows.push(cells.into_iter().collect());
    }
}

impl fmt::Display for Cells {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let mut table = Table::new();
        table.load_style(presets::NOTHING).set_header(self.header.clone()).add_rows(self.rows.clone());
        for column in table.column_iter_mut().skip(1) {
            column.set_cell_alignment(CellAlignment::Right);
        }
        f.write_str(&table.trim_fmt())
    }
}

/// Bytes in decimal units, as 4.33 MB.
pub(crate) fn bytes(bytes: u64) -> String {
    DecimalBytes(bytes).to_string()
}

/// Seconds with as many digits as matter.
pub(crate) fn seconds(seconds: f64) -> String {
    match seconds {
        s if s.is_nan() => "-".to_owned(),
        s if s < 1.0 => format!("{s:.4}"),
        s if s < 100.0 => format!("{s:.2}"),
        s => format!("{s:.0}"),
    }
}

/// A whole number with its thousands apart, as 836,352.
pub(crate) fn count(count: u64) -> String {
    HumanCount(count).to_string()
}

/// Millions per second, as 12.3 M/s.
pub(crate) fn mega(rate: f64) -> String {
    format!("{:.1} M/s", rate * 1e-6)
}
