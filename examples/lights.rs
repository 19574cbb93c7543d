//! Every kind of light that Bevy has, each over the same moving objects: with soft shadows from visibility fields in the upper
//! row, and with Bevy's own shadow maps of the same light in the lower one. Bevy gives a `RectLight` no shadow at all.
//!
//! Look at how a shadow begins sharp where an object touches the floor and widens away from it, how it follows the size and
//! shape of the light (the panel's shadows are wide along the panel and narrow across it), and how the knot's shadow crosses
//! the chair. Make the lights larger and smaller: shadow maps do not know how large a light is. The fields were baked once per
//! mesh, and nothing is drawn again from a light's place.
//!
//! `cargo run --example lights` opens a window; `--headless` records frames and a GIF instead; `--view spot` shows one kind
//! of light alone.
//!
//! | key | |
//! | --- | --- |
//! | Up, Down | larger and smaller lights |
//! | 1, 2, 3, 4 | only this kind of light: directional, point, spot, rect |
//! | 0 | all of them |
//! | A | ambient occlusion by fields on and off (off at first, so that shadows are compared alone) |
//! | Q | quality: low, medium, high, ultra |
//! | Space | pause |
//! | Esc | quit |

use std::process::ExitCode;

use bevy::anti_alias::fxaa::Fxaa;
use bevy::camera::RenderTarget;
use bevy::light::GlobalAmbientLight;
use bevy::prelude::*;
use bevy_visfield::prelude::*;
use clap::Parser;
use visfield_workspace::headless::HeadlessApp;
use visfield_workspace::light_bays::{Bay, LightKind, LightSize, ShadowSource, move_objects, resize_lights, spawn_bay};
use visfield_workspace::moving_objects::{SceneClock, default_parts};
use visfield_workspace::panes::{Pane, fit_panes, help, label};
use visfield_workspace::recording::{Recording, RecordingOptions};
use visfield_workspace::window::{Paused, exit_code, next_quality, tick, window_app};

/// Every kind of light with soft shadows from visibility fields, beside Bevy's shadow maps
#[derive(Parser, Clone, Debug)]
struct Options {
    #[command(flatten)]
    recording: RecordingOptions,
    /// Show one kind of light alone
    #[arg(long, value_enum)]
    view: Option<LightKind>,
    /// How large the lights are, as a multiple of what they are otherwise
    #[arg(long, default_value_t = 1.0, value_parser = parse_light_size, value_name = "FACTOR")]
    light_size: f32,
}

fn parse_light_size(text: &str) -> Result<f32, String> {
    let size = text.parse().ok().filter(|size| LIGHT_SIZES.contains(size));
    size.ok_or_else(|| format!("expected a number from {} to {}", LIGHT_SIZES.start(), LIGHT_SIZES.end()))
}

/// Beyond these, shadows are sharper than tables resolve, or lights hit the objects.
const LIGHT_SIZES: std::ops::RangeInclusive<f32> = 0.1..=4.0;

/// The kind of light that is shown alone.
#[derive(Resource)]
struct Shown(Option<LightKind>);

/// What cameras render to, if not the window.
#[derive(Resource)]
struct Target(Option<RenderTarget>);

fn main() -> ExitCode {
    let options = Options::parse();
    if !options.recording.headless {
        return run_in_window(&options);
    }
    match record(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: cannot write the recording: {error}");
            ExitCode::FAILURE
        }
    }
}

fn add_scene(app: &mut App, options: &Options, target: Option<RenderTarget>) {
    app.add_plugins(VisibilityFieldPlugin)
        .insert_resource(ClearColor(Color::BLACK))
        .insert_resource(GlobalAmbientLight { brightness: 260.0, color: Color::srgb(0.8, 0.88, 1.0), ..default() })
        .insert_resource(LightSize(options.light_size))
        .insert_resource(Shown(options.view))
        .insert_resource(Target(target))
        .init_resource::<SceneClock>()
        .add_systems(Startup, spawn_scene)
        .add_systems(Update, (move_objects, resize_lights, (arrange, fit_panes).chain()));
}

fn run_in_window(options: &Options) -> ExitCode {
    let mut app = window_app("visfield: lights");
    add_scene(&mut app, options, None);
    app.init_resource::<Paused>()
        .add_systems(Startup, spawn_help.after(spawn_scene))
        .add_systems(Update, ((tick, press_keys).before(move_objects), show_help));
    exit_code(app.run())
}

/// Renders one loop of the motion.
fn record(options: &Options) -> image::ImageResult<()> {
    let recording = Recording::new(&options.recording, "lights")?;
    let mut headless = HeadlessApp::new(options.recording.size, |plugins| plugins);
    let target = headless.target();
    add_scene(&mut headless.app, options, Some(target));
    headless.wait_until_ready();
    recording.run(&mut headless, "lights", HeadlessApp::capture)?;
    Ok(())
}

