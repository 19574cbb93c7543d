//! `visfield bake`: a mesh file in, a `.vfield` file out, of the parts that were asked for, with a table that was asked for or
//! one that is good enough.

use std::fmt::Write;
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use clap::Args;
use indicatif::{DecimalBytes, HumanCount, ProgressBar, ProgressStyle};
use visfield::distance::DistanceField;
use visfield::{ChordTable, Encoding, FieldParts, Representation, VisibilityField, file};
use visfield_bake::tune::{TuneError, TuneQuestion, TuneStep, tune};
use visfield_bake::{BakeError, BakeSettings, Mesh, bake, read_meshes};

use super::inspect::{cap_grid_error, distance_excess, measured_line};
use super::settings::FieldArguments;
use super::tune::TuneArguments;
use super::{CommandError, check_output};

/// Bake every mesh of a file into one .vfield file.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  visfield bake statue.glb                          writes statue.vfield beside the mesh
  visfield bake crate.obj -o assets/crate.vfield
  visfield bake car.gltf --entries 33 --exits 32    a table of 1.1 MB per mesh instead of 4.3 MB
  visfield bake car.gltf --max-bytes 500kB          the most accurate table of at most 500 kB
  visfield bake rock.glb --max-rms 4 --for ao       the smallest one for ambient occlusion with an RMS of 4/255
  visfield bake tree.glb --max-rms 1.5 --max-bytes 2MB --for ao --receivers others
  visfield bake pebble.glb --representation cap-grid --points 8    2 kB, for ambient occlusion alone
  visfield bake vase.glb --representation distance --voxels 96     no table: all rays are traced through distances
  visfield bake lamp.glb --falloff linear=1.5                      what is 1.5 mesh units away no longer counts in the cap grid

A field holds a table, which answers rays, for ambient occlusion and shadows; a cap grid, which gives ambient occlusion without
rays and without noise; and distances, which answer the rays that start inside the mesh's bounds, on the mesh itself, more accurately
than a table, and give soft shadows without noise. --representation says which, by default all three. Distances without a table
answer all rays: in far fewer bytes, but several times slower.

A table takes entries\u{b2} \u{d7} exits\u{b2} bytes in memory, less in the file, and as many rays to bake: 4.3 million by default,
about a second. Halving both sides makes it 16 times smaller. A cap grid takes 4 bytes for each of points\u{b3} points, or
2, 4 or 8 times as much with --precision and --order, and a second or two. It is measured while it is baked, around the mesh's box
and inside it. Distances take a byte for each of --voxels points along the longest axis of the mesh's box, and fewer along the others,
0.26 MB at most for 64, and some seconds; 128 take 8 times as much.

With a limit, tables of bits and of bytes, distances, and both together are baked and measured on the very mesh, against exact rays: on a floor and walls
around it, and on itself. The smallest that meets the limits wherever they are required is written, and what it was measured
to get wrong, which `visfield inspect` shows. If there is none, the command fails and writes nothing. Each mesh of a glTF file
is tuned by itself, with the same limits for each; the cap grid, if asked for, is baked beside. To have no distances, or no table, leave
them out of --representation: what is smallest is not what is fastest. It takes seconds, up to a minute for limits that cannot be met.")]
pub(super) struct Arguments {
    /// The mesh: a .glb, .gltf or .obj file in any units, closed or open. Each primitive of a glTF file becomes a field of
    /// its own; node transforms are left out.
    mesh: PathBuf,
    /// The file to write [default: MESH with the extension .vfield]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    field: FieldArguments,
    #[command(flatten)]
    tune: TuneArguments,
}

