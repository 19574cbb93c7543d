//! Why an object casts no field shadow: one reason with a stable code, found where the user's world and the GPU's disagree.

use bevy::asset::{AssetServer, LoadState};
use bevy::camera::visibility::RenderLayers;
use bevy::core_pipeline::prepass::{DepthPrepass, NormalPrepass};
use bevy::ecs::system::{SystemParam, SystemState};
use bevy::prelude::*;
use thiserror::Error;
use visfield::estimate::source::LARGE_LIGHT;
use visfield::field::cap_grid::HarmonicOrder;
use visfield::field::lookup::Grid;
use visfield::scene::Placement;

use crate::asset::VisibilityField;
use crate::components::{FieldOcclusion, FieldShadows, NotFieldOccluder, NotFieldShadowCaster, VisibilityField3d};
use crate::render::{FieldLevel, RenderFeedback};

/// Why an entity casts no field shadow. Its text says what to do next. (Where a camera sees more lights with
/// [`FieldShadows`] than it has masks for, the log names those that are left out, and this does not.)
///
/// | code | reason |
/// | --- | --- |
/// | VF001 | [`NoEntity`](Self::NoEntity): the entity does not exist |
/// | VF002 | [`NoField`](Self::NoField): it has no [`VisibilityField3d`] |
/// | VF003 | [`NotOccluder`](Self::NotOccluder): it is marked with [`NotFieldOccluder`] or [`NotFieldShadowCaster`] |
/// | VF004 | [`Hidden`](Self::Hidden): it is hidden |
/// | VF005 | [`NotLoading`](Self::NotLoading): its field is neither loaded nor loading |
/// | VF006 | [`Loading`](Self::Loading): its field is still loading |
/// | VF007 | [`LoadFailed`](Self::LoadFailed): its field failed to load |
/// | VF008 | [`BadTransform`](Self::BadTransform): its transform is singular or not finite |
/// | VF009 | [`NoTable`](Self::NoTable): its field has a cap grid alone |
/// | VF010 | [`Hemisphere`](Self::Hemisphere): its table is not one that the GPU passes read |
/// | VF011 | [`NoLight`](Self::NoLight): no light casts field shadows |
/// | VF012 | [`NoCamera`](Self::NoCamera): no active camera shows field occlusion |
/// | VF013 | [`CameraUnfit`](Self::CameraUnfit): no such camera can |
/// | VF014 | [`OtherLayers`](Self::OtherLayers): no such camera shares its render layers |
/// | VF015 | [`Inert`](Self::Inert): the plugin does nothing on this GPU |
/// | VF016 | [`Uploading`](Self::Uploading): its field is on its way to the GPU |
/// | VF017 | [`TableOverBudget`](Self::TableOverBudget): the memory budget left its field no more than a cap grid |
/// | VF018 | [`OverBudget`](Self::OverBudget): the memory budget left no room for its field |
///
/// Codes stay what they are; new reasons get new ones.
///
/// ```
/// use bevy_visfield::NoShadow;
/// assert_eq!(NoShadow::Hidden.code(), "VF004");
/// assert!(NoShadow::Hidden.to_string().starts_with("VF004: "));
/// ```
#[derive(Reflect, Clone, Copy, Debug, PartialEq, Eq, Hash, Error)]
#[reflect(Clone, PartialEq, Hash)]
#[non_exhaustive]
pub enum NoShadow {
    /// The entity does not exist (any more).
    #[error("{}: the entity does not exist; ask for the one that has the VisibilityField3d", self.code())]
    NoEntity,
    /// It has no [`VisibilityField3d`].
    #[error("{}: the entity has no VisibilityField3d; insert one beside its Mesh3d, baked from that mesh", self.code())]
    NoField,
    /// It has a [`NotFieldOccluder`] or a [`NotFieldShadowCaster`].
    #[error("{}: the entity is marked with NotFieldOccluder or NotFieldShadowCaster; remove that", self.code())]
    NotOccluder,
    /// It is hidden, by itself or by a parent.
    #[error("{}: the entity is hidden, by its own Visibility or a parent's; show it", self.code())]
    Hidden,
    /// There is no asset behind its handle, and none on its way.
    #[error(
        "{}: its field is neither loaded nor loading; load it with the asset server (\"rock.vfield#Mesh0/Primitive0\"), or add \
         it to Assets<VisibilityField>",
        self.code()
    )]
    NotLoading,
    /// Its field has yet to arrive.
    #[error("{}: its field is still loading; wait, or look for what keeps its file", self.code())]
    Loading,
    /// Its field will not arrive.
    #[error("{}: its field failed to load; the asset server's error in the log says why", self.code())]
    LoadFailed,
    /// Its transform cannot be inverted.
    #[error(
        "{}: its transform is singular or not finite; look for a scale of 0 and for NaN in its Transform and its parents'",
        self.code()
    )]
    BadTransform,
    /// Its field was baked to a cap grid alone, and no light is hidden by that.
    #[error(
        "{}: its field has a cap grid alone, which shadows no lights but large ones (with `--order 3`); bake it with \
         `--representation cap-grid,distance`",
        self.code()
    )]
    NoTable,
    /// Its table is of the papers' own representation, which the GPU passes do not read.
    #[error(
        "{}: its field is of hemispheres, and the GPU passes read two-point tables only; bake it without `--representation \
         hemisphere`",
        self.code()
    )]
    Hemisphere,
    /// No visible light that can have field shadows has [`FieldShadows`].
    #[error("{}: no visible light has FieldShadows; insert that on a light", self.code())]
    NoLight,
    /// No active 3D camera has [`FieldOcclusion`].
    #[error("{}: no active Camera3d has FieldOcclusion; insert that on the camera, or activate it", self.code())]
    NoCamera,
    /// The active cameras with [`FieldOcclusion`] lack what it needs.
    #[error(
        "{}: every active camera with FieldOcclusion has multisampling or has lost its prepass; insert Msaa::Off, DepthPrepass \
         and NormalPrepass on it",
        self.code()
    )]
    CameraUnfit,
    /// No camera that shows field occlusion is on one of its render layers.
    #[error("{}: no camera with FieldOcclusion shares a layer with its RenderLayers; let them overlap", self.code())]
    OtherLayers,
    /// The GPU lacks a capability, or there is no renderer.
    #[error(
        "{}: the plugin does nothing on this GPU, or nothing renders at all; its warning at the start says what is missing",
        self.code()
    )]
    Inert,
    /// Its field will be on the GPU in a few frames.
    #[error("{}: its field is on its way to the GPU; wait a few frames", self.code())]
    Uploading,
    /// Its field's cap grid is on the GPU, and its table is not.
    #[error(
        "{}: the memory budget left its field no more than a cap grid, which darkens ambient light only; raise \
         FieldMemoryBudget::bytes, or bake smaller fields (`visfield bake --max-bytes`)",
        self.code()
    )]
    TableOverBudget,
    /// Nothing of its field is on the GPU.
    #[error(
        "{}: the memory budget left no room for its field; raise FieldMemoryBudget::bytes, or bake smaller fields (`visfield \
         bake --max-bytes`)",
        self.code()
    )]
    OverBudget,
}

