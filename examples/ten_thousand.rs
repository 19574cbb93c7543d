//! Ten thousand moving instances of twenty meshes occlude each other, at a density that is the same for any number of them.
//!
//! Look at the numbers in the corner while you press 1 to 4: the cost of a frame follows what is near, not how many instances
//! exist. With D, at the tiles of the screen and how many instances each of them looks at.
//!
//! `cargo run --example ten_thousand` opens a window; `--headless` records frames instead, with the numbers on them.
//!
//! | key | |
//! | --- | --- |
//! | 1 2 3 4 | 10, 100, 1,000, 10,000 instances |
//! | Q | quality: low, medium, high, ultra |
//! | D | shows how many instances each tile looks at |
//! | Space | pause |
//! | Esc | quit |

use std::error::Error;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use bevy::anti_alias::fxaa::Fxaa;
use bevy::diagnostic::{Diagnostic, DiagnosticPath, DiagnosticsStore, FrameTimeDiagnosticsPlugin};
use bevy::prelude::*;
use bevy::render::diagnostic::RenderDiagnosticsPlugin;
use bevy_visfield::FieldOcclusionDiagnosticsPlugin;
use bevy_visfield::prelude::*;
use clap::Parser;
use visfield_workspace::crowd::{
    self, BakedShape, Crowd, CrowdShapes, MAX_DISTANCE, SHAPES, bake_shapes, flying_camera,
};
use visfield_workspace::headless::HeadlessApp;
use visfield_workspace::recording::{parse_size, record_frames};
use visfield_workspace::window::{Paused, exit_code, next_quality, window_app};

/// Thousands of moving objects with ambient occlusion and soft shadows, and what they cost
#[derive(Parser, Resource, Clone, Debug)]
struct Options {
    /// Render without a window; write PNG frames
    #[arg(long)]
    headless: bool,
    /// Number of frames to render without a window
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=1000))]
    frames: u32,
    /// Folder for the frames; made if it is missing
    #[arg(long, default_value = "target/ten_thousand", value_name = "DIR")]
    out: PathBuf,
    /// Width and height of the frames in pixels
    #[arg(long, default_value = "640x360", value_parser = parse_size, value_name = "WIDTHxHEIGHT")]
    size: UVec2,
    /// How many instances
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    instances: u32,
    /// Show how many instances each tile looks at
    #[arg(long)]
    tile_load: bool,
}

/// Seconds of the scene in a recorded frame, and in one round of the camera.
const FRAME: f32 = 1.0 / 12.0;
const ROUND: f32 = 40.0;

