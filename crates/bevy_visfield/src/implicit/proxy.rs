//! The boxes in which surfaces are drawn: children of the entities, kept in step with them.

use std::collections::{HashMap, HashSet};

use bevy::asset::RenderAssetUsages;
use bevy::camera::visibility::RenderLayers;
use bevy::light::{NotShadowCaster, NotShadowReceiver};
use bevy::mesh::{Indices, MeshTag, PrimitiveTopology};
use bevy::prelude::*;
use bevy::render::storage::ShaderBuffer;
use visfield::distance::DistanceField;
use visfield::gpu::layout::distance_words;
use visfield::shape::{Shape, ShapeExtent};

use super::ImplicitSurface3d;
use super::material::{SurfaceExtension, SurfaceMaterial, SurfaceUniform, edges, solid};
use crate::asset::VisibilityField;
use crate::components::VisibilityField3d;

/// The boxes of a surface.
#[derive(Component)]
struct SurfaceBoxes([Entity; 2]);

/// What the boxes of equal surfaces share, so that they are drawn together.
#[derive(Clone)]
struct SharedBoxes {
    mesh: Handle<Mesh>,
    materials: [Handle<SurfaceMaterial>; 2],
}

/// The field, and the material by which it is lit.
type SharedKey = (AssetId<VisibilityField>, Option<AssetId<StandardMaterial>>);

/// What surfaces of the same field share.
#[derive(Clone)]
struct SharedField {
    mesh: Handle<Mesh>,
    extension: SurfaceExtension,
}

#[derive(Resource, Default)]
struct Shared {
    /// `None` for fields of which there is nothing to draw.
    fields: HashMap<AssetId<VisibilityField>, Option<SharedField>>,
    boxes: HashMap<SharedKey, SharedBoxes>,
}

pub(super) fn plugin(app: &mut App) {
    app.init_resource::<Shared>().add_observer(remove_boxes).add_systems(
        PostUpdate,
        (cast, forget_changed, place_boxes, follow_surfaces).chain().before(TransformSystems::Propagate),
    );
}

/// A surface casts what it shows.
fn cast(mut commands: Commands, changed: Query<(Entity, &ImplicitSurface3d), Changed<ImplicitSurface3d>>) {
    for (entity, surface) in &changed {
        commands.entity(entity).try_insert(VisibilityField3d(surface.0.clone()));
    }
}

/// Drops what was made of assets that changed or went.
fn forget_changed(
    mut fields: MessageReader<AssetEvent<VisibilityField>>,
    mut materials: MessageReader<AssetEvent<StandardMaterial>>,
    mut shared: ResMut<Shared>,
) {
    let fields: HashSet<_> = fields.read().filter_map(changed_asset).collect();
    let materials: HashSet<_> = materials.read().filter_map(changed_asset).collect();
    if !(fields.is_empty() && materials.is_empty()) {
        let changed = |material: &Option<_>| material.is_some_and(|material| materials.contains(&material));
        shared.fields.retain(|field, _| !fields.contains(field));
        shared.boxes.retain(|(field, material), _| !fields.contains(field) && !changed(material));
    }
}

fn changed_asset<A: Asset>(event: &AssetEvent<A>) -> Option<AssetId<A>> {
    match event {
        AssetEvent::Modified { id } | AssetEvent::Removed { id } => Some(*id),
        _ => None,
    }
}

