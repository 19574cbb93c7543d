//! From the main world to the render world: cameras and lights with our components, and every occluder's transform.

use std::time::Instant;

use bevy::camera::visibility::RenderLayers;
use bevy::core_pipeline::prepass::{DepthPrepass, NormalPrepass};
use bevy::ecs::query::QueryItem;
use bevy::math::Affine3A;
use bevy::pbr::{ScreenSpaceAmbientOcclusion, ScreenSpaceAmbientOcclusionResources, SsaoBindGroups, SsaoPipelineId};
use bevy::prelude::*;
use bevy::render::Extract;
use bevy::render::extract_component::ExtractComponent;
use bevy::render::sync_component::SyncComponent;
use bevy::render::sync_world::RenderEntity;
use visfield::estimate::frame::Casting;

use super::compose::{BevysOcclusion, CombinesScreenSpace};
use super::count::CpuTimes;
use super::prepare::FieldOcclusionFrame;
use crate::asset::VisibilityField;
use crate::components::{
    FieldOcclusion, FieldShadows, NotFieldAmbientOccluder, NotFieldOccluder, NotFieldShadowCaster,
    ScreenSpaceOcclusion, VisibilityField3d,
};
use crate::receivers::OwnSurfaceOcclusion;

/// The frame's occluders.
#[derive(Resource, Default)]
pub(super) struct ExtractedOccluders(pub(super) Vec<ExtractedOccluder>);

/// Which field occludes, where, and for whom.
pub(super) struct ExtractedOccluder {
    pub(super) field: AssetId<VisibilityField>,
    pub(super) world_from_mesh: Affine3A,
    pub(super) casting: Casting,
    /// The layers that it is on; a camera that shares none does not see it occlude.
    pub(super) layers: RenderLayers,
}

/// Copies what occludes: visible entities with a field. Entities outside the view count, since they cast into it.
pub(super) fn extract_occluders(
    mut extracted: ResMut<ExtractedOccluders>,
    mut times: ResMut<CpuTimes>,
    occluders: Extract<
        Query<
            (
                &VisibilityField3d,
                &GlobalTransform,
                &InheritedVisibility,
                Option<&RenderLayers>,
                Option<&OwnSurfaceOcclusion>,
                Has<NotFieldAmbientOccluder>,
                Has<NotFieldShadowCaster>,
            ),
            Without<NotFieldOccluder>,
        >,
    >,
) {
    let started = Instant::now();
    extracted.0.clear();
    let visible = occluders.iter().filter(|(_, _, visibility, ..)| visibility.get());
    extracted.0.extend(visible.map(|(field, transform, _, layers, own_surface, no_ambient, no_shadows)| {
        let own_surface = own_surface != Some(&OwnSurfaceOcclusion::Off);
        ExtractedOccluder {
            field: field.id(),
            world_from_mesh: transform.affine(),
            casting: Casting { ambient: !no_ambient, shadows: !no_shadows, own_surface },
            layers: layers.cloned().unwrap_or_default(),
        }
    }));
    times.extract = started.elapsed();
}

impl SyncComponent for FieldOcclusion {
    // What must leave the camera with it, or Bevy's pipelines and bind groups would disagree about the texture.
    type Target = (
        Self,
        FieldOcclusionFrame,
        CombinesScreenSpace,
        BevysOcclusion,
        ScreenSpaceAmbientOcclusion,
        ScreenSpaceAmbientOcclusionResources,
        SsaoPipelineId,
        SsaoBindGroups,
    );
}

/// Pixels of a viewport's larger side below which a camera shows no occlusion: Bevy's own effect, whose place we take,
/// makes a texture with five levels, and fails where there is no room for them.
const SMALLEST_VIEWPORT: u32 = 16;

/// Copies the settings of cameras that can show field occlusion, and clears those that no longer can.
pub(super) fn extract_cameras(
    mut commands: Commands,
    cameras: Extract<
        Query<
            (
                RenderEntity,
                &Camera,
                &Msaa,
                &FieldOcclusion,
                Option<&ScreenSpaceAmbientOcclusion>,
                Has<DepthPrepass>,
                Has<NormalPrepass>,
            ),
            With<Camera3d>,
        >,
    >,
) {
    for (entity, camera, msaa, settings, screen_space, depth, normals) in &cameras {
        let mut view = commands.entity(entity);
        if !depth || !normals {
            warn_once!(
                "FieldOcclusion needs the DepthPrepass and NormalPrepass that it brought, but one was removed from its \
                 camera: that camera shows no field occlusion. Insert both again."
            );
        }
        if *msaa != Msaa::Off {
            warn_once!(
                "FieldOcclusion needs Msaa::Off, but its camera has Msaa::{msaa:?}: that camera shows no field occlusion. \
                 Insert Msaa::Off (and an anti-aliasing that works after shading, such as TAA, SMAA or FXAA)."
            );
        }
        let large_enough = camera.physical_viewport_size().is_some_and(|size| size.max_element() >= SMALLEST_VIEWPORT);
        if camera.is_active && large_enough && *msaa == Msaa::Off && depth && normals {
            // Bevy's component makes its pipelines and bind groups expect an occlusion texture. It is set in the render
            // world only, so that the user's world keeps just what the user put there.
            view.insert((*settings, screen_space.cloned().unwrap_or_default()));
            if screen_space.is_some() && settings.screen_space != ScreenSpaceOcclusion::Ignored {
                view.insert(CombinesScreenSpace);
            } else {
                view.remove::<(CombinesScreenSpace, BevysOcclusion)>();
            }
        } else {
            view.remove::<<FieldOcclusion as SyncComponent>::Target>();
        }
    }
}

impl SyncComponent for FieldShadows {
    type Target = Self;
}

impl ExtractComponent for FieldShadows {
    type QueryData = &'static Self;
    type QueryFilter = Or<(With<DirectionalLight>, With<PointLight>, With<SpotLight>, With<RectLight>)>;
    type Out = Self;

    fn extract_component(settings: QueryItem<'_, '_, Self::QueryData>) -> Option<Self> {
        Some(*settings)
    }
}
