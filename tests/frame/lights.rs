//! Every kind of light: its mask reaches it in Bevy's lighting, and no other light.

use bevy::core_pipeline::prepass::DeferredPrepass;
use bevy::core_pipeline::tonemapping::{DebandDither, Tonemapping};
use bevy::light::{GlobalAmbientLight, NotShadowCaster, NotShadowReceiver};
use bevy::pbr::DefaultOpaqueRendererMethod;
use bevy::prelude::*;
use bevy_visfield::prelude::*;
use image::RgbaImage;
use visfield_workspace::headless::HeadlessApp;

use crate::adapter;

const SIZE: UVec2 = UVec2::new(160, 120);
/// In the ball's shadow, for lights at [`LIGHT`]; and far from it.
const SHADOW: Vec3 = Vec3::new(-1.96, 0.0, 0.0);
const OPEN: Vec3 = Vec3::new(3.2, 0.0, 2.0);
const BALL: Vec3 = Vec3::new(-1.0, 1.2, 0.0);
const LIGHT: Vec3 = Vec3::new(1.88, 4.8, 0.0);

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Directional,
    Point,
    Spot,
}

/// A light, all of them from about the same place.
fn spawn_light(world: &mut World, kind: Kind, color: Color, shadow_maps: bool) -> Entity {
    match kind {
        Kind::Directional => {
            let light = DirectionalLight { illuminance: 3000.0, color, shadow_maps_enabled: shadow_maps, ..default() };
            world.spawn((light, Transform::default().looking_to(SHADOW - LIGHT, Vec3::Y)))
        }
        Kind::Point => {
            let (intensity, range) = (1_000_000.0, 30.0);
            let light = PointLight { intensity, range, color, shadow_maps_enabled: shadow_maps, ..default() };
            world.spawn((light, Transform::from_translation(LIGHT)))
        }
        Kind::Spot => {
            let (inner_angle, outer_angle, intensity, range) = (1.0, 1.2, 1_000_000.0, 30.0);
            let light = SpotLight { intensity, range, color, inner_angle, outer_angle, ..default() };
            let light = SpotLight { shadow_maps_enabled: shadow_maps, ..light };
            world.spawn((light, Transform::from_translation(LIGHT).looking_at(Vec3::ZERO, Vec3::X)))
        }
    }
    .id()
}

/// A ball over a floor, seen from the side.
struct Stage {
    headless: HeadlessApp,
    floor: Entity,
    camera: Entity,
}

impl Stage {
    fn new(deferred: bool) -> Self {
        let mut headless = HeadlessApp::new(SIZE, |plugins| plugins);
        headless.app.add_plugins(VisibilityFieldPlugin);
        let target = headless.target();
        let world = headless.app.world_mut();
        world.insert_resource(ClearColor(Color::BLACK));
        world.insert_resource(GlobalAmbientLight { brightness: 100.0, ..default() });
        let mut add_mesh = |mesh: Mesh| world.resource_mut::<Assets<Mesh>>().add(mesh);
        let floor = add_mesh(Plane3d::new(Vec3::Y, Vec2::splat(6.0)).into());
        let ball = add_mesh(Sphere::new(0.98).into());
        let material = StandardMaterial { perceptual_roughness: 1.0, reflectance: 0.0, ..default() };
        let material = MeshMaterial3d(world.resource_mut::<Assets<StandardMaterial>>().add(material));
        let field = VisibilityField(visfield::field::ball_field(0.98, 65, 32));
        let field = VisibilityField3d(world.resource_mut::<Assets<VisibilityField>>().add(field));
        let floor = world.spawn((Mesh3d(floor), material.clone())).id();
        world.spawn((Mesh3d(ball), material, Transform::from_translation(BALL), field, NotShadowCaster));
        let look = Transform::from_xyz(0.0, 3.0, 8.0).looking_at(Vec3::new(0.0, 0.8, 0.0), Vec3::Y);
        let shows = FieldOcclusion { ambient_occlusion: false, ..default() };
        // So that colours stay apart.
        let plain = (Camera3d::default(), Msaa::Off, DebandDither::Disabled, Tonemapping::None);
        let camera = world.spawn((plain, look, shows, target)).id();
        if deferred {
            world.insert_resource(DefaultOpaqueRendererMethod::deferred());
            world.entity_mut(camera).insert(DeferredPrepass);
        }
        Self { headless, floor, camera }
    }