/// Gives each surface whose assets have arrived its boxes.
fn place_boxes(
    mut commands: Commands,
    fields: Res<Assets<VisibilityField>>,
    standard: Res<Assets<StandardMaterial>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut buffers: ResMut<Assets<ShaderBuffer>>,
    mut materials: ResMut<Assets<SurfaceMaterial>>,
    mut shared: ResMut<Shared>,
    surfaces: Query<(Entity, &ImplicitSurface3d, Option<&MeshMaterial3d<StandardMaterial>>, Option<&SurfaceBoxes>)>,
    boxes: Query<(&Mesh3d, &MeshMaterial3d<SurfaceMaterial>)>,
) {
    let Shared { fields: shared_fields, boxes: shared_boxes } = &mut *shared;
    for (entity, surface, material, placed) in &surfaces {
        let Some(field) = fields.get(surface.id()) else { continue };
        let drawn = shared_fields
            .entry(surface.id())
            .or_insert_with(|| drawable(field).map(|distance| share(distance, &mut meshes, &mut buffers)));
        let Some(drawn) = drawn else {
            if let Some(placed) = placed {
                despawn_boxes(&mut commands, placed);
                commands.entity(entity).try_remove::<SurfaceBoxes>();
            }
            continue;
        };
        let key = (surface.id(), material.map(|material| material.id()));
        let made = shared_boxes.get(&key).cloned().or_else(|| {
            let default = StandardMaterial::default();
            let base = match material {
                Some(material) => standard.get(material.id())?,
                None => &default,
            };
            let both = [solid, edges].map(|box_of| materials.add(box_of(base, drawn.extension.clone())));
            let made = SharedBoxes { mesh: drawn.mesh.clone(), materials: both };
            shared_boxes.insert(key, made.clone());
            Some(made)
        });
        let Some(made) = made else { continue };
        match placed {
            None => {
                let children = made.materials.clone().map(|material| {
                    let surface_box = (Mesh3d(made.mesh.clone()), MeshMaterial3d(material), NotShadowCaster);
                    commands.spawn((surface_box, ChildOf(entity))).id()
                });
                commands.entity(entity).try_insert(SurfaceBoxes(children));
            }
            Some(SurfaceBoxes(children)) => {
                for (child, material) in children.iter().zip(&made.materials) {
                    let as_it_should =
                        boxes.get(*child).is_ok_and(|(mesh, old)| mesh.0 == made.mesh && old.0 == *material);
                    if !as_it_should && let Ok(mut child) = commands.get_entity(*child) {
                        child.try_insert((Mesh3d(made.mesh.clone()), MeshMaterial3d(material.clone())));
                    }
                }
            }
        }
    }
    let used: HashSet<SharedKey> = surfaces
        .iter()
        .map(|(_, surface, material, _)| (surface.id(), material.map(|material| material.id())))
        .collect();
    let used_fields: HashSet<_> = used.iter().map(|(field, _)| *field).collect();
    shared_fields.retain(|field, _| used_fields.contains(field));
    shared_boxes.retain(|key, _| used.contains(key));
}

/// The distances of a field, if there is something to draw; says so if that is for a reason that its author can change.
fn drawable(field: &VisibilityField) -> Option<&DistanceField> {
    let name = &field.header().name;
    let Some(distance) = field.distance_field() else {
        warn!(
            "the field \"{name}\" of an ImplicitSurface3d has no distances: it is not drawn. Bake it with a distance grid \
             (`--representation distance`), or make it of a shape (VisibilityField::of_shape)."
        );
        return None;
    };
    match distance.shape().map(Shape::extent) {
        Some(ShapeExtent::Empty) => None,
        Some(ShapeExtent::Unbounded) => {
            warn!(
                "the shape \"{name}\" of an ImplicitSurface3d has no end: it is not drawn. Intersect it with a Shape::Box that is as \
                 large as can be seen of it."
            );
            None
        }
        Some(ShapeExtent::Bounded(_)) | None => Some(distance),
    }
}

/// Puts distances into a buffer, and a box around them.
fn share(distance: &DistanceField, meshes: &mut Assets<Mesh>, buffers: &mut Assets<ShaderBuffer>) -> SharedField {
    let surface = SurfaceUniform::new(distance);
    let words = distance_words(distance);
    let pool = buffers.add(ShaderBuffer::new(bytemuck::cast_slice(&words), RenderAssetUsages::RENDER_WORLD));
    SharedField {
        mesh: meshes.add(box_mesh(surface.center, surface.half_extents)),
        extension: SurfaceExtension { surface, pool },
    }
}

fn despawn_boxes(commands: &mut Commands, SurfaceBoxes(children): &SurfaceBoxes) {
    for child in children {
        if let Ok(mut child) = commands.get_entity(*child) {
            child.try_despawn();
        }
    }
}

