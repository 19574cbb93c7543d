//! The node: encodes the passes of the current camera's frame.

use std::collections::HashMap;

use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::image::ToExtents;
use bevy::prelude::*;
use bevy::render::diagnostic::{RecordDiagnostics, TimeSpanGuard};
use bevy::render::render_resource::{CommandEncoder, Origin3d, TexelCopyBufferLayout, TexelCopyTextureInfo};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use visfield::gpu::{FrameInputs, OcclusionPasses, OcclusionView, PassTimer, ScreenSpace};

use super::compose::BevysOcclusion;
use super::prepare::FieldOcclusionFrame;
use super::residency::FieldResidency;

/// The pipelines, and what each camera keeps from frame to frame.
#[derive(Resource)]
pub(crate) struct OcclusionViews {
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
    /// What a camera kept.
    pub(super) fn view(&self, camera: Entity) -> Option<&OcclusionView> {
        self.views.get(&camera)
    }

    /// Drops what cameras kept that no longer show occlusion.
    pub(super) fn retain(&mut self, mut shows: impl FnMut(Entity) -> bool) {
        self.views.retain(|camera, _| shows(*camera));
    }
}

pub(super) fn field_occlusion(
    view: ViewQuery<(&FieldOcclusionFrame, &ViewPrepassTextures, Option<&BevysOcclusion>)>,
    residency: Res<FieldResidency>,
    queue: Res<RenderQueue>,
    mut views: ResMut<OcclusionViews>,
    mut context: RenderContext,
) {
    let entity = view.entity();
    let (frame, prepass, bevys_occlusion) = view.into_inner();
    let (Some(depth), Some(normals)) = (prepass.depth_view(), prepass.normal_view()) else { return };
    tell_masks(&queue, frame);
    let device = context.render_device().clone();
    let recorder = context.diagnostic_recorder();
    let recorder = recorder.as_deref();
    let mut timer = Spans { recorder: &recorder, open: None };
    let screen_space = bevys_occlusion
        .zip(frame.screen_space)
        .map(|(occlusion, combination)| ScreenSpace { visibility: &occlusion.0.default_view, combination });

    let OcclusionViews { passes, views } = &mut *views;
    passes.encode(
        (device.wgpu_device(), &queue, context.command_encoder()),
        residency.pool(),
        views.entry(entity).or_default(),
        &FrameInputs {
            depth,
            normals,
            motion: prepass.motion_vectors_view().filter(|_| frame.accumulates).map(|view| &**view),
            history_key: frame.lights_key,
            screen_space,
            output: &frame.output.default_view,
            page_rows: frame.page_rows(),
            viewport: frame.viewport,
            world_from_clip: frame.world_from_clip,
            instances: &frame.instances,
            lights: &frame.lights,
            show_tile_load: frame.show_tile_load,
            settings: frame.settings,
        },
        &mut timer,
    );
}

/// Tells Bevy's lighting which light has which mask.
fn tell_masks(queue: &RenderQueue, frame: &FieldOcclusionFrame) {
    let (origin, size) = frame.masks.header_rect();
    let texels: Vec<u8> = frame.masks.header().as_flattened().iter().flat_map(|number| number.to_le_bytes()).collect();
    queue.write_texture(
        TexelCopyTextureInfo {
            origin: Origin3d { x: origin.x, y: origin.y, z: 0 },
            ..frame.output.texture.as_image_copy()
        },
        &texels,
        TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(size.x * 8), rows_per_image: None },
        size.to_extents(),
    );
}

/// Times each group of passes, if the app has Bevy's `RenderDiagnosticsPlugin`.
struct Spans<'a, R> {
    recorder: &'a R,
    open: Option<TimeSpanGuard<'a, R, CommandEncoder>>,
}

impl<R: RecordDiagnostics> PassTimer for Spans<'_, R> {
    fn begin(&mut self, encoder: &mut CommandEncoder, pass: &'static str) {
        self.open = Some(self.recorder.time_span(encoder, span_name(pass)));
    }

    fn end(&mut self, encoder: &mut CommandEncoder) {
        if let Some(span) = self.open.take() {
            span.end(encoder);
        }
    }
}

/// What a group of passes is called in Bevy's diagnostics.
fn span_name(pass: &'static str) -> &'static str {
    match pass {
        "tiles" => "field_occlusion_tiles",
        "trace" => "field_occlusion_trace",
        "denoise" => "field_occlusion_denoise",
        "accumulate" => "field_occlusion_accumulate",
        "resolve" => "field_occlusion_resolve",
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use bevy::diagnostic::DiagnosticPath;

    use super::*;
    use crate::diagnostics::FieldOcclusionDiagnosticsPlugin;

    #[test]
    fn spans_have_the_paths_that_are_told() {
        let paths = OcclusionPasses::GROUPS.map(|group| format!("render/{}/elapsed_gpu", span_name(group)));
        let told = FieldOcclusionDiagnosticsPlugin::GPU_PASSES;
        assert_eq!(told.each_ref().map(DiagnosticPath::as_str), paths.each_ref().map(String::as_str));
    }
}
