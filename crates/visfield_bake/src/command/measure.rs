//! `visfield measure`: what a field costs and what it gets wrong, against exact rays.

mod distance;
mod gpu;
mod thesis;

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueEnum};
use indicatif::{DecimalBytes, HumanCount, ProgressBar, ProgressStyle};
use visfield::estimate::sampling::DiscBasis;
use visfield::field::lookup::Aim;
use visfield::field::query::Bias;
use visfield::{CapGridFormat, QueryOptions};
use visfield_bake::measure::ambient::AmbientSpeed;
use visfield_bake::measure::many::{ManyQuestion, measure_many};
use visfield_bake::measure::paper2008::{Paper2008Question, paper2008};
use visfield_bake::measure::paper2014::{Paper2014Question, paper2014};
use visfield_bake::measure::picture::{Pictures, corner_pictures};
use visfield_bake::measure::tradeoff::{Sweep, tradeoff};
use visfield_bake::measure::{
    AmbientMeasurement, AmbientQuestion, MeasureScene, MeasurementDocument, ShadowMeasurement, ShadowQuestion,
    measure_ambient, measure_shadow,
};
use visfield_bake::{BakeError, Mesh, read_meshes};

use self::distance::Distances;
use self::gpu::{OnGpu, PaperOnGpu};
use self::thesis::Thesis;
use super::settings::{FieldArguments, one_representation, points};
use super::{CommandError, check_output};

/// Measure what a field costs and what it gets wrong: the same rays through a table or distances and through triangles (crate obvhs), or
/// a cap grid against very many of them, in one run. Speeds are of one thread; let nothing else run meanwhile.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    Ao(Ambient),
    Shadow(Shadow),
    Distance(Distances),
    Paper2008(Paper),
    Tradeoff(Tradeoffs),
    Many(Objects),
    Gpu(OnGpu),
    Paper2010(PaperOnGpu),
    Paper2012(Thesis),
    Paper2014(SphereTracingPaper),
}

#[derive(Debug, Args)]
struct MeshArguments {
    /// The mesh: a .glb, .gltf or .obj file
    #[arg(long, value_name = "FILE")]
    mesh: PathBuf,
    /// Which of the file's meshes, if there are several: Mesh0/Primitive0
    #[arg(long, value_name = "NAME")]
    primitive: Option<String>,
}

impl MeshArguments {
    fn read(&self) -> Result<Mesh, CommandError> {
        read_mesh(&self.mesh, self.primitive.as_deref())
    }

    fn error(&self, source: BakeError) -> CommandError {
        CommandError::Bake { path: self.mesh.clone(), source }
    }
}

/// One mesh of a file, named for it.
fn read_mesh(path: &Path, primitive: Option<&str>) -> Result<Mesh, CommandError> {
    let mut meshes = read_meshes(path)?;
    let index = match primitive {
        Some(name) => meshes.iter().position(|mesh| mesh.name == name),
        None => (meshes.len() == 1).then_some(0),
    };
    let Some(index) = index else {
        let names = meshes.iter().map(|mesh| mesh.name.as_str()).collect::<Vec<_>>().join(", ");
        return Err(CommandError::WhichMesh { path: path.to_owned(), names });
    };
    Ok(Mesh { name: file_name(path), ..meshes.swap_remove(index) })
}

/// Where the numbers go besides the terminal.
#[derive(Debug, Args)]
struct Output {
    /// Write everything as JSON, for `visfield report`
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

impl Output {
    /// Finds out before the work whether its result could be written.
    fn check(&self, inputs: &[PathBuf]) -> Result<(), CommandError> {
        self.json.as_deref().map_or(Ok(()), |json| check_output(inputs, json))
    }

