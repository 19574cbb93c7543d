//! Meshes from files.
//!
//! Files are untrusted: whatever is in them gives meshes or a [`ReadError`]. What the meshes hold is checked later, by
//! [`Mesh::validate`](crate::Mesh::validate) or the bake.

mod gltf;
mod obj;

use std::path::{Path, PathBuf};
use std::{fs, io};

use thiserror::Error;

pub use self::gltf::GltfError;
pub use self::obj::ObjError;
use crate::mesh::Mesh;

/// Why a file gives no meshes.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The operating system refused.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file's extension is none that is read.
    #[error("{path}: only .glb, .gltf and .obj files are read; export the mesh as one of these")]
    UnknownExtension {
        /// The file.
        path: PathBuf,
    },
    /// The file has no content.
    #[error("{path}: the file is empty; export the mesh again")]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A `.glb` or `.gltf` file cannot be read.
    #[error("{path}: {source}")]
    Gltf {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: GltfError,
    },
    /// An `.obj` file cannot be read.
    #[error("{path}: {source}")]
    Obj {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: ObjError,
    },
    /// The file has no triangles at all.
    #[error("{path}: there are no triangles in this file; export the mesh with its faces")]
    NoTriangles {
        /// The file.
        path: PathBuf,
    },
}

/// Reads every mesh of a `.glb`, `.gltf` or `.obj` file, in mesh-local coordinates.
///
/// A glTF file gives one mesh for each primitive, named `Mesh{m}/Primitive{p}` as Bevy names it; node transforms, skins and
/// morph targets are left out, images are never opened. Strips and fans become triangles; a primitive of points or lines
/// becomes a mesh without triangles, which a bake refuses. An OBJ file gives one mesh of all its objects.
///
/// ```
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("triangle.obj");
/// std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")?;
/// let meshes = visfield_bake::read_meshes(&path)?;
/// assert_eq!((meshes[0].name.as_str(), meshes[0].indices.len()), ("Mesh0/Primitive0", 1));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`ReadError`] names the file, what is wrong with it, and what to do.
pub fn read_meshes(path: &Path) -> Result<Vec<Mesh>, ReadError> {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if !["glb", "gltf", "obj"].contains(&extension.as_str()) {
        return Err(ReadError::UnknownExtension { path: path.to_owned() });
    }
    let bytes = fs::read(path).map_err(|source| ReadError::Io { path: path.to_owned(), source })?;
    if bytes.is_empty() {
        return Err(ReadError::Empty { path: path.to_owned() });
    }
    let meshes = if extension == "obj" {
        obj::meshes(&bytes).map_err(|source| ReadError::Obj { path: path.to_owned(), source })?
    } else {
        gltf::meshes(&bytes, path.parent()).map_err(|source| ReadError::Gltf { path: path.to_owned(), source })?
    };
    if meshes.iter().all(|mesh| mesh.indices.is_empty()) {
        return Err(ReadError::NoTriangles { path: path.to_owned() });
    }
    Ok(meshes)
}
