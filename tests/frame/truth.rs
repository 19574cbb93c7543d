//! The frame against truth: every pixel of the scene of `moving_objects` against exact rays from the same depth and
//! normals.

use bevy::math::DVec3;
use bevy::prelude::*;
use bevy_visfield::prelude::*;
use rayon::prelude::*;
use visfield::estimate::{AmbientOcclusion, DirectionalShadow, Receiver};
use visfield_bake::{ExactScene, exact};
use visfield_workspace::headless::{ASSETS, HeadlessApp};
use visfield_workspace::moving_objects::{self, MESHES, MovingObject, PERIOD, SceneClock};

use crate::probe::ProbedFrame;
use crate::{adapter, probe};

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
        target,
    ));
    headless.wait_until_ready();
    headless
}

/// The exact scene: the triangles of all occluders where they are now.
fn exact_scene(app: &mut App, origin: DVec3) -> ExactScene {
    let meshes = MESHES.map(|name| {
        let path = format!("{}/meshes/{name}.glb", *ASSETS);
        visfield_bake::read_meshes(path.as_ref()).expect("the committed meshes can be read").remove(0)
    });
    let world = app.world_mut();
    let mut occluders = world.query::<(&ChildOf, &GlobalTransform, &VisibilityField3d)>();
    let mut objects = world.query::<&MovingObject>();
    let instances: Vec<_> = occluders
        .iter(world)
        .map(|(parent, transform, _)| {
            let mesh = objects.get(world, parent.parent()).expect("parts belong to objects").mesh;
            (&meshes[mesh], transform.affine().as_daffine3())
        })
        .collect();
    assert!(instances.len() >= 12);
    ExactScene::new(&instances, origin).expect("the committed meshes are sound")
}

#[derive(Default)]
struct Errors {
    absolute: f64,
    squared: f64,
    signed: f64,
    largest: f32,
    count: usize,
}

impl Errors {
    fn add(&mut self, found: f32, exact: f32) {
        let error = found - exact;
        self.absolute += f64::from(error.abs());
        self.squared += f64::from(error * error);
        self.signed += f64::from(error);
        self.largest = self.largest.max(error.abs());
        self.count += 1;
    }

    fn mean(&self) -> f64 {
        self.absolute / self.count as f64
    }

    fn print(&self, name: &str) {
        let n = self.count as f64;
        println!(
            "{name}: mean absolute error {:.4}, RMS {:.4}, maximum {:.3}, bias {:+.4} over {} pixels",
            self.mean(),
            (self.squared / n).sqrt(),
            self.largest,
            self.signed / n,
            self.count
        );
    }
}

/// What exact rays find for every pixel that shows a surface: ambient visibility, and that of the sun.
type Exact = Vec<Option<[f32; 2]>>;

/// What a pixel shows, in the world; nothing for the sky.
fn receiver_at(frame: &ProbedFrame, pixel: UVec2) -> Option<Receiver> {
    let receiver = frame.geometry.receiver_at(pixel);
    let position = frame.camera.as_dvec3() + receiver.position.as_dvec3();
    (receiver.depth > 0.0).then_some(Receiver { position, normal: receiver.normal })
}

fn exact_frame(app: &mut App, frame: &ProbedFrame) -> Exact {
    let scene = exact_scene(app, frame.camera.as_dvec3());
    let world = app.world_mut();
    let (light, shadows) = world.query::<(&GlobalTransform, &FieldShadows)>().single(world).expect("there is one sun");
    let sun =
        DirectionalShadow { rays: SUN_RAYS, ..DirectionalShadow::new(light.back().into(), shadows.angular_radius) };
    let ambient = AmbientOcclusion { rays: AMBIENT_RAYS, ..AmbientOcclusion::default() };
    let exact = |pixel: UVec2| {
        let receiver = receiver_at(frame, pixel)?;
        let occlusion = exact::ambient_occlusion(&scene, &receiver, &ambient);
        Some([1.0 - occlusion, exact::directional_visibility(&scene, &receiver, &sun)])
    };
    frame.geometry.pixels().collect::<Vec<_>>().into_par_iter().map(exact).collect()
}

/// Of all pixels, of floor and walls, and of objects, for ambient occlusion and for the sun.
fn errors(exact: &Exact, frame: &ProbedFrame) -> [[Errors; 3]; 2] {
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
            // One update moves the objects and renders them.
            headless.update();
            let frame = probe::read(&headless.app);
            let exact = exact.get_or_insert_with(|| exact_frame(&mut headless.app, &frame));
            let [ambient, sun] = errors(exact, &frame);
            let name = format!("{seconds} s, ambient occlusion by {estimator:?}");
            for (class, errors) in ["all", "planes", "objects"].iter().zip(&ambient) {
                errors.print(&format!("{name}, {class}"));
            }
            if let Some(folder) = std::env::var_os("VISFIELD_PICTURES") {
                save_pictures(folder.as_ref(), &format!("{estimator:?}_{seconds}"), exact, &frame.visibility);
            }
            assert!(ambient[0].mean() <= 0.015, "{name}: {}", ambient[0].mean());
            // Small objects at a low resolution: the filter's width shows, and what a grid and a table do not resolve.
            assert!(ambient[2].mean() <= 0.06, "{name}, on objects: {}", ambient[2].mean());
            if estimator == OcclusionEstimator::CapGrid {
                for (class, errors) in ["all", "planes", "objects"].iter().zip(&sun) {
                    errors.print(&format!("{seconds} s, sun visibility, {class}"));
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