    fn write(&self, document: impl FnOnce() -> Result<MeasurementDocument, CommandError>) -> Result<(), CommandError> {
        let Some(path) = &self.json else { return Ok(()) };
        document()?.write(path)?;
        Ok(())
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// How the field is asked.
#[derive(Debug, Args)]
#[command(next_help_heading = "How the field is asked")]
struct QueryArguments {
    /// How rays are snapped to the table: through a point of the true ray, or each end by itself as in the paper (faster)
    #[arg(long, value_enum, default_value_t)]
    aim: AimName,
    /// Height above a receiver's own surface below which hits do not count, in spreads of a cell
    #[arg(long, value_name = "CELLS", default_value_t = Bias::default().height)]
    bias_height: f32,
    /// Distance along the ray below which hits do not count, in spreads of a cell
    #[arg(long, value_name = "CELLS", default_value_t = Bias::default().along)]
    bias_along: f32,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum AimName {
    #[default]
    Point,
    Plain,
}

impl QueryArguments {
    fn options(&self) -> QueryOptions {
        let aim = match self.aim {
            AimName::Point => Aim::Point,
            AimName::Plain => Aim::Plain,
        };
        let bias = Bias { height: self.bias_height, along: self.bias_along };
        QueryOptions { aim, bias, ..QueryOptions::default() }
    }
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum SceneName {
    /// A floor at the mesh's lowest point and two walls behind it, 3 × 33 × 33 receivers
    #[default]
    Corner,
    /// The mesh's own surface
    #[value(name = "self")]
    OwnSurface,
}

impl From<SceneName> for MeasureScene {
    fn from(name: SceneName) -> Self {
        match name {
            SceneName::Corner => Self::Corner,
            SceneName::OwnSurface => Self::OwnSurface,
        }
    }
}

/// Ambient occlusion.
#[derive(Debug, Args)]
#[command(
    mut_arg("representation", one_representation),
    after_help = "\
Examples:
  visfield measure ao --mesh bunny.obj
  visfield measure ao --mesh bunny.obj --entries 33 --aim plain --json plain.json
  visfield measure ao --mesh bunny.obj --representation hemisphere --aim plain
  visfield measure ao --mesh bunny.obj --entries 65 --exits 64 --scene self
  visfield measure ao --mesh bunny.obj --representation cap-grid --points 16
  visfield measure ao --mesh bunny.obj --representation two-point,distance --encoding bit --voxels 64

Errors are of occlusion, from 0 to 1. The RMS is in steps of 1/255 and over all receivers; the other errors are over the
receivers whose exact or estimated occlusion exceeds 1/255. All are against the same rays, but for `truth`, which is against
4096 exact rays and charges the noise of few rays to whoever sends them. A cap grid sends none: all its errors are against the
4096. Its time is that of one object, for all receivers, raced against --rays exact rays of each and against 64 rays of each
through a table of 65\u{b2} \u{d7} 32\u{b2} bytes."
)]
struct Ambient {
    #[command(flatten)]
    mesh: MeshArguments,
    #[command(flatten)]
    field: FieldArguments,
    #[command(flatten)]
    query: QueryArguments,
    /// Where the receivers are
    #[arg(long, value_enum, default_value_t)]
    scene: SceneName,
    /// Rays per receiver, 1 to 4096
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=4096))]
    rays: u32,
    #[command(flatten)]
    output: Output,
}

/// The soft shadow of a slanted directional light.
#[derive(Debug, Args)]
#[command(
    mut_arg("representation", one_representation),
    after_help = "\
Examples:
  visfield measure shadow --mesh bunny.obj
  visfield measure shadow --mesh bunny.obj --angular-radius 0.00465 --encoding bit --entries 65 --exits 91
  visfield measure shadow --mesh bunny.obj --representation distance --voxels 128 --scene self

