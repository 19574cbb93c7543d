//! Which fields are on the GPU, and how much of each. A field is uploaded when its asset arrives or changes, once for all its
//! instances, and again at another level when the budget asks for that.

use std::collections::{HashMap, HashSet};

use bevy::asset::AssetEvent;
use bevy::camera::visibility::RenderLayers;
use bevy::prelude::*;
use bevy::render::Extract;
use bevy::render::renderer::{RenderDevice, RenderQueue};
use bevy::render::view::ExtractedView;
use visfield::Encoding;
use visfield::gpu::{FieldPool, FieldSlot, PoolStatistics};

use super::budget::{FieldLevel, FieldMemoryBudget, LevelBytes, levels_within, steady_need};
use super::extract::ExtractedOccluders;
use super::feedback::{FieldOnGpu, RenderFeedback};
use super::levels::Levels;
use crate::asset::VisibilityField;
use crate::components::FieldOcclusion;

/// The fields on the GPU, a resource of the render world.
///
/// ```
/// use bevy::{prelude::*, render::{Render, RenderApp}};
/// use bevy_visfield::{FieldLevel, FieldResidency};
/// fn watch_memory(app: &mut App) {
///     app.sub_app_mut(RenderApp).add_systems(Render, |residency: Res<FieldResidency>| {
///         let coarse = residency.fields().filter(|(_, level, _)| *level == FieldLevel::Coarse).count();
///         debug!("{} bytes of fields, {coarse} of them coarse", residency.statistics().resident_bytes);
///     });
/// }
/// ```
#[derive(Resource)]
pub struct FieldResidency {
    pool: FieldPool,
    fields: HashMap<AssetId<VisibilityField>, ResidentField>,
    budget: FieldMemoryBudget,
    /// Whether all assets were taken over; later ones come by events.
    up_to_date: bool,
    /// Whether anything happened that [`RenderFeedback`] does not tell yet.
    changed: bool,
    /// Whether it was told that the budget is too small.
    warned: bool,
}

struct ResidentField {
    levels: Levels,
    /// What is on the GPU.
    slot: Option<(FieldLevel, FieldSlot)>,
    /// What the budget has room for.
    target: FieldLevel,
    /// How large it looks: radius over distance.
    need: f32,
}

impl ResidentField {
    fn level(&self) -> FieldLevel {
        self.slot.as_ref().map_or(FieldLevel::Absent, |(level, _)| *level)
    }

    fn resident_bytes(&self) -> u64 {
        self.slot.as_ref().map_or(0, |(_, slot)| slot.bytes())
    }
}

impl FromWorld for FieldResidency {
    fn from_world(world: &mut World) -> Self {
        let budget = FieldMemoryBudget::default();
        let mut pool = FieldPool::new(world.resource::<RenderDevice>().wgpu_device());
        pool.set_limit(budget.bytes);
        Self { pool, fields: HashMap::new(), budget, up_to_date: false, changed: true, warned: false }
    }
}

impl FieldResidency {
    /// Uploads and bytes so far.
    pub fn statistics(&self) -> PoolStatistics {
        self.pool.statistics()
    }

    /// The budget that holds, in bytes: that of [`FieldMemoryBudget`], or what the adapter can bind if that is less.
    pub fn budget(&self) -> u64 {
        self.budget.bytes.min(self.pool.limit())
    }

    /// Bytes that all fields would take together, if the budget were large enough.
    pub fn asked_bytes(&self) -> u64 {
        self.fields.values().map(|field| field.levels.bytes().asked()).sum()
    }

    /// How much of a field is on the GPU.
    pub fn level(&self, id: AssetId<VisibilityField>) -> FieldLevel {
        self.fields.get(&id).map_or(FieldLevel::Absent, ResidentField::level)
    }

    /// All fields that are loaded, in no particular order: how much of each is on the GPU, and the bytes that this takes.
    pub fn fields(&self) -> impl Iterator<Item = (AssetId<VisibilityField>, FieldLevel, u64)> {
        self.fields.iter().map(|(id, field)| (*id, field.level(), field.resident_bytes()))
    }

    pub(super) fn pool(&self) -> &FieldPool {
        &self.pool
    }

    pub(super) fn slot(&self, id: AssetId<VisibilityField>) -> Option<&FieldSlot> {
        self.fields.get(&id)?.slot.as_ref().map(|(_, slot)| slot)
    }

    /// Whether a field was baked without what answers rays: then it is not the budget that keeps that off the GPU.
    pub(super) fn answers_no_rays(&self, id: AssetId<VisibilityField>) -> bool {
        self.fields.get(&id).is_some_and(|field| !field.levels.field().answers_rays())
    }

