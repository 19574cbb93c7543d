//! Shows exact visibility through Bevy's own shading: it takes the place of what the node of `bevy_visfield` found, so that a
//! picture of the reference differs from one of the fields in nothing but visibility.

use std::sync::Arc;

use bevy::core_pipeline::Core3d;
use bevy::core_pipeline::core_3d::main_opaque_pass_3d;
use bevy::prelude::*;
use bevy::render::RenderApp;
use bevy::render::extract_component::{ExtractComponent, ExtractComponentPlugin};
use bevy::render::renderer::{RenderContext, ViewQuery};
use bevy::render::view::ExtractedView;
use bevy_visfield::{FieldOcclusionFrame, FieldOcclusionSystems};
use half::f16;
use wgpu::util::DeviceExt;

use crate::reference::ExactFrame;

/// What a camera with `FieldOcclusion` shows in the place of what fields find. Its viewport must have the same size, and one
/// light the shadows; otherwise it shows the fields.
///
/// ```
/// use bevy::math::UVec2;
/// use visfield_workspace::reference_view::ExactVisibility;
/// let sky = ExactVisibility::new(UVec2::new(2, 1), &vec![None; 2]);
/// assert_eq!(sky.size(), UVec2::new(2, 1));
/// ```
#[derive(Component, ExtractComponent, Clone, Debug)]
pub struct ExactVisibility {
    size: UVec2,
    /// Rows of texels, each padded to what copies to textures need.
    texels: Arc<[u8]>,
}

impl ExactVisibility {
    /// Of a frame of this many pixels.
    pub fn new(size: UVec2, exact: &ExactFrame) -> Self {
        let mut texels = Vec::new();
        for row in exact.chunks(size.x.max(1) as usize) {
            for [ambient, light] in row.iter().map(|exact| exact.unwrap_or([1.0; 2])) {
                // The other channels of the page are those of lights that do not exist.
                let texel = [ambient, light, 1.0, 1.0].map(f16::from_f32);
                texels.extend(texel.map(f16::to_le_bytes).as_flattened());
            }
            texels.resize(texels.len().next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize), 0);
        }
        Self { size, texels: texels.into() }
    }

    /// Its width and height in pixels.
    pub fn size(&self) -> UVec2 {
        self.size
    }
}

/// Has cameras with [`ExactVisibility`] show it. Call it before the first update.
pub fn install(app: &mut App) {
    app.add_plugins(ExtractComponentPlugin::<ExactVisibility>::default());
    app.sub_app_mut(RenderApp)
        .add_systems(Core3d, replace.after(FieldOcclusionSystems::Trace).before(main_opaque_pass_3d));
}

fn replace(view: ViewQuery<(&ExtractedView, &FieldOcclusionFrame, &ExactVisibility)>, mut context: RenderContext) {
    let (view, frame, exact) = view.into_inner();
    if view.viewport.zw() != exact.size {
        return;
    }
    let texels = context.render_device().wgpu_device().create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some("exact visibility"),
        contents: &exact.texels,
        usage: wgpu::BufferUsages::COPY_SRC,
    });
    let bytes_per_row = (exact.size.x * 8).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(bytes_per_row), rows_per_image: None };
    let origin = wgpu::Origin3d { x: view.viewport.x, y: view.viewport.y, z: 0 };
    context.command_encoder().copy_buffer_to_texture(
        wgpu::TexelCopyBufferInfo { buffer: &texels, layout },
        wgpu::TexelCopyTextureInfo { origin, ..frame.output.texture.as_image_copy() },
        wgpu::Extent3d { width: exact.size.x, height: exact.size.y, depth_or_array_layers: 1 },
    );
}
