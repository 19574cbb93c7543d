//! Which lights of a view have field shadows: what Bevy's shader calls them, and what tracing needs to know of them.

use std::cmp::Reverse;

use bevy::camera::primitives::{Frustum, Sphere};
use bevy::camera::visibility::RenderLayers;
use bevy::ecs::system::SystemParam;
use bevy::math::primitives::ViewFrustum;
use bevy::math::{FloatOrd, Vec3, Vec3A};
use bevy::pbr::{
    ExtractedDirectionalLight, ExtractedPointLight, ExtractedRectLight, GlobalClusterableObjectMeta,
    MAX_DIRECTIONAL_LIGHTS,
};
use bevy::prelude::*;
use bevy::render::view::ExtractedView;

use super::masks::{RectKey, ShaderLight};
use crate::components::FieldShadows;

/// A light with field shadows. Positions and vectors are those of the world, as extracted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ShadowedLight {
    /// In the render world.
    pub(super) entity: Entity,
    /// What Bevy's shader calls it.
    pub(super) shader_light: ShaderLight,
    pub(super) shape: LightShape,
    pub(super) settings: FieldShadows,
}

/// Where a light is and how large.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum LightShape {
    Directional {
        /// Of unit length.
        to_light: Vec3,
    },
    /// A sphere; a spot light if it has a cone.
    Point { position: Vec3, radius: f32, range: f32, cone: Option<LightCone> },
    /// A rectangle that shines towards `half_height × half_width`.
    Rect { position: Vec3, half_width: Vec3, half_height: Vec3, range: f32 },
}

/// What a spot light shines on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LightCone {
    /// Along its axis, away from the light; of unit length.
    pub(super) direction: Vec3,
    /// Between the axis and the edge, in radians.
    pub(super) outer_angle: f32,
}

