//! Moving rigid objects give each other true ambient occlusion and soft shadows, from visibility baked once per mesh.
//!
//! Add [`VisibilityFieldPlugin`]; bake each rigid mesh (`visfield bake rock.glb`); then
//!
//! ```no_run
//! use bevy::{gltf::GltfAssetLabel, prelude::*};
//! use bevy_visfield::prelude::*;
//!
//! App::new()
//!     .add_plugins((DefaultPlugins, VisibilityFieldPlugin))
//!     .add_systems(Startup, |mut commands: Commands, assets: Res<AssetServer>| {
//!         let label = GltfAssetLabel::Primitive { mesh: 0, primitive: 0 };
//!         // A rigid object: its mesh, and the field that was baked from it.
//!         commands.spawn((
//!             Mesh3d(assets.load(label.from_asset("rock.glb"))),
//!             MeshMaterial3d::<StandardMaterial>::default(),
//!             VisibilityField3d(assets.load(label.from_asset("rock.vfield"))),
//!         ));
//!         // A light that casts soft shadows through the fields, and a camera that shows them.
//!         commands.spawn((DirectionalLight::default(), FieldShadows::default()));
//!         commands.spawn((Camera3d::default(), Msaa::Off, FieldOcclusion::default()));
//!     })
//!     .run();
//! ```
//!
//! Materials stay unmodified `StandardMaterial`s, forward or deferred. The data's path: [`asset`] loads fields,
//! `render/` extracts instances, prepares a camera's frame, runs the node between prepass and main pass, and hands the
//! result to Bevy's PBR shader. Feature `bake` adds `bake`: fields baked at run time, in the background. Feature `gizmos` adds
//! `FieldBoundsGizmos`, which draws the bounds of fields.
//!
//! - [`FieldShadows`] makes the shadows of a light of any kind, as soft as the light is large; [`FieldOcclusion`] has a camera's
//!   settings, [`FieldOcclusionQuality`] the presets.
//! - [`NotFieldOccluder`], [`NotFieldAmbientOccluder`], [`NotFieldShadowCaster`], [`NotFieldReceiver`] and [`OwnSurfaceOcclusion`]
//!   opt single entities out.
//! - [`FieldMemoryBudget`] bounds the GPU memory of fields.
//! - [`why_no_shadow`], [`FieldDebugView`] and [`FieldOcclusionDiagnosticsPlugin`] tell what goes on.
//!
//! # Limits
//! - Opaque and alpha-masked surfaces receive occlusion. Transparent ones are lit by what lies behind them, as with Bevy's
//!   own screen-space ambient occlusion.
//! - Every camera masks the eleven lights that matter most to it: directional ones, then those that are brightest there. Others stay
//!   unshadowed, with one warning. So do some of them on pictures so tall that their masks exceed the GPU's largest texture.
//! - Bevy's `RectLight` needs Bevy's cargo feature `area_light_luts`; without it, Bevy draws no light of it.
//! - A field with a cap grid alone casts no shadows, but of directional lights of 15° of half-angle and more if it was baked with
//!   `--order 3`.
//! - Cap grids do not resolve what is smaller than their cells: contacts are soft, and an object's own creases shallow.
//!   [`OcclusionEstimator::Rays`] shows more of both.
//! - Light that a material lets through (`diffuse_transmission`) is not shadowed by fields.
//! - [`FieldOcclusion`] needs `Msaa::Off`, and a viewport of 16 pixels or more. Its result takes the place of that of Bevy's
//!   `ScreenSpaceAmbientOcclusion`, whose textures Bevy still allocates. If the camera has that effect too, both are
//!   combined, as [`ScreenSpaceOcclusion`] says.
//! - While the plugin is active, the two upper bits of every `MeshTag` stand for `NotFieldReceiver` and `OwnSurfaceOcclusion`: leave them 0.
//! - Volumetric light and fog know shadow maps only, not field shadows.
//! - Shadows and these two components reach Bevy's shaders by patches of their text, made for Bevy 0.19. If the text is another, one
//!   error says what is missing.

