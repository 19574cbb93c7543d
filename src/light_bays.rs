//! The scene of `lights`: the same few moving objects under one light of each kind, each of them twice, with shadows from
//! visibility fields and with Bevy's own.
//!
//! A bay is a piece of floor before a wall, in a place of its own: no light reaches another bay.

use std::f32::consts::TAU;

use bevy::camera::visibility::RenderLayers;
use bevy::light::{CascadeShadowConfigBuilder, NotShadowCaster, NotShadowReceiver};
use bevy::prelude::*;
use bevy_visfield::prelude::*;

use crate::moving_objects::{ObjectParts, PERIOD, SceneClock};

/// The kinds of light, in the order of the bays.
///
/// ```
/// use visfield_workspace::light_bays::LightKind;
/// assert_eq!(LightKind::ALL.len(), 4);
/// ```
#[derive(clap::ValueEnum, Component, Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightKind {
    /// A sun.
    Directional,
    /// A ball that shines to all sides.
    Point,
    /// A ball that shines into a cone.
    Spot,
    /// A panel; Bevy gives it no shadow of its own.
    Rect,
}

impl LightKind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Directional, Self::Point, Self::Spot, Self::Rect];

    /// What Bevy calls the light.
    pub fn name(self) -> &'static str {
        match self {
            Self::Directional => "DirectionalLight",
            Self::Point => "PointLight",
            Self::Spot => "SpotLight",
            Self::Rect => "RectLight",
        }
    }
}

/// What a bay's shadows come from.
///
/// ```
/// use visfield_workspace::light_bays::ShadowSource;
/// assert_ne!(ShadowSource::Fields, ShadowSource::Maps);
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShadowSource {
    /// `FieldShadows`.
    Fields,
    /// Bevy's shadow maps.
    Maps,
}

/// One bay.
///
/// ```
/// use visfield_workspace::light_bays::{Bay, LightKind, ShadowSource};
/// let bay = Bay { kind: LightKind::Spot, source: ShadowSource::Fields };
/// assert!(bay.camera_transform().translation.distance(bay.place()) < 20.0);
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bay {
    /// Of its light.
    pub kind: LightKind,
    /// Of its shadows.
    pub source: ShadowSource,
}

/// How large the lights are, as a multiple of what the scene begins with.
///
/// ```
/// let size = visfield_workspace::light_bays::LightSize::default();
/// assert_eq!(size.0, 1.0);
/// ```
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
pub struct LightSize(pub f32);

impl Default for LightSize {
    fn default() -> Self {
        Self(1.0)
    }
}

/// Between bays: more than any light reaches.
const SPACING: f32 = 80.0;
/// How far the lights reach.
const RANGE: f32 = 25.0;
const SUN_ANGULAR_RADIUS: f32 = 0.045;
const BULB_RADIUS: f32 = 0.2;
const PANEL: Vec2 = Vec2::new(1.5, 0.5);
/// Where lights with a place are, and what they look at, in the bay.
const LIGHT: Vec3 = Vec3::new(1.25, 3.35, 1.7);
const TARGET: Vec3 = Vec3::new(-0.25, 0.6, -0.5);

impl Bay {
    /// The middle of its floor, in the world.
    pub fn place(self) -> Vec3 {
        let row = if self.source == ShadowSource::Fields { 0.0 } else { 1.0 };
        Vec3::new(self.kind as u32 as f32, 0.0, row) * SPACING
    }

    /// Directional lights shine on everything, but for the layers.
    pub fn layers(self) -> RenderLayers {
        let row = if self.source == ShadowSource::Fields { 0 } else { LightKind::ALL.len() };
        RenderLayers::layer(1 + self.kind as usize + row)
    }

    /// Where its camera is.
    pub fn camera_transform(self) -> Transform {
        let eye = self.place() + Vec3::new(-0.8, 2.2, 5.3);
        Transform::from_translation(eye).looking_at(self.place() + Vec3::new(-0.08, 1.28, -0.2), Vec3::Y)
    }
}

