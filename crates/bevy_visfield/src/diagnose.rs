//! Says what is wrong when a component cannot do anything: an entity that silently does not occlude is hard to debug.

use std::collections::HashMap;

use bevy::asset::{AssetEventSystems, AssetServer, LoadState};
use bevy::prelude::*;

use crate::asset::VisibilityField;
use crate::components::{FieldOcclusion, FieldShadows, VisibilityField3d};

/// What no light of Bevy's has.
type NoLightAtAll = (Without<DirectionalLight>, Without<PointLight>, Without<SpotLight>, Without<RectLight>);

/// Seconds after which a field that is not even loading counts as forgotten.
const PATIENCE: f32 = 5.0;

pub(crate) fn plugin(app: &mut App) {
    app.add_systems(PostUpdate, (warn_about_missing_fields.after(AssetEventSystems), warn_about_misplaced_components));
}

fn warn_about_misplaced_components(
    lights: Query<Entity, (Added<FieldShadows>, NoLightAtAll)>,
    cameras: Query<Entity, (Added<FieldOcclusion>, Without<Camera3d>)>,
) {
    for entity in &lights {
        warn!("entity {entity} has FieldShadows but no light: insert it on the light that shall have soft shadows");
    }
    for entity in &cameras {
        warn!("entity {entity} has FieldOcclusion but no Camera3d: insert it on the camera that shall show occlusion");
    }
}

/// Warns once for each handle that no asset stands behind and no load is under way for. Failed loads are told by Bevy's
/// asset server, with the loader's reason.
fn warn_about_missing_fields(
    occluders: Query<(Entity, &VisibilityField3d)>,
    fields: Res<Assets<VisibilityField>>,
    server: Res<AssetServer>,
    time: Res<Time<Real>>,
    mut waiting: Local<HashMap<AssetId<VisibilityField>, f32>>,
) {
    let mut missing: HashMap<AssetId<VisibilityField>, Entity> = HashMap::new();
    for (entity, field) in &occluders {
        if !fields.contains(field.id()) {
            missing.entry(field.id()).or_insert(entity);
        }
    }
    waiting.retain(|id, _| missing.contains_key(id));
    for (id, entity) in missing {
        let seconds = waiting.entry(id).or_insert(0.0);
        if matches!(server.get_load_state(id), Some(LoadState::Loading | LoadState::Failed(_))) || seconds.is_infinite()
        {
            continue;
        }
        *seconds += time.delta_secs();
        if *seconds > PATIENCE {
            *seconds = f32::INFINITY;
            warn!(
                "entity {entity} has a VisibilityField3d whose field is neither loaded nor loading: it does not occlude. \
                 Load the field with the asset server (\"rock.vfield#Mesh0/Primitive0\"), or add it to Assets<VisibilityField>."
            );
        }
    }
}
