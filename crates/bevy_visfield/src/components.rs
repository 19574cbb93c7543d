//! What users put on entities.

use bevy::core_pipeline::prepass::{DepthPrepass, MotionVectorPrepass, NormalPrepass};
use bevy::prelude::*;

use visfield::estimate::Falloff;
use visfield::estimate::caps::CapCombination;
use visfield::estimate::frame::{MAX_DENOISE_PASSES, MAX_RAYS, TraceResolution, TraceSettings};
use visfield::field::query::Bias;
use visfield::gpu::ScreenSpaceCombination;

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

/// Keeps an entity with a [`VisibilityField3d`] from occluding, until this marker is removed: it casts neither ambient occlusion nor
/// shadows. See [`NotFieldAmbientOccluder`] and [`NotFieldShadowCaster`] for one of both.
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

/// Keeps an entity with a [`VisibilityField3d`] from occluding ambient light. It still casts shadows.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::{NotFieldAmbientOccluder, VisibilityField3d};
/// fn net(field: VisibilityField3d) -> impl Bundle {
///     (field, NotFieldAmbientOccluder)
/// }
/// ```
#[derive(Component, Reflect, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct NotFieldAmbientOccluder;

/// Keeps an entity with a [`VisibilityField3d`] from casting shadows: a lamp on its own light, an object whose shadow map does. It
/// still occludes ambient light.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::{NotFieldShadowCaster, VisibilityField3d};
/// fn lamp(field: VisibilityField3d) -> impl Bundle {
///     (field, NotFieldShadowCaster)
/// }
/// ```
#[derive(Component, Reflect, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct NotFieldShadowCaster;

/// Shows ambient occlusion and soft shadows from visibility fields on a 3D camera.
///
/// Brings the depth and normal prepasses that it needs. Like Bevy's own screen-space effects it also needs `Msaa::Off` on
/// its camera: depth and normals of several samples per pixel would need rays from each of them. With another `Msaa` it warns once
/// and does nothing; smooth edges with FXAA, SMAA or TAA.
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
    /// What shadows are taken from, if not what the quality says.
    pub shadows: ShadowEstimator,
    /// Whether ambient light is occluded. Shadows of lights with [`FieldShadows`] do not depend on it.
    pub ambient_occlusion: bool,
    /// Ambient occlusion ignores surfaces beyond this distance, in world units, 0 to infinity (the default). A finite
    /// distance is cheaper in large scenes. Below the size of an object it is coarse: a cap grid knows the object as a whole,
    /// which fades out, and a table knows the ends of a line, not what lies between.
    pub max_distance: f32,
    /// How surfaces up to there count by their distance.
    pub falloff: OcclusionFalloff,
    /// How dark ambient occlusion is: the exponent of the visible share of ambient light, 0 (not at all) to 8. 1, the default, is
    /// what is true.
    pub intensity: f32,
    /// What becomes of Bevy's own `ScreenSpaceAmbientOcclusion`, if the camera has that too.
    pub screen_space: ScreenSpaceOcclusion,
    /// Whether frames are joined with those before them: other rays in every frame, and what they found follows the surfaces by
    /// Bevy's motion vectors, whose prepass it adds. Smoother for a few rays; needs no temporal anti-aliasing. Cap grids and cones have no use
    /// for it. Off by default.
    pub accumulate: bool,
    /// Scales how far an occluder must rise above the plane of a receiver to count, 1 by default: a small part of a cell of
    /// its table. Raise it if surfaces shadow themselves; lower it if fine creases are lost.
    pub bias: f32,
}

impl Default for FieldOcclusion {
    fn default() -> Self {
        Self {
            quality: FieldOcclusionQuality::default(),
            estimator: OcclusionEstimator::default(),
            shadows: ShadowEstimator::default(),
            ambient_occlusion: true,
            max_distance: f32::INFINITY,
            falloff: OcclusionFalloff::default(),
            intensity: 1.0,
            screen_space: ScreenSpaceOcclusion::default(),
            accumulate: false,
            bias: 1.0,
        }
    }
}

/// How ambient occlusion fades with the distance of what occludes.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::{FieldOcclusion, OcclusionFalloff};
/// fn soft_within_a_room() -> FieldOcclusion {
///     FieldOcclusion { max_distance: 4.0, falloff: OcclusionFalloff::Linear, ..default() }
/// }
/// ```
#[derive(Reflect, Clone, Copy, Debug, Default, PartialEq)]
#[reflect(Default, Clone, PartialEq)]
pub enum OcclusionFalloff {
    /// Not at all up to [`FieldOcclusion::max_distance`], where it ends.
    #[default]
    Binary,
    /// Evenly, to nothing at [`FieldOcclusion::max_distance`], which must be finite.
    Linear,
    /// Obscurance, by e^(−`tau`·distance).
    Obscurance {
        /// Per world unit, above 0. Its inverse is about as far as occlusion is felt.
        tau: f32,
    },
}

