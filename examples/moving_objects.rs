//! Fourteen instances of three meshes orbit, tumble and touch the floor, and give each other ambient occlusion and a soft
//! sun shadow from visibility baked once per mesh. Materials are plain `StandardMaterial`s; no shadow map is used.
//!
//! Ambient occlusion starts with cap grids, which cost next to nothing. Switch to rays with E and look at the creases of the
//! objects themselves and at the chairs' feet: rays show more there. On floor and walls there is little to tell apart.
//!
//! `cargo run --example moving_objects` opens a window; `--headless` records frames and a GIF instead; `--mesh PATH` shows
//! a mesh of your own, baked on the spot in the background.
//!
//! | key | |
//! | --- | --- |
//! | A | ambient occlusion on and off |
//! | S | sun shadows on and off |
//! | D | shows the occlusion itself: ambient, each light, how much each tile looks at, off |
//! | E | ambient occlusion as the quality says, by cap grids (no rays, no noise) or by rays |
//! | Q | quality: low, medium, high, ultra |
//! | L | lights: the sun alone, with a lamp, with a lamp and a spot |
//! | T | accumulate frames: smoother where few rays are sent; look at creases while it moves |
//! | B | the fields' bounds |
//! | Space | pause |
//! | Esc | quit |

use std::error::Error;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use bevy::anti_alias::fxaa::Fxaa;
use bevy::prelude::*;
use bevy_visfield::FieldBoundsGizmos;
use bevy_visfield::bake::to_bevy_mesh;
use bevy_visfield::prelude::*;
use clap::Parser;
use visfield_workspace::headless::HeadlessApp;
use visfield_workspace::moving_objects::{
    ObjectParts, SceneClock, camera_transform, default_parts, move_objects, spawn_objects, spawn_surroundings,
};
use visfield_workspace::recording::{Recording, RecordingOptions};
use visfield_workspace::window::{Paused, exit_code, next_quality, tick, window_app};

/// Moving objects with ambient occlusion and soft shadows from visibility fields
#[derive(Parser, Resource, Clone, Debug)]
struct Options {
    #[command(flatten)]
    recording: RecordingOptions,
    /// A .glb, .gltf or .obj mesh to show in place of the default ones; baked on the spot
    #[arg(long, value_name = "PATH")]
    mesh: Option<PathBuf>,
    /// What ambient occlusion is taken from
    #[arg(long, value_enum, default_value_t)]
    estimator: Estimator,
    /// What is spent
    #[arg(long, value_enum, default_value_t)]
    quality: Quality,
    /// Lights: the sun, then a lamp, then a spot
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=3))]
    lights: u32,
    /// Show the occlusion itself in the frames
    #[arg(long, value_enum)]
    debug: Option<DebugView>,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug, Default)]
enum Estimator {
    /// As the quality says
    #[default]
    Quality,
    /// Cap grids: one interpolated read per pixel and object
    Caps,
    /// Rays through tables
    Rays,
}

impl From<Estimator> for OcclusionEstimator {
    fn from(estimator: Estimator) -> Self {
        match estimator {
            Estimator::Quality => Self::ByQuality,
            Estimator::Caps => Self::CapGrid,
            Estimator::Rays => Self::Rays,
        }
    }
}

#[derive(clap::ValueEnum, Clone, Copy, Debug, Default)]
enum Quality {
    Low,
    #[default]
    Medium,
    High,
    Ultra,
}

