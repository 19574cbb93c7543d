//! Crowds of any size at the same density: instances of twenty meshes that turn, circle and bob over a plane, under one sun.
//!
//! The sites are taken from the middle outwards, so that a larger crowd holds every smaller one: what is near a point within the
//! smaller one is the same in both.

use std::f32::consts::{PI, TAU};

use bevy::light::GlobalAmbientLight;
use bevy::prelude::*;
use bevy_visfield::bake::to_bevy_mesh;
use bevy_visfield::prelude::*;
use visfield::CapGridFormat;
use visfield_bake::{BakeError, BakeSettings};

/// World units from a site to the next.
pub const SPACING: f32 = 3.0;

/// Shapes in a crowd.
pub const SHAPES: usize = LOBES_AROUND.len() * LOBES_UPWARDS.len();

const LOBES_AROUND: [f32; 5] = [3.0, 4.0, 5.0, 6.0, 7.0];
const LOBES_UPWARDS: [f32; 4] = [2.0, 3.0, 4.0, 6.0];
const SECTORS: u32 = 32;
const STACKS: u32 = 12;

/// How far a camera of [`FieldOcclusion`] looks for ambient occlusion in a crowd: further objects are those behind the next.
pub const MAX_DISTANCE: f32 = 2.0 * SPACING;

/// A mesh and its field, before an app has them.
///
/// ```
/// let shape = visfield_workspace::crowd::shape_mesh(0);
/// assert_eq!(shape.validate(), Ok(()));
/// ```
#[derive(Clone, Debug)]
pub struct BakedShape {
    /// About one unit in radius, around its origin.
    pub mesh: visfield_bake::Mesh,
    /// Its field: a small table and a small cap grid.
    pub field: visfield::VisibilityField,
}

/// Makes and bakes the shapes, which takes some seconds; `done` hears of each.
///
/// # Errors
/// If a shape cannot be baked.
pub fn bake_shapes(mut done: impl FnMut(usize)) -> Result<Vec<BakedShape>, BakeError> {
    let cap_grid = CapGridFormat { points: 10, ..CapGridFormat::DEFAULT };
    let settings = BakeSettings { cap_grid: Some(cap_grid), ..BakeSettings::two_point(33, 24) };
    let bake = |shape| {
        let mesh = shape_mesh(shape);
        let field = visfield_bake::bake(&mesh, &settings, |_rays| ())?;
        done(shape + 1);
        Ok(BakedShape { mesh, field })
    };
    (0..SHAPES).map(bake).collect()
}

