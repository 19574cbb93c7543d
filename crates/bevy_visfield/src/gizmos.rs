//! The bounds of fields, drawn with Bevy's gizmos.

use bevy::gizmos::AppGizmoBuilder;
use bevy::gizmos::config::{GizmoConfigGroup, GizmoConfigStore};
use bevy::gizmos::gizmos::Gizmos;
use bevy::math::{DVec3, Vec3};
use bevy::prelude::*;

use crate::asset::VisibilityField;
use crate::components::{NotFieldOccluder, VisibilityField3d};

/// Draws the bounding ellipsoid of every entity with a [`VisibilityField3d`], outside of which an object's rays need no look-up.
/// Off until it is enabled. The tiles of a camera are seen by [`FieldDebugView::TileLoad`](crate::FieldDebugView::TileLoad).
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::FieldBoundsGizmos;
/// fn show_bounds(mut store: ResMut<GizmoConfigStore>) {
///     store.config_mut::<FieldBoundsGizmos>().0.enabled = true;
/// }
/// ```
#[derive(Reflect, GizmoConfigGroup, Clone, Copy, Debug)]
#[reflect(Clone, Default)]
pub struct FieldBoundsGizmos {
    /// Of what occludes.
    pub color: Color,
    /// Of what is hidden, or marked with [`NotFieldOccluder`].
    pub idle_color: Color,
}

impl Default for FieldBoundsGizmos {
    fn default() -> Self {
        Self { color: Color::srgb(1.0, 0.7, 0.1), idle_color: Color::srgb(0.5, 0.5, 0.5) }
    }
}

/// Lines of each of an ellipsoid's three circles.
const LINES: u16 = 32;

pub(crate) fn plugin(app: &mut App) {
    app.init_gizmo_group::<FieldBoundsGizmos>().add_systems(PostUpdate, draw_bounds.after(TransformSystems::Propagate));
    app.world_mut().resource_mut::<GizmoConfigStore>().config_mut::<FieldBoundsGizmos>().0.enabled = false;
}

fn draw_bounds(
    mut gizmos: Gizmos<FieldBoundsGizmos>,
    fields: Res<Assets<VisibilityField>>,
    occluders: Query<(&VisibilityField3d, &GlobalTransform, &InheritedVisibility, Has<NotFieldOccluder>)>,
) {
    if !gizmos.config.enabled {
        return;
    }
    for (field, transform, visibility, idle) in &occluders {
        let Some(field) = fields.get(field.id()) else { continue };
        let world_from_field = transform.affine().as_daffine3() * field.header().bounds.mesh_from_field();
        let color = if idle || !visibility.get() { gizmos.config_ext.idle_color } else { gizmos.config_ext.color };
        for [first, second] in [[DVec3::X, DVec3::Y], [DVec3::Y, DVec3::Z], [DVec3::Z, DVec3::X]] {
            let on_circle = |line: u16| -> Vec3 {
                let (sin, cos) = (f64::from(line) / f64::from(LINES) * std::f64::consts::TAU).sin_cos();
                world_from_field.transform_point3(first * cos + second * sin).as_vec3()
            };
            gizmos.linestrip((0..=LINES).map(on_circle), color);
        }
    }
}