impl From<OcclusionFalloff> for Falloff {
    fn from(falloff: OcclusionFalloff) -> Self {
        match falloff {
            OcclusionFalloff::Binary => Self::Binary,
            OcclusionFalloff::Linear => Self::Linear,
            OcclusionFalloff::Obscurance { tau } => Self::Obscurance { tau },
        }
    }
}

/// What becomes of Bevy's `ScreenSpaceAmbientOcclusion` on a camera with [`FieldOcclusion`].
///
/// ```
/// use bevy::{pbr::ScreenSpaceAmbientOcclusion, prelude::*};
/// use bevy_visfield::{FieldOcclusion, ScreenSpaceOcclusion};
/// fn with_fine_detail() -> impl Bundle {
///     let occlusion = FieldOcclusion { screen_space: ScreenSpaceOcclusion::Darker, ..default() };
///     (Camera3d::default(), Msaa::Off, occlusion, ScreenSpaceAmbientOcclusion::default())
/// }
/// ```
#[derive(Reflect, Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[reflect(Default, Clone, PartialEq, Hash)]
pub enum ScreenSpaceOcclusion {
    /// It does not run.
    Ignored,
    /// The darker of both counts: creases by the screen, and everything else by fields.
    #[default]
    Darker,
    /// Their product counts: what both see is darkened twice.
    Product,
}

impl FieldOcclusion {
    /// How cap grids combine, if they are asked.
    fn caps(&self) -> Option<CapCombination> {
        use FieldOcclusionQuality::{Custom, High, Low, Medium, Ultra};
        let estimator = match self.estimator {
            OcclusionEstimator::ByQuality => self.quality.cost().estimator,
            chosen => chosen,
        };
        let combination = match self.quality {
            Low => CapCombination::Product,
            Medium | Custom { .. } => CapCombination::SoftCaps { directions: 8 },
            High | Ultra => CapCombination::SoftCaps { directions: 16 },
        };
        (estimator == OcclusionEstimator::CapGrid).then_some(combination)
    }

    /// Whether lights are hidden by cones.
    fn cones(&self) -> bool {
        let estimator = match self.shadows {
            ShadowEstimator::ByQuality => self.quality.cost().shadows,
            chosen => chosen,
        };
        estimator == ShadowEstimator::Cones
    }

    /// How Bevy's own is joined, if it is.
    pub(crate) fn screen_space_combination(&self) -> Option<ScreenSpaceCombination> {
        match self.screen_space {
            ScreenSpaceOcclusion::Ignored => None,
            ScreenSpaceOcclusion::Darker => Some(ScreenSpaceCombination::Darker),
            ScreenSpaceOcclusion::Product => Some(ScreenSpaceCombination::Product),
        }
    }

    pub(crate) fn trace_settings(&self) -> TraceSettings {
        let cost = self.quality.cost();
        let bias = Bias::default();
        let scale = if self.bias.is_finite() { self.bias.max(0.0) } else { 1.0 };
        TraceSettings {
            caps: if self.ambient_occlusion { self.caps() } else { None },
            cones: self.cones(),
            ambient_rays: if self.ambient_occlusion { cost.ambient_rays } else { 0 },
            shadow_rays: cost.shadow_rays,
            resolution: if cost.half_resolution { TraceResolution::Half } else { TraceResolution::Full },
            denoise_passes: cost.denoise_passes,
            max_distance: self.max_distance,
            falloff: self.falloff.into(),
            intensity: self.intensity,
            bias: Bias { height: bias.height * scale, along: bias.along * scale },
            turn: 0,
        }
        .clamped()
    }
}

/// Adds the prepass that cameras need where frames are accumulated, again if something else (temporal anti-aliasing that is turned
/// off) takes it away. It stays if they no longer are: it may be the user's.
pub(crate) fn bring_motion_vectors(
    mut commands: Commands,
    cameras: Query<(Entity, &FieldOcclusion), Without<MotionVectorPrepass>>,
) {
    for (camera, _) in cameras.iter().filter(|(_, occlusion)| occlusion.accumulate) {
        commands.entity(camera).insert(MotionVectorPrepass);
    }
}