Errors are of the occlusion of the light, from 0 to 1. The RMS is in steps of 1/255 and over receivers that are partly lit;
the other errors are over those that are not fully lit."
)]
struct Shadow {
    #[command(flatten)]
    mesh: MeshArguments,
    #[command(flatten)]
    field: FieldArguments,
    #[command(flatten)]
    query: QueryArguments,
    /// Where the receivers are
    #[arg(long, value_enum, default_value_t)]
    scene: SceneName,
    /// Half of the angle that the light covers in the sky, in radians, 0 to 1.2; the sun's is 0.00465
    #[arg(long, value_name = "RADIANS", default_value_t = 0.05, value_parser = angular_radius)]
    angular_radius: f32,
    /// Rays per receiver, 1 to 256
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=256))]
    rays: u32,
    #[command(flatten)]
    output: Output,
}

fn angular_radius(text: &str) -> Result<f32, String> {
    let radius: f32 = text.parse().map_err(|error| format!("{error}"))?;
    let range = 0.0..=DiscBasis::MAX_ANGULAR_RADIUS;
    if range.contains(&radius) { Ok(radius) } else { Err(format!("not in 0 to {} radians", range.end())) }
}

/// The figures of the 2008 paper again, beside its own numbers. Takes some minutes; `--quick` leaves out the largest tables.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  visfield measure paper2008 --mesh bunny.obj cow.obj igea.glb --json paper.json

Only shapes can be compared, what grows and what stays: the paper's machine, models and pictures are gone. Where ours are of
another shape, the findings below each figure say so, and why.")]
struct Paper {
    #[command(flatten)]
    mesh: MeshArguments,
    /// More models for Figure 8, of other triangle counts; with two or more, three objects cast on each other
    #[arg(value_name = "MODEL")]
    models: Vec<PathBuf>,
    /// Leave out the maps of 128\u{b2} and 256\u{b2} directions
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    output: Output,
}

/// The claims of the 2014 paper on sphere tracing again, on our own tracer, beside its own numbers. Takes a minute; `--quick`
/// measures a few of everything.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  visfield measure paper2014 --mesh bunny.obj --json paper.json

The mesh is baked to a grid of distances; a city, a jewel and a dodecahedron are in closed form, as the paper's scenes are. `flipped`,
`moved` and `missed` count rays that hit otherwise than with \u{3c9} = 1, that hit elsewhere, and that pass through a surface.")]
struct SphereTracingPaper {
    #[command(flatten)]
    mesh: MeshArguments,
    /// Fewer pixels, fewer values of \u{3c9}, and a coarser grid
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    output: Output,
}

/// Many fields of one mesh: representations, sizes, encodings and bounds, cap grids and distances too, and which of them nothing beats in error,
/// size and time. Takes some minutes; `--quick` tries a few small ones.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  visfield measure tradeoff --mesh bunny.obj --json tradeoff.json")]
struct Tradeoffs {
    #[command(flatten)]
    mesh: MeshArguments,
    /// A few small tables, a small cap grid and small distances only
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    output: Output,
}

/// Several objects at once, close to each other: how well cap grids combine, by each of their rules, against exact rays of the whole
/// scene. Takes some tens of seconds.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  visfield measure many --meshes bunny.obj,cow.obj,teapot.obj --instances 8 --json many.json

The objects are scaled to one size and stand on a floor with two walls, or hang above it. Errors are of occlusion, from 0 to 1,
against 4096 exact rays per receiver. `product of exact occlusions` shows what the product alone gets wrong: it needs 4096 rays for
each object. `64 rays through tables` sends them in batches through tables of 65\u{b2} \u{d7} 32\u{b2} bytes, and has their noise.")]
struct Objects {
    /// The meshes: .glb, .gltf or .obj files, all their primitives in turn
    #[arg(long, value_name = "FILES", value_delimiter = ',', required = true)]
    meshes: Vec<PathBuf>,
    /// Number of objects, as many as meshes at least, 1 to 64
    #[arg(long, value_name = "COUNT", default_value_t = 8, value_parser = clap::value_parser!(u8).range(1..=64))]
    instances: u8,
    /// Points of each cap grid along each axis, 4 to 64
    #[arg(long, value_name = "COUNT", default_value_t = CapGridFormat::DEFAULT.points, value_parser = points())]
    points: u32,
    #[command(flatten)]
    output: Output,
}

