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

/// Rows of the picture, unless the environment says otherwise: penumbrae are a few pixels wide, and more of them in a larger one.
/// The errors' bounds are those of this size.
const ROWS: u32 = 180;

fn size() -> UVec2 {
    let rows = std::env::var("VISFIELD_TRUTH_ROWS").ok().and_then(|rows| rows.parse().ok()).unwrap_or(ROWS);
    UVec2::new(rows * 16 / 9, rows)
}

/// Exact rays per pixel, enough for their own noise to be lost beside the errors.
const RAYS: u32 = 1024;

pub(crate) fn scene_app() -> HeadlessApp {
    let mut headless = HeadlessApp::new(size(), |plugins| plugins);
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
    let exact = reference::trace_frame(&scene, frame, RAYS, (&sun, RAYS), &Progress::default());
    exact.expect("nobody cancels it")
}

/// The errors of one estimator.
#[derive(Default)]
struct Classes {
    all: Errors,
    /// Of floor and walls.
    planes: Errors,
    objects: Errors,
    /// Where the exact answer is between all and nothing: in penumbrae, of the sun.
    partial: Errors,
}

/// For ambient occlusion and for the sun.
fn errors(exact: &ExactFrame, frame: &ProbedFrame) -> [Classes; 2] {
    // Objects lie before the walls: their pixels are told from the floor's and walls' by the normal.
    let is_plane = |normal: Vec3| normal.abs().max_element() > 0.9995;
    let mut errors: [Classes; 2] = Default::default();
    for ((exact, found), pixel) in exact.iter().zip(&frame.visibility).zip(frame.geometry.pixels()) {
        let Some(exact) = exact else { continue };
        let plane = is_plane(frame.geometry.receiver_at(pixel).normal);
        for (estimator, classes) in errors.iter_mut().enumerate() {
            let (found, exact) = (found[estimator], exact[estimator]);
            classes.all.add(found, exact);
            if plane { &mut classes.planes } else { &mut classes.objects }.add(found, exact);
            if exact > 0.005 && exact < 0.995 {
                classes.partial.add(found, exact);
            }
        }
    }
    errors
}

/// What a camera shows, and the largest mean errors that it may have: of ambient occlusion on all pixels and on objects, and of
/// the sun on all pixels, on objects, and in penumbrae.
struct Case {
    name: &'static str,
    occlusion: FieldOcclusion,
    /// Frames that are accumulated.
    frames: usize,
    ambient: [f64; 2],
    sun: [f64; 3],
}

fn cases() -> Vec<Case> {
    use FieldOcclusionQuality::{High, Low, Medium, Ultra};
    let of = |quality| FieldOcclusion { quality, ..default() };
    let case = |name, occlusion, ambient, sun| Case { name, occlusion, frames: 1, ambient, sun };
    let by_rays = FieldOcclusion { estimator: OcclusionEstimator::Rays, ..of(Medium) };
    let accumulated = FieldOcclusion { accumulate: true, ..of(High) };
    vec![
        case("Low", of(Low), [0.013, 0.042], [0.019, 0.075, 0.2]),
        case("Medium", of(Medium), [0.012, 0.042], [0.01, 0.032, 0.115]),
        case("Medium, by rays", by_rays, [0.0135, 0.042], [0.01, 0.032, 0.115]),
        case("High", of(High), [0.01, 0.034], [0.01, 0.032, 0.11]),
        Case { frames: 8, ..case("High, accumulated", accumulated, [0.009, 0.031], [0.01, 0.032, 0.11]) },
        case("Ultra", of(Ultra), [0.009, 0.03], [0.01, 0.032, 0.11]),
    ]
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
        for Case { name, occlusion, frames, ambient: most_ambient, sun: most_sun } in cases() {
            let world = headless.app.world_mut();
            *world.query::<&mut FieldOcclusion>().single_mut(world).expect("there is one camera") = occlusion;
            // The first frame moves the objects and renders them; the last one is read.
            for _ in 1..frames {
                headless.update();
            }
            let frame = probe::read(&mut headless);
            let exact = exact.get_or_insert_with(|| exact_frame(&mut headless.app, &frame));
            let [ambient, sun] = errors(exact, &frame);
            let name = format!("{seconds} s, {name}");
            for (estimator, classes) in [("ambient", &ambient), ("sun", &sun)] {
                println!("{name}, {estimator}: {}", classes.all);
                println!("{name}, {estimator}, planes: {}", classes.planes);
                println!("{name}, {estimator}, objects: {}", classes.objects);
            }
            println!("{name}, sun, penumbrae: {}", sun.partial);
            if let Some(folder) = std::env::var_os("VISFIELD_PICTURES") {
                save_pictures(folder.as_ref(), &name, exact, &frame.visibility);
            }
            if size().y != ROWS {
                continue;
            }
            for (errors, most) in [&ambient.all, &ambient.objects].into_iter().zip(most_ambient) {
                assert!(errors.mean() <= most, "{name}, ambient: {}", errors.mean());
            }
            for (errors, most) in [&sun.all, &sun.objects, &sun.partial].into_iter().zip(most_sun) {
                assert!(errors.mean() <= most, "{name}, the sun: {}", errors.mean());
            }
        }
    }
}

/// Writes exact, found, and their difference ×5 side by side.
fn save_pictures(folder: &std::path::Path, suffix: &str, exact: &[Option<[f32; 2]>], found: &[[f32; 2]]) {
    let size = size();
    for (estimator, name) in ["ambient", "sun"].iter().enumerate() {
        let picture = image::GrayImage::from_fn(size.x * 3, size.y, |x, y| {
            let i = (y * size.x + x % size.x) as usize;
            let exact = exact[i].map_or(1.0, |exact| exact[estimator]);
            let value = match x / size.x {
                0 => exact,
                1 => found[i][estimator],
                _ => 0.5 + 5.0 * (found[i][estimator] - exact),
            };
            image::Luma([(value.clamp(0.0, 1.0) * 255.0).round() as u8])
        });
        picture.save(folder.join(format!("{name}_{suffix}.png"))).expect("the folder can be written to");
    }
}