impl NoShadow {
    /// A name that stays the same from version to version: `VF001`.
    pub const fn code(self) -> &'static str {
        match self {
            Self::NoEntity => "VF001",
            Self::NoField => "VF002",
            Self::NotOccluder => "VF003",
            Self::Hidden => "VF004",
            Self::NotLoading => "VF005",
            Self::Loading => "VF006",
            Self::LoadFailed => "VF007",
            Self::BadTransform => "VF008",
            Self::NoTable => "VF009",
            Self::Hemisphere => "VF010",
            Self::NoLight => "VF011",
            Self::NoCamera => "VF012",
            Self::CameraUnfit => "VF013",
            Self::OtherLayers => "VF014",
            Self::Inert => "VF015",
            Self::Uploading => "VF016",
            Self::TableOverBudget => "VF017",
            Self::OverBudget => "VF018",
        }
    }
}

/// The lights that can have field shadows.
type ShadowedLights<'w, 's> = Query<
    'w,
    's,
    (&'static FieldShadows, Option<&'static InheritedVisibility>, Has<DirectionalLight>),
    Or<(With<DirectionalLight>, With<PointLight>, With<SpotLight>, With<RectLight>)>,
>;

/// The cameras that show field occlusion, if they can.
type OcclusionCameras<'w, 's> = Query<
    'w,
    's,
    (
        &'static FieldOcclusion,
        &'static Camera,
        Option<&'static Msaa>,
        Has<DepthPrepass>,
        Has<NormalPrepass>,
        Option<&'static RenderLayers>,
    ),
    With<Camera3d>,
>;

/// Tells why an entity casts no field shadow, in systems. [`why_no_shadow`] does it where there is a whole world.
///
/// It judges the frame before, as far as the GPU is concerned. Whether the shadow falls on anything is for eyes to judge:
/// [`FieldDebugView`](crate::FieldDebugView) shows where light is missing.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::{FieldShadowDiagnosis, VisibilityField3d};
/// fn complain(diagnosis: FieldShadowDiagnosis, occluders: Query<Entity, With<VisibilityField3d>>) {
///     for entity in &occluders {
///         if let Some(reason) = diagnosis.why_no_shadow(entity) {
///             info!("{entity} casts no shadow. {reason}");
///         }
///     }
/// }
/// ```
#[derive(SystemParam)]
pub struct FieldShadowDiagnosis<'w, 's> {
    /// Every entity.
    occluders: Query<
        'w,
        's,
        (
            Option<&'static VisibilityField3d>,
            Has<NotFieldOccluder>,
            Has<NotFieldShadowCaster>,
            Option<&'static InheritedVisibility>,
            Option<&'static GlobalTransform>,
            Option<&'static RenderLayers>,
        ),
    >,
    lights: ShadowedLights<'w, 's>,
    cameras: OcclusionCameras<'w, 's>,
    fields: Res<'w, Assets<VisibilityField>>,
    server: Res<'w, AssetServer>,
    feedback: Res<'w, RenderFeedback>,
}

