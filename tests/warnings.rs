//! Bad input to the plugin: each gives one clear warning or error that says what to do, and the rest of the scene renders.
//!
//! Everything is in one test, because the log is the process's own.

#[path = "frame/adapter.rs"]
mod adapter;

use std::sync::Mutex;

use bevy::log::tracing::field::{Field, Visit};
use bevy::log::tracing::{Event, Level, Subscriber};
use bevy::log::tracing_subscriber::{Layer, layer::Context};
use bevy::log::{BoxedLayer, LogPlugin};
use bevy::prelude::*;
use bevy::render::settings::{RenderCreation, WgpuLimits, WgpuSettings};
use bevy::render::{RenderApp, RenderPlugin};
use bevy_visfield::prelude::*;
use bevy_visfield::{FieldResidency, NoShadow, why_no_shadow};
use visfield_workspace::headless::HeadlessApp;

/// Warnings and errors so far.
static LOG: Mutex<Vec<String>> = Mutex::new(Vec::new());

struct Capture;

impl<S: Subscriber> Layer<S> for Capture {
    fn on_event(&self, event: &Event<'_>, _context: Context<'_, S>) {
        struct Message(String);
        impl Visit for Message {
            fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
                if field.name() == "message" {
                    self.0 = format!("{value:?}");
                }
            }
        }
        if *event.metadata().level() <= Level::WARN {
            let mut message = Message(String::new());
            event.record(&mut message);
            LOG.lock().unwrap().push(message.0);
        }
    }
}

#[expect(clippy::unnecessary_wraps, reason = "the signature is Bevy's")]
fn capture_layer(_app: &mut App) -> Option<BoxedLayer> {
    Some(Box::new(Capture))
}

/// How many warnings and errors contain all of `words`.
fn count(words: &[&str]) -> usize {
    LOG.lock().unwrap().iter().filter(|message| words.iter().all(|word| message.contains(word))).count()
}

#[track_caller]
fn assert_told_once(words: &[&str]) {
    assert_eq!(count(words), 1, "{words:?} in {:#?}", LOG.lock().unwrap());
}

fn scene(folder: &std::path::Path, render: RenderPlugin) -> HeadlessApp {
    let mut headless = HeadlessApp::new(UVec2::new(96, 64), |plugins| {
        plugins
            .set(LogPlugin { custom_layer: capture_layer, ..default() })
            .set(AssetPlugin { file_path: folder.to_string_lossy().into_owned(), ..default() })
            .set(render)
    });
    headless.app.add_plugins(VisibilityFieldPlugin);
    let target = headless.target();
    let world = headless.app.world_mut();
    let floor = world.resource_mut::<Assets<Mesh>>().add(Plane3d::new(Vec3::Y, Vec2::splat(6.0)));
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(StandardMaterial::default());
    world.spawn((Mesh3d(floor), MeshMaterial3d(material)));
    world.spawn((DirectionalLight::default(), Transform::default().looking_to(-Vec3::Y, Vec3::X), FieldShadows::SUN));
    let look = Transform::from_xyz(0.0, 4.0, 0.1).looking_at(Vec3::ZERO, Vec3::Y);
    world.spawn((Camera3d::default(), Msaa::Off, look, FieldOcclusion::default(), target));
    headless
}

fn synchronous() -> RenderPlugin {
    RenderPlugin { synchronous_pipeline_compilation: true, ..default() }
}

fn center(headless: &mut HeadlessApp) -> u8 {
    headless.capture().get_pixel(48, 32).0[0]
}

/// A cap grid that is known to be wrong inside its box, and no table for rays.
fn hollow_caps() -> Vec<u8> {
    use visfield::field::cap_grid::{self, CapGridError, CapGridHeader};
    let error = Some(CapGridError { outside: 0.01, inside: 0.3 });
    let caps = cap_grid::ball(CapGridHeader { error, ..CapGridHeader::default() });
    let header = visfield::field::ball_field(0.9, 3, 3).header().clone();
    visfield::file::encode(&[visfield::VisibilityField::new(header, caps.into()).unwrap()])
}