/// What ambient occlusion is taken from. A field is asked by the part that it has: one without a cap grid is
/// asked by cones through its distances, if [shadows](ShadowEstimator) are taken from cones, and by rays otherwise; and so are receivers
/// inside an object whose grid is known to be wrong there (a hollow crate).
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
    /// Rays through tables and distances. More accurate on an object's own surface and in contact, at many times the cost; the noise is
    /// filtered. A field of a cap grid alone does not occlude ambient light.
    Rays,
}

/// What the shadows of lights with [`FieldShadows`] are taken from. A field is asked by the part that it has: one without a distance
/// grid gets rays. Large lights are hidden by cap grids of `--order 3`, where ambient occlusion is taken from cap grids.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::{FieldOcclusion, ShadowEstimator};
/// fn by_rays() -> FieldOcclusion {
///     FieldOcclusion { shadows: ShadowEstimator::Rays, ..default() }
/// }
/// ```
#[derive(Reflect, Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[reflect(Default, Clone, PartialEq, Hash)]
pub enum ShadowEstimator {
    /// Cones for [`Low`](FieldOcclusionQuality::Low) and [`Medium`](FieldOcclusionQuality::Medium), rays for the others.
    #[default]
    ByQuality,
    /// A cone per pixel, light and object, marched through its distances, and in penumbrae six more: no noise and no filter. Good for lights
    /// of up to 15° half-angle. With cap grids, cones also give the ambient occlusion of fields that have none.
    Cones,
    /// Rays. Right for lights of any size and shape; the noise is filtered.
    Rays,
}

/// What [`FieldOcclusion`] spends. The denoiser gathers the rays of 8×8 traced pixels for ambient occlusion and of 4×4 for each
/// light, so that a surface sends 64 and 16 times as many as a pixel.
///
/// | preset | ambient occlusion | shadows |
/// | --- | --- | --- |
/// | `Low` | cap grids, as if objects hid each other by chance | a cone per light |
/// | `Medium` | cap grids, along 8 directions | a cone per light |
/// | `High` | 16 rays per pixel | 16 rays per pixel and light |
/// | `Ultra` | 32 rays per pixel | 32 rays per pixel and light |
///
/// `Low` and `Medium` send no rays to fields that were baked with a cap grid and a distance grid, as they are by default, nor to
/// shapes: no filter runs and no history, and a still scene gives the same picture in every frame, bit for bit. What other fields
/// need is traced with 4 rays from every second pixel of every second row, or with 8 from every pixel, and filtered once.
///
/// ```
/// use bevy_visfield::FieldOcclusionQuality;
/// assert_eq!(FieldOcclusionQuality::High.cost().ambient_rays, 16);
/// ```
#[derive(Reflect, Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[reflect(Default, Clone, PartialEq, Hash)]
pub enum FieldOcclusionQuality {
    /// The least that holds together.
    Low,
    /// For games.
    #[default]
    Medium,
    /// Ambient occlusion by rays, and everything from every pixel.
    High,
    /// Twice the rays of that.
    Ultra,
    /// Numbers of your own. Ambient occlusion is by rays, unless [`OcclusionEstimator::CapGrid`] is chosen.
    Custom {
        /// Ambient occlusion rays per pixel, 1 to 32; others are clamped.
        ambient_rays: u32,
        /// Rays per pixel and light, 1 to 32; others are clamped.
        shadow_rays: u32,
        /// Whether only every second pixel of every second row sends them.
        half_resolution: bool,
        /// How often what they found is filtered, 0 to 2; others are clamped.
        denoise_passes: u32,
    },
}

/// What a preset stands for.
///
/// ```
/// assert!(bevy_visfield::FieldOcclusionQuality::Low.cost().half_resolution);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FieldOcclusionCost {
    /// What ambient occlusion is taken from; never by quality.
    pub estimator: OcclusionEstimator,
    /// What shadows are taken from; never by quality.
    pub shadows: ShadowEstimator,
    /// Ambient occlusion rays per pixel, 1 to 32, of what is not taken from cap grids.
    pub ambient_rays: u32,
    /// Rays per pixel and light, 1 to 32.
    pub shadow_rays: u32,
    /// Whether only every second pixel of every second row sends them.
    pub half_resolution: bool,
    /// How often what they found is filtered, 0 to 2.
    pub denoise_passes: u32,
}

