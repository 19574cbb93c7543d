//! Which fields are on the GPU. A field is uploaded when its asset arrives or changes, once for all its instances.

use std::collections::{HashMap, HashSet};

use bevy::ecs::system::{
    SystemParamItem,
    lifetimeless::{SRes, SResMut},
};
use bevy::prelude::*;
use bevy::render::render_asset::{PrepareAssetError, RenderAsset};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use visfield::Encoding;
use visfield::gpu::{FieldPool, FieldSlot, PoolError, PoolStatistics};

use crate::asset::VisibilityField;

/// The fields on the GPU, a resource of the render world.
///
/// ```
/// use bevy::{prelude::*, render::{Render, RenderApp}};
/// use bevy_visfield::FieldResidency;
/// fn watch_memory(app: &mut App) {
///     app.sub_app_mut(RenderApp).add_systems(Render, |residency: Res<FieldResidency>| {
///         debug!("{} bytes of fields", residency.statistics().resident_bytes);
///     });
/// }
/// ```
#[derive(Resource)]
pub struct FieldResidency {
    pool: FieldPool,
    slots: HashMap<AssetId<VisibilityField>, FieldSlot>,
    /// Fields that the pool did not take, and were told of.
    refused: HashSet<AssetId<VisibilityField>>,
}

impl FromWorld for FieldResidency {
    fn from_world(world: &mut World) -> Self {
        let pool = FieldPool::new(world.resource::<RenderDevice>().wgpu_device());
        Self { pool, slots: HashMap::new(), refused: HashSet::new() }
    }
}

impl FieldResidency {
    /// Uploads and bytes so far.
    pub fn statistics(&self) -> PoolStatistics {
        self.pool.statistics()
    }

    pub(super) fn pool(&self) -> &FieldPool {
        &self.pool
    }

    pub(super) fn slot(&self, id: AssetId<VisibilityField>) -> Option<&FieldSlot> {
        self.slots.get(&id)
    }

    /// Frees the room of a field, if it has any.
    fn free(&mut self, id: AssetId<VisibilityField>) {
        if let Some(slot) = self.slots.remove(&id) {
            self.pool.remove(slot);
        }
    }
}

/// Marks a field as extracted; its data live in [`FieldResidency`], whose pool must hear of removals.
pub(super) struct ResidentField;

impl RenderAsset for ResidentField {
    type SourceAsset = VisibilityField;
    // No residency: the GPU lacks a capability, and the plugin is inert.
    type Param = (SRes<RenderDevice>, SRes<RenderQueue>, Option<SResMut<FieldResidency>>);

    fn byte_len(field: &VisibilityField) -> Option<usize> {
        usize::try_from(field.bytes()).ok()
    }

    fn prepare_asset(
        field: VisibilityField,
        id: AssetId<VisibilityField>,
        (device, queue, residency): &mut SystemParamItem<Self::Param>,
        _previous: Option<&Self>,
    ) -> Result<Self, PrepareAssetError<VisibilityField>> {
        let Some(residency) = residency else { return Ok(Self) };
        // A field that changed must not occlude as it was, so its old table goes first and leaves its room.
        residency.free(id);
        match residency.pool.insert(device.wgpu_device(), queue, &field) {
            Ok(slot) => {
                warn_of_limits(&field);
                residency.slots.insert(id, slot);
                residency.refused.remove(&id);
                Ok(Self)
            }
            Err(error) => {
                if residency.refused.insert(id) {
                    error!("visibility field `{}` does not occlude: {error}", field.header().name);
                }
                match error {
                    PoolError::Full { .. } => Err(PrepareAssetError::RetryNextUpdate(field)),
                    // It will never be taken.
                    PoolError::Representation => Ok(Self),
                }
            }
        }
    }

    fn unload_asset(id: AssetId<VisibilityField>, (_, _, residency): &mut SystemParamItem<Self::Param>) {
        if let Some(residency) = residency {
            residency.free(id);
            residency.refused.remove(&id);
        }
    }
}

/// Says what a field will get wrong, if that is known.
fn warn_of_limits(field: &visfield::VisibilityField) {
    let name = &field.header().name;
    if field.table().is_some_and(|table| table.encoding() == Encoding::Bit) {
        warn!(
            "visibility field `{name}` is of bits, which know no distances: its own mesh looks black where it receives \
             occlusion by rays; bake it with `--encoding u8`, unless it is never seen itself"
        );
    }
    if !field.answers_rays() && field.cap_grid().is_some_and(|grid| !grid.serves_inside()) {
        warn!(
            "the cap grid of visibility field `{name}` is wrong inside its bounding box, and there is no table for rays: \
             ambient occlusion in there is a guess; bake it with `--representation two-point,cap-grid`"
        );
    }
}
