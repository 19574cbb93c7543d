//! What a frame costs: every pass at each preset for the scene of `moving_objects`, Bevy's screen-space ambient occlusion and its
//! shadow maps for the same frame, and crowds of 10 to 10,000 instances at the same density, seen by a camera that sees the same part
//! of each.
//!
//! ```text
//! cargo run --example frame_bench -- --json frames.json
//! ```
//!
//! Look at the last table: the time of the lists of tiles is the culling, and with the rest it should hardly grow from 100 instances
//! to 10,000. Where the GPU has no timestamps, only the time of whole frames is measured, submitted and waited for.
//! Without a GPU, `--quick` takes small frames and few of them.

mod cost;
mod timer;

use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;

use bevy::app::TerminalCtrlCHandlerPlugin;
use bevy::core_pipeline::prepass::{DepthPrepass, NormalPrepass};
use bevy::log::LogPlugin;
use bevy::pbr::{ScreenSpaceAmbientOcclusion, ScreenSpaceAmbientOcclusionQualityLevel};
use bevy::prelude::*;
use bevy::render::diagnostic::RenderDiagnosticsPlugin;
use bevy_visfield::FieldOcclusionDiagnosticsPlugin;
use bevy_visfield::prelude::*;
use clap::Parser;
use serde::Serialize;
use visfield_workspace::crowd::{self, BakedShape, Crowd, CrowdShapes, MAX_DISTANCE, bake_shapes, overhead_camera};
use visfield_workspace::headless::HeadlessApp;
use visfield_workspace::moving_objects::{
    PERIOD, SceneClock, camera_transform, default_parts, move_objects, spawn_objects, spawn_surroundings,
};
use visfield_workspace::recording::parse_size;

use cost::{FrameCost, Frames, measure};
use timer::TimedApp;

/// Measures what a frame costs
#[derive(Parser, Clone, Debug)]
struct Options {
    /// Write what was measured
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Width and height of the frames in pixels
    #[arg(long, default_value = "1920x1080", default_value_if("quick", "true", "320x180"), value_parser = parse_size,
          value_name = "WIDTHxHEIGHT")]
    size: UVec2,
    /// Frames whose medians count
    #[arg(long, default_value = "40", default_value_if("quick", "true", "5"),
          value_parser = clap::value_parser!(u32).range(1..=100))]
    frames: u32,
    /// Few and small frames: to see that it works, or without a GPU
    #[arg(long)]
    quick: bool,
}

/// What `--json` writes, in the form of `visfield measure`.
#[derive(Serialize)]
struct Document {
    kind: &'static str,
    visfield: &'static str,
    adapter: String,
    backend: String,
    driver: String,
    width: u32,
    height: u32,
    frames: u32,
    /// Whether the GPU has timestamps; where not, only whole frames are timed, submitted and waited for.
    timestamps: bool,
    moving_objects: Vec<FrameCost>,
    crowds: Vec<CrowdCost>,
    growth: Vec<Growth>,
}

#[derive(Serialize)]
struct CrowdCost {
    quality: &'static str,
    count: usize,
    #[serde(flatten)]
    cost: FrameCost,
}

/// How many times as much a crowd of 10,000 costs as one of 100.
#[derive(Serialize)]
struct Growth {
    quality: &'static str,
    /// All passes of fields.
    field_gpu: Option<f64>,
    /// The lists of tiles alone.
    tiles: Option<f64>,
    prepare_cpu: Option<f64>,
}

const QUALITIES: [(&str, FieldOcclusionQuality); 4] = [
    ("low", FieldOcclusionQuality::Low),
    ("medium", FieldOcclusionQuality::Medium),
    ("high", FieldOcclusionQuality::High),
    ("ultra", FieldOcclusionQuality::Ultra),
];

