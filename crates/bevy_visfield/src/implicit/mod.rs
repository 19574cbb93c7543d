//! Surfaces without triangles: the zero set of a field's distances, drawn by sphere tracing within a box.
//!
//! An entity with an [`ImplicitSurface3d`] gets two children, both with a box for their mesh: one is drawn in the prepass and the opaque
//! phase, and writes the depth of what its rays hit; the other one in the transparent phase, where it blends the pixels that the surface
//! covers only partly over what lies behind ([`material`]).

mod material;
mod proxy;

use bevy::prelude::*;
use bevy::render::RenderApp;

use crate::asset::VisibilityField;

/// Draws the surface of a field without triangles, lit as its `MeshMaterial3d<StandardMaterial>` says, if it has one: a shape or a grid of
/// distances, found by sphere tracing. It has the right depth among meshes, takes part in the depth, normal and motion-vector
/// prepasses, receives light, ambient occlusion and shadows as they do, and has smooth edges without multisampling.
///
/// It also casts: the entity gets a [`VisibilityField3d`](crate::VisibilityField3d) of the same field. Put
/// [`NotFieldOccluder`](crate::NotFieldOccluder) on it to keep it from that. It casts into no shadow map.
///
/// The field needs distances that end somewhere: a shape's ([`visfield::VisibilityField::of_shape`]) but of one without end, or a grid's.
/// Otherwise a warning says what to do, and nothing is drawn.
///
/// Any invertible transform is fine, mirrored and non-uniform ones included. Textures of the material are not used: there are no
/// coordinates for them. Nor is its alpha. The entity should have no `Mesh3d`, which would be drawn as well.
///
/// # Glass
///
/// A material with `specular_transmission` above 0 is glass: rays are refracted by its `ior` (1 and more), followed through the
/// surface's distances to where they leave it, with total reflection, and show what Bevy's transmission texture has there: all that
/// is not transparent and on the screen. `thickness` is not used, for it is found; `attenuation_color` and `attenuation_distance` (in
/// world units) tint by the way in the glass; `perceptual_roughness` 0 is clear. Shapes that are
/// [convex](visfield::shape::Shape::is_convex) are traced in fewer steps, and light that has left others does not enter them again.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::{ImplicitSurface3d, VisibilityField};
/// use visfield::shape::Shape;
/// fn glass_ball(
///     mut commands: Commands,
///     mut fields: ResMut<Assets<VisibilityField>>,
///     mut materials: ResMut<Assets<StandardMaterial>>,
/// ) -> Result {
///     let ball = visfield::VisibilityField::of_shape(Shape::Sphere { radius: 1.0 })?;
///     let glass =
///         StandardMaterial { specular_transmission: 1.0, ior: 1.5, perceptual_roughness: 0.0, ..default() };
///     commands.spawn((
///         ImplicitSurface3d(fields.add(VisibilityField(ball))),
///         MeshMaterial3d(materials.add(glass)),
///     ));
///     Ok(())
/// }
/// ```
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::{ImplicitSurface3d, VisibilityField};
/// fn ball(field: Handle<VisibilityField>, material: Handle<StandardMaterial>) -> impl Bundle {
///     (ImplicitSurface3d(field), MeshMaterial3d(material), Transform::from_xyz(0.0, 1.0, 0.0))
/// }
/// ```
#[derive(Component, Reflect, Clone, Debug, Default, PartialEq, Eq, Deref, DerefMut)]
#[reflect(Component, Default, Clone, PartialEq)]
#[require(Transform, Visibility)]
pub struct ImplicitSurface3d(pub Handle<VisibilityField>);

impl From<Handle<VisibilityField>> for ImplicitSurface3d {
    fn from(handle: Handle<VisibilityField>) -> Self {
        Self(handle)
    }
}

pub(crate) fn plugin(app: &mut App) {
    app.register_type::<ImplicitSurface3d>();
    // Without a renderer, as on a server, there is nothing to draw with.
    let world = app.world();
    let draws = world.contains_resource::<Assets<Shader>>()
        && world.contains_resource::<Assets<Mesh>>()
        && world.contains_resource::<Assets<StandardMaterial>>();
    if draws && app.get_sub_app(RenderApp).is_some() {
        app.add_plugins((material::plugin, proxy::plugin));
    }
}
