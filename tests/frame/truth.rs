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

use crate::{adapter, probe};

const SIZE: UVec2 = UVec2::new(320, 180);
const RAYS: u32 = 256;

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
        let path = format!("{ASSETS}/meshes/{name}.glb");
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

#[test]
fn the_frame_is_near_exact_rays() {
    if !adapter::available() {
        return;
    }
    let mut headless = scene_app();
    for seconds in [0.0, 0.3 * PERIOD] {
        headless.app.world_mut().resource_mut::<SceneClock>().0 = seconds;
        // One update moves the objects and renders them.
        headless.update();
        let frame = probe::read(&headless.app);
        let camera = frame.camera.as_dvec3();
        let exact_scene = exact_scene(&mut headless.app, camera);
        let sun = {
            let world = headless.app.world_mut();
            let (light, shadows) =
                world.query::<(&GlobalTransform, &FieldShadows)>().single(world).expect("there is one sun");
            DirectionalShadow { rays: RAYS, ..DirectionalShadow::new(light.back().into(), shadows.angular_radius) }
        };
        let ambient = AmbientOcclusion { rays: RAYS, ..AmbientOcclusion::default() };

        let pixels: Vec<UVec2> = frame.geometry.pixels().collect();
        // What a pixel shows, in the world; nothing for the sky.
        let receiver_at = |pixel: UVec2| {
            let receiver = frame.geometry.receiver_at(pixel);
            let position = camera + receiver.position.as_dvec3();
            (receiver.depth > 0.0).then_some(Receiver { position, normal: receiver.normal })
        };
        let exact: Vec<Option<[f32; 2]>> = pixels
            .par_iter()
            .map(|&pixel| {
                let receiver = receiver_at(pixel)?;
                let occlusion = exact::ambient_occlusion(&exact_scene, &receiver, &ambient);
                Some([1.0 - occlusion, exact::directional_visibility(&exact_scene, &receiver, &sun)])
            })
            .collect();
        // Objects lie before the walls: their pixels are told from the floor's and walls' by the normal.
        let is_plane = |normal: Vec3| normal.abs().max_element() > 0.9995;
        let mut errors: [[Errors; 3]; 2] = Default::default();
        for ((exact, found), &pixel) in exact.iter().zip(&frame.visibility).zip(&pixels) {
            let Some(exact) = exact else { continue };
            let class = if is_plane(frame.geometry.receiver_at(pixel).normal) { 1 } else { 2 };
            for estimator in 0..2 {
                for class in [0, class] {
                    errors[estimator][class].add(found[estimator], exact[estimator]);
                }
            }
        }
        for (estimator, errors) in ["ambient occlusion", "sun visibility"].iter().zip(&errors) {
            for (class, errors) in ["all", "planes", "objects"].iter().zip(errors) {
                errors.print(&format!("{seconds} s, {estimator}, {class}"));
            }
        }
        // How near the reference itself is to the true integral, on every 16th pixel.
        let converged = AmbientOcclusion { rays: 4096, ..ambient };
        let reference: Vec<Option<[f32; 2]>> = (0..pixels.len())
            .into_par_iter()
            .step_by(16)
            .map(|i| {
                let ([rays_256, _], receiver) = (exact[i]?, receiver_at(pixels[i])?);
                Some([rays_256, 1.0 - exact::ambient_occlusion(&exact_scene, &receiver, &converged)])
            })
            .collect();
        let mut noise = Errors::default();
        reference.iter().flatten().for_each(|[rays_256, converged]| noise.add(*rays_256, *converged));
        noise.print(&format!("{seconds} s, ambient occlusion, {RAYS} exact rays against 4096"));
        if let Some(folder) = std::env::var_os("VISFIELD_PICTURES") {
            save_pictures(folder.as_ref(), seconds, &exact, &frame.visibility);
        }
        for (estimator, errors) in ["ambient occlusion", "sun visibility"].iter().zip(&errors) {
            assert!(errors[0].mean() <= 0.02, "{estimator}: {}", errors[0].mean());
            // Small objects at a low resolution: the filter's width shows, and the table's in self-shadowing.
            assert!(errors[2].mean() <= 0.065, "{estimator} on objects: {}", errors[2].mean());
        }
    }
}

/// Writes exact, found, and their difference ×5 side by side.
fn save_pictures(folder: &std::path::Path, seconds: f32, exact: &[Option<[f32; 2]>], found: &[[f32; 2]]) {
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
        picture.save(folder.join(format!("{name}_{seconds}.png"))).expect("the folder can be written to");
    }
}