impl FieldShadowDiagnosis<'_, '_> {
    /// The first reason that is found, or `None` if the entity casts shadows.
    pub fn why_no_shadow(&self, entity: Entity) -> Option<NoShadow> {
        self.casts_shadow(entity).err()
    }

    fn casts_shadow(&self, entity: Entity) -> Result<(), NoShadow> {
        let Ok((handle, not_occluder, not_caster, visibility, transform, layers)) = self.occluders.get(entity) else {
            return Err(NoShadow::NoEntity);
        };
        let handle = handle.ok_or(NoShadow::NoField)?;
        if not_occluder || not_caster {
            return Err(NoShadow::NotOccluder);
        }
        if !visibility.is_some_and(|visibility| visibility.get()) {
            return Err(NoShadow::Hidden);
        }
        let field = self.fields.get(handle.id()).ok_or_else(|| self.why_not_loaded(handle.id()))?;
        let world_from_mesh = transform.copied().unwrap_or_default().affine().as_daffine3();
        // Seen from nearby: how far it is from a camera is not its fault.
        if Placement::new(&field.header().bounds, world_from_mesh, world_from_mesh.translation).is_none() {
            return Err(NoShadow::BadTransform);
        }
        let tableless = field.distance_field().is_some() || self.caps_hide_lights(field);
        match field.table().map(visfield::ChordTable::grid) {
            None if !tableless => return Err(NoShadow::NoTable),
            Some(Grid::Hemisphere(_)) if !tableless => return Err(NoShadow::Hemisphere),
            _ => {}
        }
        if !self.lights.iter().any(|(_, visibility, _)| visibility.is_none_or(|visibility| visibility.get())) {
            return Err(NoShadow::NoLight);
        }
        self.is_seen(layers.unwrap_or_default())?;
        self.is_on_gpu(handle.id(), tableless)
    }

    fn why_not_loaded(&self, id: AssetId<VisibilityField>) -> NoShadow {
        match self.server.get_load_state(id) {
            // What is loaded has yet to be put among the assets, or was taken out of them.
            Some(LoadState::Loading) => NoShadow::Loading,
            Some(LoadState::Failed(_)) => NoShadow::LoadFailed,
            Some(LoadState::NotLoaded | LoadState::Loaded) | None => NoShadow::NotLoading,
        }
    }

    /// Whether a light is so large that the field's cap grid hides it, for a camera that asks cap grids.
    fn caps_hide_lights(&self, field: &visfield::VisibilityField) -> bool {
        field.cap_grid().is_some_and(|grid| grid.header().format.order == HarmonicOrder::Three)
            && self.lights.iter().any(|(shadows, _, in_the_sky)| in_the_sky && shadows.angular_radius >= LARGE_LIGHT)
            && self.cameras.iter().any(|(settings, ..)| settings.trace_settings().caps.is_some())
    }

    /// Whether a camera can show its shadow.
    fn is_seen(&self, layers: &RenderLayers) -> Result<(), NoShadow> {
        let (mut fit, mut active) = (false, false);
        for (_, camera, msaa, depth, normals, camera_layers) in &self.cameras {
            if camera.is_active {
                active = true;
                if msaa.copied().unwrap_or_default() == Msaa::Off && depth && normals {
                    fit = true;
                    if layers.intersects(camera_layers.unwrap_or_default()) {
                        return Ok(());
                    }
                }
            }
        }
        Err(match (active, fit) {
            (false, _) => NoShadow::NoCamera,
            (true, false) => NoShadow::CameraUnfit,
            (true, true) => NoShadow::OtherLayers,
        })
    }

    /// `tableless`: whether it casts shadows without its table.
    fn is_on_gpu(&self, id: AssetId<VisibilityField>, tableless: bool) -> Result<(), NoShadow> {
        if !self.feedback.is_active() {
            return Err(NoShadow::Inert);
        }
        let Some(found) = self.feedback.field(id) else { return Err(NoShadow::Uploading) };
        let casts = |level: FieldLevel| level >= FieldLevel::Coarse || tableless && level == FieldLevel::WithoutTable;
        match found.target {
            _ if casts(found.level) => Ok(()),
            target if casts(target) => Err(NoShadow::Uploading),
            FieldLevel::Absent => Err(NoShadow::OverBudget),
            _ => Err(NoShadow::TableOverBudget),
        }
    }
}

/// [`FieldShadowDiagnosis::why_no_shadow`] for exclusive systems, tests and consoles.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::why_no_shadow;
/// fn explain(world: &mut World, entity: Entity) -> String {
///     why_no_shadow(world, entity).map_or("it casts shadows".to_owned(), |reason| reason.to_string())
/// }
/// ```
///
/// # Panics
/// Without [`VisibilityFieldPlugin`](crate::VisibilityFieldPlugin).
pub fn why_no_shadow(world: &mut World, entity: Entity) -> Option<NoShadow> {
    let mut state = SystemState::<FieldShadowDiagnosis>::new(world);
    let diagnosis = state.get(world).expect("VisibilityFieldPlugin provides what it asks for");
    diagnosis.why_no_shadow(entity)
}

#[cfg(test)]
mod tests;