    /// Takes what the asset is now, if there is one: a field that changed must not occlude as it was, and leaves its room.
    fn replace(&mut self, id: AssetId<VisibilityField>, field: Option<&VisibilityField>) {
        let before = self.fields.remove(&id);
        self.changed |= before.is_some() || field.is_some();
        let need = before.as_ref().map_or(0.0, |before| before.need);
        if let Some((_, slot)) = before.and_then(|before| before.slot) {
            self.pool.remove(slot);
        }
        if let Some(field) = field {
            warn_of_limits(field);
            let levels = Levels::new(field.0.clone());
            self.fields.insert(id, ResidentField { levels, slot: None, target: FieldLevel::Absent, need });
        }
    }

    /// Decides on the level of each field. The most needed ones come first.
    fn plan(
        &mut self,
        needs: impl FnOnce(&Self) -> HashMap<AssetId<VisibilityField>, f32>,
    ) -> Vec<AssetId<VisibilityField>> {
        let (asked, budget) = (self.asked_bytes(), self.budget());
        if asked > budget {
            let needs = needs(self);
            for (id, field) in &mut self.fields {
                field.need = steady_need(field.need, needs.get(id).copied().unwrap_or(0.0));
            }
            if !self.warned {
                self.warned = true;
                warn!(
                    "visibility fields ask for {asked} bytes of GPU memory, but the budget is {budget}: the least needed ones \
                     get coarser tables, no more than their cap grids, or nothing. Raise FieldMemoryBudget::bytes (it is {}, \
                     and this adapter can bind {} at most), or bake smaller fields (`visfield bake --max-bytes`).",
                    self.budget.bytes,
                    self.pool.adapter_limit(),
                );
            }
        }
        let mut order: Vec<_> = self.fields.iter().map(|(id, field)| (*id, field.need, field.levels.bytes())).collect();
        order.sort_by(|(a, need_a, _), (b, need_b, _)| need_b.total_cmp(need_a).then_with(|| a.cmp(b)));
        let bytes: Vec<LevelBytes> = order.iter().map(|(_, _, bytes)| *bytes).collect();
        for ((id, ..), level) in order.iter().zip(levels_within(budget, &bytes)) {
            if let Some(field) = self.fields.get_mut(id) {
                self.changed |= field.target != level;
                field.target = level;
            }
        }
        order.into_iter().map(|(id, ..)| id).collect()
    }

    /// Brings fields to the levels that were planned, as far as one frame may upload. What shrinks goes first and makes room.
    fn upload(&mut self, device: &RenderDevice, queue: &RenderQueue, order: &[AssetId<VisibilityField>]) {
        let mut uploaded = 0;
        for id in order.iter().rev() {
            let Some(field) = self.fields.get_mut(id).filter(|field| field.level() > field.target) else { continue };
            // Until a coarser table is made, the finer one stays.
            if field.target == FieldLevel::Absent || field.levels.ready(field.target) {
                let target = field.target;
                self.bring(device, queue, *id, target, &mut uploaded);
            }
        }
        let statistics = self.pool.statistics();
        if statistics.buffer_bytes > self.pool.limit() && statistics.resident_bytes <= self.pool.limit() {
            self.repack(device, queue, 0);
        }
        for id in order {
            let Some(field) = self.fields.get_mut(id).filter(|field| field.level() < field.target) else { continue };
            let (now, bytes) = (field.level(), field.levels.bytes());
            // Until a coarser table is made, the cap grid serves.
            let up_to = FieldLevel::ALL.into_iter().rev().filter(|level| (now..=field.target).contains(level));
            let Some(level) = up_to.into_iter().find(|level| bytes.of(*level).is_some() && field.levels.ready(*level))
            else {
                continue;
            };
            let others = self.pool.statistics().resident_bytes - field.resident_bytes();
            if level > now && others + bytes.of(level).unwrap_or(0) <= self.budget() {
                self.bring(device, queue, *id, level, &mut uploaded);
            }
        }
    }

    /// Replaces what is on the GPU of one field, unless the frame has uploaded enough.
    fn bring(
        &mut self,
        device: &RenderDevice,
        queue: &RenderQueue,
        id: AssetId<VisibilityField>,
        level: FieldLevel,
        uploaded: &mut u64,
    ) {
        let Some(field) = self.fields.get_mut(&id) else { return };
        let bytes = field.levels.bytes().of(level).unwrap_or(0);
        if bytes > 0 && *uploaded > 0 && *uploaded + bytes > self.budget.upload_bytes_per_frame {
            return;
        }
        self.changed = true;
        if let Some((_, slot)) = field.slot.take() {
            self.pool.remove(slot);
        }
        let Some(part) = field.levels.get(level).cloned() else { return };
        let inserted = self.pool.insert(device.wgpu_device(), queue, &part).or_else(|_| {
            // There is room, but not in one piece.
            self.repack(device, queue, bytes);
            self.pool.insert(device.wgpu_device(), queue, &part)
        });
        let Some(field) = self.fields.get_mut(&id) else { return };
        match inserted {
            Ok(slot) => {
                *uploaded += bytes;
                field.slot = Some((level, slot));
            }
            Err(error) => {
                error!("visibility field `{}` does not occlude: {error}", part.header().name);
                field.levels.give_up(level);
            }
        }
    }

