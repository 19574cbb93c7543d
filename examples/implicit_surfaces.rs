//! Surfaces without triangles among meshes: shapes in closed form and a mesh's grid of distances, drawn by sphere tracing. They pass
//! through meshes and through each other, and give and take ambient occlusion and soft shadows like everything else.
//!
//! Look at where they meet the meshes, at their outlines, which are smooth although no pixel is sampled twice, and at the shadows on
//! them. The knot is there twice: blue by its triangles, gold by a grid of 64 distances along its longest side, baked at the start.
//! The glass, a ball and a cuboid's intersection, bends what is seen through it.
//!
//! `cargo run --example implicit_surfaces` opens a window; `--headless` records frames and a GIF instead; `--mesh FILE` shows a mesh of
//! yours in the place of the knot.
//!
//! | key | |
//! | --- | --- |
//! | D | shows the ambient occlusion itself |
//! | Space | pause |
//! | Esc | quit |

use std::error::Error;
use std::f32::consts::{FRAC_PI_2, TAU};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use bevy::camera::Hdr;
use bevy::prelude::*;
use bevy_visfield::bake::to_bevy_mesh;
use bevy_visfield::prelude::*;
use clap::Parser;
use visfield::distance::DistanceGridFormat;
use visfield::shape::Shape;
use visfield_bake::BakeSettings;
use visfield_workspace::headless::{ASSETS, HeadlessApp};
use visfield_workspace::moving_objects::{PERIOD, SceneClock, spawn_surroundings};
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
    /// A .glb, .gltf or .obj mesh to show in the place of the knot, the first in the file
    #[arg(long, value_name = "PATH")]
    mesh: Option<PathBuf>,
}

/// What is shown by its triangles and by its distances.
#[derive(Resource, Clone)]
struct Knot(visfield_bake::Mesh);

