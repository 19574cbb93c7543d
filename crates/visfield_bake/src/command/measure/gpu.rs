//! `visfield measure gpu` and `visfield measure paper2010`: what runs in shaders.

use std::path::PathBuf;

use clap::Args;
use visfield_bake::measure::MeasurementDocument;
use visfield_bake::measure::gpu::{GpuError, GpuQuestion, MOST_RAYS, measure_gpu};
use visfield_bake::measure::paper2010::{Paper2010Question, paper2010};

use super::{MeshArguments, Output, read_mesh, with_progress};
use crate::command::CommandError;
use crate::command::settings::side;

/// Two fields of a mesh on the fastest GPU that there is, or on a software adapter: look-ups beside what limits them, and rays
/// beside any-hit traversal of a compressed wide BVH in a shader, all of them the same rays.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  visfield measure gpu --mesh bunny.obj --json gpu.json

The rays are those of the 2008 paper's corner that meet the field's bounds. `gather limit` reads random bytes of the same table and
does nothing else; `arithmetic limit` does everything but read the byte. Look-ups cannot be faster than the lower of the two. Errors
are of ambient occlusion, against the same rays through triangles.")]
pub(super) struct OnGpu {
    #[command(flatten)]
    mesh: MeshArguments,
    /// Side of the small table's grid of points at which rays enter the bounds; the large one is of 65\u{b2} \u{d7} 64\u{b2} bytes
    #[arg(long, value_name = "CELLS", default_value_t = GpuQuestion::default().small.0, value_parser = side())]
    entries: u32,
    /// Side of the small table's grid of points at which rays leave the bounds
    #[arg(long, value_name = "CELLS", default_value_t = GpuQuestion::default().small.1, value_parser = side())]
    exits: u32,
    /// About how many rays, 1024 to 4,000,000 [default: as many as the adapter traces in a while]
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1024..=i64::from(MOST_RAYS)))]
    rays: Option<u32>,
    #[command(flatten)]
    output: Output,
}

/// The figures of the 2010 paper again, on the fastest GPU that there is, or on a software adapter, beside its own numbers. Takes some
/// minutes.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  visfield measure paper2010 --mesh bunny.obj cow.obj igea.glb --json paper.json

Receivers in a corner take the place of the paper's pixels, 3 \u{d7} SIDE\u{b2} of them. Times are of all receivers. With two models or
more besides, Figures 6 and 8 have the first three at once.")]
pub(super) struct PaperOnGpu {
    #[command(flatten)]
    mesh: MeshArguments,
    /// More models for Figures 5, 6 and 8
    #[arg(value_name = "MODEL")]
    models: Vec<PathBuf>,
    /// Receivers along each side of the corner's squares, 2 to 512 [default: 256, or 64 on software adapters]
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u16).range(2..=512))]
    side: Option<u16>,
    /// The paper's tables of 65 MB too
    #[arg(long)]
    full: bool,
    #[command(flatten)]
    output: Output,
}

impl MeshArguments {
    fn gpu_error(&self, source: GpuError) -> CommandError {
        CommandError::Gpu { path: self.mesh.clone(), source: Box::new(source) }
    }
}

impl OnGpu {
    pub(super) fn run(&self) -> Result<String, CommandError> {
        self.output.check(std::slice::from_ref(&self.mesh.mesh))?;
        let mesh = self.mesh.read()?;
        let question = GpuQuestion { small: (self.entries, self.exits), rays: self.rays, ..GpuQuestion::default() };
        let measurement = with_progress(|progress| measure_gpu(&mesh, &question, progress))
            .map_err(|source| self.mesh.gpu_error(source))?;
        let text = measurement.table();
        self.output.write(|| Ok(MeasurementDocument::Gpu(Box::new(measurement))))?;
        Ok(text)
    }
}

impl PaperOnGpu {
    pub(super) fn run(&self) -> Result<String, CommandError> {
        self.output.check(&[std::slice::from_ref(&self.mesh.mesh), &self.models].concat())?;
        let mut meshes = vec![self.mesh.read()?];
        for path in &self.models {
            meshes.push(read_mesh(path, None)?);
        }
        let question = Paper2010Question { side: self.side.map(usize::from), ..Paper2010Question::new(self.full) };
        let measurement = with_progress(|progress| paper2010(&meshes, &question, progress))
            .map_err(|source| self.mesh.gpu_error(source))?;
        let text = measurement.table();
        self.output.write(|| Ok(MeasurementDocument::Paper2010(Box::new(measurement))))?;
        Ok(text)
    }
}
