//! A look at the occlusion texture itself, in the place of the picture.

use std::num::NonZeroU64;

use bevy::asset::{embedded_asset, load_embedded_asset};
use bevy::core_pipeline::tonemapping::tonemapping;
use bevy::core_pipeline::{Core3d, Core3dSystems, FullscreenShader};
use bevy::prelude::*;
use bevy::render::camera::ExtractedCamera;
use bevy::render::extract_component::{ExtractComponent, ExtractComponentPlugin};
use bevy::render::render_resource::binding_types::{texture_2d, uniform_buffer_sized};
use bevy::render::render_resource::{
    BindGroupEntries, BindGroupLayoutDescriptor, BindGroupLayoutEntries, BufferInitDescriptor, BufferUsages,
    CachedRenderPipelineId, ColorTargetState, ColorWrites, FragmentState, Operations, PipelineCache,
    RenderPassColorAttachment, RenderPassDescriptor, RenderPipelineDescriptor, ShaderStages, SpecializedRenderPipeline,
    SpecializedRenderPipelines, TextureFormat, TextureSampleType,
};
use bevy::render::renderer::{RenderContext, ViewQuery};
use bevy::render::view::{ExtractedView, ViewTarget};
use bevy::render::{GpuResourceAppExt, Render, RenderApp, RenderStartup, RenderSystems};

use crate::components::FieldOcclusion;
use crate::render::FieldOcclusionFrame;

/// Shows what [`FieldOcclusion`] computed instead of the picture, in grey: white is visible, black is occluded.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::{FieldDebugView, FieldOcclusion};
/// fn camera() -> impl Bundle {
///     (Camera3d::default(), Msaa::Off, FieldOcclusion::default(), FieldDebugView::AmbientVisibility)
/// }
/// ```
#[derive(Component, ExtractComponent, Reflect, Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[reflect(Component, Default, Clone, PartialEq)]
#[extract_component_sync_target((Self, FieldDebugPipeline))]
pub enum FieldDebugView {
    /// The unoccluded share of ambient light.
    #[default]
    AmbientVisibility,
    /// The visible share of a light: of those with [`FieldShadows`](crate::FieldShadows) that the camera shadows, this one, in an
    /// order that stays as long as they are the same. White if there are not as many.
    Light(u32),
    /// How many instances each tile of 16×16 pixels looks at: dark blue for none, over green and yellow to red for 64 and more.
    TileLoad,
}

/// Beyond all pages.
const NO_CHANNEL: u32 = 4 * 4;

pub(crate) fn plugin(app: &mut App) {
    embedded_asset!(app, "debug.wgsl");
    app.add_plugins(ExtractComponentPlugin::<FieldDebugView>::default());
    let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
    render_app
        .init_gpu_resource::<SpecializedRenderPipelines<FieldDebugShader>>()
        .add_systems(RenderStartup, init_shader)
        .add_systems(Render, prepare_pipelines.in_set(RenderSystems::Prepare))
        // Anti-aliasing may run before or after; it leaves flat grey alone.
        .add_systems(Core3d, show.after(tonemapping).in_set(Core3dSystems::PostProcess));
}

#[derive(Resource)]
struct FieldDebugShader {
    layout: BindGroupLayoutDescriptor,
    fullscreen: FullscreenShader,
    fragment: Handle<Shader>,
}

#[derive(Component)]
pub struct FieldDebugPipeline {
    pipeline: CachedRenderPipelineId,
    /// The channel of the occlusion texture, through its pages.
    channel: u32,
}

impl SpecializedRenderPipeline for FieldDebugShader {
    type Key = (FieldDebugView, TextureFormat);

    fn specialize(&self, (view, format): Self::Key) -> RenderPipelineDescriptor {
        let entry_point = match view {
            FieldDebugView::AmbientVisibility | FieldDebugView::Light(_) => "visible",
            FieldDebugView::TileLoad => "tile_load",
        };
        RenderPipelineDescriptor {
            label: Some("field_debug".into()),
            layout: vec![self.layout.clone()],
            vertex: self.fullscreen.to_vertex_state(),
            fragment: Some(FragmentState {
                shader: self.fragment.clone(),
                entry_point: Some(entry_point.into()),
                targets: vec![Some(ColorTargetState { format, blend: None, write_mask: ColorWrites::ALL })],
                ..default()
            }),
            ..default()
        }
    }
}

fn init_shader(mut commands: Commands, fullscreen: Res<FullscreenShader>, server: Res<AssetServer>) {
    commands.insert_resource(FieldDebugShader {
        layout: BindGroupLayoutDescriptor::new(
            "field_debug_layout",
            &BindGroupLayoutEntries::sequential(
                ShaderStages::FRAGMENT,
                (
                    texture_2d(TextureSampleType::Float { filterable: true }),
                    uniform_buffer_sized(false, NonZeroU64::new(size_of::<[u32; 4]>() as u64)),
                ),
            ),
        ),
        fullscreen: fullscreen.clone(),
        fragment: load_embedded_asset!(server.as_ref(), "debug.wgsl"),
    });
}

fn prepare_pipelines(
    mut commands: Commands,
    cache: Res<PipelineCache>,
    mut pipelines: ResMut<SpecializedRenderPipelines<FieldDebugShader>>,
    shader: Res<FieldDebugShader>,
    cameras: Query<(Entity, &ExtractedView, &FieldDebugView), (With<ExtractedCamera>, With<FieldOcclusion>)>,
) {
    for (entity, view, debug_view) in &cameras {
        let channel = match debug_view {
            FieldDebugView::AmbientVisibility | FieldDebugView::TileLoad => 0,
            FieldDebugView::Light(light) => light.saturating_add(1).min(NO_CHANNEL),
        };
        let kind = if channel == 0 { *debug_view } else { FieldDebugView::AmbientVisibility };
        let pipeline = pipelines.specialize(&cache, &shader, (kind, view.target_format));
        commands.entity(entity).insert(FieldDebugPipeline { pipeline, channel });
    }
}

fn show(
    view: ViewQuery<(&ViewTarget, &FieldOcclusionFrame, &FieldDebugPipeline)>,
    shader: Res<FieldDebugShader>,
    cache: Res<PipelineCache>,
    mut context: RenderContext,
) {
    let (target, frame, pipeline) = view.into_inner();
    let channel = pipeline.channel;
    let Some(pipeline) = cache.get_render_pipeline(pipeline.pipeline) else { return };
    // Where the channel is: in which page, and where that starts.
    let place = [channel % 4, channel / 4 * frame.page_rows(), 0, 0];
    let place = context.render_device().create_buffer_with_data(&BufferInitDescriptor {
        label: Some("field_debug"),
        contents: bytemuck::cast_slice(&place),
        usage: BufferUsages::UNIFORM,
    });
    let bind_group = context.render_device().create_bind_group(
        "field_debug",
        &cache.get_bind_group_layout(&shader.layout),
        &BindGroupEntries::sequential((&frame.output.default_view, place.as_entire_binding())),
    );
    let mut pass = context.command_encoder().begin_render_pass(&RenderPassDescriptor {
        label: Some("field_debug"),
        color_attachments: &[Some(RenderPassColorAttachment {
            view: target.post_process_write().destination,
            depth_slice: None,
            resolve_target: None,
            ops: Operations::default(),
        })],
        ..default()
    });
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, &bind_group, &[]);
    pass.draw(0..3, 0..1);
}
