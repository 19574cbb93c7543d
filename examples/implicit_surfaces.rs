//! Surfaces without triangles among meshes: distances, drawn by sphere tracing, that dip into the floor, pass through meshes, and give and
//! take ambient occlusion and soft shadows like everything else.
//!
//! Look at where they meet the meshes, at their outlines, which are smooth although no pixel is sampled twice, and at the shadows on them.
//!
//! `cargo run --example implicit_surfaces` opens a window; `--headless` records frames and a GIF instead.
//!
//! | key | |
//! | --- | --- |
//! | D | shows the ambient occlusion itself |
//! | Space | pause |
//! | Esc | quit |

use std::f32::consts::TAU;
use std::process::ExitCode;

use bevy::mesh::VertexAttributeValues;
use bevy::prelude::*;
use bevy_visfield::prelude::*;
use clap::Parser;
use visfield_bake::{BakeSettings, bake};
use visfield_workspace::headless::HeadlessApp;
use visfield_workspace::moving_objects::{PERIOD, SceneClock, default_parts, spawn_surroundings};
use visfield_workspace::recording::{Recording, RecordingOptions};
use visfield_workspace::window::{Paused, exit_code, tick, window_app};

/// Surfaces without triangles among meshes, with ambient occlusion and soft shadows
#[derive(Parser, Resource, Clone, Debug)]
struct Options {
    #[command(flatten)]
    recording: RecordingOptions,
    /// Show the ambient occlusion itself in the frames
    #[arg(long)]
    debug: bool,
}

fn main() -> ExitCode {
    let options = Options::parse();
    if !options.recording.headless {
        let mut app = window_app("visfield: implicit surfaces");
        add_scene(&mut app);
        app.init_resource::<Paused>()
            .add_systems(Startup, spawn_window_camera)
            .add_systems(Update, (tick.before(move_bodies), press_keys));
        return exit_code(app.run());
    }
    match record(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: cannot write the recording: {error}");
            ExitCode::FAILURE
        }
    }
}

fn record(options: &Options) -> image::ImageResult<()> {
    let recording = Recording::new(&options.recording, "implicit_surfaces")?;
    let mut headless = HeadlessApp::new(options.recording.size, |plugins| plugins);
    add_scene(&mut headless.app);
    let target = headless.target();
    let mut commands = headless.app.world_mut().commands();
    let camera = spawn_camera(&mut commands);
    commands.entity(camera).insert(target);
    if options.debug {
        commands.entity(camera).insert(FieldDebugView::AmbientVisibility);
    }
    headless.wait_until_ready();
    recording.run(&mut headless, "implicit_surfaces", HeadlessApp::capture)?;
    Ok(())
}

fn add_scene(app: &mut App) {
    app.add_plugins(VisibilityFieldPlugin)
        .insert_resource(ClearColor(Color::srgb(0.72, 0.80, 0.90)))
        .init_resource::<SceneClock>()
        .add_systems(Startup, spawn_scene)
        .add_systems(Update, move_bodies);
}

fn spawn_camera(commands: &mut Commands) -> Entity {
    let view = Transform::from_xyz(2.2, 3.0, 5.2).looking_at(Vec3::new(-0.3, 0.9, 0.0), Vec3::Y);
    // No anti-aliasing of its own, so that the surfaces' is seen.
    commands.spawn((Camera3d::default(), Msaa::Off, view, FieldOcclusion::default())).id()
}

fn spawn_window_camera(mut commands: Commands) {
    spawn_camera(&mut commands);
}

/// How a body moves, by the turns since the start.
#[derive(Component, Clone, Copy)]
struct Motion(fn(f32) -> Transform);

