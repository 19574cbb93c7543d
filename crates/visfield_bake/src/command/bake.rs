//! `visfield bake`: a mesh file in, a `.vfield` file out.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use indicatif::{DecimalBytes, HumanCount, ProgressBar, ProgressStyle};
use visfield::VisibilityField;
use visfield::file;
use visfield_bake::{BakeError, BakeSettings, Mesh, bake, read_meshes};

use super::CommandError;
use super::settings::FieldArguments;

/// Bake every mesh of a file into one .vfield file.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  visfield bake statue.glb                          writes statue.vfield beside the mesh
  visfield bake crate.obj -o assets/crate.vfield
  visfield bake car.gltf --entries 33 --exits 32    a table of 1.1 MB per mesh instead of 4.3 MB

A table takes entries\u{b2} \u{d7} exits\u{b2} bytes in memory, less in the file, and as many rays to bake: 4.3 million by default,
about a second. Halving both sides makes it 16 times smaller.")]
pub(super) struct Arguments {
    /// The mesh: a .glb, .gltf or .obj file in any units, closed or open. Each primitive of a glTF file becomes a field of
    /// its own; node transforms are left out.
    mesh: PathBuf,
    /// The file to write [default: MESH with the extension .vfield]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    field: FieldArguments,
}

impl Arguments {
    pub(super) fn run(&self) -> Result<String, CommandError> {
        let output = self.output.clone().unwrap_or_else(|| self.mesh.with_extension("vfield"));
        check_output(&self.mesh, &output)?;
        let meshes = read_meshes(&self.mesh)?;
        let settings = self.field.settings();
        // Draws on stderr, and only if that is a terminal.
        let bar = ProgressBar::new(settings.rays().saturating_mul(meshes.len() as u64));
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent} %  {eta}") {
            bar.set_style(style);
        }
        let mut report = String::new();
        let mut fields = Vec::new();
        for mesh in &meshes {
            bar.set_message(mesh.name.clone());
            let start = Instant::now();
            match bake(mesh, &settings, |rays| bar.inc(rays)) {
                Ok(field) => {
                    report_field(&mut report, &field, settings, start.elapsed().as_secs_f64());
                    fields.push(field);
                }
                Err(error) if is_fatal(&error, &meshes) => {
                    return Err(CommandError::Bake { path: self.mesh.clone(), source: error });
                }
                Err(error) => {
                    bar.inc(settings.rays());
                    bar.suspend(|| eprintln!("warning: {}: left out: {error}", self.mesh.display()));
                }
            }
        }
        bar.finish_and_clear();
        if fields.is_empty() {
            return Err(CommandError::NothingBaked { path: self.mesh.clone(), meshes: meshes.len() });
        }
        file::write(&output, &fields).map_err(CommandError::Write)?;
        let size = fs::metadata(&output).map_or(0, |metadata| metadata.len());
        let plural = if fields.len() == 1 { "" } else { "s" };
        _ = writeln!(report, "{}: {} field{plural}, {}", output.display(), fields.len(), DecimalBytes(size));
        Ok(report)
    }
}

/// Whether nothing can be gained by going on to the next mesh.
fn is_fatal(error: &BakeError, meshes: &[Mesh]) -> bool {
    matches!(error, BakeError::Settings(_)) || meshes.len() == 1
}

/// Finds out before the work whether its result could be stored at all.
fn check_output(mesh: &Path, output: &Path) -> Result<(), CommandError> {
    let same = fs::canonicalize(mesh).is_ok_and(|mesh| fs::canonicalize(output).is_ok_and(|output| mesh == output));
    if same {
        return Err(CommandError::OutputIsMesh { path: output.to_owned() });
    }
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty());
    // Without a mesh the folder beside it may be missing too; the mesh is then what to complain about.
    if mesh.exists() && folder.is_some_and(|folder| !folder.is_dir()) {
        return Err(CommandError::NoOutputFolder { path: output.to_owned() });
    }
    Ok(())
}

fn report_field(report: &mut String, field: &VisibilityField, settings: BakeSettings, seconds: f64) {
    let header = field.header();
    _ = writeln!(
        report,
        "{}: {} triangles, table {} = {}, {:.2} s, {:.2} M rays/s",
        header.name,
        HumanCount(header.triangles.into()),
        header.representation,
        DecimalBytes(header.table_bytes()),
        seconds,
        settings.rays() as f64 / seconds * 1e-6,
    );
}
