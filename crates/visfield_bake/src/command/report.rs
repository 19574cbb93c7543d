//! `visfield report`: measurements in, one HTML page out.

use std::path::{Path, PathBuf};

use clap::Args;
use visfield_bake::measure::document::{DocumentError, MeasurementDocument};
use visfield_bake::report::{ReportEntry, report};

use super::{CommandError, check_output};

/// Make one HTML page with tables, plots and pictures from the files of `visfield measure --json`.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  visfield measure ao --mesh bunny.obj --json ao.json
  visfield measure paper2008 --mesh bunny.obj --json paper.json
  visfield report ao.json paper.json -o bunny.html

The page needs no other file and no network.")]
pub(super) struct Arguments {
    /// Measurements of any kind
    #[arg(required = true, value_name = "FILE")]
    measurements: Vec<PathBuf>,
    /// The page to write
    #[arg(short, long, value_name = "FILE", default_value = "report.html")]
    output: PathBuf,
}

impl Arguments {
    pub(super) fn run(&self) -> Result<String, CommandError> {
        check_output(&self.measurements, &self.output)?;
        let entries = self.measurements.iter().map(|path| entry(path)).collect::<Result<Vec<_>, _>>()?;
        let page = report(&entries);
        visfield::file::write_bytes(&self.output, page.as_bytes()).map_err(CommandError::Write)?;
        let plural = if entries.len() == 1 { "" } else { "s" };
        Ok(format!("{}: {} measurement{plural}\n", self.output.display(), entries.len()))
    }
}

fn entry(path: &Path) -> Result<ReportEntry, DocumentError> {
    let document = MeasurementDocument::read(path)?;
    Ok(ReportEntry { file: path.display().to_string(), document })
}