fn spawn_scene(
    mut commands: Commands,
    server: Res<AssetServer>,
    target: Res<Target>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let parts = default_parts(&server);
    for source in [ShadowSource::Fields, ShadowSource::Maps] {
        for kind in LightKind::ALL {
            let bay = Bay { kind, source };
            spawn_bay(&mut commands, &mut meshes, &mut materials, &parts, bay);
            spawn_camera(&mut commands, bay, &target);
        }
    }
}

fn spawn_camera(commands: &mut Commands, bay: Bay, target: &Target) {
    // Cameras of one target need an order.
    let order = bay.kind as isize + if bay.source == ShadowSource::Fields { 0 } else { LightKind::ALL.len() as isize };
    let mut camera = commands.spawn((
        Camera3d::default(),
        Camera { order, ..default() },
        Msaa::Off,
        Fxaa::default(),
        bay.camera_transform(),
        bay.layers(),
        bay,
    ));
    if let Some(target) = &target.0 {
        camera.insert(target.clone());
    }
    if bay.source == ShadowSource::Fields {
        let quality = FieldOcclusionQuality::High;
        camera.insert(FieldOcclusion { quality, ambient_occlusion: false, ..default() });
    }
    let camera = camera.id();
    let shadows = match bay {
        Bay { source: ShadowSource::Fields, .. } => "fields",
        Bay { kind: LightKind::Rect, .. } => "no map in Bevy",
        _ => "shadow map",
    };
    commands.spawn(label(camera, format!("{}: {shadows}", bay.kind.name())));
}

/// Shows all bays in two rows, or the two of one kind beside each other.
fn arrange(mut commands: Commands, shown: Res<Shown>, mut cameras: Query<(Entity, &Bay, &mut Camera)>) {
    if !shown.is_changed() {
        return;
    }
    for (entity, bay, mut camera) in &mut cameras {
        let second = u32::from(bay.source == ShadowSource::Maps);
        let pane = match shown.0 {
            Some(_) => Pane { cell: UVec2::new(second, 0), grid: UVec2::new(2, 1) },
            None => Pane { cell: UVec2::new(bay.kind as u32, second), grid: UVec2::new(4, 2) },
        };
        camera.is_active = shown.0.is_none_or(|kind| kind == bay.kind);
        commands.entity(entity).insert(pane);
    }
}

fn press_keys(
    keys: Res<ButtonInput<KeyCode>>,
    mut paused: ResMut<Paused>,
    mut size: ResMut<LightSize>,
    mut shown: ResMut<Shown>,
    mut exit: MessageWriter<AppExit>,
    mut cameras: Query<&mut FieldOcclusion>,
) {
    if keys.just_pressed(KeyCode::Escape) {
        exit.write(AppExit::Success);
    }
    if keys.just_pressed(KeyCode::Space) {
        paused.0 = !paused.0;
    }
    for (key, factor) in [(KeyCode::ArrowUp, 1.25), (KeyCode::ArrowDown, 0.8)] {
        if keys.just_pressed(key) {
            size.0 = (size.0 * factor).clamp(*LIGHT_SIZES.start(), *LIGHT_SIZES.end());
        }
    }
    let kinds = [KeyCode::Digit1, KeyCode::Digit2, KeyCode::Digit3, KeyCode::Digit4].into_iter().zip(LightKind::ALL);
    for (key, kind) in kinds.map(|(key, kind)| (key, Some(kind))).chain([(KeyCode::Digit0, None)]) {
        if keys.just_pressed(key) {
            shown.0 = kind;
        }
    }
    for mut occlusion in &mut cameras {
        if keys.just_pressed(KeyCode::KeyA) {
            occlusion.ambient_occlusion = !occlusion.ambient_occlusion;
        }
        if keys.just_pressed(KeyCode::KeyQ) {
            occlusion.quality = next_quality(occlusion.quality);
        }
    }
}

#[derive(Component)]
struct Help;

/// One in the first pane of each arrangement; those of inactive cameras are not drawn.
fn spawn_help(mut commands: Commands, cameras: Query<(Entity, &Bay)>) {
    for (camera, _) in cameras.iter().filter(|(_, bay)| bay.source == ShadowSource::Fields) {
        commands.spawn((Help, help(camera, "")));
    }
}

fn show_help(
    size: Res<LightSize>,
    shown: Res<Shown>,
    cameras: Query<(&FieldOcclusion, &Bay)>,
    mut helps: Query<(&mut Text, &UiTargetCamera), With<Help>>,
) {
    for (mut help, target) in &mut helps {
        let Ok((occlusion, bay)) = cameras.get(target.0) else { continue };
        let first = bay.kind == shown.0.unwrap_or(LightKind::Directional);
        let text = if first {
            format!(
                "Up/Down light size: {:.2}\n1-4 one light, 0 all\nA ambient occlusion: {}\nQ quality: {:?}\nSpace pause, Esc quit",
                size.0,
                if occlusion.ambient_occlusion { "on" } else { "off" },
                occlusion.quality,
            )
        } else {
            String::new()
        };
        if help.0 != text {
            help.0 = text;
        }
    }
}
