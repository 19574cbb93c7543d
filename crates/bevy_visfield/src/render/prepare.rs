//! Puts each camera's frame together: occluders relative to the camera, the lights by their masks, and the texture to fill.

use std::hash::BuildHasher;

use std::time::Instant;

use bevy::camera::MainPassResolutionOverride;
use bevy::camera::visibility::RenderLayers;
use bevy::image::ToExtents;
use bevy::math::{DVec3, Mat4, UVec2};
use bevy::platform::hash::FixedHasher;
use bevy::prelude::*;
use bevy::render::camera::{ExtractedCamera, TemporalJitter};
use bevy::render::render_resource::{TextureDescriptor, TextureDimension, TextureUsages};
use bevy::render::renderer::RenderDevice;
use bevy::render::texture::{CachedTexture, TextureCache};
use bevy::render::view::ExtractedView;
use bevy::tasks::{ComputeTaskPool, ParallelSlice};
use visfield::estimate::frame::{MAX_LIGHTS, TraceSettings};
use visfield::estimate::light::Light;
use visfield::field::cap_grid::HarmonicOrder;
use visfield::gpu::layout::InstanceData;
use visfield::gpu::{OUTPUT_FORMAT, ScreenSpaceCombination};
use visfield::scene::Placement;

use super::count::CpuTimes;
use super::extract::{ExtractedOccluder, ExtractedOccluders};
use super::lights::{ExtractedLights, LightShape, ShadowedLight};
use super::masks::MaskTable;
use super::node::OcclusionViews;
use super::residency::FieldResidency;
use crate::components::FieldOcclusion;
use crate::debug::FieldDebugView;

/// One camera's frame, on its view in the render world, for passes of your own that read the occlusion texture.
///
/// ```
/// use bevy::{prelude::*, render::renderer::ViewQuery};
/// use bevy_visfield::FieldOcclusionFrame;
/// fn my_pass(view: ViewQuery<&FieldOcclusionFrame>) {
///     let frame = view.into_inner();
///     let _occlusion = (&frame.output.default_view, frame.page_rows());
/// }
/// ```
#[derive(Component)]
pub struct FieldOcclusionFrame {
    /// What the node fills: pages as large as the camera's target, one below the other, of four channels each; see
    /// [`OUTPUT_FORMAT`]. Below them Bevy's lighting is told which light has which.
    pub output: CachedTexture,
    pub(super) masks: MaskTable,
    /// First pixel and size of the camera's viewport.
    pub(super) viewport: (UVec2, UVec2),
    /// From clip space to the world relative to the camera.
    pub(super) world_from_clip: Mat4,
    pub(super) instances: Vec<InstanceData>,
    /// By their masks.
    pub(super) lights: Vec<Light>,
    pub(super) settings: TraceSettings,
    pub(super) screen_space: Option<ScreenSpaceCombination>,
    pub(super) accumulates: bool,
    /// Another one for other lights, or the same in another order.
    pub(super) lights_key: u64,
    pub(super) show_tile_load: bool,
}

impl FieldOcclusionFrame {
    /// Rows from a page of the output to the next.
    pub fn page_rows(&self) -> u32 {
        self.masks.page_size().y
    }
}

pub(super) fn prepare_frames(
    mut commands: Commands,
    device: Res<RenderDevice>,
    mut texture_cache: ResMut<TextureCache>,
    mut kept: ResMut<OcclusionViews>,
    mut times: ResMut<CpuTimes>,
    residency: Res<FieldResidency>,
    occluders: Res<ExtractedOccluders>,
    lights: ExtractedLights,
    views: Query<(
        Entity,
        &ExtractedView,
        &ExtractedCamera,
        &FieldOcclusion,
        Option<&FieldDebugView>,
        Option<&RenderLayers>,
        Option<&TemporalJitter>,
        Option<&MainPassResolutionOverride>,
    )>,
) {
    let started = Instant::now();
    kept.retain(|camera| views.contains(camera));
    let max_side = device.limits().max_texture_dimension_2d;
    for (entity, view, camera, occlusion, debug_view, layers, jitter, resolution) in &views {
        let Some(target_size) = camera.physical_target_size else { continue };
        let layers = layers.unwrap_or_default();
        let table = |lights: &[ShadowedLight]| {
            let lights: Vec<_> = lights.iter().map(|light| light.shader_light).collect();
            MaskTable::new(&lights, target_size, max_side)
        };
        let mut shadowed = lights.shadowed_lights(view, layers, MAX_LIGHTS);
        let mut table_of_all = table(&shadowed);
        if let Some(masks) = table_of_all.as_ref().map(MaskTable::masks).filter(|masks| *masks < shadowed.len()) {
            warn_once!(
                "a camera's target of {target_size} pixels leaves room for the shadows of {masks} lights, not of {}: textures \
                 end at {max_side} pixels here. Remove FieldShadows from lights that matter less.",
                shadowed.len()
            );
            // The most important ones of them.
            shadowed = lights.shadowed_lights(view, layers, masks);
            table_of_all = table(&shadowed);
        }
        let Some(masks) = table_of_all else {
            warn_once!("a camera's target of {target_size} pixels leaves no room for field occlusion: it shows none");
            continue;
        };
        shadowed.truncate(masks.masks());
        let output = texture_cache.get(
            &device,
            TextureDescriptor {
                label: Some("field_occlusion_texture"),
                size: masks.texture_size().to_extents(),
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format: OUTPUT_FORMAT,
                usage: TextureUsages::STORAGE_BINDING | TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
                view_formats: &[],
            },
        );
        let viewport_size = resolution.map_or(view.viewport.zw(), |resolution| resolution.0);
        let camera_position = view.world_from_view.translation();
        let settings = occlusion.trace_settings();
        let lights: Vec<Light> = shadowed.iter().map(|light| relative_light(light, camera_position)).collect();
        commands.entity(entity).insert(FieldOcclusionFrame {
            output,
            masks,
            viewport: (view.viewport.xy(), viewport_size),
            world_from_clip: relative_world_from_clip(view, jitter, viewport_size),
            instances: place_occluders(&residency, &occluders, layers, camera_position.as_dvec3(), &settings, &lights),
            lights,
            settings,
            screen_space: occlusion.screen_space_combination(),
            accumulates: occlusion.accumulate,
            lights_key: FixedHasher.hash_one(shadowed.iter().map(|light| light.entity).collect::<Vec<_>>()),
            show_tile_load: debug_view == Some(&FieldDebugView::TileLoad),
        });
    }
    times.prepare = started.elapsed();
}

