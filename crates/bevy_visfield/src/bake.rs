//! Fields baked at run time, in the background (feature `bake`). Shipping games bake in their asset pipeline; this serves
//! editors, prototypes and generated meshes.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use bevy::mesh::{Indices, PrimitiveTopology, VertexAttributeValues};
use bevy::prelude::*;
use bevy::tasks::{AsyncComputeTaskPool, Task, futures::check_ready};
use visfield_bake::{BakeError, BakeSettings};

use crate::asset::VisibilityField;
use crate::components::VisibilityField3d;

/// Bakes a field from the `Mesh3d` on the same entity, in the background; when done, gives the entity its
/// [`VisibilityField3d`] and removes itself. Entities that share a mesh and settings share one bake and one field.
///
/// The mesh must be a triangle list with float positions, and its data must stay in the main world
/// (`RenderAssetUsages::MAIN_WORLD`, as glTF files and `Assets::add` leave it by default). A mesh that cannot be baked is
/// told in one error, and its entity stays without a field.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::bake::BakeVisibilityField;
/// fn generated(mesh: Handle<Mesh>, material: Handle<StandardMaterial>) -> impl Bundle {
///     (Mesh3d(mesh), MeshMaterial3d(material), BakeVisibilityField::default())
/// }
/// ```
#[derive(Component, Clone, Copy, Debug, Default)]
#[require(BakeProgress)]
pub struct BakeVisibilityField {
    /// How fine the field is.
    pub settings: BakeSettings,
}

/// How far the bake of an entity's field is, from 0 to 1; removed together with [`BakeVisibilityField`].
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::bake::BakeProgress;
/// fn report(bakes: Query<&BakeProgress>) {
///     for progress in &bakes {
///         info!("{:.0} %", progress.0 * 100.0);
///     }
/// }
/// ```
#[derive(Component, Reflect, Clone, Copy, Debug, Default, PartialEq)]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct BakeProgress(pub f32);

pub(crate) fn plugin(app: &mut App) {
    app.register_type::<BakeProgress>().init_resource::<Bakes>().add_systems(Update, bake_in_background);
}

/// What identifies a bake: the mesh, and the table's sides.
type BakeKey = (AssetId<Mesh>, u32, u32);

/// The bakes so far. Finished ones stay as weak ids, so that later entities with the same mesh share the field while it
/// lives.
#[derive(Resource, Default)]
struct Bakes(HashMap<BakeKey, Bake>);

enum Bake {
    Running { task: Task<Result<visfield::VisibilityField, BakeError>>, rays_done: Arc<AtomicU64> },
    Finished(AssetId<VisibilityField>),
    Failed,
}

fn bake_in_background(
    mut commands: Commands,
    mut bakes: ResMut<Bakes>,
    mut fields: ResMut<Assets<VisibilityField>>,
    meshes: Res<Assets<Mesh>>,
    mut waiting: Query<(Entity, &Mesh3d, &BakeVisibilityField, &mut BakeProgress)>,
) {
    // Fields that finish in this very frame, held until all their entities have them.
    let mut finished: HashMap<BakeKey, Handle<VisibilityField>> = HashMap::new();
    for (entity, mesh, request, mut progress) in &mut waiting {
        let key = (mesh.id(), request.settings.entries, request.settings.exits);
        if let Some(Bake::Finished(id)) = bakes.0.get(&key) {
            if let Some(handle) = fields.get_strong_handle(*id) {
                finished.entry(key).or_insert(handle);
            } else {
                // All its users are gone, and the field with them.
                bakes.0.remove(&key);
            }
        }
        let bake = match bakes.0.entry(key) {
            Entry::Occupied(bake) => bake.into_mut(),
            Entry::Vacant(place) => {
                // Not loaded yet: ask again next frame.
                let Some(mesh) = meshes.get(key.0) else { continue };
                place.insert(start(mesh, key.0.to_string(), request.settings))
            }
        };
        if let Bake::Running { task, rays_done } = bake {
            progress.0 = rays_done.load(Ordering::Relaxed) as f32 / request.settings.rays().max(1) as f32;
            match check_ready(task) {
                None => continue,
                Some(Ok(field)) => {
                    let handle = fields.add(VisibilityField(field));
                    *bake = Bake::Finished(handle.id());
                    finished.insert(key, handle);
                }
                Some(Err(error)) => {
                    error!("a mesh cannot be baked, it will not occlude: {error}");
                    *bake = Bake::Failed;
                }
            }
        }
        let mut entity = commands.entity(entity);
        entity.remove::<(BakeVisibilityField, BakeProgress)>();
        if let Some(handle) = finished.get(&key) {
            entity.insert(VisibilityField3d(handle.clone()));
        }
    }
}