fn main() -> ExitCode {
    let options = Options::parse();
    match run(&options) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<ExitCode, Box<dyn Error>> {
    let started = Instant::now();
    let bar = indicatif::ProgressBar::new(SHAPES as u64).with_message("baking");
    let shapes = bake_shapes(|done| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    println!("baked {SHAPES} meshes in {:.1} s", started.elapsed().as_secs_f32());
    if options.headless { record(options, &shapes) } else { Ok(run_in_window(options, &shapes)) }
}

fn add_scene(app: &mut App, options: &Options, shapes: &[BakedShape]) {
    app.add_plugins((
        VisibilityFieldPlugin,
        FieldOcclusionDiagnosticsPlugin::default(),
        FrameTimeDiagnosticsPlugin::default(),
        RenderDiagnosticsPlugin,
        crowd::plugin,
    ))
    .insert_resource(ClearColor(Color::srgb(0.72, 0.80, 0.90)))
    .insert_resource(Crowd { count: options.instances as usize, seconds: 0.0 })
    .add_systems(Startup, (crowd::spawn_surroundings, spawn_numbers))
    .add_systems(Update, (fly, show_numbers));
    let shapes = CrowdShapes::new(app.world_mut(), shapes);
    app.insert_resource(shapes);
}

fn camera(options: &Options) -> impl Bundle {
    // The tables are small, for a quick start; this keeps their cells from shadowing themselves.
    let occlusion = FieldOcclusion { max_distance: MAX_DISTANCE, bias: 2.5, ..default() };
    let view = options.tile_load.then_some(FieldDebugView::TileLoad);
    (Camera3d::default(), IsDefaultUiCamera, Msaa::Off, Fxaa::default(), flying_camera(0.0), occlusion, DebugView(view))
}

/// The view that a camera shows in the place of the picture.
#[derive(Component)]
struct DebugView(Option<FieldDebugView>);

fn run_in_window(options: &Options, shapes: &[BakedShape]) -> ExitCode {
    let mut app = window_app("visfield: ten thousand");
    add_scene(&mut app, options, shapes);
    app.init_resource::<Paused>().add_systems(Update, (tick, press_keys, set_debug_view).before(fly));
    app.world_mut().spawn(camera(options));
    exit_code(app.run())
}

fn record(options: &Options, shapes: &[BakedShape]) -> Result<ExitCode, Box<dyn Error>> {
    println!("rendering {} frames of {} × {} pixels", options.frames, options.size.x, options.size.y);
    let mut headless = HeadlessApp::new(options.size, |plugins| plugins);
    add_scene(&mut headless.app, options, shapes);
    headless.app.add_systems(Update, set_debug_view.before(fly));
    let target = headless.target();
    headless.app.world_mut().spawn((camera(options), target));
    headless.wait_until_ready();
    record_frames(&mut headless, &options.out, options.frames, |headless, frame| {
        headless.app.world_mut().resource_mut::<Crowd>().seconds = frame as f32 * FRAME;
        headless.capture()
    })?;
    println!("frames rendered: {}; they are in {}", options.frames, options.out.display());
    println!("{}", numbers(headless.app.world().resource(), options.instances as usize));
    Ok(ExitCode::SUCCESS)
}

fn tick(time: Res<Time>, paused: Res<Paused>, mut crowd: ResMut<Crowd>) {
    if !paused.0 {
        crowd.seconds += time.delta_secs();
    }
}

fn fly(crowd: Res<Crowd>, mut camera: Single<&mut Transform, With<Camera3d>>) {
    **camera = flying_camera((crowd.seconds / ROUND).fract());
}

fn set_debug_view(mut commands: Commands, cameras: Query<(Entity, &DebugView), Changed<DebugView>>) {
    for (camera, view) in &cameras {
        match view.0 {
            Some(view) => commands.entity(camera).insert(view),
            None => commands.entity(camera).remove::<FieldDebugView>(),
        };
    }
}

fn press_keys(
    keys: Res<ButtonInput<KeyCode>>,
    mut crowd: ResMut<Crowd>,
    mut paused: ResMut<Paused>,
    mut exit: MessageWriter<AppExit>,
    camera: Single<(&mut FieldOcclusion, &mut DebugView)>,
) {
    let counts = [(KeyCode::Digit1, 10), (KeyCode::Digit2, 100), (KeyCode::Digit3, 1_000), (KeyCode::Digit4, 10_000)];
    for (_, count) in counts.into_iter().filter(|(key, _)| keys.just_pressed(*key)) {
        crowd.count = count;
    }
    if keys.just_pressed(KeyCode::Space) {
        paused.0 = !paused.0;
    }
    if keys.just_pressed(KeyCode::Escape) {
        exit.write(AppExit::Success);
    }
    let (mut occlusion, mut view) = camera.into_inner();
    if keys.just_pressed(KeyCode::KeyQ) {
        occlusion.quality = next_quality(occlusion.quality);
    }
    if keys.just_pressed(KeyCode::KeyD) {
        view.0 = if view.0.is_some() { None } else { Some(FieldDebugView::TileLoad) };
    }
}

#[derive(Component)]
struct Numbers;

fn spawn_numbers(mut commands: Commands) {
    let place =
        Node { position_type: PositionType::Absolute, left: px(8), top: px(8), padding: px(6).all(), ..default() };
    let background = BackgroundColor(Color::srgba(0.0, 0.0, 0.0, 0.6));
    commands.spawn((Numbers, Text::default(), TextFont::from_font_size(12.0), place, background));
}

fn show_numbers(
    store: Res<DiagnosticsStore>,
    crowd: Res<Crowd>,
    occlusion: Single<&FieldOcclusion>,
    mut text: Single<&mut Text, With<Numbers>>,
) {
    text.0 = format!("quality: {:?}\n{}", occlusion.quality, numbers(&store, crowd.count));
}

/// What the latest frames cost.
fn numbers(store: &DiagnosticsStore, count: usize) -> String {
    use FieldOcclusionDiagnosticsPlugin as Field;
    let value = |path: &DiagnosticPath| store.get(path).and_then(Diagnostic::average).unwrap_or(0.0);
    let latest = |path: &DiagnosticPath| store.get(path).and_then(Diagnostic::value).unwrap_or(0.0);
    let mut text = format!("{count} instances, {:.0} placed\n", latest(&Field::INSTANCES));
    let names = ["lists of tiles", "rays", "filter", "accumulation", "resolve"];
    for (name, path) in names.into_iter().zip(&Field::GPU_PASSES) {
        let _ = writeln!(text, "GPU {name}: {:.2} ms", value(path));
    }
    let _ = writeln!(
        text,
        "CPU copy {:.2} ms, place {:.2} ms, frame {:.1} ms",
        value(&Field::EXTRACT),
        value(&Field::PREPARE),
        value(&FrameTimeDiagnosticsPlugin::FRAME_TIME)
    );
    let _ = writeln!(text, "{} entries in the lists", latest(&Field::TILE_ENTRIES));
    let megabytes = |path: &DiagnosticPath| latest(path) / 1.0e6;
    let _ = write!(
        text,
        "{:.1} MB of fields, {:.1} MB beyond",
        megabytes(&Field::FIELD_BYTES),
        megabytes(&Field::FRAME_BYTES)
    );
    text
}