/// Keeps what Bevy does not inherit in step.
fn follow_surfaces(
    mut commands: Commands,
    surfaces: Query<(&SurfaceBoxes, Option<&RenderLayers>, Has<NotShadowReceiver>, Option<&MeshTag>)>,
    boxes: Query<(Option<&RenderLayers>, Has<NotShadowReceiver>, Option<&MeshTag>)>,
) {
    for (SurfaceBoxes(children), layers, not_receiver, tag) in &surfaces {
        for child in children {
            let Ok((old_layers, was_not_receiver, old_tag)) = boxes.get(*child) else { continue };
            if old_layers != layers {
                match layers {
                    Some(layers) => commands.entity(*child).try_insert(layers.clone()),
                    None => commands.entity(*child).try_remove::<RenderLayers>(),
                };
            }
            if was_not_receiver != not_receiver {
                if not_receiver {
                    commands.entity(*child).try_insert(NotShadowReceiver);
                } else {
                    commands.entity(*child).try_remove::<NotShadowReceiver>();
                }
            }
            if old_tag.map(|tag| tag.0) != tag.map(|tag| tag.0) {
                match tag {
                    Some(tag) => commands.entity(*child).try_insert(tag.clone()),
                    None => commands.entity(*child).try_remove::<MeshTag>(),
                };
            }
        }
    }
}

/// The boxes of what is no longer a surface go.
fn remove_boxes(removed: On<Remove, ImplicitSurface3d>, mut commands: Commands, surfaces: Query<&SurfaceBoxes>) {
    let Ok(placed) = surfaces.get(removed.entity) else { return };
    despawn_boxes(&mut commands, placed);
    commands.entity(removed.entity).try_remove::<SurfaceBoxes>();
}