    fn world(&mut self) -> &mut World {
        self.headless.app.world_mut()
    }

    fn picture(&mut self) -> RgbaImage {
        self.headless.wait_until_ready();
        self.headless.capture()
    }

    /// The colour of a point of the world.
    fn color_of(&mut self, picture: &RgbaImage, point: Vec3) -> [i32; 3] {
        let camera = self.headless.app.world().entity(self.camera);
        let (camera, transform) = (camera.get::<Camera>().unwrap(), camera.get::<GlobalTransform>().unwrap());
        let at = camera.world_to_viewport(transform, point).expect("the point is in view");
        let [r, g, b, _] = picture.get_pixel(at.x as u32, at.y as u32).0.map(i32::from);
        [r, g, b]
    }
}

#[test]
fn every_kind_of_light_is_shadowed() {
    if !adapter::available() {
        return;
    }
    for deferred in [false, true] {
        for kind in [Kind::Directional, Kind::Point, Kind::Spot] {
            let mut stage = Stage::new(deferred);
            let light = spawn_light(stage.world(), kind, Color::WHITE, false);
            let off = stage.picture();
            stage.world().entity_mut(light).insert(FieldShadows::default());
            let on = stage.picture();
            let floor = stage.floor;
            stage.world().entity_mut(floor).insert(NotShadowReceiver);
            let opted_out = stage.picture();
            let mut at = |point| [&off, &on, &opted_out].map(|picture| stage.color_of(picture, point)[0]);
            let (shadow, open) = (at(SHADOW), at(OPEN));
            println!("{kind:?}, deferred: {deferred}: off, on, opted out: shadow {shadow:?}, open {open:?}");
            assert!(shadow[1] < shadow[0] - 30, "{kind:?}, deferred: {deferred}: {shadow:?}");
            assert_eq!(shadow[2], shadow[0], "NotShadowReceiver: {kind:?}, deferred: {deferred}");
            assert!((open[1] - open[0]).abs() <= 1 && open[0] > 40, "{kind:?}, deferred: {deferred}: {open:?}");
        }
    }
}

#[test]
fn every_light_has_a_mask_of_its_own() {
    use Kind::{Directional, Point, Spot};
    if !adapter::available() {
        return;
    }
    let [red, green, blue] = [LinearRgba::RED, LinearRgba::GREEN, LinearRgba::BLUE].map(|color| (color * 0.3).into());
    // Kind, colour, and shadow maps, which decide about the order of lights in Bevy's shader.
    let lights = [
        (Spot, green, false),
        (Point, red, true),
        (Directional, blue, false),
        (Point, blue, false),
        (Spot, red, false),
        (Directional, red, true),
        (Point, green, true),
        (Directional, green, true),
        (Point, red, false),
        (Spot, blue, true),
    ];
    let mut stage = Stage::new(false);
    let spawned = lights.map(|(kind, color, maps)| (spawn_light(stage.world(), kind, color, maps), color));
    let off = stage.picture();
    let before = stage.color_of(&off, SHADOW);
    // One after the other, then all of a colour, then all.
    for (light, color) in spawned {
        stage.world().entity_mut(light).insert(FieldShadows::default());
        let picture = stage.picture();
        let after = stage.color_of(&picture, SHADOW);
        let darker = std::array::from_fn(|i| after[i] < before[i] - 10);
        assert_eq!(darker, [color == red, color == green, color == blue], "{before:?} to {after:?}");
        assert!(std::iter::zip(before, after).all(|(before, after)| after < before - 10 || after == before));
        stage.world().entity_mut(light).remove::<FieldShadows>();
    }
    for (light, _) in spawned.iter().filter(|(_, color)| *color == red) {
        stage.world().entity_mut(*light).insert(FieldShadows::default());
    }
    let picture = stage.picture();
    let others = stage.color_of(&picture, SHADOW);
    assert!(others[0] < before[0] - 60 && others[1..] == before[1..], "{before:?} to {others:?}");
    for (light, _) in spawned {
        stage.world().entity_mut(light).insert(FieldShadows::default());
    }
    let picture = stage.picture();
    let none = stage.color_of(&picture, SHADOW);
    assert!(none.iter().all(|&value| value < 80), "{before:?} to {none:?}");
}