impl Arguments {
    pub(super) fn run(&self) -> Result<String, CommandError> {
        match &self.what {
            What::Ao(arguments) => arguments.run(),
            What::Shadow(arguments) => arguments.run(),
            What::Distance(arguments) => arguments.run(),
            What::Paper2008(arguments) => arguments.run(),
            What::Tradeoff(arguments) => arguments.run(),
            What::Many(arguments) => arguments.run(),
            What::Gpu(arguments) => arguments.run(),
            What::Paper2010(arguments) => arguments.run(),
            What::Paper2012(arguments) => arguments.run(),
            What::Paper2014(arguments) => arguments.run(),
        }
    }
}

impl Ambient {
    fn run(&self) -> Result<String, CommandError> {
        let bake = self.field.measured_settings()?;
        self.output.check(std::slice::from_ref(&self.mesh.mesh))?;
        let mesh = self.mesh.read()?;
        let question = AmbientQuestion {
            bake,
            scene: self.scene.into(),
            rays: self.rays,
            options: self.query.options(),
            speed: true,
        };
        let measurement = measure_ambient(&mesh, &question).map_err(|source| self.mesh.error(source))?;
        let text = ambient_table(&measurement);
        let document = || {
            let pictures = pictures(&mesh, question.scene, &measurement.exact, &measurement.found)
                .map_err(|source| self.mesh.error(source))?;
            Ok(MeasurementDocument::Ambient { measurement: Box::new(measurement), pictures })
        };
        self.output.write(document)?;
        Ok(text)
    }
}

impl Shadow {
    fn run(&self) -> Result<String, CommandError> {
        let bake = self.field.measured_settings()?;
        self.output.check(std::slice::from_ref(&self.mesh.mesh))?;
        let mesh = self.mesh.read()?;
        let question = ShadowQuestion {
            bake,
            scene: self.scene.into(),
            angular_radius: self.angular_radius,
            rays: self.rays,
            options: self.query.options(),
            speed: true,
        };
        let measurement = measure_shadow(&mesh, &question).map_err(|source| self.mesh.error(source))?;
        let text = shadow_table(&measurement);
        let document = || {
            let pictures = pictures(&mesh, question.scene, &measurement.exact, &measurement.found)
                .map_err(|source| self.mesh.error(source))?;
            Ok(MeasurementDocument::Shadow { measurement: Box::new(measurement), pictures })
        };
        self.output.write(document)?;
        Ok(text)
    }
}

impl Paper {
    fn run(&self) -> Result<String, CommandError> {
        self.output.check(&[std::slice::from_ref(&self.mesh.mesh), &self.models].concat())?;
        let mesh = self.mesh.read()?;
        let others = self.models.iter().map(|path| read_mesh(path, None)).collect::<Result<Vec<_>, _>>()?;
        let measurement =
            with_progress(|progress| paper2008(&mesh, &others, &Paper2008Question::new(self.quick), progress))
                .map_err(|source| self.mesh.error(source))?;
        let text = measurement.table();
        self.output.write(|| Ok(MeasurementDocument::Paper2008(Box::new(measurement))))?;
        Ok(text)
    }
}

impl SphereTracingPaper {
    fn run(&self) -> Result<String, CommandError> {
        self.output.check(std::slice::from_ref(&self.mesh.mesh))?;
        let mesh = self.mesh.read()?;
        let measurement = with_progress(|progress| paper2014(&mesh, &Paper2014Question::new(self.quick), progress))
            .map_err(|source| self.mesh.error(source))?;
        let text = measurement.table();
        self.output.write(|| Ok(MeasurementDocument::Paper2014(Box::new(measurement))))?;
        Ok(text)
    }
}