impl FieldOcclusionQuality {
    /// The numbers behind a preset.
    pub const fn cost(self) -> FieldOcclusionCost {
        match self {
            Self::Low => preset_cost(false, 4, true),
            Self::Medium => preset_cost(false, 8, false),
            Self::High => preset_cost(true, 16, false),
            Self::Ultra => preset_cost(true, MAX_RAYS, false),
            Self::Custom { ambient_rays, shadow_rays, half_resolution, denoise_passes } => FieldOcclusionCost {
                estimator: OcclusionEstimator::Rays,
                shadows: ShadowEstimator::Rays,
                ambient_rays: clamp(ambient_rays, 1, MAX_RAYS),
                shadow_rays: clamp(shadow_rays, 1, MAX_RAYS),
                half_resolution,
                denoise_passes: clamp(denoise_passes, 0, MAX_DENOISE_PASSES),
            },
        }
    }
}

/// A preset whose fields are all asked by rays, or only those that have nothing else.
const fn preset_cost(all_by_rays: bool, rays: u32, half_resolution: bool) -> FieldOcclusionCost {
    FieldOcclusionCost {
        estimator: if all_by_rays { OcclusionEstimator::Rays } else { OcclusionEstimator::CapGrid },
        shadows: if all_by_rays { ShadowEstimator::Rays } else { ShadowEstimator::Cones },
        ambient_rays: rays,
        shadow_rays: rays,
        half_resolution,
        denoise_passes: 1,
    }
}

/// `Ord::clamp`, which is not yet const.
const fn clamp(number: u32, least: u32, most: u32) -> u32 {
    if number < least {
        least
    } else if number > most {
        most
    } else {
        number
    }
}

/// Soft shadows of a light, cast by entities with a [`VisibilityField3d`]. How soft follows from the light's own size: the `radius`
/// of a `PointLight` or `SpotLight` and `width` × `height` of a `RectLight`, in world units, and the angular radius of a
/// `DirectionalLight`, which is told here. Each camera shadows the eleven lights that matter most to it.
///
/// Where a light has shadow maps too, the darker of both counts: both know the same objects.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::FieldShadows;
/// fn hazy_sun() -> impl Bundle {
///     (DirectionalLight::default(), FieldShadows { angular_radius: 0.03 })
/// }
/// fn bulb() -> impl Bundle {
///     (PointLight { radius: 0.05, ..default() }, FieldShadows::default())
/// }
/// ```
#[derive(Component, Reflect, Clone, Copy, Debug, PartialEq)]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct FieldShadows {
    /// Half of the angle that a directional light's disc covers in the sky, in radians, 0 to 1.2. Larger is softer. Other lights
    /// have a size of their own. From 0.26 (15°) on, the
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
        let wild = Custom { ambient_rays: 0, shadow_rays: u32::MAX, half_resolution: true, denoise_passes: 9 };
        for quality in [Low, Medium, High, Ultra, wild] {
            for strange in [f32::NAN, f32::INFINITY, -1.0, 0.0] {
                let settings = FieldOcclusion { quality, max_distance: strange, bias: strange, ..default() };
                let trace = settings.trace_settings();
                assert!((1..=MAX_RAYS).contains(&trace.ambient_rays));
                assert!((1..=MAX_RAYS).contains(&trace.shadow_rays));
                assert!(trace.clamped().max_distance >= 0.0);
                assert!(trace.bias.height >= 0.0 && trace.bias.along.is_finite());
                assert!(trace.denoise_passes <= MAX_DENOISE_PASSES);
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
    fn the_cheaper_presets_use_cap_grids_and_cones_unless_told_otherwise() {
        use FieldOcclusionQuality::{Custom, High, Low, Medium, Ultra};
        let caps = |quality, estimator| FieldOcclusion { quality, estimator, ..default() }.trace_settings().caps;
        let custom = Custom { ambient_rays: 3, shadow_rays: 3, half_resolution: false, denoise_passes: 0 };
        for (quality, by_caps) in [(Low, true), (Medium, true), (High, false), (Ultra, false), (custom, false)] {
            assert_eq!(caps(quality, OcclusionEstimator::ByQuality).is_some(), by_caps, "{quality:?}");
            assert!(caps(quality, OcclusionEstimator::CapGrid).is_some());
            assert!(caps(quality, OcclusionEstimator::Rays).is_none());
        }
        assert_eq!(caps(Low, OcclusionEstimator::ByQuality), Some(CapCombination::Product));
        let cones = |quality, shadows| FieldOcclusion { quality, shadows, ..default() }.trace_settings().cones;
        for (quality, by_cones) in [(Low, true), (Medium, true), (High, false), (Ultra, false), (custom, false)] {
            assert_eq!(cones(quality, ShadowEstimator::ByQuality), by_cones, "{quality:?}");
            assert!(cones(quality, ShadowEstimator::Cones) && !cones(quality, ShadowEstimator::Rays));
        }
    }
}
