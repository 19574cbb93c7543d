//! Fields as Bevy assets, and the loader of `.vfield` files.

use std::collections::HashMap;

use bevy::asset::{AssetLoader, LoadContext, io::Reader};
use bevy::prelude::*;
use thiserror::Error;
use visfield::file::{DecodeError, decode};

/// A field as an asset. Load one from a `.vfield` file by the label of the mesh that it was baked from,
/// `"rock.vfield#Mesh0/Primitive0"`, just as the mesh itself is `"rock.glb#Mesh0/Primitive0"`.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::VisibilityField;
/// fn add(baked: visfield::VisibilityField, assets: &mut Assets<VisibilityField>) -> Handle<VisibilityField> {
///     assets.add(VisibilityField(baked))
/// }
/// ```
#[derive(Asset, TypePath, Clone, Debug, Deref)]
pub struct VisibilityField(pub visfield::VisibilityField);

/// All fields of one `.vfield` file: what the path without a label loads.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::{VisibilityField, VisibilityFieldSet};
/// fn first_body(set: &VisibilityFieldSet) -> Option<Handle<VisibilityField>> {
///     set.fields.get("Mesh0/Primitive0").cloned()
/// }
/// ```
#[derive(Asset, TypePath, Clone, Debug, Default)]
pub struct VisibilityFieldSet {
    /// The fields by name.
    pub fields: HashMap<String, Handle<VisibilityField>>,
}

/// Loads `.vfield` files, which `visfield bake` writes.
///
/// ```
/// use bevy::asset::AssetLoader;
/// assert_eq!(bevy_visfield::VisibilityFieldLoader.extensions(), ["vfield"]);
/// ```
#[derive(TypePath, Clone, Copy, Debug, Default)]
pub struct VisibilityFieldLoader;

/// Why a `.vfield` file cannot be loaded.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum VisibilityFieldLoaderError {
    /// The file cannot be read.
    #[error("the field cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// Its content cannot be decoded.
    #[error(transparent)]
    Decode(#[from] DecodeError),
}

impl AssetLoader for VisibilityFieldLoader {
    type Asset = VisibilityFieldSet;
    type Settings = ();
    type Error = VisibilityFieldLoaderError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        _settings: &(),
        load_context: &mut LoadContext<'_>,
    ) -> Result<VisibilityFieldSet, VisibilityFieldLoaderError> {
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).await?;
        let label = |field: visfield::VisibilityField| {
            let name = field.header().name.clone();
            let handle = load_context.add_labeled_asset(name.clone(), VisibilityField(field));
            (name, handle)
        };
        Ok(VisibilityFieldSet { fields: decode(&bytes)?.into_iter().map(label).collect() })
    }

    fn extensions(&self) -> &[&str] {
        &["vfield"]
    }
}