impl Tradeoffs {
    fn run(&self) -> Result<String, CommandError> {
        self.output.check(std::slice::from_ref(&self.mesh.mesh))?;
        let mesh = self.mesh.read()?;
        let sweep = if self.quick { Sweep::quick() } else { Sweep::default() };
        let measurement =
            with_progress(|progress| tradeoff(&mesh, &sweep, progress)).map_err(|source| self.mesh.error(source))?;
        let text = measurement.table();
        self.output.write(|| Ok(MeasurementDocument::Tradeoff(Box::new(measurement))))?;
        Ok(text)
    }
}

impl Objects {
    fn run(&self) -> Result<String, CommandError> {
        self.output.check(&self.meshes)?;
        let mut meshes = Vec::new();
        for path in &self.meshes {
            let read = read_meshes(path)?;
            let several = read.len() > 1;
            for mesh in read {
                let file = file_name(path);
                let name = if several { format!("{file} {}", mesh.name) } else { file };
                let mesh = Mesh { name, ..mesh };
                // Before anything that takes time, and while it is known which file it is from.
                mesh.validate().map_err(|source| CommandError::Bake {
                    path: path.clone(),
                    source: BakeError::Mesh { name: mesh.name.clone(), source },
                })?;
                meshes.push(mesh);
            }
        }
        let instances = self.instances.into();
        if meshes.len() > instances {
            return Err(CommandError::TooManyMeshes { meshes: meshes.len(), instances });
        }
        let question = ManyQuestion {
            instances,
            cap_grid: CapGridFormat { points: self.points, ..CapGridFormat::DEFAULT },
            ..ManyQuestion::default()
        };
        let measurement = with_progress(|progress| measure_many(&meshes, &question, progress))
            .map_err(|source| CommandError::Bake { path: self.meshes[0].clone(), source })?;
        let text = measurement.table();
        self.output.write(|| Ok(MeasurementDocument::Many(Box::new(measurement))))?;
        Ok(text)
    }
}

/// Pictures are of the corner; a mesh's own surface has none.
fn pictures(
    mesh: &Mesh,
    scene: MeasureScene,
    exact: &[f32],
    found: &[f32],
) -> Result<Option<Box<Pictures>>, BakeError> {
    if scene != MeasureScene::Corner {
        return Ok(None);
    }
    let pictures = corner_pictures(mesh, exact, found);
    pictures
        .map(|pictures| Some(Box::new(pictures)))
        .map_err(|source| BakeError::Mesh { name: mesh.name.clone(), source })
}

/// Shows how far long work has come, on stderr, and only if that is a terminal.
fn with_progress<T>(work: impl FnOnce(&(dyn Fn(f64, &str) + Sync)) -> T) -> T {
    const STEPS: u64 = 1000;
    let bar = ProgressBar::new(STEPS);
    if let Ok(style) = ProgressStyle::with_template("{wide_msg} {bar:30} {percent} %  {eta}") {
        bar.set_style(style);
    }
    let result = work(&|share, doing| {
        bar.set_message(doing.to_owned());
        bar.set_position((share * STEPS as f64) as u64);
    });
    bar.finish_and_clear();
    result
}