const COUNTS: [usize; 4] = [10, 100, 1_000, 10_000];

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), Box<dyn Error>> {
    let frames = Frames { warm_up: options.frames.div_ceil(4).max(3), measured: options.frames };
    let (adapter, moving_objects) = measure_moving_objects(options.size, frames);
    let shapes = bake_shapes(|_| ())?;
    let crowds = measure_crowds(options.size, frames, &shapes);
    let timestamps = moving_objects.iter().any(|cost| cost.frame_gpu.is_some());
    println!(
        "{} ({}), {} × {} pixels, medians of {} frames, ms",
        adapter.name, adapter.backend, options.size.x, options.size.y, options.frames
    );
    if !timestamps {
        println!("this adapter has no timestamps: only the time of whole frames, submitted and waited for");
    }
    let growth: Vec<Growth> = ["medium", "high"].map(|quality| growth(&crowds, quality)).into();
    print_moving_objects(&moving_objects);
    print_crowds(&crowds, &growth);
    if let Some(path) = &options.json {
        let document = Document {
            kind: "frames",
            visfield: env!("CARGO_PKG_VERSION"),
            adapter: adapter.name,
            backend: adapter.backend.to_string(),
            driver: format!("{} {}", adapter.driver, adapter.driver_info),
            width: options.size.x,
            height: options.size.y,
            frames: options.frames,
            timestamps,
            moving_objects,
            crowds,
            growth,
        };
        visfield::file::write_bytes(path, &serde_json::to_vec_pretty(&document)?)?;
    }
    Ok(())
}

fn timed_app(size: UVec2, log: Log) -> TimedApp {
    let mut headless = HeadlessApp::new(size, |plugins| match log {
        Log::Started => plugins.disable::<LogPlugin>().disable::<TerminalCtrlCHandlerPlugin>(),
        Log::Start => plugins,
    });
    headless.app.add_plugins((
        VisibilityFieldPlugin,
        RenderDiagnosticsPlugin,
        FieldOcclusionDiagnosticsPlugin::default(),
    ));
    TimedApp::new(headless)
}

/// Whether an app starts the log, which only the first one of a process can.
enum Log {
    Start,
    Started,
}

/// A camera that makes the prepasses that all techniques need, and shows none.
fn spawn_camera(timed: &mut TimedApp, transform: Transform) -> Entity {
    let target = timed.headless.target();
    let camera = (Camera3d::default(), Msaa::Off, DepthPrepass, NormalPrepass, transform, target);
    timed.headless.app.world_mut().spawn(camera).id()
}

fn measure_moving_objects(size: UVec2, frames: Frames) -> (wgpu::AdapterInfo, Vec<FrameCost>) {
    let mut timed = timed_app(size, Log::Start);
    timed.headless.app.init_resource::<SceneClock>().add_systems(Update, move_objects).add_systems(
        Startup,
        |mut commands: Commands,
         server: Res<AssetServer>,
         mut meshes: ResMut<Assets<Mesh>>,
         mut materials: ResMut<Assets<StandardMaterial>>| {
            spawn_objects(&mut commands, &mut materials, &default_parts(&server));
            spawn_surroundings(&mut commands, &mut meshes, &mut materials);
        },
    );
    let camera = spawn_camera(&mut timed, camera_transform());
    let measured = |timed: &mut TimedApp, name: &str| {
        measure(timed, name, frames, |world, share| world.resource_mut::<SceneClock>().0 = PERIOD * share)
    };
    let mut costs = vec![measured(&mut timed, "nothing")];
    for (name, quality) in QUALITIES {
        let world = timed.headless.app.world_mut();
        world.entity_mut(camera).insert(FieldOcclusion { quality, ..default() });
        costs.push(measured(&mut timed, name));
    }
    let world = timed.headless.app.world_mut();
    world.entity_mut(camera).remove::<FieldOcclusion>().insert(ScreenSpaceAmbientOcclusion {
        quality_level: ScreenSpaceAmbientOcclusionQualityLevel::High,
        ..default()
    });
    costs.push(measured(&mut timed, "Bevy's SSAO, high"));
    let world = timed.headless.app.world_mut();
    world.entity_mut(camera).remove::<ScreenSpaceAmbientOcclusion>();
    for mut light in world.query::<&mut DirectionalLight>().iter_mut(world) {
        light.shadow_maps_enabled = true;
    }
    costs.push(measured(&mut timed, "Bevy's shadow maps"));
    (timed.adapter(), costs)
}