impl From<Quality> for FieldOcclusionQuality {
    fn from(quality: Quality) -> Self {
        match quality {
            Quality::Low => Self::Low,
            Quality::Medium => Self::Medium,
            Quality::High => Self::High,
            Quality::Ultra => Self::Ultra,
        }
    }
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum DebugView {
    Ambient,
    Sun,
}

/// The user's own meshes, read before the app starts so that a bad file is told at once.
#[derive(Resource, Clone)]
struct OwnMeshes(Vec<visfield_bake::Mesh>);

fn main() -> ExitCode {
    let options = Options::parse();
    let own_meshes = match options.mesh.as_deref().map(read_own_meshes).transpose() {
        Ok(meshes) => meshes,
        Err(error) => {
            eprintln!("error: {error}");
            return ExitCode::FAILURE;
        }
    };
    if !options.recording.headless {
        return run_in_window(options, own_meshes);
    }
    match record(&options, own_meshes) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: cannot write the recording: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Reads the user's meshes and leaves out those that cannot be baked, with a warning.
fn read_own_meshes(path: &Path) -> Result<OwnMeshes, Box<dyn Error>> {
    let mut sound = Vec::new();
    for mesh in visfield_bake::read_meshes(path)? {
        match mesh.validate() {
            Ok(()) => sound.push(mesh),
            Err(error) => eprintln!("warning: {}: {}: {error}", path.display(), mesh.name),
        }
    }
    if sound.is_empty() {
        return Err(format!("{}: none of its meshes can be baked", path.display()).into());
    }
    Ok(OwnMeshes(sound))
}

fn add_scene(app: &mut App, options: Options, own_meshes: Option<OwnMeshes>) {
    app.add_plugins(VisibilityFieldPlugin)
        .insert_resource(ClearColor(Color::srgb(0.72, 0.80, 0.90)))
        .insert_resource(options)
        .init_resource::<SceneClock>()
        .add_systems(Startup, spawn_scene)
        .add_systems(Update, move_objects);
    if let Some(own_meshes) = own_meshes {
        app.insert_resource(own_meshes);
    }
}

fn run_in_window(options: Options, own_meshes: Option<OwnMeshes>) -> ExitCode {
    let mut app = window_app("visfield: moving objects");
    add_scene(&mut app, options, own_meshes);
    app.init_resource::<Paused>()
        .add_systems(Startup, (spawn_window_camera, spawn_help))
        .add_systems(Update, (tick.before(move_objects), press_keys, show_help));
    exit_code(app.run())
}

/// Renders one loop of the motion.
fn record(options: &Options, own_meshes: Option<OwnMeshes>) -> image::ImageResult<()> {
    let recording = Recording::new(&options.recording, "demo")?;
    let mut headless = HeadlessApp::new(options.recording.size, |plugins| plugins);
    add_scene(&mut headless.app, options.clone(), own_meshes);
    let target = headless.target();
    let mut commands = headless.app.world_mut().commands();
    let camera = spawn_camera(&mut commands, options);
    commands.entity(camera).insert(target);
    match options.debug {
        Some(DebugView::Ambient) => drop(commands.entity(camera).insert(FieldDebugView::AmbientVisibility)),
        Some(DebugView::Sun) => drop(commands.entity(camera).insert(FieldDebugView::Light(0))),
        None => {}
    }
    wait_for_bakes(&mut headless);
    headless.wait_until_ready();

    recording.run(&mut headless, "moving_objects", HeadlessApp::capture)?;
    Ok(())
}

/// Runs frames until the user's meshes are baked. The bar hides itself in a pipe.
fn wait_for_bakes(headless: &mut HeadlessApp) {
    let style = indicatif::ProgressStyle::with_template("{msg} {bar:40} {percent} %").expect("the template is valid");
    let bar = indicatif::ProgressBar::new(1000).with_style(style).with_message("baking");
    headless.update();
    headless.update_until(|app| {
        let world = app.world_mut();
        let mut bakes = world.query::<&BakeProgress>();
        let slowest = bakes.iter(world).map(|progress| progress.0).min_by(f32::total_cmp);
        bar.set_position((slowest.unwrap_or(1.0) * 1000.0) as u64);
        slowest.is_none()
    });
    bar.finish_and_clear();
}

fn spawn_scene(
    mut commands: Commands,
    server: Res<AssetServer>,
    options: Res<Options>,
    own_meshes: Option<Res<OwnMeshes>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let parts = match own_meshes {
        Some(own) => vec![own_parts(&own.0, &mut meshes)],
        None => default_parts(&server).to_vec(),
    };
    spawn_objects(&mut commands, &mut materials, &parts);
    spawn_surroundings(&mut commands, &mut meshes, &mut materials);
    spawn_more_lights(&mut commands, options.lights);
}

/// Beside the sun: which of the lights it is, from 2.
#[derive(Component)]
struct MoreLight(u32);

fn spawn_more_lights(commands: &mut Commands, lights: u32) {
    let lamp =
        PointLight { intensity: 250_000.0, radius: 0.12, range: 12.0, color: Color::srgb(1.0, 0.75, 0.5), ..default() };
    let spot = SpotLight {
        intensity: 1_500_000.0,
        radius: 0.15,
        range: 20.0,
        outer_angle: 0.5,
        inner_angle: 0.35,
        color: Color::srgb(0.6, 0.75, 1.0),
        ..default()
    };
    let aimed = Transform::from_xyz(4.5, 5.5, 4.5).looking_at(Vec3::new(0.5, 0.5, 0.0), Vec3::Y);
    commands.spawn((
        MoreLight(2),
        lamp,
        Transform::from_xyz(0.4, 2.5, 3.2),
        shown(lights >= 2),
        FieldShadows::default(),
    ));
    commands.spawn((MoreLight(3), spot, aimed, shown(lights >= 3), FieldShadows::default()));
}

fn shown(yes: bool) -> Visibility {
    if yes { Visibility::Inherited } else { Visibility::Hidden }
}

/// The user's meshes as one object, brought to the size of the default ones.
fn own_parts(own: &[visfield_bake::Mesh], meshes: &mut Assets<Mesh>) -> ObjectParts {
    let corners = own.iter().flat_map(|mesh| &mesh.positions).map(|&p| Vec3::from(p)).filter(|p| p.is_finite());
    let (low, high) = corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    let scale = 2.0 / (high - low).max_element().max(f32::MIN_POSITIVE);
    let object_from_mesh = Transform::from_scale(Vec3::splat(scale)).with_translation((low + high) * (-0.5 * scale));
    let meshes = own.iter().map(|mesh| meshes.add(to_bevy_mesh(mesh))).collect();
    ObjectParts { meshes, fields: Vec::new(), object_from_mesh }
}

fn spawn_camera(commands: &mut Commands, options: &Options) -> Entity {
    let occlusion =
        FieldOcclusion { estimator: options.estimator.into(), quality: options.quality.into(), ..default() };
    commands.spawn((Camera3d::default(), Msaa::Off, Fxaa::default(), camera_transform(), occlusion)).id()
}

fn spawn_window_camera(mut commands: Commands, options: Res<Options>) {
    spawn_camera(&mut commands, &options);
}

fn press_keys(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    mut paused: ResMut<Paused>,
    mut exit: MessageWriter<AppExit>,
    suns: Query<(Entity, Has<FieldShadows>), With<DirectionalLight>>,
    mut more_lights: Query<(&MoreLight, &mut Visibility)>,
    mut gizmos: ResMut<GizmoConfigStore>,
    mut cameras: Query<(Entity, &mut FieldOcclusion, Option<&FieldDebugView>)>,
) {
    if keys.just_pressed(KeyCode::Escape) {
        exit.write(AppExit::Success);
    }
    if keys.just_pressed(KeyCode::Space) {
        paused.0 = !paused.0;
    }
    if keys.just_pressed(KeyCode::KeyS) {
        for (sun, shadowed) in &suns {
            let mut sun = commands.entity(sun);
            if shadowed {
                sun.remove::<FieldShadows>()
            } else {
                sun.insert(FieldShadows::default())
            };
        }
    }
    if keys.just_pressed(KeyCode::KeyB) {
        let bounds = gizmos.config_mut::<FieldBoundsGizmos>().0;
        bounds.enabled = !bounds.enabled;
    }
    let count = lights(more_lights.iter().map(|(_, visibility)| visibility));
    if keys.just_pressed(KeyCode::KeyL) {
        let next = count % 3 + 1;
        more_lights.iter_mut().for_each(|(light, mut visibility)| *visibility = shown(light.0 <= next));
    }
    for (camera, mut occlusion, view) in &mut cameras {
        if keys.just_pressed(KeyCode::KeyT) {
            occlusion.accumulate = !occlusion.accumulate;
        }
        if keys.just_pressed(KeyCode::KeyA) {
            occlusion.ambient_occlusion = !occlusion.ambient_occlusion;
        }
        if keys.just_pressed(KeyCode::KeyE) {
            occlusion.estimator = match occlusion.estimator {
                OcclusionEstimator::ByQuality => OcclusionEstimator::CapGrid,
                OcclusionEstimator::CapGrid => OcclusionEstimator::Rays,
                OcclusionEstimator::Rays => OcclusionEstimator::ByQuality,
            };
        }
        if keys.just_pressed(KeyCode::KeyQ) {
            occlusion.quality = next_quality(occlusion.quality);
        }
        if keys.just_pressed(KeyCode::KeyD) {
            let mut camera = commands.entity(camera);
            match view {
                None => camera.insert(FieldDebugView::AmbientVisibility),
                Some(FieldDebugView::AmbientVisibility) => camera.insert(FieldDebugView::Light(0)),
                Some(FieldDebugView::Light(light)) if light + 1 < count => {
                    camera.insert(FieldDebugView::Light(light + 1))
                }
                Some(FieldDebugView::Light(_)) => camera.insert(FieldDebugView::TileLoad),
                Some(FieldDebugView::TileLoad) => camera.remove::<FieldDebugView>(),
            };
        }
    }
}

/// How many lights are on, the sun included.
fn lights<'a>(more: impl Iterator<Item = &'a Visibility>) -> u32 {
    1 + more.filter(|visibility| **visibility != Visibility::Hidden).count() as u32
}

#[derive(Component)]
struct Help;

fn spawn_help(mut commands: Commands) {
    let place = Node { position_type: PositionType::Absolute, left: px(12), top: px(12), ..default() };
    commands.spawn((Help, Text::default(), TextFont::from_font_size(15.0), TextColor(Color::BLACK), place));
}

fn show_help(
    mut help: Single<&mut Text, With<Help>>,
    cameras: Query<(&FieldOcclusion, Option<&FieldDebugView>)>,
    shadowed: Query<(), (With<DirectionalLight>, With<FieldShadows>)>,
    more_lights: Query<&Visibility, With<MoreLight>>,
    bakes: Query<&BakeProgress>,
) {
    let Ok((occlusion, view)) = cameras.single() else { return };
    let on = |on: bool| if on { "on" } else { "off" };
    let view = match view {
        None => "picture".to_owned(),
        Some(FieldDebugView::AmbientVisibility) => "ambient visibility".to_owned(),
        Some(FieldDebugView::Light(light)) => format!("visibility of light {}", light + 1),
        Some(FieldDebugView::TileLoad) => "load of tiles".to_owned(),
    };
    let mut text = format!(
        "A ambient occlusion: {}   E by: {:?}   S sun shadows: {}   L lights: {}   D view: {view}\n\
         Q quality: {:?}   T accumulate: {}   B bounds   Space pause   Esc quit",
        on(occlusion.ambient_occlusion),
        occlusion.estimator,
        on(!shadowed.is_empty()),
        lights(more_lights.iter()),
        occlusion.quality,
        on(occlusion.accumulate),
    );
    if let Some(progress) = bakes.iter().map(|progress| progress.0).min_by(f32::total_cmp) {
        let _ = write!(text, "\nbaking: {:.0} %", progress * 100.0);
    }
    if help.0 != text {
        help.0 = text;
    }
}
