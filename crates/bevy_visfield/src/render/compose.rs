//! How occlusion reaches unmodified materials: Bevy's PBR shader reads our texture in the place of its screen-space
//! ambient occlusion, and multiplies direct light with the masks in the texture's other channels.

use bevy::asset::AssetEvent;
use bevy::pbr::{ScreenSpaceAmbientOcclusionResources, SsaoBindGroups, SsaoPipelineId};
use bevy::prelude::*;
use bevy::render::render_resource::WgpuLimits;
use bevy::shader::{Shader, ShaderImport, Source};
use visfield::gpu::MissingCapability;

use super::prepare::FieldOcclusionFrame;

/// Bevy makes the texture that we replace only where its own screen-space ambient occlusion runs.
pub(super) fn check(limits: &WgpuLimits) -> Result<(), MissingCapability> {
    let (needed, found) = (5, limits.max_storage_textures_per_shader_stage);
    let missing = MissingCapability::Limit { name: "max_storage_textures_per_shader_stage", needed, found };
    if found < needed { Err(missing) } else { Ok(()) }
}

/// Puts our texture where Bevy's lighting reads its own, and keeps Bevy's own passes from running.
pub(super) fn replace_occlusion_texture(
    mut commands: Commands,
    mut views: Query<(Entity, &FieldOcclusionFrame, &mut ScreenSpaceAmbientOcclusionResources)>,
) {
    for (entity, frame, mut resources) in &mut views {
        resources.screen_space_ambient_occlusion_texture = frame.output.clone();
        commands.entity(entity).remove::<(SsaoBindGroups, SsaoPipelineId)>();
    }
}

/// The module of Bevy's shader that sums up the lights.
const LIGHTING_MODULE: &str = "bevy_pbr::pbr_functions";

/// Lets Bevy's lighting read the light masks, as soon as its shader arrives (and again if it is reloaded).
pub(super) fn mask_direct_light(mut events: MessageReader<AssetEvent<Shader>>, mut shaders: ResMut<Assets<Shader>>) {
    for event in events.read() {
        let (AssetEvent::Added { id } | AssetEvent::Modified { id }) = event else { continue };
        // Untracked: the event at hand has yet to be extracted, and will carry the patched source.
        let Some(shader) = shaders.get_mut_untracked(*id) else { continue };
        if shader.import_path != ShaderImport::Custom(LIGHTING_MODULE.to_owned()) {
            continue;
        }
        if let Some(source) = masked_source(shader.source.as_str()) {
            shader.source = Source::Wgsl(source.into());
        } else {
            error!(
                "{LIGHTING_MODULE} is not the one of Bevy 0.19: lights will have no field shadows. Use the Bevy version \
                 that this version of bevy_visfield was made for."
            );
        }
    }
}

/// Where directional light is computed…
const DIRECTIONAL_LIGHT: &str = "var light_contrib = lighting::directional_light(i, &lighting_input, enable_diffuse);";
/// …and where it is added. The same statement serves point and spot lights further up.
const ADD_LIGHT: &str = "direct_light += light_contrib * shadow;";
/// The function that both belong to.
const APPLY_LIGHTING: &str = "fn apply_pbr_lighting(";

const ADD_MASKED_LIGHT: &str = "
#ifdef SCREEN_SPACE_AMBIENT_OCCLUSION
        if (in.flags & MESH_FLAGS_SHADOW_RECEIVER_BIT) != 0u {
            shadow *= visfield_directional_visibility(i, in.frag_coord.xy);
        }
#endif
        direct_light += light_contrib * shadow;";

/// Green and blue hold occlusion and alpha visibility, so that the textures of other cameras, which have but a red channel,
/// read as unshadowed.
const VISIBILITY_FUNCTION: &str = "
#ifdef SCREEN_SPACE_AMBIENT_OCCLUSION
fn visfield_directional_visibility(light: u32, frag_coord: vec2<f32>) -> f32 {
    let masks = textureLoad(view_bindings::screen_space_ambient_occlusion_texture, vec2<i32>(frag_coord), 0);
    switch light {
        case 0u: { return 1.0 - masks.g; }
        case 1u: { return 1.0 - masks.b; }
        case 2u: { return masks.a; }
        default: { return 1.0; }
    }
}
#endif
";

/// Bevy's lighting with the masks, the source itself if it has them already, or `None` if its text is not what we know.
fn masked_source(source: &str) -> Option<String> {
    if source.contains(VISIBILITY_FUNCTION) {
        return Some(source.to_owned());
    }
    let once = |text: &str| source.matches(text).count() == 1;
    if !once(DIRECTIONAL_LIGHT) || !once(APPLY_LIGHTING) || source.matches(ADD_LIGHT).count() != 3 {
        return None;
    }
    let (before, lighting) = source.split_at(source.find(APPLY_LIGHTING)?);
    let (upper, directional) = lighting.split_at(lighting.find(DIRECTIONAL_LIGHT)?);
    if !directional.contains(ADD_LIGHT) {
        return None;
    }
    let directional = directional.replacen(ADD_LIGHT, ADD_MASKED_LIGHT, 1);
    Some([before, VISIBILITY_FUNCTION, upper, &directional].concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: &str = "
fn apply_pbr_lighting(in: PbrInput) {
    direct_light += light_contrib * shadow;
    direct_light += light_contrib * shadow;
        var light_contrib = lighting::directional_light(i, &lighting_input, enable_diffuse);
        direct_light += light_contrib * shadow;
}";

    #[test]
    fn only_directional_light_is_masked() {
        let masked = masked_source(KNOWN).unwrap();
        let (point_and_spot, directional) = masked.split_once(DIRECTIONAL_LIGHT).unwrap();
        assert_eq!(point_and_spot.matches("shadow *=").count(), 0);
        assert_eq!(directional.matches("shadow *= visfield_directional_visibility(i, ").count(), 1);
        assert_eq!(masked.matches(ADD_LIGHT).count(), 3);
    }

    #[test]
    fn masking_twice_changes_nothing() {
        let masked = masked_source(KNOWN).unwrap();
        assert_eq!(masked_source(&masked), Some(masked.clone()));
    }

    #[test]
    fn unknown_text_is_left_alone() {
        for unknown in [
            KNOWN.replace("shadow;", "shadows;"),
            KNOWN.replacen(ADD_LIGHT, "", 1),
            KNOWN.replace("directional_light(i,", "directional_light(k,"),
            KNOWN.replace("apply_pbr_lighting", "apply_lighting"),
        ] {
            assert_eq!(masked_source(&unknown), None);
        }
    }
}