/// The mesh of a shape: a star of the superformula (Gielis 2003) with lobes of its own, normalised to a radius of one.
pub fn shape_mesh(shape: usize) -> visfield_bake::Mesh {
    let around = LOBES_AROUND[shape % LOBES_AROUND.len()];
    let upwards = LOBES_UPWARDS[shape / LOBES_AROUND.len() % LOBES_UPWARDS.len()];
    let radius = |lobes: f32, angle: f32| {
        let (sin, cos) = (lobes * angle / 4.0).sin_cos();
        (cos.abs().powf(1.7) + sin.abs().powf(1.7)).powi(-3)
    };
    let mut positions = Vec::new();
    for stack in 0..=STACKS {
        let latitude = PI * (stack as f32 / STACKS as f32 - 0.5);
        for sector in 0..SECTORS {
            let longitude = TAU * sector as f32 / SECTORS as f32;
            let up = radius(upwards, latitude);
            let flat = up * radius(around, longitude) * latitude.cos();
            positions.push([flat * longitude.cos(), up * latitude.sin(), flat * longitude.sin()]);
        }
    }
    let largest = positions.iter().map(|&p| Vec3::from(p).length()).fold(0.0, f32::max);
    positions.iter_mut().flatten().for_each(|coordinate| *coordinate /= largest);
    let corner = |stack: u32, sector: u32| stack * SECTORS + sector % SECTORS;
    let quads = (0..STACKS).flat_map(|stack| (0..SECTORS).map(move |sector| (stack, sector)));
    let indices = quads
        .flat_map(|(stack, sector)| {
            let (low, high) = (stack, stack + 1);
            let [a, b, c, d] =
                [corner(low, sector), corner(high, sector), corner(high, sector + 1), corner(low, sector + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    visfield_bake::Mesh { name: format!("shape {shape}"), positions, indices }
}

/// The shapes in an app, each with a material of its own.
#[derive(Resource, Clone, Debug)]
pub struct CrowdShapes(Vec<(Mesh3d, MeshMaterial3d<StandardMaterial>, VisibilityField3d)>);

impl CrowdShapes {
    /// Hands the shapes to an app.
    ///
    /// # Panics
    /// If the app has no meshes, materials or fields: add Bevy's plugins and [`VisibilityFieldPlugin`] first.
    pub fn new(world: &mut World, shapes: &[BakedShape]) -> Self {
        let add = |(number, shape): (usize, &BakedShape)| {
            let mesh = world.resource_mut::<Assets<Mesh>>().add(to_bevy_mesh(&shape.mesh));
            let color = Color::hsl(number as f32 * 137.5 % 360.0, 0.45, 0.5);
            let material = StandardMaterial { base_color: color, perceptual_roughness: 0.8, ..default() };
            let material = world.resource_mut::<Assets<StandardMaterial>>().add(material);
            let field = world.resource_mut::<Assets<VisibilityField>>().add(VisibilityField(shape.field.clone()));
            (Mesh3d(mesh), MeshMaterial3d(material), VisibilityField3d(field))
        };
        Self(shapes.iter().enumerate().map(add).collect())
    }
}

/// One of a crowd.
///
/// ```
/// use visfield_workspace::crowd::{SPACING, members};
/// let (few, many) = (members(10), members(100));
/// assert!(few.iter().zip(&many).all(|(a, b)| a.transform_at(1.0) == b.transform_at(1.0)));
/// assert!(many.iter().all(|member| member.transform_at(0.0).translation.length() < 8.0 * SPACING));
/// ```
#[derive(Component, Clone, Copy, Debug)]
pub struct CrowdMember {
    shape: usize,
    site: Vec2,
    scale: f32,
    phase: f32,
}

impl CrowdMember {
    /// Where it is at a time in seconds.
    pub fn transform_at(&self, seconds: f32) -> Transform {
        let turn = (seconds * 0.15 + self.phase) * TAU;
        let at = self.site + Vec2::from_angle(turn) * 0.25 * SPACING;
        let height = self.scale * (0.75 + 0.35 * (2.0 * turn).sin());
        let axis = Vec3::new(self.phase - 0.5, 1.0, 0.5 - self.phase * self.phase).normalize();
        Transform {
            translation: Vec3::new(at.x, height, at.y),
            rotation: Quat::from_axis_angle(axis, turn),
            scale: Vec3::splat(self.scale),
        }
    }
}

/// A crowd of `count`, from its middle outwards.
pub fn members(count: usize) -> Vec<CrowdMember> {
    let half = ((count as f32 / PI).sqrt() + 2.0).ceil() as i32;
    let mut cells: Vec<(i32, i32)> = (-half..=half).flat_map(|x| (-half..=half).map(move |z| (x, z))).collect();
    cells.sort_by_key(|&(x, z)| (x * x + z * z, x, z));
    cells.truncate(count);
    cells
        .into_iter()
        .map(|(x, z)| {
            let random = |salt: i32| spread(x, z, salt);
            let jitter = Vec2::new(random(0), random(1)) - 0.5;
            CrowdMember {
                shape: (random(2) * SHAPES as f32) as usize % SHAPES,
                site: (Vec2::new(x as f32, z as f32) + jitter * 0.3) * SPACING,
                scale: 0.8 + 0.6 * random(3),
                phase: random(4),
            }
        })
        .collect()
}

/// A number from 0 to 1 that is another one for each cell and salt, and the same in every run.
fn spread(x: i32, z: i32, salt: i32) -> f32 {
    let mixed = [x, z, salt].iter().fold(0x9e37_79b9_u32, |hash, &number| {
        let hash = (hash ^ number as u32).wrapping_mul(0x85eb_ca6b);
        (hash ^ (hash >> 15)).wrapping_mul(0xc2b2_ae35)
    });
    (mixed ^ (mixed >> 13)) as f32 / u32::MAX as f32
}

/// How many there shall be, and the time that they are moved to, in seconds.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq)]
pub struct Crowd {
    /// Members.
    pub count: usize,
    /// Advance it to move them.
    pub seconds: f32,
}

/// Keeps as many members as [`Crowd`] says, and moves them.
pub fn plugin(app: &mut App) {
    app.init_resource::<Crowd>().add_systems(Update, (fit_crowd, move_crowd).chain());
}

/// Replaces the crowd when its size changes.
fn fit_crowd(
    mut commands: Commands,
    crowd: Res<Crowd>,
    shapes: Option<Res<CrowdShapes>>,
    present: Query<Entity, With<CrowdMember>>,
) {
    let Some(shapes) = shapes.filter(|_| present.iter().len() != crowd.count) else { return };
    present.iter().for_each(|member| commands.entity(member).despawn());
    let spawned: Vec<_> = members(crowd.count)
        .into_iter()
        .map(|member| (member, shapes.0[member.shape].clone(), member.transform_at(crowd.seconds)))
        .collect();
    commands.spawn_batch(spawned);
}

fn move_crowd(crowd: Res<Crowd>, mut members: Query<(&CrowdMember, &mut Transform)>) {
    members.par_iter_mut().for_each(|(member, mut transform)| *transform = member.transform_at(crowd.seconds));
}

/// Spawns the plane that the crowd is over, the sun, and the sky's light.
pub fn spawn_surroundings(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let ground =
        StandardMaterial { base_color: Color::linear_rgb(0.5, 0.48, 0.45), perceptual_roughness: 0.95, ..default() };
    let plane = meshes.add(Plane3d::new(Vec3::Y, Vec2::splat(1_000.0)));
    commands.spawn((Mesh3d(plane), MeshMaterial3d(materials.add(ground))));
    commands.spawn((
        DirectionalLight { illuminance: 5_000.0, color: Color::srgb(1.0, 0.95, 0.85), ..default() },
        Transform::default().looking_to(-Vec3::new(0.5, 1.0, 0.35), Vec3::Y),
        FieldShadows::default(),
    ));
    commands.insert_resource(GlobalAmbientLight {
        color: Color::srgb(0.85, 0.92, 1.0),
        brightness: 1_000.0,
        ..default()
    });
}

/// A camera over the middle that looks down: all it sees lies within a crowd of a hundred, and so looks the same in every larger
/// one.
pub fn overhead_camera() -> Transform {
    Transform::from_xyz(0.0, 10.0, 6.0).looking_at(Vec3::ZERO, Vec3::Y)
}

/// A camera that flies over the crowd in a circle and looks ahead and a little down, at a share of its way.
///
/// ```
/// use visfield_workspace::crowd::flying_camera;
/// assert!(flying_camera(0.0).translation.abs_diff_eq(flying_camera(1.0).translation, 1e-3));
/// ```
pub fn flying_camera(share: f32) -> Transform {
    let on_path = |share: f32| {
        let along = Vec2::from_angle(share * TAU) * 14.0;
        Vec3::new(along.x, 5.0 + (share * TAU * 2.0).sin(), along.y)
    };
    let ahead = on_path(share + 0.09);
    Transform::from_translation(on_path(share)).looking_at(Vec3::new(ahead.x, 0.5, ahead.z), Vec3::Y)
}
