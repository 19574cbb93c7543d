//! The scene of `moving_objects`: fourteen instances of three meshes that orbit, tumble and touch the floor, between a
//! floor and two walls, under one sun.
//!
//! Every motion repeats after [`PERIOD`] seconds, so that a recording loops.

use std::f32::consts::TAU;

use bevy::gltf::GltfAssetLabel;
use bevy::light::GlobalAmbientLight;
use bevy::prelude::*;
use bevy_visfield::prelude::*;

/// Seconds after which every motion repeats.
pub const PERIOD: f32 = 8.0;

/// Where the sun stands: the unit vector towards it is this one, normalised.
const TO_SUN: Vec3 = Vec3::new(0.6, 1.0, 0.5);

/// The time of the scene in seconds. Advance it to move the objects.
///
/// ```
/// let start = visfield_workspace::moving_objects::SceneClock::default();
/// assert_eq!(start.0, 0.0);
/// ```
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq)]
pub struct SceneClock(pub f32);

/// The default meshes under `assets/meshes`, each about two units tall and centred at its origin.
pub const MESHES: [&str; 3] = ["torus_knot", "supershape", "chair"];

/// One moving object: which mesh, how large, what colour, and its motion.
///
/// ```
/// use visfield_workspace::moving_objects::{PERIOD, objects};
/// let chair = objects()[0];
/// let (start, end) = (chair.transform_at(0.0), chair.transform_at(PERIOD));
/// assert!(start.translation.abs_diff_eq(end.translation, 1e-4));
/// ```
#[derive(Component, Clone, Copy, Debug)]
pub struct MovingObject {
    /// Which of [`MESHES`] (or of the user's meshes) it shows.
    pub mesh: usize,
    /// Its size in world units per mesh unit.
    pub scale: f32,
    /// Its base colour, linear RGB.
    pub color: [f32; 3],
    motion: Motion,
}

#[derive(Clone, Copy, Debug)]
enum Motion {
    /// Slides in a circle on the floor, turning about the vertical axis.
    Slide { center: Vec2, radius: f32, phase: f32, spins: f32 },
    /// Circles in the air, tumbling about a tilted axis.
    Orbit { center: Vec3, radius: f32, phase: f32, axis: Vec3, spins: f32 },
    /// Hops on the spot, touching the floor once per hop.
    Hop { at: Vec2, height: f32, phase: f32, spins: f32 },
}

impl MovingObject {
    /// Where it is at a time in seconds.
    pub fn transform_at(&self, seconds: f32) -> Transform {
        let turns = seconds / PERIOD;
        let on_circle = |phase: f32| Vec2::from_angle((turns + phase) * TAU);
        // Meshes are two units tall around their origin, so this stands them on the floor.
        let standing = self.scale * floor_distance(self.mesh);
        let (translation, rotation) = match self.motion {
            Motion::Slide { center, radius, phase, spins } => {
                let at = center + on_circle(phase) * radius;
                (Vec3::new(at.x, standing, at.y), Quat::from_rotation_y((turns * spins + phase) * TAU))
            }
            Motion::Orbit { center, radius, phase, axis, spins } => {
                let at = on_circle(phase) * radius;
                let rotation = Quat::from_axis_angle(axis.normalize(), (turns * spins + phase) * TAU);
                (center + Vec3::new(at.x, 0.35 * (at.x + at.y), at.y), rotation)
            }
            Motion::Hop { at, height, phase, spins } => {
                let up = ((2.0 * turns + phase) * TAU / 2.0).sin().abs() * height;
                (Vec3::new(at.x, standing + up, at.y), Quat::from_rotation_y((turns * spins + phase) * TAU))
            }
        };
        Transform { translation, rotation, scale: Vec3::splat(self.scale) }
    }
}

/// How far a mesh's lowest point lies below its origin, in mesh units, while it is upright.
fn floor_distance(mesh: usize) -> f32 {
    [0.72, 0.99, 1.0].get(mesh).copied().unwrap_or(1.0)
}

/// The fourteen objects of the scene.
pub fn objects() -> Vec<MovingObject> {
    const KNOT: usize = 0;
    const SUPERSHAPE: usize = 1;
    const CHAIR: usize = 2;
    const RED: [f32; 3] = [0.62, 0.12, 0.08];
    const BLUE: [f32; 3] = [0.10, 0.24, 0.55];
    const GREEN: [f32; 3] = [0.20, 0.42, 0.14];
    const GOLD: [f32; 3] = [0.75, 0.50, 0.14];
    const IVORY: [f32; 3] = [0.75, 0.71, 0.62];

    let mut objects = Vec::new();
    let mut add = |mesh, scale, color, motion| objects.push(MovingObject { mesh, scale, color, motion });
    // Four chairs slide around a supershape that hops among them.
    for (i, color) in [IVORY, GOLD, IVORY, GREEN].into_iter().enumerate() {
        let phase = i as f32 / 4.0;
        add(CHAIR, 1.15, color, Motion::Slide { center: Vec2::new(0.3, 0.6), radius: 2.1, phase, spins: -1.0 });
    }
    add(SUPERSHAPE, 1.0, RED, Motion::Hop { at: Vec2::new(0.3, 0.6), height: 0.6, phase: 0.0, spins: 1.0 });
    // Knots and supershapes orbit above, close to each other and to the walls.
    for i in 0..4 {
        let phase = i as f32 / 4.0 + 0.1;
        let (mesh, color) = if i % 2 == 0 { (KNOT, BLUE) } else { (SUPERSHAPE, GOLD) };
        let axis = Vec3::new(1.0, 0.5 + i as f32 * 0.4, 0.3 - i as f32 * 0.2);
        let center = Vec3::new(-1.0, 3.1, -1.0);
        add(mesh, 0.95, color, Motion::Orbit { center, radius: 1.7, phase, axis, spins: 1.0 + (i % 2) as f32 });
    }
    // Small ones on the floor: still contacts, and contacts that come and go.
    add(KNOT, 0.95, BLUE, Motion::Slide { center: Vec2::new(-2.8, -0.4), radius: 0.4, phase: 0.3, spins: 1.0 });
    add(KNOT, 0.7, RED, Motion::Hop { at: Vec2::new(3.3, 2.4), height: 0.8, phase: 0.5, spins: -1.0 });
    add(SUPERSHAPE, 0.8, IVORY, Motion::Slide { center: Vec2::new(2.9, -1.6), radius: 0.5, phase: 0.8, spins: -2.0 });
    add(SUPERSHAPE, 0.6, GREEN, Motion::Hop { at: Vec2::new(-2.6, 2.6), height: 0.6, phase: 0.25, spins: 1.0 });
    add(CHAIR, 0.95, RED, Motion::Slide { center: Vec2::new(-0.6, -2.3), radius: 0.3, phase: 0.6, spins: 1.0 });
    objects
}