/// One moving object of a bay.
///
/// ```
/// use visfield_workspace::light_bays::{Bay, LightKind, ShadowSource, objects};
/// use visfield_workspace::moving_objects::PERIOD;
/// let knot = objects(Bay { kind: LightKind::Point, source: ShadowSource::Maps })[0];
/// let (start, end) = (knot.transform_at(0.0), knot.transform_at(PERIOD));
/// assert!(start.translation.abs_diff_eq(end.translation, 1e-3));
/// ```
#[derive(Component, Clone, Copy, Debug)]
pub struct BayObject {
    /// Which of [`MESHES`](crate::moving_objects::MESHES) it shows.
    pub mesh: usize,
    color: [f32; 3],
    scale: f32,
    center: Vec3,
    /// Up and down around the centre.
    bob: f32,
    axis: Vec3,
    spins: f32,
    phase: f32,
}

impl BayObject {
    /// Where it is at a time in seconds.
    pub fn transform_at(&self, seconds: f32) -> Transform {
        let turns = seconds / PERIOD;
        Transform {
            translation: self.center + Vec3::Y * (self.bob * (turns * TAU).sin()),
            rotation: Quat::from_axis_angle(self.axis.normalize(), (turns * self.spins + self.phase) * TAU),
            scale: Vec3::splat(self.scale),
        }
    }
}

/// The objects of a bay: a chair and a supershape on the floor, and a knot and a supershape in the air.
pub fn objects(bay: Bay) -> [BayObject; 4] {
    let object = |mesh, color, scale, at: Vec3, bob, axis, spins, phase| BayObject {
        mesh,
        color,
        scale,
        center: bay.place() + at,
        bob,
        axis,
        spins,
        phase,
    };
    [
        object(2, [0.72, 0.66, 0.56], 0.78, Vec3::new(-0.75, 0.78, 0.35), 0.0, Vec3::Y, 1.0, 0.12),
        object(0, [0.10, 0.26, 0.58], 0.52, Vec3::new(-0.35, 2.25, -0.75), 0.12, Vec3::new(0.4, 1.0, 0.2), 1.0, 0.0),
        object(1, [0.66, 0.13, 0.08], 0.5, Vec3::new(0.85, 0.495, 0.3), 0.0, Vec3::Y, -1.0, 0.3),
        object(1, [0.78, 0.52, 0.14], 0.33, Vec3::new(0.75, 1.65, -0.3), -0.15, Vec3::new(1.0, 0.6, 0.3), 1.0, 0.6),
    ]
}

/// Spawns a bay with its light, but no camera.
pub fn spawn_bay(
    commands: &mut Commands,
    meshes: &mut Assets<Mesh>,
    materials: &mut Assets<StandardMaterial>,
    parts: &[ObjectParts],
    bay: Bay,
) {
    let mut matt = |[r, g, b]: [f32; 3], perceptual_roughness| {
        let base_color = Color::linear_rgb(r, g, b);
        materials.add(StandardMaterial { base_color, perceptual_roughness, ..default() })
    };
    let plaster = matt([0.52, 0.50, 0.47], 0.95);
    for (normal, at) in [(Vec3::Y, Vec3::new(0.0, 0.0, 0.0)), (Vec3::Z, Vec3::new(0.0, 0.0, -1.9))] {
        let mesh = Mesh3d(meshes.add(Plane3d::new(normal, Vec2::splat(12.0))));
        let place = Transform::from_translation(bay.place() + at);
        commands.spawn((mesh, MeshMaterial3d(plaster.clone()), place, bay.layers()));
    }
    for object in objects(bay) {
        let material = MeshMaterial3d(matt(object.color, 0.7));
        let parts = &parts[object.mesh % parts.len()];
        commands.spawn((object, object.transform_at(0.0), Visibility::default())).with_children(|children| {
            for (mesh, field) in parts.meshes.iter().zip(&parts.fields) {
                let part = (Mesh3d(mesh.clone()), material.clone(), VisibilityField3d(field.clone()));
                children.spawn((part, parts.object_from_mesh, bay.layers()));
            }
        });
    }
    spawn_light(commands, meshes, materials, bay);
}

