//! What a frame was made of, and how long its preparation took, for diagnostics.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use bevy::prelude::*;
use bevy::render::Extract;
use visfield::gpu::OUTPUT_FORMAT;

use super::node::OcclusionViews;
use super::prepare::FieldOcclusionFrame;
use super::residency::FieldResidency;

/// Of all cameras together.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FrameCounts {
    pub(crate) instances: usize,
    pub(crate) lights: usize,
    pub(crate) tile_entries: u64,
    pub(crate) lookups_at_most: u64,
    pub(crate) field_bytes: u64,
    pub(crate) frame_bytes: u64,
    pub(crate) times: CpuTimes,
}

/// How long the CPU was busy, a resource of the render world.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub(crate) struct CpuTimes {
    pub(crate) extract: Duration,
    pub(crate) prepare: Duration,
}

/// A resource of the main world: the latest frame that nobody has heard of.
#[derive(Resource, Debug, Default)]
pub(crate) struct LatestCounts(Mutex<Option<FrameCounts>>);

impl LatestCounts {
    pub(crate) fn tell(&self, counts: FrameCounts) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(counts);
    }

    pub(crate) fn take(&self) -> Option<FrameCounts> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// Counts the frame before the one that is being extracted. Where the plugin is inert there is none.
pub(crate) fn count_frame(
    latest: Extract<Res<LatestCounts>>,
    views: Option<Res<OcclusionViews>>,
    residency: Option<Res<FieldResidency>>,
    times: Option<Res<CpuTimes>>,
    frames: Query<(Entity, &FieldOcclusionFrame)>,
) {
    let (Some(views), Some(residency), Some(times)) = (views, residency, times) else { return };
    let field_bytes = residency.statistics().resident_bytes;
    let mut counts = FrameCounts { field_bytes, times: *times, ..FrameCounts::default() };
    for (camera, frame) in &frames {
        let output = &frame.output.texture;
        let texel_bytes = OUTPUT_FORMAT.block_copy_size(None).unwrap_or(0);
        counts.instances += frame.instances.len();
        counts.lights += frame.lights.len();
        counts.frame_bytes += u64::from(output.width()) * u64::from(output.height()) * u64::from(texel_bytes);
        let Some(view) = views.view(camera) else { continue };
        let entries = u64::from(view.tile_entries());
        let settings = &frame.settings;
        let rays = u64::from(settings.ambient_rays) + u64::from(settings.shadow_rays) * frame.lights.len() as u64;
        let traced_pixels = TILE_PIXELS / u64::from(settings.resolution.scale()).pow(2);
        counts.tile_entries += entries;
        counts.lookups_at_most += entries * traced_pixels * rays;
        counts.frame_bytes += view.bytes();
    }
    latest.tell(counts);
}

/// Pixels of a tile.
const TILE_PIXELS: u64 = 16 * 16;