    /// Moves all fields together, with room for `bytes` more.
    fn repack(&mut self, device: &RenderDevice, queue: &RenderQueue, bytes: u64) {
        let resident = self.fields.values_mut().filter_map(|field| {
            let (level, slot) = field.slot.as_mut()?;
            Some((slot, field.levels.get(*level)?))
        });
        self.pool.repack(device.wgpu_device(), queue, resident, bytes);
    }
}

/// Takes over fields that arrived, changed or went, whatever happened to them in between, and the budget.
pub(super) fn extract_fields(
    residency: Option<ResMut<FieldResidency>>,
    mut events: Extract<MessageReader<AssetEvent<VisibilityField>>>,
    fields: Extract<Res<Assets<VisibilityField>>>,
    budget: Extract<Res<FieldMemoryBudget>>,
) {
    let Some(mut residency) = residency else { return };
    if residency.budget != **budget {
        residency.budget = **budget;
        residency.pool.set_limit(budget.bytes);
    }
    if !residency.up_to_date {
        residency.up_to_date = true;
        events.clear();
        for (id, field) in fields.iter() {
            residency.replace(id, Some(field));
        }
    }
    // Whatever happened to a field, and however often: what counts is what it is now.
    let changed = events.read().filter_map(|event| match event {
        AssetEvent::Added { id }
        | AssetEvent::Modified { id }
        | AssetEvent::Removed { id }
        | AssetEvent::Unused { id } => Some(*id),
        AssetEvent::LoadedWithDependencies { .. } => None,
    });
    for id in changed.collect::<HashSet<_>>() {
        residency.replace(id, fields.get(id));
    }
}

/// Decides which fields are needed most, uploads, and tells the main world.
pub(super) fn update_residency(
    mut residency: ResMut<FieldResidency>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    feedback: Res<RenderFeedback>,
    occluders: Res<ExtractedOccluders>,
    views: Query<(&ExtractedView, Option<&RenderLayers>), With<FieldOcclusion>>,
) {
    let residency = &mut *residency;
    let cameras: Vec<_> =
        views.iter().map(|(view, layers)| (view.world_from_view.translation(), layers.unwrap_or_default())).collect();
    let order = residency.plan(|residency| {
        let mut needs: HashMap<AssetId<VisibilityField>, f32> = HashMap::new();
        for occluder in &occluders.0 {
            let Some(field) = residency.fields.get(&occluder.field) else { continue };
            let (center, radius) = field.levels.sphere_in_world(&occluder.world_from_mesh);
            let nearest = cameras
                .iter()
                .filter(|(_, layers)| occluder.layers.intersects(layers))
                .map(|(camera, _)| camera.distance(center))
                .fold(f32::INFINITY, f32::min);
            // Nowhere is an object needed more than in its middle.
            let need = radius / nearest.max(radius * 1.0e-3);
            if need.is_finite() {
                let largest = needs.entry(occluder.field).or_default();
                *largest = largest.max(need);
            }
        }
        needs
    });
    residency.upload(&device, &queue, &order);
    if std::mem::take(&mut residency.changed) {
        let state = |field: &ResidentField| FieldOnGpu { level: field.level(), target: field.target };
        feedback.tell(residency.fields.iter().map(|(id, field)| (*id, state(field))).collect());
    }
}

/// Says what a field will get wrong, if that is known.
fn warn_of_limits(field: &visfield::VisibilityField) {
    let name = &field.header().name;
    if field.distance_field().is_none() && field.table().is_some_and(|table| table.encoding() == Encoding::Bit) {
        warn!(
            "visibility field `{name}` is of bits, which know no distances: its own mesh looks black where it receives \
             occlusion by rays; bake it with `--encoding u8`, unless it is never seen itself"
        );
    }
    if !field.answers_rays() && field.cap_grid().is_some_and(|grid| !grid.serves_inside()) {
        warn!(
            "the cap grid of visibility field `{name}` is wrong inside its bounding box, and there is nothing else: \
             ambient occlusion in there is a guess; bake it with `--representation cap-grid,distance`"
        );
    }
}