impl Arguments {
    pub(super) fn run(&self) -> Result<String, CommandError> {
        let output = self.output.clone().unwrap_or_else(|| self.mesh.with_extension("vfield"));
        check_output(std::slice::from_ref(&self.mesh), &output)?;
        let meshes = read_meshes(&self.mesh)?;
        let (settings, question) = (self.field.settings(), self.tune.question(&self.field.settings()));
        // Draws on stderr, and only if that is a terminal.
        let bar = ProgressBar::new(settings.rays().saturating_mul(meshes.len() as u64));
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent} %  {eta}") {
            bar.set_style(style);
        }
        let mut report = String::new();
        let mut fields = Vec::new();
        for mesh in &meshes {
            let baked = match &question {
                Some(question) => tune_one(mesh, question, settings, &bar, &mut report),
                None => bake_one(mesh, settings, &bar, &mut report),
            };
            match baked {
                Ok(field) => fields.push(field),
                Err(error) if is_fatal(&error, &meshes) => {
                    let path = self.mesh.clone();
                    return Err(match error {
                        TuneError::Bake(source) => CommandError::Bake { path, source },
                        source => CommandError::Tune { path, source: Box::new(source) },
                    });
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

/// Bakes a mesh as the settings say: distances by themselves, so that their time can be told.
fn bake_one(
    mesh: &Mesh,
    settings: BakeSettings,
    bar: &ProgressBar,
    report: &mut String,
) -> Result<VisibilityField, TuneError> {
    bar.set_message(mesh.name.clone());
    settings.validate().map_err(BakeError::from)?;
    let traced = BakeSettings { distance: None, ..settings };
    let first = if traced.validate().is_ok() { traced } else { settings };
    let start = Instant::now();
    let (mut field, rays) = bake_counted(mesh, &first, bar)?;
    let mut seconds = start.elapsed().as_secs_f64();
    let (header, table) = (field.header(), field.table().map_or_else(String::new, table_size));
    _ = write!(report, "{}: {} triangles", header.name, HumanCount(header.triangles.into()));
    if first == traced {
        _ = write!(report, ", {table}{seconds:.2} s, {:.2} M rays/s", rays as f64 / seconds * 1e-6);
    }
    _ = writeln!(report);
    if let Some(format) = settings.distance.filter(|_| first == traced) {
        let start = Instant::now();
        field = with_part(&field, mesh, &BakeSettings::of_distance(format), bar)?;
        seconds = start.elapsed().as_secs_f64();
    }
    report_cap_grid(&field, report);
    report_distance(&field, Some(seconds), report);
    note_limits(&field, report);
    Ok(field)
}

/// Bakes and moves the bar by all that was expected; how many rays it really took is returned too.
fn bake_counted(mesh: &Mesh, settings: &BakeSettings, bar: &ProgressBar) -> Result<(VisibilityField, u64), BakeError> {
    let traced = AtomicU64::new(0);
    let field = bake(mesh, settings, |rays| {
        traced.fetch_add(rays, Ordering::Relaxed);
        bar.inc(rays);
    })?;
    let traced = traced.into_inner();
    bar.inc(settings.rays().saturating_sub(traced));
    Ok((field, traced))
}

/// Bakes a mesh with a table, distances, or both, that are as cheap as will do, and the cap grid of the settings if they have one. The
/// bar starts again for everything that is tried.
fn tune_one(
    mesh: &Mesh,
    question: &TuneQuestion,
    settings: BakeSettings,
    bar: &ProgressBar,
    report: &mut String,
) -> Result<VisibilityField, TuneError> {
    bar.set_message(format!("{}: exact rays", mesh.name));
    let restart = |settings: &BakeSettings| {
        bar.set_message(format!("{}: {settings}", mesh.name));
        bar.set_length(settings.rays());
        bar.set_position(0);
    };
    let start = Instant::now();
    let tuned = tune(mesh, question, |step| match step {
        TuneStep::Field(settings) => restart(&settings),
        TuneStep::Rays(rays) => bar.inc(rays),
        _ => {}
    })?;
    let header = tuned.field.header();
    let plural = if tuned.measured_fields == 1 { "" } else { "s" };
    _ = writeln!(
        report,
        "{}: {} triangles, {} = {}, chosen in {:.2} s, {} field{plural} measured",
        header.name,
        HumanCount(header.triangles.into()),
        tuned.settings,
        DecimalBytes(tuned.field.bytes()),
        start.elapsed().as_secs_f64(),
        tuned.measured_fields,
    );
    for measured in &header.measured {
        _ = writeln!(report, "  {}", measured_line(measured));
    }
    let mut field = tuned.field;
    if let Some(settings) = settings.cap_grid.map(BakeSettings::of_cap_grid) {
        restart(&settings);
        field = with_part(&field, mesh, &settings, bar)?;
    }
    report_cap_grid(&field, report);
    report_distance(&field, None, report);
    note_limits(&field, report);
    Ok(field)
}

/// The same field with a cap grid or distances beside what it has.
fn with_part(
    field: &VisibilityField,
    mesh: &Mesh,
    settings: &BakeSettings,
    bar: &ProgressBar,
) -> Result<VisibilityField, BakeError> {
    let (baked, _) = bake_counted(mesh, settings, bar)?;
    let (old, new) = (field.parts().clone(), baked.parts().clone());
    let parts = FieldParts { cap_grid: new.cap_grid.or(old.cap_grid), distance: new.distance.or(old.distance), ..old };
    Ok(VisibilityField::new(field.header().clone(), parts)?)
}

/// Part of a line: which chords a table stores, in how many bytes.
fn table_size(table: &ChordTable) -> String {
    format!("table {} = {}, ", table.representation(), DecimalBytes(table.format().bytes()))
}

/// A line about the cap grid, if there is one.
fn report_cap_grid(field: &VisibilityField, report: &mut String) {
    let Some(grid) = field.cap_grid() else { return };
    let format = grid.header().format;
    let error = cap_grid_error(grid).map_or_else(String::new, |error| format!(", {error}"));
    _ = writeln!(report, "  cap grid {format} = {}{error}", DecimalBytes(format.bytes()));
}

/// A line about the distances, if there are any, and the seconds that they took, if these are known.
fn report_distance(field: &VisibilityField, seconds: Option<f64>, report: &mut String) {
    let Some(grid) = field.distance_field().and_then(DistanceField::grid) else { return };
    let header = grid.header();
    let seconds = seconds.map_or_else(String::new, |seconds| format!(", {seconds:.2} s"));
    let (format, bytes, excess) = (header.format, DecimalBytes(header.bytes()), distance_excess(header));
    _ = writeln!(report, "  distances {format} = {bytes}{seconds}, {excess}");
}

/// What the field cannot do in a game, if anything.
fn note_limits(field: &VisibilityField, report: &mut String) {
    if field.cap_grid().is_some_and(|grid| !grid.serves_inside()) {
        _ = writeln!(
            report,
            "  note: the cap grid is wrong inside its box; receivers there are answered by distances or by a table where the \
             field has one, and may be wrong where it has neither"
        );
    }
    if let Some(reach) = field.cap_grid().map(|grid| grid.header().format.falloff.reach()) {
        let radius = bounding_radius(field);
        if f64::from(reach) < SMALLEST_REACH * radius {
            _ = writeln!(
                report,
                "  note: a falloff that reaches {reach} is coarse on a mesh of radius {radius:.3}; from about that radius up it is \
                 good"
            );
        }
    }
    let Some(table) = field.table() else {
        if field.distance_field().is_some() {
            _ = writeln!(report, "  note: without a table, distances answer all rays, several times slower");
        }
        return;
    };
    if matches!(table.representation(), Representation::Hemisphere { .. }) {
        _ = writeln!(report, "  note: for comparisons; games render two-point fields only");
    }
    if table.encoding() == Encoding::Bit && field.distance_field().is_none() {
        _ = writeln!(report, "  note: bits know no distances; the mesh looks black where it receives occlusion itself");
    }
}

/// Share of the bounding radius below which a falloff's reach is noted.
const SMALLEST_REACH: f64 = 0.5;

/// The longest axis of what surrounds the mesh, in mesh units.
fn bounding_radius(field: &VisibilityField) -> f64 {
    let axes = field.header().bounds.mesh_from_field().matrix3;
    [axes.x_axis, axes.y_axis, axes.z_axis].into_iter().fold(0.0, |longest, axis| longest.max(axis.length()))
}

/// Whether nothing can be gained by going on to the next mesh. A mesh that cannot be baked is left out of several; limits
/// hold for all of them.
fn is_fatal(error: &TuneError, meshes: &[Mesh]) -> bool {
    !matches!(error, TuneError::Bake(BakeError::Mesh { .. })) || meshes.len() == 1
}
