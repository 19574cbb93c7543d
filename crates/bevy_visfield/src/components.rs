//! What users put on entities.

use bevy::core_pipeline::prepass::{DepthPrepass, NormalPrepass};
use bevy::prelude::*;

use visfield::estimate::caps::CapCombination;
use visfield::estimate::frame::{MAX_RAYS, TraceSettings};
use visfield::field::query::Bias;

use crate::asset::VisibilityField;

/// The visibility field of a rigid object. Its entity occludes: it darkens ambient light on its neighbours and on itself,
/// and shadows the lights that have [`FieldShadows`].
///
/// The field must have been baked from the mesh on the same entity; any invertible transform is fine, mirrored and
/// non-uniform ones included. Instances share one field.
///
/// ```
/// use bevy::{gltf::GltfAssetLabel, prelude::*};
/// use bevy_visfield::VisibilityField3d;
/// fn rock(assets: &AssetServer) -> impl Bundle {
///     let label = GltfAssetLabel::Primitive { mesh: 0, primitive: 0 };
///     (Mesh3d(assets.load(label.from_asset("rock.glb"))), VisibilityField3d(assets.load(label.from_asset("rock.vfield"))))
/// }
/// ```
#[derive(Component, Reflect, Clone, Debug, Default, PartialEq, Eq, Deref, DerefMut)]
#[reflect(Component, Default, Clone, PartialEq)]
#[require(Transform, Visibility)]
pub struct VisibilityField3d(pub Handle<VisibilityField>);

impl From<Handle<VisibilityField>> for VisibilityField3d {
    fn from(handle: Handle<VisibilityField>) -> Self {
        Self(handle)
    }
}

/// Keeps an entity with a [`VisibilityField3d`] from occluding, until this marker is removed.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::{NotFieldOccluder, VisibilityField3d};
/// fn ghost(field: VisibilityField3d) -> impl Bundle {
///     (field, NotFieldOccluder)
/// }
/// ```
#[derive(Component, Reflect, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct NotFieldOccluder;

/// Shows ambient occlusion and soft shadows from visibility fields on a 3D camera.
///
/// Brings the depth and normal prepasses that it needs. Like Bevy's own screen-space effects it also needs `Msaa::Off` on
/// its camera; with another `Msaa` it warns once and does nothing.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::{FieldOcclusion, FieldOcclusionQuality};
/// fn camera() -> impl Bundle {
///     let nearby = FieldOcclusion { max_distance: 5.0, quality: FieldOcclusionQuality::Low, ..default() };
///     (Camera3d::default(), Msaa::Off, nearby)
/// }
/// ```
#[derive(Component, Reflect, Clone, Copy, Debug, PartialEq)]
#[reflect(Component, Default, Clone, PartialEq)]
#[require(DepthPrepass, NormalPrepass)]
pub struct FieldOcclusion {
    /// The trade of time for accuracy: what ambient occlusion is taken from, and how many rays are sent.
    pub quality: FieldOcclusionQuality,
    /// What ambient occlusion is taken from, if not what the quality says.
    pub estimator: OcclusionEstimator,
    /// Whether ambient light is occluded. Shadows of lights with [`FieldShadows`] do not depend on it.
    pub ambient_occlusion: bool,
    /// Ambient occlusion ignores surfaces beyond this distance, in world units, 0 to infinity (the default). A finite
    /// distance is cheaper in large scenes. Below the size of an object it is coarse: a cap grid knows the object as a whole,
    /// which fades out, and a table knows the ends of a line, not what lies between.
    pub max_distance: f32,
    /// Scales how far an occluder must rise above the plane of a receiver to count, 1 by default: a small part of a cell of
    /// its table. Raise it if surfaces shadow themselves; lower it if fine creases are lost.
    pub bias: f32,
}

impl Default for FieldOcclusion {
    fn default() -> Self {
        Self {
            quality: FieldOcclusionQuality::default(),
            estimator: OcclusionEstimator::default(),
            ambient_occlusion: true,
            max_distance: f32::INFINITY,
            bias: 1.0,
        }
    }
}