#[test]
fn bad_input_is_told_once_and_the_rest_renders() {
    if !adapter::available() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let ball = visfield::field::ball_field(0.9, 33, 16);
    let good = visfield::file::encode(std::slice::from_ref(&ball));
    let mut damaged = good.clone();
    *damaged.last_mut().unwrap() ^= 1;
    let mut newer = good.clone();
    newer[8] = 77;
    for (name, bytes) in [
        ("good", &good[..]),
        ("damaged", &damaged),
        ("newer", &newer),
        ("cut", &good[..good.len() / 2]),
        ("empty", &[]),
        ("text", b"not a field at all"),
        ("hollow", &hollow_caps()),
    ] {
        std::fs::write(folder.path().join(format!("{name}.vfield")), bytes).unwrap();
    }

    let mut headless = scene(folder.path(), synchronous());
    let world = headless.app.world_mut();
    let server = world.resource::<AssetServer>().clone();
    let load = |name: &str| VisibilityField3d(server.load(format!("{name}.vfield#ball")));
    // A good one over the floor's middle, under the sun.
    world.spawn((load("good"), Transform::from_xyz(0.0, 1.2, 0.0).with_scale(Vec3::splat(0.8))));
    // Files that cannot be loaded, and a handle that nobody loads.
    for name in ["damaged", "newer", "cut", "empty", "text", "missing"] {
        world.spawn(load(name));
    }
    world.spawn(VisibilityField3d::default());
    // Caps alone, far away, under a light that they cannot shadow.
    for x in [50.0, 60.0] {
        world.spawn((load("hollow"), Transform::from_xyz(x, 0.0, 0.0)));
    }
    // Transforms that no ray can follow, two of them: still one warning.
    world.spawn((load("good"), Transform::from_scale(Vec3::new(1.0, 0.0, 1.0))));
    world.spawn((load("good"), Transform::from_xyz(f32::NAN, 0.0, 0.0)));
    // A camera with multisampling, into an image of its own.
    let second = Image::new_target_texture(32, 32, bevy::render::render_resource::TextureFormat::Rgba8UnormSrgb, None);
    let second = world.resource_mut::<Assets<Image>>().add(second);
    world.spawn((
        Camera3d::default(),
        Msaa::Sample4,
        FieldOcclusion::default(),
        bevy::camera::RenderTarget::Image(second.into()),
        Transform::from_xyz(0.0, 4.0, 0.1).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    // Components where they do nothing.
    world.spawn((Transform::default(), FieldShadows::default()));
    world.spawn(FieldOcclusion::default());
    // Strange settings.
    for angular_radius in [f32::NAN, -1.0, f32::INFINITY] {
        world.spawn((DirectionalLight { illuminance: 0.0, ..default() }, FieldShadows { angular_radius }));
    }

    // More lights than there are masks.
    for _ in 0..12 {
        world.spawn((PointLight { intensity: 0.0, ..default() }, FieldShadows::default()));
    }

    let start = std::time::Instant::now();
    headless.update_until(|_| start.elapsed().as_secs_f32() > 6.5);
    let with_occluder = center(&mut headless);
    let world = headless.app.world_mut();
    let occluders: Vec<Entity> = world.query_filtered::<Entity, With<VisibilityField3d>>().iter(world).collect();
    for occluder in occluders {
        world.entity_mut(occluder).insert(NotFieldOccluder);
    }
    let without = center(&mut headless);
    assert!(with_occluder + 20 < without, "the good field occludes: {with_occluder} and {without}");

    // A budget that is too small, again and again.
    for bytes in [0, 300_000, 1000] {
        headless.app.insert_resource(FieldMemoryBudget { bytes, ..default() });
        (0..3).for_each(|_| headless.update());
    }

    assert_told_once(&["FieldMemoryBudget", "the budget is 0"]);
    assert_eq!(count(&["the budget is"]), 1);
    assert_told_once(&["damaged.vfield", "checksum"]);
    assert_told_once(&["newer.vfield", "format version 77", "bake the mesh again"]);
    assert_told_once(&["cut.vfield", "cut short"]);
    assert_told_once(&["empty.vfield", "not a .vfield file"]);
    assert_told_once(&["text.vfield", "not a .vfield file"]);
    assert_told_once(&["missing.vfield"]);
    assert_told_once(&["neither loaded nor loading"]);
    assert_told_once(&["a cap grid alone", "casts no shadows"]);
    assert_told_once(&["the cap grid of visibility field `ball` is wrong inside its bounding box"]);
    assert_told_once(&["singular or not finite"]);
    assert_told_once(&["FieldOcclusion needs Msaa::Off", "Sample4"]);
    assert_told_once(&["FieldShadows but no light"]);
    assert_told_once(&["FieldOcclusion but no Camera3d"]);
    assert_told_once(&["directional ones", "room for the shadows of 11"]);
    assert_eq!(count(&["panicked"]), 0);
    drop(headless);

    // An adapter that lacks a limit: the scene renders, unoccluded.
    let limited = |limits: WgpuLimits| RenderPlugin {
        render_creation: RenderCreation::from(WgpuSettings { constrained_limits: Some(limits), ..default() }),
        ..synchronous()
    };
    let mut headless =
        scene(folder.path(), limited(WgpuLimits { max_storage_textures_per_shader_stage: 4, ..WgpuLimits::default() }));
    let server = headless.app.world().resource::<AssetServer>().clone();
    let good: Handle<VisibilityField> = server.load("good.vfield#ball");
    let occluder = headless.app.world_mut().spawn((VisibilityField3d(good), Transform::from_xyz(0.0, 1.2, 0.0))).id();
    headless.wait_until_ready();
    assert_eq!(why_no_shadow(headless.app.world_mut(), occluder), Some(NoShadow::Inert));
    assert_eq!(center(&mut headless), without);
    assert!(headless.app.sub_app(RenderApp).world().get_resource::<FieldResidency>().is_none(), "nothing is uploaded");
    assert_told_once(&["VisibilityFieldPlugin stays inert", "max_storage_textures_per_shader_stage is 4"]);
}