fn start(mesh: &Mesh, name: String, settings: BakeSettings) -> Bake {
    let mesh = to_bake_mesh(mesh, name);
    let rays_done = Arc::new(AtomicU64::new(0));
    let counter = Arc::clone(&rays_done);
    let task = AsyncComputeTaskPool::get().spawn(async move {
        visfield_bake::bake(&mesh, &settings, |rays| {
            counter.fetch_add(rays, Ordering::Relaxed);
        })
    });
    Bake::Running { task, rays_done }
}

/// The positions and triangles of a Bevy mesh; a mesh of another kind becomes one without triangles, which the bake refuses
/// with a reason.
fn to_bake_mesh(mesh: &Mesh, name: String) -> visfield_bake::Mesh {
    let positions = match mesh.attribute(Mesh::ATTRIBUTE_POSITION) {
        Some(VertexAttributeValues::Float32x3(positions)) => positions.clone(),
        _ => Vec::new(),
    };
    let corners: Vec<u32> = match (mesh.primitive_topology(), mesh.indices()) {
        (PrimitiveTopology::TriangleList, Some(Indices::U16(indices))) => {
            indices.iter().map(|&i| u32::from(i)).collect()
        }
        (PrimitiveTopology::TriangleList, Some(Indices::U32(indices))) => indices.clone(),
        (PrimitiveTopology::TriangleList, None) => (0..positions.len() as u32).collect(),
        _ => Vec::new(),
    };
    let (triangles, _rest) = corners.as_chunks::<3>();
    visfield_bake::Mesh { name, positions, indices: triangles.to_vec() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::asset::AssetPlugin;

    fn app() -> App {
        let mut app = App::new();
        app.add_plugins((MinimalPlugins, AssetPlugin::default()))
            .init_asset::<Mesh>()
            .init_asset::<VisibilityField>()
            .add_plugins(plugin);
        app
    }

    fn run_until_done(app: &mut App) {
        for _ in 0..2000 {
            app.update();
            if app.world_mut().query::<&BakeVisibilityField>().iter(app.world()).next().is_none() {
                return;
            }
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        panic!("the bake did not end");
    }

    const SMALL: BakeVisibilityField = BakeVisibilityField { settings: BakeSettings { entries: 9, exits: 8 } };

    #[test]
    fn entities_with_the_same_mesh_share_a_field() {
        let mut app = app();
        let mesh = app.world_mut().resource_mut::<Assets<Mesh>>().add(Sphere::new(1.0));
        let spawn = |app: &mut App| app.world_mut().spawn((Mesh3d(mesh.clone()), SMALL)).id();
        let (first, second) = (spawn(&mut app), spawn(&mut app));
        run_until_done(&mut app);
        let late = spawn(&mut app);
        run_until_done(&mut app);
        let field = |entity: Entity| app.world().entity(entity).get::<VisibilityField3d>().cloned().unwrap();
        assert_eq!(field(first), field(second));
        assert_eq!(field(first), field(late));
        assert_eq!(app.world().resource::<Assets<VisibilityField>>().len(), 1);
    }

    #[test]
    fn a_mesh_that_cannot_be_baked_is_told_and_left() {
        let mut app = app();
        let lines = Mesh::new(PrimitiveTopology::LineList, bevy::asset::RenderAssetUsages::default());
        let mesh = app.world_mut().resource_mut::<Assets<Mesh>>().add(lines);
        let entity = app.world_mut().spawn((Mesh3d(mesh), SMALL)).id();
        run_until_done(&mut app);
        assert!(app.world().entity(entity).get::<VisibilityField3d>().is_none());
    }
}