impl FieldOcclusion {
    /// How cap grids combine, if they are asked.
    fn caps(&self) -> Option<CapCombination> {
        use FieldOcclusionQuality::{Custom, High, Low, Medium, Ultra};
        let by_quality = matches!(self.quality, Low | Medium);
        let asked = match self.estimator {
            OcclusionEstimator::ByQuality => by_quality,
            OcclusionEstimator::CapGrid => true,
            OcclusionEstimator::Rays => false,
        };
        let combination = match self.quality {
            Low => CapCombination::Product,
            Medium | Custom { .. } => CapCombination::SoftCaps { directions: 8 },
            High | Ultra => CapCombination::SoftCaps { directions: 16 },
        };
        asked.then_some(combination)
    }

    pub(crate) fn trace_settings(&self) -> TraceSettings {
        let rays = self.quality.rays();
        let bias = Bias::default();
        let scale = if self.bias.is_finite() { self.bias.max(0.0) } else { 1.0 };
        TraceSettings {
            caps: if self.ambient_occlusion { self.caps() } else { None },
            ambient_rays: if self.ambient_occlusion { rays.ambient } else { 0 },
            shadow_rays: rays.shadow,
            max_distance: self.max_distance,
            bias: Bias { height: bias.height * scale, along: bias.along * scale },
        }
    }
}

/// What ambient occlusion is taken from. A field is asked by the part that it has: one without a cap grid gets rays, and
/// receivers inside an object whose grid is known to be wrong there (a hollow crate) get rays too.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::{FieldOcclusion, OcclusionEstimator};
/// fn by_rays() -> FieldOcclusion {
///     FieldOcclusion { estimator: OcclusionEstimator::Rays, ..default() }
/// }
/// ```
#[derive(Reflect, Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[reflect(Default, Clone, PartialEq, Hash)]
pub enum OcclusionEstimator {
    /// Cap grids for [`Low`](FieldOcclusionQuality::Low) and [`Medium`](FieldOcclusionQuality::Medium), rays for the others.
    #[default]
    ByQuality,
    /// Cap grids: one interpolated read per pixel and object near it. No noise, no filter. Objects are combined as if they hid
    /// each other by chance at [`Low`](FieldOcclusionQuality::Low), along 16 directions at
    /// [`High`](FieldOcclusionQuality::High) and [`Ultra`](FieldOcclusionQuality::Ultra), and along 8 otherwise.
    CapGrid,
    /// Rays through tables. More accurate on an object's own surface and in contact, at many times the cost; the noise is
    /// filtered. A field without a table does not occlude ambient light.
    Rays,
}

/// What [`FieldOcclusion`] spends. The denoiser gathers the rays of 8×8 pixels for ambient occlusion and of 4×4 for each light,
/// so that a surface sends 64 and 16 times as many as a pixel.
///
/// ```
/// use bevy_visfield::FieldOcclusionQuality;
/// assert_eq!(FieldOcclusionQuality::High.rays().ambient, 16);
/// ```
#[derive(Reflect, Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[reflect(Default, Clone, PartialEq, Hash)]
pub enum FieldOcclusionQuality {
    /// Ambient occlusion by cap grids, objects combined as if they hid each other by chance. 4 rays per pixel for each light,
    /// and for the ambient occlusion of fields without a grid.
    Low,
    /// Ambient occlusion by cap grids, objects combined along 8 directions. 8 rays per pixel for each light, and for the
    /// ambient occlusion of fields without a grid.
    #[default]
    Medium,
    /// 16 rays per pixel for ambient occlusion, and 16 for each light.
    High,
    /// 32 rays per pixel for ambient occlusion, and 32 for each light.
    Ultra,
    /// Numbers of your own, each 1 to 32; others are clamped. Ambient occlusion is by rays, unless
    /// [`OcclusionEstimator::CapGrid`] is chosen.
    Custom {
        /// Ambient occlusion rays per pixel.
        ambient_rays: u32,
        /// Rays per pixel and light.
        shadow_rays: u32,
    },
}

/// Rays per pixel.
///
/// ```
/// assert_eq!(bevy_visfield::FieldOcclusionQuality::Low.rays().shadow, 4);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RaysPerPixel {
    /// Ambient occlusion rays.
    pub ambient: u32,
    /// Rays per light.
    pub shadow: u32,
}