/// The light, and what it looks like. Its sizes are those of [`resize_lights`].
fn spawn_light(commands: &mut Commands, meshes: &mut Assets<Mesh>, materials: &mut Assets<StandardMaterial>, bay: Bay) {
    let place = Transform::from_translation(bay.place() + LIGHT).looking_at(bay.place() + TARGET, Vec3::Y);
    let shadow_maps_enabled = bay.source == ShadowSource::Maps;
    let mut light = commands.spawn((bay, place, bay.layers(), Visibility::default()));
    let shape = match bay.kind {
        LightKind::Directional => {
            let cascades = CascadeShadowConfigBuilder { maximum_distance: 16.0, ..default() }.build();
            let color = Color::srgb(1.0, 0.93, 0.82);
            light
                .insert((DirectionalLight { illuminance: 6_500.0, color, shadow_maps_enabled, ..default() }, cascades));
            None
        }
        LightKind::Point => {
            let color = Color::srgb(1.0, 0.86, 0.68);
            let intensity = 900_000.0;
            light.insert(PointLight { intensity, range: RANGE, color, shadow_maps_enabled, ..default() });
            Some((Mesh::from(Sphere::new(1.0)), color))
        }
        LightKind::Spot => {
            let color = Color::srgb(0.80, 0.90, 1.0);
            let (inner_angle, outer_angle) = (0.42, 0.58);
            let aimed = SpotLight { inner_angle, outer_angle, shadow_maps_enabled, ..default() };
            light.insert(SpotLight { intensity: 1_300_000.0, range: RANGE, color, ..aimed });
            Some((Mesh::from(Sphere::new(1.0)), color))
        }
        LightKind::Rect => {
            let color = Color::srgb(0.94, 0.96, 1.0);
            light.insert(RectLight { intensity: 260_000.0, range: RANGE, color, width: 1.0, height: 1.0 });
            // Its front is −z; seen from behind it is dark, as the light is.
            Some((Mesh::from(Plane3d::new(Vec3::NEG_Z, Vec2::splat(0.5))), color))
        }
    };
    if bay.source == ShadowSource::Fields {
        light.insert(FieldShadows::default());
    }
    if let Some((mesh, color)) = shape {
        let emissive = color.to_linear() * 6.0;
        let material = materials.add(StandardMaterial { base_color: Color::BLACK, emissive, ..default() });
        light.insert((Mesh3d(meshes.add(mesh)), MeshMaterial3d(material), NotShadowCaster, NotShadowReceiver));
    }
}

/// Gives the lights the size of [`LightSize`]. What they look like is scaled with them.
pub fn resize_lights(
    size: Res<LightSize>,
    mut suns: Query<&mut FieldShadows, With<DirectionalLight>>,
    mut points: Query<(&mut PointLight, &mut Transform), Without<SpotLight>>,
    mut spots: Query<(&mut SpotLight, &mut Transform), Without<PointLight>>,
    mut rects: Query<&mut Transform, (With<RectLight>, Without<PointLight>, Without<SpotLight>)>,
) {
    let radius = BULB_RADIUS * size.0;
    for mut shadows in &mut suns {
        shadows.angular_radius = SUN_ANGULAR_RADIUS * size.0;
    }
    for (mut light, mut transform) in &mut points {
        (light.radius, transform.scale) = (radius, Vec3::splat(radius));
    }
    for (mut light, mut transform) in &mut spots {
        (light.radius, transform.scale) = (radius, Vec3::splat(radius));
    }
    // Bevy multiplies a panel's width and height with its scale, and leaves radii alone.
    for mut transform in &mut rects {
        transform.scale = (PANEL * size.0).extend(1.0);
    }
}

/// Moves the objects to where they are at the time of the [`SceneClock`].
pub fn move_objects(clock: Res<SceneClock>, mut objects: Query<(&BayObject, &mut Transform)>) {
    for (object, mut transform) in &mut objects {
        *transform = object.transform_at(clock.0);
    }
}