fn spawn_scene(
    mut commands: Commands,
    server: Res<AssetServer>,
    mut fields: ResMut<Assets<VisibilityField>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    spawn_surroundings(&mut commands, &mut meshes, &mut materials);
    let mut colored = |r, g, b| {
        materials.add(StandardMaterial {
            base_color: Color::linear_rgb(r, g, b),
            perceptual_roughness: 0.6,
            ..default()
        })
    };
    let mut field = |name: &str, mesh: Mesh| fields.add(VisibilityField(baked(name, &mesh)));
    let sphere = field("sphere", Sphere::new(1.0).mesh().uv(48, 24));
    let torus = field("torus", Torus { minor_radius: 0.25, major_radius: 0.75 }.mesh().build());
    let block = field("block", Cuboid::new(1.0, 1.6, 1.0).mesh().build());

    // The surfaces.
    commands.spawn((
        ImplicitSurface3d(sphere.clone()),
        MeshMaterial3d(colored(0.62, 0.12, 0.08)),
        Motion(|turns| Transform::from_xyz(-0.6 + 0.5 * (turns * TAU).sin(), 0.55, 0.6)),
    ));
    commands.spawn((
        ImplicitSurface3d(sphere),
        MeshMaterial3d(colored(0.20, 0.42, 0.14)),
        Motion(|turns| {
            Transform::from_xyz(-2.3, 1.6, -1.2)
                .with_rotation(Quat::from_rotation_z(turns * TAU))
                .with_scale(Vec3::new(0.9, 0.45, -0.6))
        }),
    ));
    commands.spawn((
        ImplicitSurface3d(torus),
        MeshMaterial3d(colored(0.10, 0.24, 0.55)),
        Motion(|turns| {
            let rotation = Quat::from_rotation_y(turns * TAU) * Quat::from_rotation_x(1.2);
            Transform::from_xyz(1.2, 1.35, 0.4).with_rotation(rotation).with_scale(Vec3::splat(1.1))
        }),
    ));
    // The meshes.
    let cuboid = Mesh3d(meshes.add(Cuboid::new(1.0, 1.6, 1.0)));
    let ivory = MeshMaterial3d(colored(0.75, 0.71, 0.62));
    for (x, z) in [(0.4, 0.9), (2.1, 0.2)] {
        let at = Transform::from_xyz(x, 0.8, z).with_rotation(Quat::from_rotation_y(0.5));
        commands.spawn((cuboid.clone(), ivory.clone(), VisibilityField3d(block.clone()), at));
    }
    let [_, _, chair] = default_parts(&server);
    commands.spawn((
        Mesh3d(chair.meshes[0].clone()),
        MeshMaterial3d(colored(0.75, 0.50, 0.14)),
        VisibilityField3d(chair.fields[0].clone()),
        Motion(|turns| {
            let at = Vec2::from_angle(turns * TAU) * 0.3 + Vec2::new(-1.9, 1.3);
            Transform::from_xyz(at.x, 1.1, at.y).with_scale(Vec3::splat(1.1))
        }),
    ));
}

/// The field of a mesh of Bevy's.
fn baked(name: &str, mesh: &Mesh) -> visfield::VisibilityField {
    let Some(VertexAttributeValues::Float32x3(positions)) = mesh.attribute(Mesh::ATTRIBUTE_POSITION) else {
        unreachable!("Bevy's primitives have positions");
    };
    let corners: Vec<u32> =
        mesh.indices().map(|indices| indices.iter().map(|i| i as u32).collect()).unwrap_or_default();
    let indices = corners.as_chunks::<3>().0.to_vec();
    let mesh = visfield_bake::Mesh { name: name.to_owned(), positions: positions.clone(), indices };
    bake(&mesh, &BakeSettings::default(), |_| ()).expect("Bevy's primitives are sound")
}

fn move_bodies(clock: Res<SceneClock>, mut bodies: Query<(&Motion, &mut Transform)>) {
    for (motion, mut transform) in &mut bodies {
        *transform = motion.0(clock.0 / PERIOD);
    }
}

fn press_keys(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    mut paused: ResMut<Paused>,
    mut exit: MessageWriter<AppExit>,
    cameras: Query<(Entity, Has<FieldDebugView>), With<Camera3d>>,
) {
    if keys.just_pressed(KeyCode::Escape) {
        exit.write(AppExit::Success);
    }
    if keys.just_pressed(KeyCode::Space) {
        paused.0 = !paused.0;
    }
    if keys.just_pressed(KeyCode::KeyD) {
        for (camera, shown) in &cameras {
            if shown {
                commands.entity(camera).remove::<FieldDebugView>();
            } else {
                commands.entity(camera).insert(FieldDebugView::AmbientVisibility);
            }
        }
    }
}
