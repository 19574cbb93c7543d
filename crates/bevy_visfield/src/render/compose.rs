//! How occlusion reaches unmodified materials: Bevy's PBR shader reads our texture in the place of its screen-space
//! ambient occlusion, and shadows direct light with the masks in the texture's other channels ([`super::masks`]).

use std::mem;

use bevy::pbr::{ScreenSpaceAmbientOcclusionResources, SsaoBindGroups, SsaoPipelineId};
use bevy::prelude::*;
use bevy::render::render_resource::WgpuLimits;
use bevy::render::texture::CachedTexture;
use visfield::gpu::MissingCapability;

use super::prepare::FieldOcclusionFrame;
use crate::shader_patch::{ShaderPatch, replace_exactly};

/// Bevy makes the texture that we replace only where its own screen-space ambient occlusion runs.
pub(super) fn check(limits: &WgpuLimits) -> Result<(), MissingCapability> {
    let (needed, found) = (5, limits.max_storage_textures_per_shader_stage);
    let missing = MissingCapability::Limit { name: "max_storage_textures_per_shader_stage", needed, found };
    if found < needed { Err(missing) } else { Ok(()) }
}

/// Marks views whose camera has Bevy's screen-space ambient occlusion beside ours: it stays, to be combined with ours.
#[derive(Component)]
pub struct CombinesScreenSpace;

/// What Bevy's own passes fill in such views, as large as the viewport: ambient visibility in the red channel. It is
/// complete in `Core3dSystems::MainPass`, and not before: Bevy's system has no name to order others by, but is ordered
/// before that set.
#[derive(Component)]
#[expect(dead_code, reason = "the frame's passes read it from the next change on")]
pub struct ScreenSpaceOcclusion(pub(super) CachedTexture);

/// Puts our texture where Bevy's lighting reads its own. Bevy's own passes do not run, unless their result is combined with
/// ours: then it is kept for our passes.
pub(super) fn replace_occlusion_texture(
    mut commands: Commands,
    mut views: Query<(
        Entity,
        &FieldOcclusionFrame,
        &mut ScreenSpaceAmbientOcclusionResources,
        Has<CombinesScreenSpace>,
    )>,
) {
    for (entity, frame, mut resources, combines) in &mut views {
        let bevys_own = mem::replace(&mut resources.screen_space_ambient_occlusion_texture, frame.output.clone());
        let mut view = commands.entity(entity);
        if combines {
            // Bevy's bind groups have the texture already.
            view.insert(ScreenSpaceOcclusion(bevys_own));
        } else {
            view.remove::<(SsaoBindGroups, SsaoPipelineId)>();
        }
    }
}

/// Lets Bevy's lighting read the light masks.
pub(super) const MASK_DIRECT_LIGHT: ShaderPatch = ShaderPatch {
    module: "bevy_pbr::pbr_functions",
    patched: masked_source,
    purpose: "lights will have no field shadows",
};

/// What reads the masks.
const VISIBILITY_FUNCTIONS: &str =
    concat!("#ifdef SCREEN_SPACE_AMBIENT_OCCLUSION\n", include_str!("masks.wgsl"), "#endif\n\n");
/// The function that the following belong to; the functions that read masks go before it.
const APPLY_LIGHTING: &str = "fn apply_pbr_lighting(";

/// Where the light of point, spot and directional lights is computed, in the order of the source, and what tells the mask.
const SHADOWED_LIGHTS: [(&str, &str); 3] = [
    (
        "let light_contrib = lighting::point_light(light_id, &lighting_input, enable_diffuse, true);",
        "visfield_clustered_visibility(light_id, in.frag_coord.xy)",
    ),
    (
        "let light_contrib = lighting::spot_light(light_id, &lighting_input, enable_diffuse);",
        "visfield_clustered_visibility(light_id, in.frag_coord.xy)",
    ),
    (
        "var light_contrib = lighting::directional_light(i, &lighting_input, enable_diffuse);",
        "visfield_directional_visibility(i, in.frag_coord.xy)",
    ),
];
/// Where their light is added, once after each.
const ADD_SHADOWED_LIGHT: &str = "direct_light += light_contrib * shadow;";

/// Where the light of rect lights is computed…
const RECT_LIGHT: &str = "let light_contrib = lighting::rect_light(i, &lighting_input, enable_diffuse);";
/// …and where it is added. Bevy has no shadows for them.
const ADD_RECT_LIGHT: &str = "direct_light += light_contrib;";
const ADD_MASKED_RECT_LIGHT: &str = "
#ifdef SCREEN_SPACE_AMBIENT_OCCLUSION
        if (in.flags & MESH_FLAGS_SHADOW_RECEIVER_BIT) != 0u {
            direct_light += light_contrib * visfield_rect_visibility(i, in.frag_coord.xy);
        } else {
            direct_light += light_contrib;
        }
