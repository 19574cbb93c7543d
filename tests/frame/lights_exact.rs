//! The bays of `lights` against truth: under each kind of light, every pixel's shadow against exact rays to the same light.

use bevy::prelude::*;
use bevy_visfield::prelude::*;
use visfield::estimate::light::Light;
use visfield_workspace::headless::HeadlessApp;
use visfield_workspace::light_bays::{self, Bay, BayObject, LightKind, LightSize, ShadowSource};
use visfield_workspace::moving_objects::{PERIOD, SceneClock, default_parts};
use visfield_workspace::probe::{self, ProbedCamera, ProbedFrame};
use visfield_workspace::reference::{self, Errors, ExactFrame, Progress, ReferenceMeshes};

use crate::adapter;

const SIZE: UVec2 = UVec2::new(240, 240);
const RAYS: u32 = 256;

fn bay_app(bay: Bay) -> HeadlessApp {
    let mut headless = HeadlessApp::new(SIZE, |plugins| plugins);
    let app = &mut headless.app;
    app.add_plugins(VisibilityFieldPlugin)
        .init_resource::<LightSize>()
        .insert_resource(SceneClock(0.2 * PERIOD))
        .add_systems(
            Startup,
            move |mut commands: Commands,
                  server: Res<AssetServer>,
                  mut meshes: ResMut<Assets<Mesh>>,
                  mut materials: ResMut<Assets<StandardMaterial>>| {
                let parts = default_parts(&server);
                light_bays::spawn_bay(&mut commands, &mut meshes, &mut materials, &parts, bay);
            },
        )
        .add_systems(Update, (light_bays::move_objects, light_bays::resize_lights));
    probe::install(app);
    let target = headless.target();
    let shows = FieldOcclusion { quality: FieldOcclusionQuality::High, ambient_occlusion: false, ..default() };
    let camera = (Camera3d::default(), Msaa::Off, bay.camera_transform(), bay.layers(), shows, ProbedCamera, target);
    headless.app.world_mut().spawn(camera);
    headless.wait_until_ready();
    headless
}

/// The bay's light, relative to the camera.
fn light(world: &mut World, camera: Vec3) -> Light {
    type Kinds = (
        &'static GlobalTransform,
        &'static FieldShadows,
        Option<&'static PointLight>,
        Option<&'static SpotLight>,
        Option<&'static RectLight>,
    );
    let (place, shadows, point, spot, rect) = world.query::<Kinds>().single(world).expect("one light is shadowed");
    let at = place.translation() - camera;
    let axis = |axis: Dir3| Vec3::from(axis);
    if let Some(point) = point {
        Light::sphere(at, point.radius, point.range)
    } else if let Some(spot) = spot {
        Light::spot(at, spot.radius, spot.range, axis(place.forward()), spot.outer_angle)
    } else if let Some(rect) = rect {
        // As Bevy does, with its scale.
        let half = |side: Vec3| place.affine().transform_vector3(side * 0.5);
        let (half_width, half_height) = (half(Vec3::X * rect.width), half(Vec3::Y * rect.height));
        Light::rectangle(at, half_width, half_height, axis(place.forward()), rect.range)
    } else {
        Light::directional(axis(place.back()), shadows.angular_radius)
    }
}

fn exact_frame(world: &mut World, frame: &ProbedFrame) -> ExactFrame {
    let seconds = world.resource::<SceneClock>().0;
    let objects: Vec<_> =
        world.query::<&BayObject>().iter(world).map(|object| (object.mesh, object.transform_at(seconds))).collect();
    let meshes = ReferenceMeshes::read().expect("the committed meshes can be read");
    let scene = meshes.scene(objects, frame.camera.as_dvec3()).expect("the committed meshes are sound");
    let light = light(world, frame.camera);
    reference::trace_frame(&scene, frame, 0, (&light, RAYS), &Progress::default()).expect("nobody cancels it")
}

/// Of all pixels; of floor and wall; of objects; of those in a penumbra on floor and wall; and where the shadow is full there.
fn errors(exact: &ExactFrame, frame: &ProbedFrame) -> [Errors; 5] {
    let mut errors = [Errors::default(); 5];
    for ((exact, found), pixel) in exact.iter().zip(&frame.visibility).zip(frame.geometry.pixels()) {
        let Some([_, exact]) = *exact else { continue };
        let is_plane = frame.geometry.receiver_at(pixel).normal.abs().max_element() > 0.9995;
        let classes = [true, is_plane, !is_plane, is_plane && exact > 0.0 && exact < 1.0, is_plane && exact <= 0.0];
        for (errors, _) in errors.iter_mut().zip(classes).filter(|(_, counts)| *counts) {
            errors.add(found[1], exact);
        }
    }
    errors
}

fn save_picture(folder: &std::path::Path, kind: LightKind, exact: &ExactFrame, frame: &ProbedFrame) {
    let picture = image::GrayImage::from_fn(SIZE.x * 3, SIZE.y, |x, y| {
        let i = (y * SIZE.x + x % SIZE.x) as usize;
        let (exact, found) = (exact[i].map_or(1.0, |exact| exact[1]), frame.visibility[i][1]);
        let value = [exact, found, 0.5 + 5.0 * (found - exact)][(x / SIZE.x) as usize];
        image::Luma([(value.clamp(0.0, 1.0) * 255.0).round() as u8])
    });
    picture.save(folder.join(format!("light_{kind:?}.png"))).expect("the folder can be written to");
}

#[test]
fn the_shadow_of_every_kind_of_light_is_near_exact_rays() {
    if !adapter::available() {
        return;
    }
    for kind in LightKind::ALL {
        let mut headless = bay_app(Bay { kind, source: ShadowSource::Fields });
        let frame = probe::read(&mut headless);
        let exact = exact_frame(headless.app.world_mut(), &frame);
        let errors = errors(&exact, &frame);
        for (class, errors) in ["all", "planes", "objects", "penumbra", "full shadow"].iter().zip(&errors) {
            println!("{kind:?}, {class}: {errors}");
        }
        if let Some(folder) = std::env::var_os("VISFIELD_PICTURES") {
            save_picture(folder.as_ref(), kind, &exact, &frame);
        }
        let [all, planes, objects, penumbra, full] = errors.map(|errors| errors.mean());
        assert!(all <= 0.02 && planes <= 0.02, "{kind:?}: {all}, on planes {planes}");
        assert!(objects <= 0.08, "{kind:?}, on objects: {objects}");
        // The sun is small for the tables, and far from what it shadows on the wall.
        assert!(penumbra <= 0.09 && full <= 0.11, "{kind:?}, in the penumbra: {penumbra}, in full shadow: {full}");
        assert!(errors[3].count > 500, "{kind:?}: there is a penumbra to be wrong in");
    }
}
