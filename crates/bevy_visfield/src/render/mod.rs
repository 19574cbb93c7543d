//! A frame, stage by stage: [`extract`] what moved, [`residency`] of fields on the GPU, [`prepare`] each camera's frame, run
//! the [`node`], and [`compose`] the result into Bevy's lighting.

mod budget;
mod compose;
mod count;
mod extract;
mod feedback;
mod levels;
mod lights;
mod masks;
mod node;
mod prepare;
mod residency;

use bevy::core_pipeline::core_3d::main_opaque_pass_3d;
use bevy::core_pipeline::{Core3d, Core3dSystems};
use bevy::pbr::deferred::deferred_lighting;
use bevy::pbr::prepare_mesh_view_bind_groups;
use bevy::prelude::*;
use bevy::render::extract_component::ExtractComponentPlugin;
use bevy::render::renderer::RenderDevice;
use bevy::render::sync_component::SyncComponentPlugin;
use bevy::render::{ExtractSchedule, GpuResourceAppExt, Render, RenderApp, RenderSystems};
use visfield::gpu::OcclusionPasses;

use crate::components::{FieldOcclusion, FieldShadows};
use crate::receivers;
use crate::shader_patch::patch_shaders;
use node::OcclusionViews;

pub use budget::{FieldLevel, FieldMemoryBudget};
#[cfg(test)]
pub(crate) use count::CpuTimes;
pub(crate) use count::{FrameCounts, LatestCounts, count_frame};
#[cfg(test)]
pub(crate) use feedback::FieldOnGpu;
pub(crate) use feedback::RenderFeedback;
pub use prepare::FieldOcclusionFrame;
pub use residency::FieldResidency;

/// Where this plugin's systems run, for ordering your own around them.
///
/// ```
/// use bevy::{core_pipeline::Core3d, prelude::*};
/// use bevy_visfield::FieldOcclusionSystems;
/// fn order(render_app: &mut App, system: fn()) {
///     render_app.add_systems(Core3d, system.after(FieldOcclusionSystems::Trace));
/// }
/// ```
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FieldOcclusionSystems {
    /// In `ExtractSchedule`: cameras, occluders and their transforms are copied.
    Extract,
    /// In `Render`, within `RenderSystems::PrepareResources`: each camera's frame is put together.
    Prepare,
    /// In `Render`, after `RenderSystems::PrepareBindGroups`: the occlusion texture is bound to Bevy's lighting.
    Compose,
    /// In `Core3d`, at the start of `Core3dSystems::MainPass`: the occlusion texture is computed.
    Trace,
}

pub(crate) fn plugin(app: &mut App) {
    app.init_resource::<FieldMemoryBudget>()
        .init_resource::<RenderFeedback>()
        .register_type::<FieldMemoryBudget>()
        .register_type::<FieldLevel>();
    // Without a renderer, as on a server, their hooks would panic where a component is removed.
    if app.get_sub_app(RenderApp).is_some() {
        app.add_plugins((
            SyncComponentPlugin::<FieldOcclusion>::default(),
            ExtractComponentPlugin::<FieldShadows>::default(),
        ));
    }
}

/// Adds what needs a capable GPU, or warns once and leaves the plugin inert.
pub(crate) fn finish(app: &mut App) {
    let feedback = app.world().resource::<RenderFeedback>().clone();
    let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
    let limits = render_app.world().resource::<RenderDevice>().limits();
    if let Err(missing) = OcclusionPasses::check(&limits).and_then(|()| compose::check(&limits)) {
        warn!("VisibilityFieldPlugin stays inert: {missing}. Objects will not occlude each other.");
        return;
    }
    feedback.activate();
    render_app
        .insert_resource(feedback)
        .init_gpu_resource::<FieldResidency>()
        .init_resource::<extract::ExtractedOccluders>()
        .init_resource::<count::CpuTimes>()
        .init_gpu_resource::<OcclusionViews>()
        .add_systems(
            ExtractSchedule,
            (extract::extract_cameras, extract::extract_occluders, residency::extract_fields)
                .in_set(FieldOcclusionSystems::Extract),
        )
        .configure_sets(
            Render,
            (
                FieldOcclusionSystems::Prepare.in_set(RenderSystems::PrepareResources),
                FieldOcclusionSystems::Compose.after(RenderSystems::PrepareBindGroups).before(RenderSystems::Render),
            ),
        )
        .add_systems(
            Render,
            (
                residency::update_residency.in_set(RenderSystems::PrepareAssets),
                prepare::prepare_frames.in_set(FieldOcclusionSystems::Prepare),
                // Bevy's bind groups are made once more, with our texture in the place of its own.
                (compose::replace_occlusion_texture, prepare_mesh_view_bind_groups)
                    .chain()
                    .run_if(any_with_component::<FieldOcclusionFrame>)
                    .in_set(FieldOcclusionSystems::Compose),
            ),
        )
        .configure_sets(
            Core3d,
            // Within this set, so that Bevy's own screen-space ambient occlusion, which comes before it, can be joined; and
            // before all that reads the result.
            FieldOcclusionSystems::Trace
                .in_set(Core3dSystems::MainPass)
                .before(main_opaque_pass_3d)
                .before(deferred_lighting),
        )
        .add_systems(Core3d, node::field_occlusion.in_set(FieldOcclusionSystems::Trace));
    patch_shaders(app, [compose::MASK_DIRECT_LIGHT]);
    receivers::keep_receiver_flags(app);
}