fn main() -> ExitCode {
    let options = Options::parse();
    let knot = match read_knot(&options) {
        Ok(knot) => knot,
        Err(error) => {
            eprintln!("error: {error}");
            return ExitCode::FAILURE;
        }
    };
    if !options.recording.headless {
        let mut app = window_app("visfield: implicit surfaces");
        add_scene(&mut app, knot);
        app.init_resource::<Paused>()
            .add_systems(Startup, spawn_window_camera)
            .add_systems(Update, (tick.before(move_bodies), press_keys));
        return exit_code(app.run());
    }
    match record(&options, knot) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: cannot write the recording: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Reads the mesh before the app starts, so that a bad file is told at once.
fn read_knot(options: &Options) -> Result<Knot, Box<dyn Error>> {
    let default = Path::new(&*ASSETS).join("meshes/torus_knot.glb");
    let path = options.mesh.as_deref().unwrap_or(&default);
    let Some(mesh) = visfield_bake::read_meshes(path)?.into_iter().next() else {
        return Err(format!("{}: there is no mesh in it", path.display()).into());
    };
    mesh.validate().map_err(|error| format!("{}: {}: {error}", path.display(), mesh.name))?;
    Ok(Knot(mesh))
}

fn record(options: &Options, knot: Knot) -> image::ImageResult<()> {
    let recording = Recording::new(&options.recording, "implicit_surfaces")?;
    let mut headless = HeadlessApp::new(options.recording.size, |plugins| plugins);
    add_scene(&mut headless.app, knot);
    let target = headless.target();
    let mut commands = headless.app.world_mut().commands();
    let camera = spawn_camera(&mut commands);
    commands.entity(camera).insert(target);
    if options.debug {
        commands.entity(camera).insert(FieldDebugView::AmbientVisibility);
    }
    headless.update();
    headless.update_until(|app| app.world_mut().query::<&BakeProgress>().iter(app.world()).next().is_none());
    headless.wait_until_ready();
    recording.run(&mut headless, "implicit_surfaces", HeadlessApp::capture)?;
    Ok(())
}

fn add_scene(app: &mut App, knot: Knot) {
    app.add_plugins(VisibilityFieldPlugin)
        .insert_resource(knot)
        .insert_resource(ClearColor(Color::srgb(0.72, 0.80, 0.90)))
        .init_resource::<SceneClock>()
        .add_systems(Startup, spawn_scene)
        .add_systems(Update, (move_bodies, show_distances));
}

fn spawn_camera(commands: &mut Commands) -> Entity {
    let view = Transform::from_xyz(2.2, 3.0, 5.2).looking_at(Vec3::new(-0.3, 0.9, 0.0), Vec3::Y);
    // No anti-aliasing of its own, so that the surfaces' is seen; and what is behind glass as bright as beside it, for which Bevy has to
    // map its tones after all is drawn.
    commands.spawn((Camera3d::default(), Hdr, Msaa::Off, view, FieldOcclusion::default())).id()
}

fn spawn_window_camera(mut commands: Commands) {
    spawn_camera(&mut commands);
}

/// How a body moves, by the turns since the start.
#[derive(Component, Clone, Copy)]
struct Motion(fn(f32) -> Transform);

/// A mesh that is shown by the distances that are being baked of it.
#[derive(Component)]
struct ByDistances;

fn spawn_scene(
    mut commands: Commands,
    knot: Res<Knot>,
    mut fields: ResMut<Assets<VisibilityField>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    spawn_surroundings(&mut commands, &mut meshes, &mut materials);
    let glass = materials.add(StandardMaterial {
        base_color: Color::WHITE,
        specular_transmission: 1.0,
        ior: 1.5,
        perceptual_roughness: 0.0,
        attenuation_color: Color::srgb(0.75, 0.95, 0.85),
        attenuation_distance: 2.5,
        ..default()
    });
    let mut colored = |r, g, b| {
        MeshMaterial3d(materials.add(StandardMaterial {
            base_color: Color::linear_rgb(r, g, b),
            perceptual_roughness: 0.6,
            ..default()
        }))
    };
    let (red, green, blue) = (colored(0.62, 0.12, 0.08), colored(0.20, 0.42, 0.14), colored(0.10, 0.24, 0.55));
    let (gold, ivory) = (colored(0.75, 0.50, 0.14), colored(0.75, 0.71, 0.62));
    let mut field = |shape: Shape| {
        let field = visfield::VisibilityField::of_shape(shape).expect("all its lengths are above 0");
        fields.add(VisibilityField(field))
    };

    // Shapes: a cuboid with rounded corners and three holes, two balls that have grown together, and the ground they dip into.
    let cuboid = |x, y, z| Shape::Box { half_extents: [x, y, z] };
    let hole = Shape::Cylinder { half_height: 2.0, radius: 0.34 };
    let drilled = cuboid(0.7, 0.7, 0.7)
        .intersection(Shape::Sphere { radius: 0.95 })
        .difference(hole.clone())
        .difference(hole.clone().turned(Quat::from_rotation_x(FRAC_PI_2)))
        .difference(hole.turned(Quat::from_rotation_z(FRAC_PI_2)));
    commands.spawn((
        ImplicitSurface3d(field(drilled)),
        red,
        Motion(|turns| {
            let rotation = Quat::from_rotation_y(turns * TAU) * Quat::from_rotation_x(0.6);
            Transform::from_xyz(-1.5, 1.3, 1.2).with_rotation(rotation)
        }),
    ));
    let ball = |radius| Shape::Sphere { radius };
    let pair = ball(0.5).moved(Vec3::X * 0.45).smooth_union(ball(0.35).moved(Vec3::X * -0.45), 0.4);
    commands.spawn((
        ImplicitSurface3d(field(pair)),
        green,
        Motion(|turns| {
            let at = Vec2::from_angle(turns * TAU) * 0.25;
            Transform::from_xyz(2.7 + at.x, 0.35 + at.y, -0.4).with_rotation(Quat::from_rotation_y(-turns * TAU))
        }),
    ));
    // A ground without end would not be drawn; cut from one, a step of the floor is.
    let step = Shape::HalfSpace.intersection(cuboid(1.3, 0.12, 1.1)).moved(Vec3::Y * 0.12);
    commands.spawn((ImplicitSurface3d(field(step)), ivory.clone(), Transform::from_xyz(0.7, 0.0, 1.6)));

    // Glass throws no shadow, and dims nothing around it but what touches it.
    commands.spawn((
        ImplicitSurface3d(field(cuboid(0.62, 0.62, 0.62).intersection(ball(0.8)))),
        MeshMaterial3d(glass),
        NotFieldShadowCaster,
        Motion(|turns| {
            let rotation = Quat::from_rotation_y(turns * FRAC_PI_2) * Quat::from_rotation_x(0.4);
            Transform::from_xyz(0.7, 1.05, 1.6).with_rotation(rotation)
        }),
    ));

    // Meshes: fields of shapes do for them too.
    let block = field(cuboid(0.35, 0.9, 0.35));
    let mesh = Mesh3d(meshes.add(Cuboid::new(0.7, 1.8, 0.7)));
    for (x, z, turn) in [(-1.5, 1.2, 0.5), (1.9, -1.6, 0.2), (-3.0, -0.6, 0.9)] {
        let at = Transform::from_xyz(x, 0.9, z).with_rotation(Quat::from_rotation_y(turn));
        commands.spawn((mesh.clone(), ivory.clone(), VisibilityField3d(block.clone()), at));
    }

    // The knot by its triangles, and by its distances.
    let settings = BakeSettings::of_distance(DistanceGridFormat::DEFAULT);
    let (to_unit, mesh) = (to_unit(&knot.0), Mesh3d(meshes.add(to_bevy_mesh(&knot.0))));
    let mut spawn_knot = |motion: fn(f32) -> Transform| {
        let knot = (mesh.clone(), BakeVisibilityField { settings }, to_unit);
        let body = commands.spawn((Motion(motion), Transform::default(), Visibility::default())).id();
        commands.spawn((knot, ChildOf(body))).id()
    };
    let triangles = spawn_knot(|turns| {
        Transform::from_xyz(-1.0, 1.1, -1.5)
            .with_rotation(Quat::from_rotation_y(turns * TAU))
            .with_scale(Vec3::splat(1.1))
    });
    let distances = spawn_knot(|turns| {
        Transform::from_xyz(0.9, 1.5, -1.4)
            .with_rotation(Quat::from_rotation_y(turns * TAU))
            .with_scale(Vec3::splat(1.1))
    });
    commands.entity(triangles).insert(blue);
    commands.entity(distances).insert((gold, ByDistances));
}

/// What brings a mesh to two units around the origin.
fn to_unit(mesh: &visfield_bake::Mesh) -> Transform {
    let corners = mesh.positions.iter().map(|&position| Vec3::from(position)).filter(|position| position.is_finite());
    let (low, high) = corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    let scale = 2.0 / (high - low).max_element().max(f32::MIN_POSITIVE);
    Transform::from_scale(Vec3::splat(scale)).with_translation((low + high) * (-0.5 * scale))
}

/// Once a mesh is baked, its distances take its place.
fn show_distances(
    mut commands: Commands,
    baked: Query<(Entity, &VisibilityField3d), (With<ByDistances>, Added<VisibilityField3d>)>,
) {
    for (entity, field) in &baked {
        commands.entity(entity).remove::<(Mesh3d, ByDistances)>().insert(ImplicitSurface3d(field.0.clone()));
    }
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
