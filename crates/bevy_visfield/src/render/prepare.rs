//! Puts each camera's frame together: occluders relative to the camera, the lights by channel, and the texture to fill.

use bevy::camera::MainPassResolutionOverride;
use bevy::camera::visibility::RenderLayers;
use bevy::image::ToExtents;
use bevy::math::{DVec3, Mat4, UVec2};
use bevy::pbr::ExtractedDirectionalLight;
use bevy::prelude::*;
use bevy::render::camera::{ExtractedCamera, TemporalJitter};
use bevy::render::render_resource::{TextureDescriptor, TextureDimension, TextureUsages};
use bevy::render::renderer::RenderDevice;
use bevy::render::texture::{CachedTexture, TextureCache};
use bevy::render::view::ExtractedView;
use visfield::estimate::frame::{FrameLight, MAX_LIGHTS, TraceSettings};
use visfield::field::cap_grid::HarmonicOrder;
use visfield::gpu::OUTPUT_FORMAT;
use visfield::gpu::layout::InstanceData;
use visfield::scene::Placement;

use super::extract::{ExtractedOccluder, ExtractedOccluders};
use super::node::OcclusionViews;
use super::residency::FieldResidency;
use crate::components::{FieldOcclusion, FieldShadows};

/// One camera's frame, on its view in the render world, for passes of your own that read the occlusion texture.
///
/// ```
/// use bevy::{prelude::*, render::renderer::ViewQuery};
/// use bevy_visfield::FieldOcclusionFrame;
/// fn my_pass(view: ViewQuery<&FieldOcclusionFrame>) {
///     let _occlusion = &view.into_inner().output.default_view;
/// }
/// ```
#[derive(Component)]
pub struct FieldOcclusionFrame {
    /// What the node fills, as large as the camera's target; see [`OUTPUT_FORMAT`] for its channels.
    pub output: CachedTexture,
    /// First pixel and size of the camera's viewport.
    pub(super) viewport: (UVec2, UVec2),
    /// From clip space to the world relative to the camera.
    pub(super) world_from_clip: Mat4,
    pub(super) instances: Vec<InstanceData>,
    pub(super) lights: Vec<FrameLight>,
    pub(super) settings: TraceSettings,
}

pub(super) fn prepare_frames(
    mut commands: Commands,
    device: Res<RenderDevice>,
    mut texture_cache: ResMut<TextureCache>,
    mut kept: ResMut<OcclusionViews>,
    residency: Res<FieldResidency>,
    occluders: Res<ExtractedOccluders>,
    lights: Query<(Entity, &ExtractedDirectionalLight, Option<&RenderLayers>, Option<&FieldShadows>)>,
    views: Query<(
        Entity,
        &ExtractedView,
        &ExtractedCamera,
        &FieldOcclusion,
        Option<&RenderLayers>,
        Option<&TemporalJitter>,
        Option<&MainPassResolutionOverride>,
    )>,
) {
    kept.retain(|camera| views.contains(camera));
    for (entity, view, camera, settings, layers, jitter, resolution) in &views {
        let Some(target_size) = camera.physical_target_size else { continue };
        let output = texture_cache.get(
            &device,
            TextureDescriptor {
                label: Some("field_occlusion_texture"),
                size: target_size.to_extents(),
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format: OUTPUT_FORMAT,
                usage: TextureUsages::STORAGE_BINDING | TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            },
        );
        let viewport_size = resolution.map_or(view.viewport.zw(), |resolution| resolution.0);
        let camera_position = view.world_from_view.translation().as_dvec3();
        let (layers, settings) = (layers.unwrap_or_default(), settings.trace_settings());
        let lights = masked_lights(&lights, layers);
        commands.entity(entity).insert(FieldOcclusionFrame {
            output,
            viewport: (view.viewport.xy(), viewport_size),
            world_from_clip: relative_world_from_clip(view, jitter, viewport_size),
            instances: place_occluders(&residency, &occluders, layers, camera_position, &settings, &lights),
            lights,
            settings,
        });
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
    lights: &[FrameLight],
) -> Vec<InstanceData> {
    let caps = settings.caps.is_some();
    let ambient = caps || settings.ambient_rays > 0;
    let place = |occluder: &ExtractedOccluder| {
        let slot = residency.slot(occluder.field)?;
        let placement = Placement::new(slot.bounds(), occluder.world_from_mesh.as_daffine3(), camera_position);
        if placement.is_none() {
            warn_once!(
                "a visibility field's transform is singular or not finite ({}): such objects do not occlude",
                occluder.world_from_mesh
            );
        }
        let hides_large_lights = slot.cap_grid().is_some_and(|grid| caps && grid.order == HarmonicOrder::Three);
        let casts = |light: &FrameLight| slot.table().is_some() || hides_large_lights && light.is_large();
        let occludes = !ambient || caps;
        if residency.lacks_table(occluder.field) && !(occludes && lights.iter().all(casts)) {
            warn_once!(
                "a visibility field has a cap grid and no table: it casts no shadows (but of large lights, with `--order 3`), \
                 and occludes ambient light only for cameras whose FieldOcclusion takes it from cap grids. Bake it with \
                 `--representation two-point,cap-grid`."
            );
        }
        Some(InstanceData::new(slot, &placement?, caps))
    };
    occluders.0.iter().filter(|occluder| occluder.layers.intersects(camera_layers)).filter_map(place).collect()
}

/// The lights with field shadows. A light's channel is its index in Bevy's shader, which `prepare_lights` gives by (volumetric,
/// shadow maps, entity) among the lights on the camera's layers.
fn masked_lights(
    lights: &Query<(Entity, &ExtractedDirectionalLight, Option<&RenderLayers>, Option<&FieldShadows>)>,
    camera_layers: &RenderLayers,
) -> Vec<FrameLight> {
    let mut seen: Vec<_> =
        lights.iter().filter(|(_, _, layers, _)| layers.unwrap_or_default().intersects(camera_layers)).collect();
    seen.sort_by_key(|(entity, light, _, _)| (light.volumetric, light.shadow_maps_enabled, *entity));
    let masked = seen.iter().enumerate().filter_map(|(index, (_, light, _, shadows))| {
        let shadows = (*shadows)?;
        if index >= MAX_LIGHTS {
            warn_once!(
                "only the first {MAX_LIGHTS} directional lights of a camera can have field shadows; lights without \
                 FieldShadows count too, before those with shadow maps"
            );
            return None;
        }
        let to_light = light.transform.back().as_vec3();
        to_light.is_normalized().then(|| FrameLight::new(index, to_light, shadows.angular_radius))
    });
    masked.collect()
}