/// A light as the passes know it.
fn relative_light(light: &ShadowedLight, camera: Vec3) -> Light {
    match light.shape {
        LightShape::Directional { to_light } => Light::directional(to_light, light.settings.angular_radius),
        LightShape::Point { position, radius, range, cone: None } => Light::sphere(position - camera, radius, range),
        LightShape::Point { position, radius, range, cone: Some(cone) } => {
            Light::spot(position - camera, radius, range, cone.direction, cone.outer_angle)
        }
        LightShape::Rect { position, half_width, half_height, range } => {
            let direction = half_height.cross(half_width).normalize();
            Light::rectangle(position - camera, half_width, half_height, direction, range)
        }
    }
}

/// From clip space to the world relative to the camera: free of the camera's position, and so of its rounding.
fn relative_world_from_clip(view: &ExtractedView, jitter: Option<&TemporalJitter>, size: UVec2) -> Mat4 {
    let mut clip_from_view = view.clip_from_view;
    if let Some(jitter) = jitter {
        jitter.jitter_projection(&mut clip_from_view, size.as_vec2());
    }
    Mat4::from_mat3a(view.world_from_view.affine().matrix3) * clip_from_view.inverse()
}

/// The occluders whose fields are on the GPU, relative to the camera.
fn place_occluders(
    residency: &FieldResidency,
    occluders: &ExtractedOccluders,
    camera_layers: &RenderLayers,
    camera_position: DVec3,
    settings: &TraceSettings,
    lights: &[Light],
) -> Vec<InstanceData> {
    let wanted = settings.wanted();
    let ambient = wanted.caps || settings.ambient_rays > 0;
    let place = |occluder: &ExtractedOccluder| {
        let slot = residency.slot(occluder.field)?;
        let placement = Placement::new(slot.bounds(), occluder.world_from_mesh.as_daffine3(), camera_position);
        if placement.is_none() {
            warn_once!(
                "a visibility field's transform is singular or not finite ({}): such objects do not occlude",
                occluder.world_from_mesh
            );
        }
        let hides_large_lights = slot.cap_grid().is_some_and(|grid| wanted.caps && grid.order == HarmonicOrder::Three);
        let casts = |light: &Light| slot.answers().rays || hides_large_lights && light.is_large();
        let occludes = !ambient || wanted.caps;
        if residency.answers_no_rays(occluder.field) && !(occludes && lights.iter().all(casts)) {
            warn_once!(
                "a visibility field has a cap grid alone: it casts no shadows (but of large lights, with `--order 3`), \
                 and occludes ambient light only for cameras whose FieldOcclusion takes it from cap grids. Bake it with \
                 `--representation cap-grid,distance`."
            );
        }
        Some(InstanceData::new(slot, &placement?, occluder.casting, wanted))
    };
    let place_some = |_, occluders: &[ExtractedOccluder]| -> Vec<InstanceData> {
        occluders.iter().filter(|occluder| occluder.layers.intersects(camera_layers)).filter_map(place).collect()
    };
    match ComputeTaskPool::try_get().filter(|_| occluders.0.len() > WORTH_SHARING) {
        Some(pool) => occluders.0.par_splat_map(pool, None, place_some).concat(),
        None => place_some(0, &occluders.0),
    }
}

/// More occluders than this are placed by all threads.
const WORTH_SHARING: usize = 512;