/// A box of six faces with four corners each; the vertex shader places them by their number and needs no more than as many. The positions
/// are those that Bevy culls by.
fn box_mesh(center: Vec3, half_extents: Vec3) -> Mesh {
    let corner = |index: u16| {
        let sign = |bit: u16| if index & bit == 0 { -1.0 } else { 1.0 };
        (center + half_extents * Vec3::new(sign(1), sign(2), sign(4))).to_array()
    };
    let positions: Vec<[f32; 3]> = (0..24).map(corner).collect();
    let indices = (0..6).flat_map(|face: u16| [0, 1, 2, 0, 2, 3].map(|corner| 4 * face + corner)).collect();
    Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![[0.0, 0.0, 1.0]; 24])
        .with_inserted_indices(Indices::U16(indices))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn app() -> App {
        let mut app = App::new();
        app.add_plugins((TaskPoolPlugin::default(), AssetPlugin::default(), plugin))
            .init_asset::<VisibilityField>()
            .init_asset::<StandardMaterial>()
            .init_asset::<SurfaceMaterial>()
            .init_asset::<ShaderBuffer>()
            .init_asset::<Mesh>();
        app
    }

    fn add(app: &mut App, field: visfield::VisibilityField) -> Handle<VisibilityField> {
        app.world_mut().resource_mut::<Assets<VisibilityField>>().add(VisibilityField(field))
    }

    fn ball(app: &mut App) -> Handle<VisibilityField> {
        add(app, visfield::VisibilityField::of_shape(Shape::Sphere { radius: 0.9 }).unwrap())
    }

    fn boxes(app: &mut App) -> Vec<(AssetId<Mesh>, AssetId<SurfaceMaterial>)> {
        let world = app.world_mut();
        let mut boxes = world.query::<(&Mesh3d, &MeshMaterial3d<SurfaceMaterial>)>();
        boxes.iter(world).map(|(mesh, material)| (mesh.id(), material.id())).collect()
    }

    #[test]
    fn boxes_come_are_shared_and_go() {
        let mut app = app();
        let field = ball(&mut app);
        let material = app.world_mut().resource_mut::<Assets<StandardMaterial>>().add(StandardMaterial::default());
        let waiting = app.world_mut().spawn(ImplicitSurface3d::default()).id();
        let one = app.world_mut().spawn((ImplicitSurface3d(field.clone()), MeshMaterial3d(material.clone()))).id();
        let other = app.world_mut().spawn((ImplicitSurface3d(field.clone()), MeshMaterial3d(material.clone()))).id();
        app.update();
        let placed = boxes(&mut app);
        assert_eq!(placed.len(), 4, "two boxes each, none for the field that is not there");
        assert_eq!(placed.iter().collect::<HashSet<_>>().len(), 2, "both surfaces share them");
        assert_eq!(app.world().get::<VisibilityField3d>(one).map(|field| field.id()), Some(field.id()), "it casts");
        assert_eq!(app.world().get::<VisibilityField3d>(waiting).map(|field| field.id()), Some(AssetId::default()));

        // Another colour, another field.
        let next = ball(&mut app);
        if let Some(mut material) = app.world_mut().resource_mut::<Assets<StandardMaterial>>().get_mut(&material) {
            material.base_color = Color::BLACK;
        }
        app.world_mut().entity_mut(other).insert(ImplicitSurface3d(next));
        app.update();
        app.update();
        let changed = boxes(&mut app);
        assert_eq!(changed.len(), 4);
        assert!(changed.iter().all(|new| !placed.contains(new)), "{placed:?} {changed:?}");
        let materials = app.world().resource::<Assets<SurfaceMaterial>>();
        let black =
            |(_, id): &(_, AssetId<SurfaceMaterial>)| materials.get(*id).unwrap().base.base_color == Color::BLACK;
        assert!(changed.iter().all(black));

        app.world_mut().entity_mut(one).remove::<ImplicitSurface3d>();
        app.world_mut().despawn(other);
        app.world_mut().despawn(waiting);
        app.update();
        assert_eq!(boxes(&mut app), []);
        app.update();
        let shared = app.world().resource::<Shared>();
        assert!(shared.boxes.is_empty() && shared.fields.is_empty());
    }

    #[test]
    fn surfaces_of_the_same_field_share_its_distances() {
        let mut app = app();
        let field = ball(&mut app);
        for _ in 0..2 {
            let material = app.world_mut().resource_mut::<Assets<StandardMaterial>>().add(StandardMaterial::default());
            app.world_mut().spawn((ImplicitSurface3d(field.clone()), MeshMaterial3d(material)));
        }
        app.update();
        assert_eq!(boxes(&mut app).len(), 4);
        assert_eq!(app.world().resource::<Assets<ShaderBuffer>>().len(), 1);
    }

    #[test]
    fn what_is_not_to_be_drawn_has_no_boxes() {
        let mut app = app();
        let without = add(&mut app, visfield::field::ball_field(0.9, 3, 2));
        let endless = add(&mut app, visfield::VisibilityField::of_shape(Shape::HalfSpace).unwrap());
        let nothing = add(&mut app, visfield::VisibilityField::of_shape(Shape::Union(vec![])).unwrap());
        for field in [without, endless, nothing] {
            app.world_mut().spawn(ImplicitSurface3d(field));
        }
        let field = ball(&mut app);
        app.world_mut().spawn(ImplicitSurface3d(field.clone()));
        app.update();
        assert_eq!(boxes(&mut app).len(), 2, "only the ball's");
        // What was drawn, and is nothing now.
        if let Some(mut ball) = app.world_mut().resource_mut::<Assets<VisibilityField>>().get_mut(&field) {
            *ball = VisibilityField(visfield::VisibilityField::of_shape(Shape::Union(vec![])).unwrap());
        }
        app.update();
        app.update();
        assert_eq!(boxes(&mut app), []);
    }

    #[test]
    fn boxes_take_after_their_surface() {
        let mut app = app();
        let field = ball(&mut app);
        let layers = RenderLayers::layer(3);
        let surface =
            app.world_mut().spawn((ImplicitSurface3d(field), layers.clone(), NotShadowReceiver, MeshTag(7))).id();
        app.update();
        let SurfaceBoxes(children) = *app.world().get::<SurfaceBoxes>(surface).unwrap();
        app.update();
        for child in children {
            let child = app.world().entity(child);
            assert!(child.contains::<NotShadowReceiver>() && child.contains::<NotShadowCaster>());
            assert_eq!(child.get::<RenderLayers>(), Some(&layers));
            assert_eq!(child.get::<MeshTag>().map(|tag| tag.0), Some(7));
        }
        app.world_mut().entity_mut(surface).remove::<(RenderLayers, NotShadowReceiver, MeshTag)>();
        app.update();
        for child in children {
            let child = app.world().entity(child);
            assert!(!child.contains::<NotShadowReceiver>() && !child.contains::<RenderLayers>());
            assert!(!child.contains::<MeshTag>());
        }
    }
}
