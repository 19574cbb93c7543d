//! What a surface receives, per entity: components, kept in two bits of the mesh's tag, which the prepass writes into the
//! alpha channel of its normals, where the frame's passes read it.

use bevy::mesh::MeshTag;
use bevy::prelude::*;

use crate::shader_patch::{ShaderPatch, patch_shaders, replace_exactly};

/// Keeps an entity's mesh from receiving ambient occlusion from visibility fields, until this marker is removed. Shadows of
/// lights it still receives, unless it has Bevy's `NotShadowReceiver` too.
///
/// It belongs on the entity of the mesh itself. The upper two bits of that entity's `MeshTag` are taken by it, as by
/// [`OwnSurfaceOcclusion`]; materials of your own that read the tag should ignore them.
///
/// ```
/// use bevy::{light::NotShadowReceiver, prelude::*};
/// use bevy_visfield::NotFieldReceiver;
/// fn hologram(mesh: Mesh3d) -> impl Bundle {
///     (mesh, NotFieldReceiver, NotShadowReceiver)
/// }
/// ```
#[derive(Component, Reflect, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct NotFieldReceiver;

/// Whether an entity with a [`VisibilityField3d`](crate::VisibilityField3d) occludes its own surface: its ambient light, and
/// that of lights with [`FieldShadows`](crate::FieldShadows). Others it occludes either way, and they it.
///
/// A field resolves an object's own creases less well than what is around it. Where it is too coarse, turn it off, and let
/// Bevy's screen-space ambient occlusion and shadow maps do those.
///
/// It belongs on the entity of the mesh itself, beside the field. The upper two bits of that entity's `MeshTag` are taken by
/// it, as by [`NotFieldReceiver`]; materials of your own that read the tag should ignore them.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::{OwnSurfaceOcclusion, VisibilityField3d};
/// fn crate_of_planks(mesh: Mesh3d, field: VisibilityField3d) -> impl Bundle {
///     (mesh, field, OwnSurfaceOcclusion::Off)
/// }
/// ```
#[derive(Component, Reflect, Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[reflect(Component, Default, Clone, PartialEq, Hash)]
pub enum OwnSurfaceOcclusion {
    /// It does, as without this component.
    #[default]
    On,
    /// It does not.
    Off,
}

/// The bits of a mesh's tag that are ours. Without them, the prepass writes what Bevy's own writes: alpha 1.
const FLAGS: u32 = OWN_SURFACE_OFF | NOT_RECEIVER;
/// The surface is not occluded by its own field: alpha 2/3, or 0 if it has both flags.
const OWN_SURFACE_OFF: u32 = 1 << 30;
/// The surface receives no ambient occlusion: alpha 1/3, or 0 if it has both flags.
const NOT_RECEIVER: u32 = 1 << 31;

/// Adds what keeps the flags in step, and writes them in the prepass: nothing that an inert plugin should do.
pub(crate) fn keep_receiver_flags(app: &mut App) {
    app.add_systems(PostUpdate, keep_flags);
    patch_shaders(app, PREPASS_PATCHES);
}

/// Keeps our bits of the tag in step with the components, and leaves the user's as they are.
fn keep_flags(
    mut commands: Commands,
    changed: Query<
        Entity,
        (
            Or<(With<NotFieldReceiver>, With<OwnSurfaceOcclusion>)>,
            Or<(Added<NotFieldReceiver>, Changed<OwnSurfaceOcclusion>, Changed<MeshTag>)>,
        ),
    >,
    mut removed_receivers: RemovedComponents<NotFieldReceiver>,
    mut removed_own: RemovedComponents<OwnSurfaceOcclusion>,
    mut removed_tags: RemovedComponents<MeshTag>,
    receivers: Query<(Option<&MeshTag>, Has<NotFieldReceiver>, Option<&OwnSurfaceOcclusion>)>,
) {
    let removed = removed_receivers.read().chain(removed_own.read()).chain(removed_tags.read());
    for entity in changed.iter().chain(removed) {
        // It may be gone.
        let Ok((tag, not_receiver, own)) = receivers.get(entity) else { continue };
        let before = tag.map_or(0, |tag| tag.0);
        let mut after = before & !FLAGS;
        if not_receiver {
            after |= NOT_RECEIVER;
        }
        if own == Some(&OwnSurfaceOcclusion::Off) {
            after |= OWN_SURFACE_OFF;
        }
        if after != before {
            commands.entity(entity).try_insert(MeshTag(after));
        }
    }
}

const WITHOUT_FLAGS: &str = "NotFieldReceiver and OwnSurfaceOcclusion will have no effect";

/// Every shader of Bevy's that writes the normals of the prepass, but that of meshlets, which have no tag.
const PREPASS_PATCHES: [ShaderPatch; 3] = [
    ShaderPatch {
        module: "bevy_pbr/prepass/prepass.wgsl",
        patched: |source| flagged_source(source, &[VERTEX_NORMAL]),
        purpose: WITHOUT_FLAGS,
    },
    ShaderPatch {
        module: "bevy_pbr/render/pbr_prepass.wgsl",
        patched: |source| flagged_source(source, &[MAPPED_NORMAL, VERTEX_NORMAL]),
        purpose: WITHOUT_FLAGS,
    },
    ShaderPatch {
        module: "bevy_pbr::pbr_deferred_functions",
        patched: flagged_deferred_source,
        purpose: WITHOUT_FLAGS,
    },
];