/// The lights in the render world. Bevy orders them in `RenderSystems::CreateViews`; ask after that.
#[derive(SystemParam)]
pub(super) struct ExtractedLights<'w, 's> {
    clustered: Res<'w, GlobalClusterableObjectMeta>,
    directional: Query<
        'w,
        's,
        (Entity, &'static ExtractedDirectionalLight, &'static RenderLayers, Option<&'static FieldShadows>),
    >,
    points: Query<'w, 's, (Entity, &'static ExtractedPointLight, &'static RenderLayers, &'static FieldShadows)>,
    rects: Query<'w, 's, (Entity, &'static ExtractedRectLight, &'static FieldShadows)>,
}

/// A light, and its weight beside others.
struct Candidate {
    light: ShadowedLight,
    /// Infinite for directional lights, otherwise its luminous intensity over the square of its distance from the camera.
    importance: f32,
}

impl ExtractedLights<'_, '_> {
    /// The lights with field shadows that shine into a view on these layers: at most `most` of them, the most important if
    /// there are more, in an order that depends on nothing but which these are. Directional lights matter most; of the others
    /// those that are brightest at the camera.
    pub(super) fn shadowed_lights(
        &self,
        view: &ExtractedView,
        camera_layers: &RenderLayers,
        most: usize,
    ) -> Vec<ShadowedLight> {
        let clip_from_world = view.clip_from_world.unwrap_or_else(|| {
            let view_from_world = view.world_from_view.affine().inverse();
            view.clip_from_view * Mat4::from(view_from_world)
        });
        let frustum = Frustum(ViewFrustum::from_clip_from_world(&clip_from_world));
        let camera = view.world_from_view.translation();
        let mut candidates = self.directional_lights(camera_layers);
        candidates.extend(self.point_lights(camera_layers, camera).filter(|light| light.is_near(&frustum)));
        candidates.extend(self.rect_lights(camera).filter(|light| light.is_near(&frustum)));
        choose(candidates, most)
    }

    /// As `prepare_lights` orders and counts them.
    fn directional_lights(&self, camera_layers: &RenderLayers) -> Vec<Candidate> {
        let mut seen: Vec<_> =
            self.directional.iter().filter(|(_, _, layers, _)| layers.intersects(camera_layers)).collect();
        seen.sort_by_key(|(entity, light, _, _)| (light.volumetric, light.shadow_maps_enabled, *entity));
        let shown = (0..).zip(seen).take(MAX_DIRECTIONAL_LIGHTS);
        let shadowed = shown.filter_map(|(index, (entity, light, _, settings))| {
            let shape = LightShape::Directional { to_light: light.transform.back().into() };
            let shader_light = ShaderLight::Directional(index);
            Candidate::new(entity, shader_light, shape, *settings?, f32::INFINITY)
        });
        shadowed.collect()
    }

    fn point_lights(&self, camera_layers: &RenderLayers, camera: Vec3) -> impl Iterator<Item = Candidate> {
        let seen = self.points.iter().filter(|(_, _, layers, _)| layers.intersects(camera_layers));
        seen.filter_map(move |(entity, light, _, settings)| {
            let index = u32::try_from(*self.clustered.entity_to_index.get(&entity)?).ok()?;
            let position = light.transform.translation();
            let direction = light.transform.forward().into();
            let cone = light.spot_light_angles.map(|(_, outer_angle)| LightCone { direction, outer_angle });
            let shape = LightShape::Point { position, radius: light.radius, range: light.range, cone };
            let importance = importance(light.intensity, light.color, position, camera);
            Candidate::new(entity, ShaderLight::Clustered(index), shape, *settings, importance)
        })
    }

    /// Rect lights shine on every layer, as in Bevy.
    fn rect_lights(&self, camera: Vec3) -> impl Iterator<Item = Candidate> {
        self.rects.iter().filter_map(move |(entity, light, settings)| {
            let position = light.transform.translation();
            let half_width = light.transform.right() * light.width * 0.5;
            let half_height = light.transform.up() * light.height * 0.5;
            let shape = LightShape::Rect { position, half_width, half_height, range: light.range };
            // Bevy makes it a luminance.
            let importance = importance(light.intensity * light.width * light.height, light.color, position, camera);
            Candidate::new(entity, ShaderLight::Rect(RectKey::new(light)), shape, *settings, importance)
        })
    }
}

/// How bright a light of this luminous intensity is at the camera.
fn importance(intensity: f32, color: LinearRgba, position: Vec3, camera: Vec3) -> f32 {
    let importance = intensity * color.luminance() / position.distance_squared(camera);
    if importance.is_finite() { importance } else { f32::MAX }
}

/// The most important, in the order of their entities: a light keeps its mask while others come nearer.
fn choose(mut candidates: Vec<Candidate>, most: usize) -> Vec<ShadowedLight> {
    if candidates.len() > most {
        warn_once!(
            "{} lights with FieldShadows shine into one view, which has room for the shadows of {most}: the directional \
             ones and the brightest at the camera get theirs, the others none. Remove FieldShadows from lights that \
             need none, or shorten their range.",
            candidates.len()
        );
        candidates.sort_by_key(|candidate| (Reverse(FloatOrd(candidate.importance)), candidate.light.entity));
        candidates.truncate(most);
    }
    candidates.sort_by_key(|candidate| candidate.light.entity);
    candidates.into_iter().map(|candidate| candidate.light).collect()
}

impl Candidate {
    /// `None` if the light has no place: its transform is not finite or is singular.
    fn new(
        entity: Entity,
        shader_light: ShaderLight,
        shape: LightShape,
        settings: FieldShadows,
        importance: f32,
    ) -> Option<Self> {
        let light = ShadowedLight { entity, shader_light, shape, settings };
        shape.is_sound().then_some(Self { light, importance })
    }

    /// Whether anything in the frustum can be in its range.
    fn is_near(&self, frustum: &Frustum) -> bool {
        let (center, radius) = match self.light.shape {
            LightShape::Directional { .. } => return true,
            LightShape::Point { position, range, .. } | LightShape::Rect { position, range, .. } => (position, range),
        };
        frustum.intersects_sphere(&Sphere { center: Vec3A::from(center), radius }, false)
    }
}

impl LightShape {
    fn is_sound(&self) -> bool {
        match *self {
            Self::Directional { to_light } => to_light.is_normalized(),
            Self::Point { position, radius, range, cone } => {
                let aimed = cone.is_none_or(|cone| cone.direction.is_normalized() && cone.outer_angle.is_finite());
                position.is_finite() && radius.is_finite() && range > 0.0 && aimed
            }
            Self::Rect { position, half_width, half_height, range } => {
                let area = half_width.cross(half_height).length();
                position.is_finite() && area.is_finite() && area > 0.0 && range > 0.0
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(index: u32, importance: f32) -> Candidate {
        let shape = LightShape::Point { position: Vec3::ZERO, radius: 0.0, range: 1.0, cone: None };
        let entity = Entity::from_raw_u32(index).unwrap();
        Candidate::new(entity, ShaderLight::Clustered(index), shape, FieldShadows::HAZY, importance).unwrap()
    }

    fn chosen(importances: &[f32], most: usize) -> Vec<u32> {
        let candidates = (0..).zip(importances).map(|(index, importance)| candidate(index, *importance)).collect();
        let lights = choose(candidates, most);
        assert!(lights.is_sorted_by_key(|light| light.entity), "their order depends on nothing else");
        let mut chosen: Vec<_> = lights.iter().map(|light| light.entity.index_u32()).collect();
        chosen.sort_unstable();
        chosen
    }

    #[test]
    fn the_most_important_lights_are_chosen() {
        let importances = [1.0, f32::INFINITY, 0.0, 5.0, 2.0];
        assert_eq!(chosen(&importances, 5), [0, 1, 2, 3, 4]);
        assert_eq!(chosen(&importances, 3), [1, 3, 4]);
        assert_eq!(chosen(&importances, 1), [1]);
        assert!(chosen(&importances, 0).is_empty());
    }

    #[test]
    fn importance_falls_with_distance_and_is_a_number() {
        let at = |position: Vec3| importance(10.0, LinearRgba::WHITE, position, Vec3::ZERO);
        assert!((at(Vec3::X) - 10.0).abs() < 1e-4 && at(Vec3::X * 2.0) < 2.6);
        assert_eq!(at(Vec3::ZERO), f32::MAX, "below any directional light");
        assert_eq!(importance(0.0, LinearRgba::WHITE, Vec3::ZERO, Vec3::ZERO), f32::MAX);
    }

    #[test]
    fn lights_without_a_place_have_no_shadows() {
        let point = |position, range| LightShape::Point { position, radius: 0.1, range, cone: None };
        assert!(point(Vec3::ONE, 5.0).is_sound());
        assert!(!point(Vec3::NAN, 5.0).is_sound());
        assert!(!point(Vec3::ONE, f32::NAN).is_sound());
        let rect = |half_width| LightShape::Rect { position: Vec3::ZERO, half_width, half_height: Vec3::Y, range: 9.0 };
        assert!(rect(Vec3::X).is_sound());
        assert!(!rect(Vec3::ZERO).is_sound() && !rect(Vec3::NAN).is_sound());
        assert!(!LightShape::Directional { to_light: Vec3::NAN }.is_sound());
    }

    #[test]
    fn only_lights_that_reach_the_view_count() {
        let projection = Mat4::perspective_infinite_reverse_rh(1.0, 1.0, 0.1);
        let frustum = Frustum(ViewFrustum::from_clip_from_world(&projection));
        let near = |position, range| {
            let shape = LightShape::Point { position, radius: 0.0, range, cone: None };
            let light = ShadowedLight { shape, ..candidate(0, 1.0).light };
            Candidate { light, importance: 1.0 }.is_near(&frustum)
        };
        assert!(near(Vec3::NEG_Z * 5.0, 1.0));
        assert!(!near(Vec3::Z * 5.0, 1.0));
        assert!(near(Vec3::Z * 5.0, 10.0));
    }
}