fn measure_crowds(size: UVec2, frames: Frames, shapes: &[BakedShape]) -> Vec<CrowdCost> {
    let mut timed = timed_app(size, Log::Started);
    timed.headless.app.add_plugins(crowd::plugin).add_systems(Startup, crowd::spawn_surroundings);
    let shapes = CrowdShapes::new(timed.headless.app.world_mut(), shapes);
    timed.headless.app.insert_resource(shapes);
    let camera = spawn_camera(&mut timed, overhead_camera());
    let mut costs = Vec::new();
    for (quality_name, quality) in QUALITIES.into_iter().filter(|(name, _)| ["medium", "high"].contains(name)) {
        for count in COUNTS {
            let world = timed.headless.app.world_mut();
            world.entity_mut(camera).insert(FieldOcclusion { quality, max_distance: MAX_DISTANCE, ..default() });
            world.resource_mut::<Crowd>().count = count;
            let name = format!("{count} instances, {quality_name}");
            let cost = measure(&mut timed, name, frames, |world, share| world.resource_mut::<Crowd>().seconds = share);
            costs.push(CrowdCost { quality: quality_name, count, cost });
        }
    }
    costs
}

fn growth(crowds: &[CrowdCost], quality: &'static str) -> Growth {
    let of = |count| crowds.iter().find(|crowd| crowd.quality == quality && crowd.count == count);
    let ratio = |time: fn(&FrameCost) -> Option<f64>| Some(time(&of(10_000)?.cost)? / time(&of(100)?.cost)?);
    Growth {
        quality,
        field_gpu: ratio(|cost| cost.field_gpu),
        tiles: ratio(|cost| cost.tiles),
        prepare_cpu: ratio(|cost| cost.prepare_cpu),
    }
}

/// A number of a table, or a dash.
fn cell(number: Option<f64>) -> String {
    number.map_or("-".to_owned(), |number| format!("{number:.3}"))
}

fn print_row(name: &str, cells: &[String]) {
    print!("{name:<26}");
    for cell in cells {
        print!("{cell:>12}");
    }
    println!();
}

fn print_moving_objects(costs: &[FrameCost]) {
    println!("\nthe scene of moving_objects");
    let header = ["tiles", "trace", "denoise", "resolve", "fields", "SSAO", "frame GPU", "frame wall", "more GPU"];
    print_row("", &header.map(str::to_owned));
    let nothing = costs.first().and_then(|cost| cost.frame_gpu);
    for cost in costs {
        let more = cost.frame_gpu.zip(nothing).map(|(frame, nothing)| frame - nothing);
        let cells = [
            cost.tiles,
            cost.trace,
            cost.denoise,
            cost.resolve,
            cost.field_gpu,
            cost.ssao,
            cost.frame_gpu,
            Some(cost.frame_wall),
            more,
        ];
        print_row(&cost.name, &cells.map(cell));
    }
    println!(
        "\"more GPU\" is the whole frame less one that shows nothing of the kind; Bevy times no shadow maps itself"
    );
}

fn print_crowds(crowds: &[CrowdCost], growth: &[Growth]) {
    println!("\ncrowds of the same density; the camera's view lies within a crowd of 100");
    let header = ["culling", "trace", "denoise", "resolve", "fields", "frame GPU", "extract CPU", "prepare CPU"];
    print_row("", &header.iter().map(|name| (*name).to_owned()).chain(["entries".to_owned()]).collect::<Vec<_>>());
    for CrowdCost { cost, .. } in crowds {
        let times = [
            cost.tiles,
            cost.trace,
            cost.denoise,
            cost.resolve,
            cost.field_gpu,
            cost.frame_gpu,
            cost.extract_cpu,
            cost.prepare_cpu,
        ];
        let entries = cost.tile_entries.map_or("-".to_owned(), |entries| format!("{entries:.0}"));
        print_row(&cost.name, &times.map(cell).into_iter().chain([entries]).collect::<Vec<_>>());
    }
    for growth in growth {
        println!(
            "10,000 instances cost {} × as much on the GPU as 100 at {} (culling alone {} ×, prepare CPU {} ×)",
            cell(growth.field_gpu),
            growth.quality,
            cell(growth.tiles),
            cell(growth.prepare_cpu)
        );
    }
}