/// Where the normal of the vertices is written…
const VERTEX_NORMAL: &str = "out.normal = vec4(in.world_normal * 0.5 + vec3(0.5), 1.0);";
/// …and that of a normal map.
const MAPPED_NORMAL: &str = "out.normal = vec4(normal * 0.5 + vec3(0.5), 1.0);";
/// What is done then. The alpha channel has two bits, and nothing of Bevy's reads it.
const FLAG_NORMAL: &str = "
#ifdef VERTEX_OUTPUT_INSTANCE_INDEX
#ifndef MESHLET_MESH_MATERIAL_PASS
    out.normal.a -= f32(mesh[in.instance_index].tag >> 30u) / 3.0;
#endif
#endif";

/// The first line of the deferred functions, and what the flags need of other modules.
const DEFERRED_MODULE: &str = "#define_import_path bevy_pbr::pbr_deferred_functions\n";
const IMPORT_MESH: &str = "
#ifdef PREPASS_PIPELINE
#import bevy_pbr::mesh_bindings::mesh
#endif
";

/// A shader that writes each of `normals` once, and no others, with the flags; `None` if it is another.
fn flagged_source(source: &str, normals: &[&str]) -> Option<String> {
    if source.contains(FLAG_NORMAL) {
        return Some(source.to_owned());
    }
    if source.matches("out.normal").count() != normals.len() {
        return None;
    }
    normals.iter().try_fold(source.to_owned(), |flagged, normal| {
        replace_exactly(&flagged, 1, normal, &[normal, FLAG_NORMAL].concat())
    })
}

fn flagged_deferred_source(source: &str) -> Option<String> {
    if source.contains(FLAG_NORMAL) {
        return Some(source.to_owned());
    }
    let imported = replace_exactly(source, 1, DEFERRED_MODULE, &[DEFERRED_MODULE, IMPORT_MESH].concat())?;
    flagged_source(&imported, &[VERTEX_NORMAL])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_follow_the_components_and_keep_the_users_bits() {
        let mut app = App::new();
        app.add_systems(PostUpdate, keep_flags);
        let tag = |app: &App, entity: Entity| app.world().entity(entity).get::<MeshTag>().map(|tag| tag.0);
        let both = app.world_mut().spawn((NotFieldReceiver, OwnSurfaceOcclusion::Off)).id();
        let tagged = app.world_mut().spawn((MeshTag(7), OwnSurfaceOcclusion::On)).id();
        let users = app.world_mut().spawn(MeshTag(u32::MAX)).id();
        app.update();
        assert_eq!(tag(&app, both), Some(FLAGS));
        assert_eq!(tag(&app, tagged), Some(7));
        assert_eq!(tag(&app, users), Some(u32::MAX), "no components of ours, no change");

        app.world_mut().entity_mut(both).remove::<NotFieldReceiver>();
        app.world_mut().entity_mut(tagged).insert(OwnSurfaceOcclusion::Off);
        app.update();
        assert_eq!(tag(&app, both), Some(OWN_SURFACE_OFF));
        assert_eq!(tag(&app, tagged), Some(7 | OWN_SURFACE_OFF));

        // The user takes tags away and sets others.
        app.world_mut().entity_mut(both).remove::<MeshTag>();
        app.world_mut().entity_mut(tagged).get_mut::<MeshTag>().unwrap().0 = 9;
        app.update();
        assert_eq!(tag(&app, both), Some(OWN_SURFACE_OFF));
        assert_eq!(tag(&app, tagged), Some(9 | OWN_SURFACE_OFF));

        *app.world_mut().entity_mut(both).get_mut::<OwnSurfaceOcclusion>().unwrap() = OwnSurfaceOcclusion::On;
        app.world_mut().entity_mut(tagged).remove::<OwnSurfaceOcclusion>().insert(NotFieldReceiver);
        app.update();
        assert_eq!(tag(&app, both), Some(0));
        assert_eq!(tag(&app, tagged), Some(9 | NOT_RECEIVER));

        app.world_mut().entity_mut(tagged).remove::<NotFieldReceiver>();
        app.world_mut().despawn(both);
        app.update();
        assert_eq!(tag(&app, tagged), Some(9));
    }

    #[test]
    fn every_normal_is_flagged_once() {
        let source = format!("{VERTEX_NORMAL} else {MAPPED_NORMAL}");
        let flagged = flagged_source(&source, &[MAPPED_NORMAL, VERTEX_NORMAL]).unwrap();
        assert_eq!(flagged, format!("{VERTEX_NORMAL}{FLAG_NORMAL} else {MAPPED_NORMAL}{FLAG_NORMAL}"));
        assert_eq!(flagged_source(&flagged, &[MAPPED_NORMAL, VERTEX_NORMAL]), Some(flagged));
        let deferred = format!("{DEFERRED_MODULE}fn f() {{ {VERTEX_NORMAL} }}");
        let flagged = flagged_deferred_source(&deferred).unwrap();
        assert!(flagged.starts_with(&[DEFERRED_MODULE, IMPORT_MESH].concat()));
        assert_eq!(flagged_deferred_source(&flagged), Some(flagged));
    }

    #[test]
    fn unknown_text_is_left_alone() {
        let normals = [MAPPED_NORMAL, VERTEX_NORMAL];
        for unknown in [
            String::new(),
            VERTEX_NORMAL.to_owned(),
            VERTEX_NORMAL.repeat(2),
            format!("{VERTEX_NORMAL}{MAPPED_NORMAL}out.normal = vec4(0.0);"),
        ] {
            assert_eq!(flagged_source(&unknown, &normals), None, "{unknown}");
        }
        assert_eq!(flagged_deferred_source(VERTEX_NORMAL), None, "another module");
        assert_eq!(flagged_deferred_source(DEFERRED_MODULE), None);
    }
}