#else
        direct_light += light_contrib;
#endif";

/// Bevy's lighting with the masks, the source itself if it has them already, or `None` if its text is not what we know. Of
/// mask and shadow map the darker wins: both know the same objects. Light that a material transmits is not masked.
fn masked_source(source: &str) -> Option<String> {
    if source.contains(VISIBILITY_FUNCTIONS) {
        return Some(source.to_owned());
    }
    // Each light is computed and then added, before the next.
    let statements = SHADOWED_LIGHTS.iter().flat_map(|(light, _)| [*light, ADD_SHADOWED_LIGHT]);
    let mut rest = source;
    for statement in statements.chain([RECT_LIGHT, ADD_RECT_LIGHT]) {
        rest = rest.split_once(statement)?.1;
    }
    if source.matches(ADD_SHADOWED_LIGHT).count() != SHADOWED_LIGHTS.len() {
        return None;
    }
    let mut masked = replace_exactly(source, 1, APPLY_LIGHTING, &[VISIBILITY_FUNCTIONS, APPLY_LIGHTING].concat())?;
    for (light, visibility) in SHADOWED_LIGHTS {
        masked = replace_exactly(&masked, 1, light, &[light, &shadow_by(visibility)].concat())?;
    }
    masked = replace_exactly(&masked, 1, RECT_LIGHT, RECT_LIGHT)?;
    replace_exactly(&masked, 1, ADD_RECT_LIGHT, ADD_MASKED_RECT_LIGHT)
}

fn shadow_by(visibility: &str) -> String {
    format!(
        "
#ifdef SCREEN_SPACE_AMBIENT_OCCLUSION
        if (in.flags & MESH_FLAGS_SHADOW_RECEIVER_BIT) != 0u {{
            shadow = min(shadow, {visibility});
        }}
#endif"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: &str = "
fn apply_pbr_lighting(in: PbrInput) {
        let light_contrib = lighting::point_light(light_id, &lighting_input, enable_diffuse, true);
        direct_light += light_contrib * shadow;
            lighting::point_light(light_id, &transmissive_lighting_input, enable_diffuse, true);
        let light_contrib = lighting::spot_light(light_id, &lighting_input, enable_diffuse);
        direct_light += light_contrib * shadow;
        var light_contrib = lighting::directional_light(i, &lighting_input, enable_diffuse);
        direct_light += light_contrib * shadow;
        let light_contrib = lighting::rect_light(i, &lighting_input, enable_diffuse);
        direct_light += light_contrib;
}";

    #[test]
    fn every_light_is_masked_before_it_is_added() {
        let masked = masked_source(KNOWN).unwrap();
        let mut parts = masked.split(ADD_SHADOWED_LIGHT);
        for (light, visibility) in SHADOWED_LIGHTS {
            let part = parts.next().unwrap();
            let (_, mask) = part.split_once(light).unwrap();
            assert_eq!(mask.trim(), shadow_by(visibility).trim());
        }
        let rect = parts.next().unwrap();
        assert_eq!(rect.matches("visfield_rect_visibility(i, ").count(), 1);
        assert_eq!(parts.next(), None);
        assert_eq!(masked.matches("#ifdef").count(), masked.matches("#endif").count());
        let [functions, user] = ["fn visfield_visibility(", APPLY_LIGHTING].map(|text| masked.find(text).unwrap());
        assert!(functions < user);
    }

    #[test]
    fn masking_twice_changes_nothing() {
        let masked = masked_source(KNOWN).unwrap();
        assert_eq!(masked_source(&masked), Some(masked.clone()));
    }

    #[test]
    fn unknown_text_is_left_alone() {
        let [point, spot, directional] = SHADOWED_LIGHTS.map(|(light, _)| light);
        let mut unknown: Vec<String> = [point, spot, directional, RECT_LIGHT, ADD_RECT_LIGHT, APPLY_LIGHTING]
            .iter()
            .flat_map(|text| [KNOWN.replace(text, ""), KNOWN.replace(text, &[*text, *text].concat())])
            .collect();
        unknown.extend([
            KNOWN.replace("shadow;", "shadows;"),
            KNOWN.replacen(ADD_SHADOWED_LIGHT, "", 1),
            KNOWN.replacen(ADD_SHADOWED_LIGHT, &ADD_SHADOWED_LIGHT.repeat(2), 1),
            KNOWN.replace(spot, "exchanged").replace(point, spot).replace("exchanged", point),
            // A light before it is computed.
            KNOWN.replacen(point, "", 1).replacen(ADD_SHADOWED_LIGHT, &[ADD_SHADOWED_LIGHT, point].concat(), 1),
        ]);
        for unknown in unknown {
            assert_eq!(masked_source(&unknown), None, "{unknown}");
        }
    }
}