impl FieldOcclusionQuality {
    /// The numbers behind a preset.
    pub const fn rays(self) -> RaysPerPixel {
        let (ambient, shadow) = match self {
            Self::Low => (4, 4),
            Self::Medium => (8, 8),
            Self::High => (16, 16),
            Self::Ultra => (MAX_RAYS, MAX_RAYS),
            Self::Custom { ambient_rays, shadow_rays } => (ambient_rays, shadow_rays),
        };
        RaysPerPixel { ambient: clamp_rays(ambient), shadow: clamp_rays(shadow) }
    }
}

/// `Ord::clamp`, which is not yet const.
const fn clamp_rays(rays: u32) -> u32 {
    if rays < 1 {
        1
    } else if rays > MAX_RAYS {
        MAX_RAYS
    } else {
        rays
    }
}

/// Soft shadows of a directional light, cast by entities with a [`VisibilityField3d`].
///
/// They multiply with the light's shadow maps, if it has those too: let objects with fields stay out of the maps
/// (`NotShadowCaster`), or turn the maps off.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::FieldShadows;
/// fn hazy_sun() -> impl Bundle {
///     (DirectionalLight::default(), FieldShadows { angular_radius: 0.03 })
/// }
/// ```
#[derive(Component, Reflect, Clone, Copy, Debug, PartialEq)]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct FieldShadows {
    /// Half of the angle that the light's disc covers in the sky, in radians, 0 to 1.2. Larger is softer. From 0.26 (15°) on, the
    /// cap grids of fields that were baked with `--order 3` hide it, without rays and noise, where cap grids are used; at 15°
    /// they are coarse, from 0.5 on good.
    pub angular_radius: f32,
}

impl FieldShadows {
    /// The sun in a clear sky. Sharper than the default tables resolve; see [`HAZY`](Self::HAZY).
    pub const SUN: Self = Self { angular_radius: 0.00465 };
    /// The sun through haze: as sharp as the default 65² × 32² tables resolve without showing their cells.
    pub const HAZY: Self = Self { angular_radius: 0.05 };
    /// A bright part of the sky.
    pub const SKY: Self = Self { angular_radius: 0.3 };
}

impl Default for FieldShadows {
    fn default() -> Self {
        Self::HAZY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_and_degenerate_settings_stay_in_range() {
        use FieldOcclusionQuality::{Custom, High, Low, Medium, Ultra};
        let wild = Custom { ambient_rays: 0, shadow_rays: u32::MAX };
        for quality in [Low, Medium, High, Ultra, wild] {
            for strange in [f32::NAN, f32::INFINITY, -1.0, 0.0] {
                let settings = FieldOcclusion { quality, max_distance: strange, bias: strange, ..default() };
                let trace = settings.trace_settings();
                assert!((1..=MAX_RAYS).contains(&trace.ambient_rays));
                assert!((1..=MAX_RAYS).contains(&trace.shadow_rays));
                assert!(trace.clamped().max_distance >= 0.0);
                assert!(trace.bias.height >= 0.0 && trace.bias.along.is_finite());
            }
        }
    }

    #[test]
    fn ambient_occlusion_can_be_off_on_its_own() {
        let off = FieldOcclusion { ambient_occlusion: false, ..default() }.trace_settings();
        assert_eq!((off.ambient_rays, off.caps), (0, None));
        assert!(off.shadow_rays > 0);
    }

    #[test]
    fn the_cheaper_presets_use_cap_grids_unless_told_otherwise() {
        use FieldOcclusionQuality::{Custom, High, Low, Medium, Ultra};
        let caps = |quality, estimator| FieldOcclusion { quality, estimator, ..default() }.trace_settings().caps;
        let custom = Custom { ambient_rays: 3, shadow_rays: 3 };
        for (quality, by_caps) in [(Low, true), (Medium, true), (High, false), (Ultra, false), (custom, false)] {
            assert_eq!(caps(quality, OcclusionEstimator::ByQuality).is_some(), by_caps, "{quality:?}");
            assert!(caps(quality, OcclusionEstimator::CapGrid).is_some());
            assert!(caps(quality, OcclusionEstimator::Rays).is_none());
        }
        assert_eq!(caps(Low, OcclusionEstimator::ByQuality), Some(CapCombination::Product));
    }
}
