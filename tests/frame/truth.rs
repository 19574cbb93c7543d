//! The frame against truth: every pixel of the scene of `moving_objects` against exact rays from the same depth and
//! normals.

use bevy::prelude::*;
use bevy_visfield::prelude::*;
use visfield::estimate::light::Light;
use visfield_workspace::headless::HeadlessApp;
use visfield_workspace::moving_objects::{self, MovingObject, PERIOD, SceneClock};
use visfield_workspace::probe::{self, ProbedCamera, ProbedFrame};
use visfield_workspace::reference::{self, Errors, ExactFrame, Progress, ReferenceMeshes};

use crate::adapter;

const SIZE: UVec2 = UVec2::new(320, 180);
/// Exact rays per pixel, enough for their own noise to be lost beside the errors.
const AMBIENT_RAYS: u32 = 1024;
const SUN_RAYS: u32 = 256;

fn scene_app() -> HeadlessApp {
    let mut headless = HeadlessApp::new(SIZE, |plugins| plugins);
    let app = &mut headless.app;
    app.add_plugins(VisibilityFieldPlugin)
        .init_resource::<SceneClock>()
        .add_systems(
            Startup,
            |mut commands: Commands,
             server: Res<AssetServer>,
             mut meshes: ResMut<Assets<Mesh>>,
             mut materials: ResMut<Assets<StandardMaterial>>| {
                moving_objects::spawn_objects(&mut commands, &mut materials, &moving_objects::default_parts(&server));
                moving_objects::spawn_surroundings(&mut commands, &mut meshes, &mut materials);
            },
        )
        .add_systems(Update, moving_objects::move_objects);
    probe::install(app);
    let target = headless.target();
    headless.app.world_mut().spawn((
        Camera3d::default(),
        Msaa::Off,
        moving_objects::camera_transform(),
        FieldOcclusion::default(),
        ProbedCamera,
        target,
    ));
    headless.wait_until_ready();
    headless
}

fn exact_frame(app: &mut App, frame: &ProbedFrame) -> ExactFrame {
    let world = app.world_mut();
    let seconds = world.resource::<SceneClock>().0;
    let objects =
        world.query::<&MovingObject>().iter(world).map(|o| (o.mesh, o.transform_at(seconds))).collect::<Vec<_>>();
    assert!(objects.len() >= 12);
    let meshes = ReferenceMeshes::read().expect("the committed meshes can be read");
    let scene = meshes.scene(objects, frame.camera.as_dvec3()).expect("the committed meshes are sound");
    let (light, shadows) = world.query::<(&GlobalTransform, &FieldShadows)>().single(world).expect("there is one sun");
    let sun = Light::directional(light.back().into(), shadows.angular_radius);
    let exact = reference::trace_frame(&scene, frame, AMBIENT_RAYS, (&sun, SUN_RAYS), &Progress::default());
    exact.expect("nobody cancels it")
}

/// Of all pixels, of floor and walls, and of objects, for ambient occlusion and for the sun.
fn errors(exact: &ExactFrame, frame: &ProbedFrame) -> [[Errors; 3]; 2] {
    // Objects lie before the walls: their pixels are told from the floor's and walls' by the normal.
    let is_plane = |normal: Vec3| normal.abs().max_element() > 0.9995;
    let mut errors: [[Errors; 3]; 2] = Default::default();
    for ((exact, found), pixel) in exact.iter().zip(&frame.visibility).zip(frame.geometry.pixels()) {
        let Some(exact) = exact else { continue };
        let class = if is_plane(frame.geometry.receiver_at(pixel).normal) { 1 } else { 2 };
        for light in 0..2 {
            for class in [0, class] {
                errors[light][class].add(found[light], exact[light]);
            }
        }
    }
    errors
}

#[test]
fn the_frame_is_near_exact_rays() {
    if !adapter::available() {
        return;
    }
    let mut headless = scene_app();
    for seconds in [0.0, 0.3 * PERIOD] {
        headless.app.world_mut().resource_mut::<SceneClock>().0 = seconds;
        let mut exact = None;
        for estimator in [OcclusionEstimator::CapGrid, OcclusionEstimator::Rays] {
            let world = headless.app.world_mut();
            world.query::<&mut FieldOcclusion>().single_mut(world).expect("there is one camera").estimator = estimator;
            // The first frame of it moves the objects and renders them.
            let frame = probe::read(&mut headless);
            let exact = exact.get_or_insert_with(|| exact_frame(&mut headless.app, &frame));
            let [ambient, sun] = errors(exact, &frame);
            let name = format!("{seconds} s, ambient occlusion by {estimator:?}");
            for (class, errors) in ["all", "planes", "objects"].iter().zip(&ambient) {
                println!("{name}, {class}: {errors}");
            }
            if let Some(folder) = std::env::var_os("VISFIELD_PICTURES") {
                save_pictures(folder.as_ref(), &format!("{estimator:?}_{seconds}"), exact, &frame.visibility);
            }
            assert!(ambient[0].mean() <= 0.015, "{name}: {}", ambient[0].mean());
            // Small objects at a low resolution: the filter's width shows, and what a grid and a table do not resolve.
            assert!(ambient[2].mean() <= 0.06, "{name}, on objects: {}", ambient[2].mean());
            if estimator == OcclusionEstimator::CapGrid {
                for (class, errors) in ["all", "planes", "objects"].iter().zip(&sun) {
                    println!("{seconds} s, sun visibility, {class}: {errors}");
                }
                assert!(sun[0].mean() <= 0.02, "the sun: {}", sun[0].mean());
                assert!(sun[2].mean() <= 0.065, "the sun on objects: {}", sun[2].mean());
            }
        }
    }
}

/// Writes exact, found, and their difference ×5 side by side.
fn save_pictures(folder: &std::path::Path, suffix: &str, exact: &[Option<[f32; 2]>], found: &[[f32; 2]]) {
    for (estimator, name) in ["ambient", "sun"].iter().enumerate() {
        let picture = image::GrayImage::from_fn(SIZE.x * 3, SIZE.y, |x, y| {
            let i = (y * SIZE.x + x % SIZE.x) as usize;
            let exact = exact[i].map_or(1.0, |exact| exact[estimator]);
            let value = match x / SIZE.x {
                0 => exact,
                1 => found[i][estimator],
                _ => 0.5 + 5.0 * (found[i][estimator] - exact),
            };
            image::Luma([(value.clamp(0.0, 1.0) * 255.0).round() as u8])
        });
        picture.save(folder.join(format!("{name}_{suffix}.png"))).expect("the folder can be written to");
    }
}
