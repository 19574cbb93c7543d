//! Fields baked at run time, in the background (feature `bake`). Shipping games bake in their asset pipeline; this serves
//! editors, prototypes and generated meshes.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use bevy::asset::RenderAssetUsages;
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
/// told in an error, and its entity stays without a field; insert the component again after a repair. When a mesh is
/// modified, entities keep the field they have: insert the component again for a new one.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::bake::BakeVisibilityField;
/// fn generated(mesh: Handle<Mesh>, material: Handle<StandardMaterial>) -> impl Bundle {
///     (Mesh3d(mesh), MeshMaterial3d(material), BakeVisibilityField::default())
/// }
/// ```
#[derive(Component, Reflect, Clone, Copy, Debug, Default)]
#[reflect(Component, Default, Clone)]
#[require(BakeProgress)]
pub struct BakeVisibilityField {
    /// What the field stores. Only two-point representations are rendered.
    #[reflect(ignore)]
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
    app.register_type::<BakeVisibilityField>()
        .register_type::<BakeProgress>()
        .init_resource::<Bakes>()
        .add_systems(Update, bake_in_background);
}

/// What identifies a bake.
type BakeKey = (AssetId<Mesh>, BakeSettings);

/// The bakes so far. Finished ones stay as weak ids, so that later entities with the same mesh share the field while it
/// lives.
#[derive(Resource, Default)]
struct Bakes(HashMap<BakeKey, Bake>);

enum Bake {
    Running { task: Task<Result<visfield::VisibilityField, BakeError>>, rays_done: Arc<AtomicU64> },
    Finished(AssetId<VisibilityField>),
}

fn bake_in_background(
    mut commands: Commands,
    mut bakes: ResMut<Bakes>,
    mut fields: ResMut<Assets<VisibilityField>>,
    meshes: Res<Assets<Mesh>>,
    server: Res<AssetServer>,
    mut changes: MessageReader<AssetEvent<Mesh>>,
    mut waiting: Query<(Entity, &Mesh3d, &BakeVisibilityField, &mut BakeProgress)>,
) {
    for change in changes.read() {
        if let AssetEvent::Modified { id } | AssetEvent::Removed { id } = change {
            bakes.0.retain(|(mesh, ..), _| mesh != id);
        }
    }
    // What ended in this very frame, for all the entities that wait for it.
    let mut ended: HashMap<BakeKey, Outcome> = HashMap::new();
    for (entity, mesh, request, mut progress) in &mut waiting {
        let key = (mesh.id(), request.settings);
        let outcome = match ended.entry(key) {
            Entry::Occupied(outcome) => outcome.get().clone(),
            Entry::Vacant(place) => {
                let outcome = bakes.advance(key, &mut progress, &mut fields, &meshes, &server);
                let Some(outcome) = outcome else { continue };
                place.insert(outcome).clone()
            }
        };
        let mut entity = commands.entity(entity);
        entity.try_remove::<(BakeVisibilityField, BakeProgress)>();
        if let Outcome::Baked(handle) = outcome {
            entity.try_insert(VisibilityField3d(handle));
        }
    }
}

/// How a bake ended.
#[derive(Clone)]
enum Outcome {
    Baked(Handle<VisibilityField>),
    /// The reason has been told.
    Failed,
}

impl Bakes {
    /// Starts a bake or looks after it; `None` until it has ended, or while its mesh has yet to load.
    fn advance(
        &mut self,
        key: BakeKey,
        progress: &mut BakeProgress,
        fields: &mut Assets<VisibilityField>,
        meshes: &Assets<Mesh>,
        server: &AssetServer,
    ) -> Option<Outcome> {
        if let Some(Bake::Finished(id)) = self.0.get(&key) {
            match fields.get_strong_handle(*id) {
                Some(handle) => return Some(Outcome::Baked(handle)),
                // All its users are gone, and the field with them.
                None => self.0.remove(&key),
            };
        }
        let bake = match self.0.entry(key) {
            Entry::Occupied(bake) => bake.into_mut(),
            Entry::Vacant(place) => match meshes.get(key.0) {
                Some(mesh) => place.insert(start(mesh, key.0.to_string(), key.1)),
                // The asset server has told why.
                None if server.load_state(key.0).is_failed() => return Some(Outcome::Failed),
                None => return None,
            },
        };
        let Bake::Running { task, rays_done } = bake else { return None };
        progress.0 = rays_done.load(Ordering::Relaxed) as f32 / key.1.rays().max(1) as f32;
        match check_ready(task)? {
            Ok(field) => {
                let handle = fields.add(VisibilityField(field));
                *bake = Bake::Finished(handle.id());
                Some(Outcome::Baked(handle))
            }
            Err(error) => {
                error!("a mesh cannot be baked, it will not occlude: {error}");
                self.0.remove(&key);
                Some(Outcome::Failed)
            }
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

/// The positions and triangles of a Bevy mesh. A mesh of another kind, or whose data left the main world, becomes one
/// without triangles, which the bake refuses with a reason.
fn to_bake_mesh(mesh: &Mesh, name: String) -> visfield_bake::Mesh {
    let positions = match mesh.try_attribute_option(Mesh::ATTRIBUTE_POSITION) {
        Ok(Some(VertexAttributeValues::Float32x3(positions))) => positions.clone(),
        _ => Vec::new(),
    };
    let corners: Vec<u32> = match (mesh.primitive_topology(), mesh.try_indices_option()) {
        (PrimitiveTopology::TriangleList, Ok(Some(Indices::U16(indices)))) => {
            indices.iter().map(|&i| u32::from(i)).collect()
        }
        (PrimitiveTopology::TriangleList, Ok(Some(Indices::U32(indices)))) => indices.clone(),
        (PrimitiveTopology::TriangleList, Ok(None)) => (0..positions.len() as u32).collect(),
        _ => Vec::new(),
    };
    let (triangles, _rest) = corners.as_chunks::<3>();
    visfield_bake::Mesh { name, positions, indices: triangles.to_vec() }
}

/// A mesh that was read for a bake, as Bevy draws it: smooth normals, no texture coordinates. For models in formats that
/// Bevy does not load itself. The mesh should be [valid](visfield_bake::Mesh::validate).
///
/// ```
/// use bevy::prelude::*;
/// fn show(mesh: &visfield_bake::Mesh, meshes: &mut Assets<Mesh>) -> Mesh3d {
///     Mesh3d(meshes.add(bevy_visfield::bake::to_bevy_mesh(mesh)))
/// }
/// ```
pub fn to_bevy_mesh(mesh: &visfield_bake::Mesh) -> Mesh {
    Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, mesh.positions.clone())
        .with_inserted_indices(Indices::U32(mesh.indices.as_flattened().to_vec()))
        .with_computed_smooth_normals()
}

#[cfg(test)]
mod tests {
    use super::*;

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

    const SMALL: BakeVisibilityField = BakeVisibilityField { settings: BakeSettings::two_point(9, 8) };

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
        let lines = Mesh::new(PrimitiveTopology::LineList, RenderAssetUsages::default());
        let mesh = app.world_mut().resource_mut::<Assets<Mesh>>().add(lines);
        let entity = app.world_mut().spawn((Mesh3d(mesh), SMALL)).id();
        run_until_done(&mut app);
        assert!(app.world().entity(entity).get::<VisibilityField3d>().is_none());
    }
}