/// What an object is made of: the meshes that are spawned under it, with what gives them their field.
///
/// ```no_run
/// # use bevy::prelude::*;
/// use visfield_workspace::moving_objects::{ObjectParts, default_parts};
/// fn parts(server: &AssetServer) -> [ObjectParts; 3] {
///     default_parts(server)
/// }
/// ```
#[derive(Clone, Debug)]
pub struct ObjectParts {
    /// The meshes, in the object's own space.
    pub meshes: Vec<Handle<Mesh>>,
    /// Their baked fields; empty if they are to be baked on the spot.
    pub fields: Vec<Handle<VisibilityField>>,
    /// From the meshes' space to the object's, where it is about two units tall around its origin.
    pub object_from_mesh: Transform,
}

/// The default meshes and their committed fields.
pub fn default_parts(server: &AssetServer) -> [ObjectParts; 3] {
    let label = GltfAssetLabel::Primitive { mesh: 0, primitive: 0 };
    MESHES.map(|name| ObjectParts {
        meshes: vec![server.load(label.from_asset(format!("meshes/{name}.glb")))],
        fields: vec![server.load(label.from_asset(format!("meshes/{name}.vfield")))],
        object_from_mesh: Transform::IDENTITY,
    })
}

/// Spawns the objects, each with the parts of its mesh.
pub fn spawn_objects(commands: &mut Commands, materials: &mut Assets<StandardMaterial>, parts: &[ObjectParts]) {
    for object in objects() {
        let [r, g, b] = object.color;
        let material = materials.add(StandardMaterial {
            base_color: Color::linear_rgb(r, g, b),
            perceptual_roughness: 0.75,
            ..default()
        });
        let parts = &parts[object.mesh % parts.len()];
        commands.spawn((object, object.transform_at(0.0), Visibility::default())).with_children(|children| {
            for (i, mesh) in parts.meshes.iter().enumerate() {
                let mut part =
                    children.spawn((Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()), parts.object_from_mesh));
                match parts.fields.get(i) {
                    Some(field) => part.insert(VisibilityField3d(field.clone())),
                    None => part.insert(BakeVisibilityField::default()),
                };
            }
        });
    }
}

/// Spawns the floor, the two walls and the sun. Floor and walls receive occlusion; being large, flat and still they cast
/// none.
pub fn spawn_surroundings(
    commands: &mut Commands,
    meshes: &mut Assets<Mesh>,
    materials: &mut Assets<StandardMaterial>,
) {
    let plaster = materials.add(StandardMaterial {
        base_color: Color::linear_rgb(0.50, 0.48, 0.45),
        perceptual_roughness: 0.95,
        ..default()
    });
    let mut plane = |normal: Vec3, half_size: Vec2, at: Vec3| {
        let mesh = meshes.add(Plane3d::new(normal, half_size));
        commands.spawn((Mesh3d(mesh), MeshMaterial3d(plaster.clone()), Transform::from_translation(at)));
    };
    plane(Vec3::Y, Vec2::new(4.5, 4.5), Vec3::new(0.5, 0.0, 1.1));
    plane(Vec3::Z, Vec2::new(4.5, 2.6), Vec3::new(0.5, 2.6, -3.4));
    plane(Vec3::X, Vec2::new(2.6, 4.5), Vec3::new(-4.0, 2.6, 1.1));
    commands.spawn((
        DirectionalLight { illuminance: 5_000.0, color: Color::srgb(1.0, 0.95, 0.85), ..default() },
        Transform::default().looking_to(-TO_SUN, Vec3::Y),
        FieldShadows::default(),
    ));
    commands.insert_resource(GlobalAmbientLight {
        color: Color::srgb(0.85, 0.92, 1.0),
        brightness: 1_000.0,
        ..default()
    });
}

/// The camera's place, looking into the corner.
pub fn camera_transform() -> Transform {
    Transform::from_xyz(4.4, 4.3, 8.2).looking_at(Vec3::new(-0.15, 1.45, -0.2), Vec3::Y)
}

/// Moves the objects to where they are at the time of the [`SceneClock`].
pub fn move_objects(clock: Res<SceneClock>, mut objects: Query<(&MovingObject, &mut Transform)>) {
    for (object, mut transform) in &mut objects {
        *transform = object.transform_at(clock.0);
    }
}
