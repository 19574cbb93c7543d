//! `visfield measure paper2012`: estimators over distances.

use std::path::PathBuf;

use clap::Args;
use visfield::distance::DistanceGridFormat;
use visfield_bake::measure::MeasurementDocument;
use visfield_bake::measure::paper2012::{Paper2012Question, paper2012};

use super::{MeshArguments, Output, angular_radius, read_mesh, with_progress};
use crate::command::CommandError;

/// The scenes of the 2012 thesis again: its cheap shadows and ambient occlusion from distances, and what this crate draws with, all
/// against very many exact rays. Takes a minute or two.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  visfield measure paper2012 --mesh bunny.obj cow.obj --json thesis.json

A sphere, a box, the mesh, and the mesh with a box stand on a ground; each further model does so by itself. Errors are of occlusion,
from 0 to 1, over receivers that are occluded by more than 1/255; a bias above 0 is too dark. The thesis has pictures and no errors:
`visfield report` shows them beside ours.")]
pub(super) struct Thesis {
    #[command(flatten)]
    mesh: MeshArguments,
    /// More models, each on the ground by itself
    #[arg(value_name = "MODEL")]
    models: Vec<PathBuf>,
    /// Points of each distance grid along its longest axis, 8 to 256
    #[arg(long, value_name = "COUNT", default_value_t = DistanceGridFormat::DEFAULT.voxels,
        value_parser = clap::value_parser!(u32).range(8..=256))]
    voxels: u32,
    /// Half of the angle that the light covers in the sky, in radians, 0 to 1.2
    #[arg(long, value_name = "RADIANS", default_value_t = Paper2012Question::default().angular_radius, value_parser = angular_radius)]
    angular_radius: f32,
    /// Exact rays of each receiver, 1 to 4096
    #[arg(long, default_value_t = Paper2012Question::default().rays, value_parser = clap::value_parser!(u32).range(1..=4096))]
    rays: u32,
    #[command(flatten)]
    output: Output,
}

impl Thesis {
    pub(super) fn run(&self) -> Result<String, CommandError> {
        self.output.check(&[std::slice::from_ref(&self.mesh.mesh), &self.models].concat())?;
        let mesh = self.mesh.read()?;
        let others = self.models.iter().map(|path| read_mesh(path, None)).collect::<Result<Vec<_>, _>>()?;
        let question = Paper2012Question {
            distance: DistanceGridFormat { voxels: self.voxels, ..DistanceGridFormat::DEFAULT },
            // A point of light has no penumbra to scale.
            angular_radius: self.angular_radius.max(1.0e-4),
            rays: self.rays,
            ..Paper2012Question::default()
        };
        let measurement = with_progress(|progress| paper2012(&mesh, &others, &question, progress))
            .map_err(|source| self.mesh.error(source))?;
        let text = measurement.table();
        self.output.write(|| Ok(MeasurementDocument::Paper2012(Box::new(measurement))))?;
        Ok(text)
    }
}
