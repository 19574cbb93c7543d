//! Small, careful changes to Bevy's own shaders, made as soon as their text arrives.
//!
//! Bevy offers no hooks where its lighting sums up lights or its prepass writes normals. A patch replaces text that must occur
//! exactly as often as in the Bevy version that this crate is made for; if it does not, the shader stays as it is.

use bevy::asset::AssetEvent;
use bevy::prelude::*;
use bevy::shader::{Shader, ShaderImport};

/// A change to one of Bevy's shaders.
pub(crate) struct ShaderPatch {
    /// The shader's import path, or the end of its asset path if it has none.
    pub(crate) module: &'static str,
    /// Its text with the change, the text itself if it has the change already, or `None` if it is not the text that is known.
    pub(crate) patched: fn(&str) -> Option<String>,
    /// What users miss if that text is not known.
    pub(crate) purpose: &'static str,
}

/// The changes to make.
#[derive(Resource, Default)]
pub(crate) struct ShaderPatches(pub(crate) Vec<ShaderPatch>);

impl ShaderPatch {
    fn is_for(&self, import: &ShaderImport) -> bool {
        match import {
            ShaderImport::Custom(path) => path == self.module,
            ShaderImport::AssetPath(path) => path.ends_with(self.module),
        }
    }
}

/// Adds changes to Bevy's shaders. They are made after the asset events of a frame and before its extraction, so that no
/// pipeline is built from the text without them.
pub(crate) fn patch_shaders(app: &mut App, patches: impl IntoIterator<Item = ShaderPatch>) {
    if !app.world().contains_resource::<ShaderPatches>() {
        app.init_resource::<ShaderPatches>().add_systems(Last, apply_patches);
    }
    app.world_mut().resource_mut::<ShaderPatches>().0.extend(patches);
}

/// Changes shaders that arrived (and again those that are reloaded).
fn apply_patches(
    mut events: MessageReader<AssetEvent<Shader>>,
    mut shaders: ResMut<Assets<Shader>>,
    patches: Res<ShaderPatches>,
) {
    for event in events.read() {
        let (AssetEvent::Added { id } | AssetEvent::Modified { id }) = event else { continue };
        // Untracked: the event at hand has yet to be extracted, and will carry the patched source.
        let Some(shader) = shaders.get_mut_untracked(*id) else { continue };
        for ShaderPatch { module, patched, purpose } in
            patches.0.iter().filter(|patch| patch.is_for(&shader.import_path))
        {
            if let Some(source) = patched(shader.source.as_str()) {
                // Only the text and what it imports: the rest is as the loader made it.
                let Shader { source, imports, .. } = Shader::from_wgsl(source, shader.path.clone());
                (shader.source, shader.imports) = (source, imports);
            } else {
                error!(
                    "{module} is not the one of Bevy 0.19: {purpose}. Use the Bevy version that this version of \
                     bevy_visfield was made for."
                );
            }
        }
    }
}

/// The text with every `from` replaced, if there are exactly `count`.
pub(crate) fn replace_exactly(text: &str, count: usize, from: &str, to: &str) -> Option<String> {
    (text.matches(from).count() == count).then(|| text.replace(from, to))
}
