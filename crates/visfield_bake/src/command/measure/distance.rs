//! `visfield measure distance`: distances themselves, without rays.

use clap::Args;
use visfield_bake::measure::MeasurementDocument;
use visfield_bake::measure::distance::{DistanceQuestion, measure_distance};

use super::{MeshArguments, Output, with_progress};
use crate::command::CommandError;
use crate::command::settings::DistanceArguments;

/// How far a grid's distances are from those to the nearest triangle, all over the grid and on the surface. Takes some seconds.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  visfield measure distance --mesh bunny.obj
  visfield measure distance --mesh bunny.obj --voxels 128 --distance-bits 16 --json distance.json

Errors are in voxels, the sides of a cube between neighbouring points of the grid. Where distances are too large, rays may pass through
what they should hit: at the surface they are so by no more than the grid's `excess`, which `visfield inspect` shows. Where they are too
small, surfaces are thicker.")]
pub(super) struct Distances {
    #[command(flatten)]
    mesh: MeshArguments,
    #[command(flatten)]
    distance: DistanceArguments,
    /// Points that are asked, in the grid and again on the surface, 1 to 100,000,000
    #[arg(long, value_name = "COUNT", default_value_t = DistanceQuestion::default().points, value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    points: u32,
    #[command(flatten)]
    output: Output,
}

impl Distances {
    pub(super) fn run(&self) -> Result<String, CommandError> {
        self.output.check(std::slice::from_ref(&self.mesh.mesh))?;
        let mesh = self.mesh.read()?;
        let question = DistanceQuestion { format: self.distance.format(), points: self.points };
        let measurement = with_progress(|progress| measure_distance(&mesh, &question, progress))
            .map_err(|source| self.mesh.error(source))?;
        let text = measurement.table();
        self.output.write(|| Ok(MeasurementDocument::Distance(Box::new(measurement))))?;
        Ok(text)
    }
}
