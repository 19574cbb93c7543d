//! Real models bake, load and render: a scan that is open at the bottom, one in tiny units, and a glTF of several meshes.

use std::path::PathBuf;

use bevy::prelude::*;
use bevy_visfield::bake::to_bevy_mesh;
use bevy_visfield::prelude::*;
use visfield_bake::{BakeSettings, bake, read_meshes};
use visfield_workspace::headless::HeadlessApp;

use crate::adapter;

/// The test meshes stay outside the repository. Without them a test is skipped by hand and fails under CI.
fn real_mesh(name: &str) -> Option<PathBuf> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/meshes")).join(name);
    if path.exists() {
        return Some(path);
    }
    assert!(std::env::var_os("CI").is_none(), "CI needs {}", path.display());
    eprintln!("skipped: {} is missing", path.display());
    None
}

/// Bakes a model, writes its fields to a file and loads that through the asset server; then shows it over a floor and
/// returns how much the floor below it darkens.
fn bake_load_and_render(name: &str) {
    let (Some(path), true) = (real_mesh(name), adapter::available()) else { return };
    let meshes = read_meshes(&path).unwrap();
    let settings = BakeSettings::two_point(33, 16);
    let fields: Vec<_> = meshes.iter().map(|mesh| bake(mesh, &settings, |_| ()).unwrap()).collect();
    let folder = tempfile::tempdir().unwrap();
    visfield::file::write(&folder.path().join("model.vfield"), &fields).unwrap();

    let size = UVec2::new(160, 120);
    let mut headless = HeadlessApp::new(size, |plugins| {
        plugins.set(AssetPlugin { file_path: folder.path().to_string_lossy().into_owned(), ..default() })
    });
    headless.app.add_plugins(VisibilityFieldPlugin);
    let target = headless.target();
    let world = headless.app.world_mut();
    let server = world.resource::<AssetServer>().clone();
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(StandardMaterial::default());
    let floor = world.resource_mut::<Assets<Mesh>>().add(Plane3d::new(Vec3::Y, Vec2::splat(4.0)));
    world.spawn((Mesh3d(floor), MeshMaterial3d(material.clone())));

    // Scaled to stand two units tall on the floor, whatever its own units are.
    let corners = || meshes.iter().flat_map(|mesh| mesh.positions.iter().map(|&p| Vec3::from(p)));
    let (low, high) = corners().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
    let scale = 2.0 / (high - low).max_element();
    let center = (low + high) / 2.0;
    let place =
        Transform::from_translation(-scale * Vec3::new(center.x, low.y, center.z)).with_scale(Vec3::splat(scale));
    for mesh in &meshes {
        let field: Handle<VisibilityField> = server.load(format!("model.vfield#{}", mesh.name));
        let shape = world.resource_mut::<Assets<Mesh>>().add(to_bevy_mesh(mesh));
        world.spawn((Mesh3d(shape), MeshMaterial3d(material.clone()), place, VisibilityField3d(field)));
    }
    let look = Transform::from_xyz(2.5, 3.0, 5.0).looking_at(Vec3::Y * 0.8, Vec3::Y);
    let camera = world
        .spawn((
            Camera3d::default(),
            Msaa::Off,
            look,
            FieldOcclusion::default(),
            FieldDebugView::AmbientVisibility,
            target,
        ))
        .id();
    headless.wait_until_ready();
    let picture = headless.capture();
    if let Some(folder) = std::env::var_os("VISFIELD_PICTURES") {
        picture.save(PathBuf::from(folder).join(format!("{}.png", name.replace('/', "_")))).unwrap();
    }
    // Just before the model's foot, and in the corner of the picture, where the floor is far from it. Encoded as sRGB.
    let foot = Vec3::new(0.0, 0.0, scale * (high.z - center.z) + 0.08);
    let camera = headless.app.world().entity(camera);
    let (camera, transform) = (camera.get::<Camera>().unwrap(), camera.get::<GlobalTransform>().unwrap());
    let at = camera.world_to_viewport(transform, foot).unwrap();
    let around = (-4..=4).map(|x| picture.get_pixel((at.x as i32 + x) as u32, at.y as u32).0[0]);
    let (near, far) = (around.min().unwrap(), picture.get_pixel(2, size.y - 3).0[0]);
    println!("{name}: {} fields, visibility {near} of 255 at its foot, {far} far away", fields.len());
    assert!(near < 235, "{name}: {near} at its foot");
    assert!(far > 245, "{name}: {far} far away");
}

#[test]
fn the_bunny_renders() {
    bake_load_and_render("stanford-bunny.obj");
}

#[test]
fn tiny_units_render() {
    bake_load_and_render("igea.glb");
}

#[test]
fn a_model_of_several_meshes_renders() {
    bake_load_and_render("FlightHelmet/FlightHelmet.gltf");
}