// The code in the README and the guide compiles.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct Readme;
#[cfg(doctest)]
#[doc = include_str!("../../../docs/guide.md")]
struct Guide;

pub mod asset;
#[cfg(feature = "bake")]
pub mod bake;
mod components;
mod debug;
mod diagnose;
mod diagnostics;
#[cfg(feature = "gizmos")]
mod gizmos;
mod implicit;
mod no_shadow;
mod receivers;
mod render;
mod shader_patch;

use bevy::app::{App, Plugin, PostUpdate};
use bevy::asset::AssetApp;

pub use asset::{VisibilityField, VisibilityFieldLoader, VisibilityFieldSet};
pub use components::{
    FieldOcclusion, FieldOcclusionCost, FieldOcclusionQuality, FieldShadows, NotFieldAmbientOccluder, NotFieldOccluder,
    NotFieldShadowCaster, OcclusionEstimator, OcclusionFalloff, ScreenSpaceOcclusion, ShadowEstimator,
    VisibilityField3d,
};
pub use debug::FieldDebugView;
pub use diagnostics::FieldOcclusionDiagnosticsPlugin;
#[cfg(feature = "gizmos")]
pub use gizmos::FieldBoundsGizmos;
pub use implicit::ImplicitSurface3d;
pub use no_shadow::{FieldShadowDiagnosis, NoShadow, why_no_shadow};
pub use receivers::{NotFieldReceiver, OwnSurfaceOcclusion};
pub use render::{FieldLevel, FieldMemoryBudget, FieldOcclusionFrame, FieldOcclusionSystems, FieldResidency};

/// What most users need.
pub mod prelude {
    #[cfg(feature = "bake")]
    pub use crate::bake::{BakeProgress, BakeVisibilityField};
    pub use crate::{
        FieldDebugView, FieldMemoryBudget, FieldOcclusion, FieldOcclusionQuality, FieldShadowDiagnosis, FieldShadows,
        ImplicitSurface3d, NotFieldAmbientOccluder, NotFieldOccluder, NotFieldReceiver, NotFieldShadowCaster,
        OcclusionEstimator, OcclusionFalloff, OwnSurfaceOcclusion, ScreenSpaceOcclusion, ShadowEstimator,
        VisibilityField, VisibilityField3d, VisibilityFieldPlugin,
    };
}

/// Ambient occlusion and soft shadows from visibility fields.
///
/// Needs Bevy's PBR plugins. On a GPU that lacks a capability it warns once and stays inert.
///
/// ```no_run
/// use bevy::prelude::*;
/// App::new().add_plugins((DefaultPlugins, bevy_visfield::VisibilityFieldPlugin)).run();
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct VisibilityFieldPlugin;

impl Plugin for VisibilityFieldPlugin {
    fn build(&self, app: &mut App) {
        app.init_asset::<VisibilityField>()
            .init_asset::<VisibilityFieldSet>()
            .init_asset_loader::<VisibilityFieldLoader>()
            .register_type::<VisibilityField3d>()
            .register_type::<NotFieldOccluder>()
            .register_type::<NotFieldAmbientOccluder>()
            .register_type::<NotFieldShadowCaster>()
            .register_type::<FieldOcclusion>()
            .register_type::<FieldShadows>()
            .register_type::<FieldDebugView>()
            .register_type::<NoShadow>()
            .register_type::<NotFieldReceiver>()
            .register_type::<OwnSurfaceOcclusion>()
            .add_systems(PostUpdate, components::bring_motion_vectors)
            .add_plugins((render::plugin, debug::plugin, diagnose::plugin, implicit::plugin));
        #[cfg(feature = "bake")]
        app.add_plugins(bake::plugin);
        #[cfg(feature = "gizmos")]
        if app.is_plugin_added::<bevy::gizmos::GizmoPlugin>() {
            app.add_plugins(gizmos::plugin);
        }
    }

    fn finish(&self, app: &mut App) {
        render::finish(app);
    }
}