type Lines = Vec<(&'static str, String)>;

fn ambient_table(m: &AmbientMeasurement) -> String {
    let mut lines = vec![
        ("mesh", format!("{}, {} triangles", m.mesh, HumanCount(m.triangles.into()))),
        ("field", field_line(&m.representation, &m.size, &m.encoding, &m.bounds)),
        ("in memory", DecimalBytes(m.field_bytes).to_string()),
        ("bake", format!("{:.2} s, {}", m.bake_seconds, mega(m.bake_rays_per_second))),
        ("scene", format!("{}, {} receivers, lookups: {}", m.scene, HumanCount(m.receivers as u64), m.aim)),
        ("rays", rays_line(m.rays, m.rays_meeting_bounds, m.occluded_fraction)),
    ];
    lines.extend(m.speed.iter().flat_map(speed_lines));
    lines.extend(error_lines(
        [m.rms_255, m.mean_abs, m.max_abs, m.bias_signed],
        [m.mean_abs_truth, m.exact_mean_abs_truth],
    ));
    in_columns(&lines)
}

fn shadow_table(m: &ShadowMeasurement) -> String {
    let (receivers, partly_lit) = (HumanCount(m.receivers as u64), HumanCount(m.partly_lit as u64));
    let mut lines = vec![
        ("mesh", format!("{}, {} triangles", m.mesh, HumanCount(m.triangles.into()))),
        ("field", field_line(&m.representation, &m.size, &m.encoding, &m.bounds)),
        ("in memory", DecimalBytes(m.field_bytes).to_string()),
        ("bake", format!("{:.2} s, {}", m.bake_seconds, mega(m.bake_rays_per_second))),
        ("light", format!("angular radius {} rad", m.angular_radius)),
        ("scene", format!("{}, {receivers} receivers, {partly_lit} partly lit, lookups: {}", m.scene, m.aim)),
        ("rays", rays_line(m.rays, m.rays_meeting_bounds, m.occluded_fraction)),
    ];
    lines.extend(m.speed.iter().flat_map(speed_lines));
    lines.extend(error_lines(
        [m.rms_255, m.mean_abs, m.max_abs, m.bias_signed],
        [m.mean_abs_truth, m.exact_mean_abs_truth],
    ));
    in_columns(&lines)
}

fn field_line(representation: &str, size: &str, encoding: &str, bounds: &str) -> String {
    format!("{representation} {size}, {encoding}, {bounds}")
}

fn rays_line(rays: u64, meeting: u64, occluded: f64) -> String {
    let meeting = 100.0 * meeting as f64 / rays.max(1) as f64;
    format!("{}, {meeting:.1} % meet the bounds, {:.1} % are occluded", HumanCount(rays), 100.0 * occluded)
}

fn speed_lines(speed: &AmbientSpeed) -> Lines {
    let times = format!("field {:.6} s, triangles {:.6} s", speed.field_seconds, speed.bvh_seconds);
    let mut lines = match speed.caps {
        None => vec![
            ("all rays", times),
            ("  speedup", format!("{:.1}\u{d7}", speed.speedup)),
            ("rays that meet the bounds", String::new()),
            ("  speedup", format!("{:.1}\u{d7}", speed.speedup_meeting_bounds)),
            ("  through the field", mega(speed.lookups_per_second)),
        ],
        Some(caps) => vec![
            ("a receiver and object", format!("{:.1} ns", caps.nanoseconds_per_receiver_and_object)),
            (
                "64 rays of a receiver",
                format!(
                    "{:.0} ns: 64 rays through a 65\u{b2} \u{d7} 32\u{b2} table cost {:.1}\u{d7} as much",
                    caps.table_nanoseconds_per_receiver,
                    caps.ratio()
                ),
            ),
            ("all receivers", times),
            ("  speedup", format!("{:.1}\u{d7}", speed.speedup)),
            ("  receivers", mega(speed.lookups_per_second)),
            ("rays that meet the bounds", String::new()),
        ],
    };
    lines.extend([
        ("  through the triangles", mega(speed.bvh_rays_per_second)),
        ("random bytes of the field", mega(speed.gather_limit_lookups_per_second)),
    ]);
    lines
}

fn error_lines([rms_255, mean_abs, max_abs, bias]: [f64; 4], [truth, exact_truth]: [f64; 2]) -> Lines {
    vec![
        ("RMS \u{d7} 255", format!("{rms_255:.2}")),
        ("mean absolute error", format!("{mean_abs:.4}")),
        ("largest error", format!("{max_abs:.3}")),
        ("bias", format!("{bias:+.4} (above 0: too dark)")),
        ("against the truth", format!("{truth:.4}; the exact rays themselves {exact_truth:.4}")),
    ]
}

fn mega(per_second: f64) -> String {
    format!("{:.1} M/s", per_second * 1e-6)
}

fn in_columns(lines: &Lines) -> String {
    lines.iter().map(|(name, value)| format!("{name:<28}{value}").trim_end().to_owned() + "\n").collect()
}
