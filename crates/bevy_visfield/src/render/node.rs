//! The node: encodes the passes of the current camera's frame.

use std::collections::HashMap;

use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::prelude::*;
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use visfield::gpu::{FrameInputs, OcclusionPasses, OcclusionView};

use super::prepare::FieldOcclusionFrame;
use super::residency::FieldResidency;

/// The pipelines, and what each camera keeps from frame to frame.
#[derive(Resource)]
pub(super) struct OcclusionViews {
    passes: OcclusionPasses,
    views: HashMap<Entity, OcclusionView>,
}

impl FromWorld for OcclusionViews {
    fn from_world(world: &mut World) -> Self {
        let device = world.resource::<RenderDevice>();
        Self { passes: OcclusionPasses::new(device.wgpu_device()), views: HashMap::new() }
    }
}

impl OcclusionViews {
    /// Drops what cameras kept that no longer show occlusion.
    pub(super) fn retain(&mut self, mut shows: impl FnMut(Entity) -> bool) {
        self.views.retain(|camera, _| shows(*camera));
    }
}

pub(super) fn field_occlusion(
    view: ViewQuery<(&FieldOcclusionFrame, &ViewPrepassTextures)>,
    residency: Res<FieldResidency>,
    queue: Res<RenderQueue>,
    mut views: ResMut<OcclusionViews>,
    mut context: RenderContext,
) {
    let entity = view.entity();
    let (frame, prepass) = view.into_inner();
    let (Some(depth), Some(normals)) = (prepass.depth_view(), prepass.normal_view()) else { return };
    let device = context.render_device().clone();
    let diagnostics = context.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let time_span = diagnostics.time_span(context.command_encoder(), "field_occlusion");

    let OcclusionViews { passes, views } = &mut *views;
    passes.encode(
        device.wgpu_device(),
        &queue,
        context.command_encoder(),
        residency.pool(),
        views.entry(entity).or_default(),
        &FrameInputs {
            depth,
            normals,
            output: &frame.output.default_view,
            viewport: frame.viewport,
            world_from_clip: frame.world_from_clip,
            instances: &frame.instances,
            lights: &frame.lights,
            settings: frame.settings,
        },
    );

    time_span.end(context.command_encoder());
}
