//! The example meshes and their fields, `assets/meshes`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::cargo::{self, Target};
use crate::{TaskError, execute};

/// Makes all of them again.
pub(crate) fn generate() -> Result<(), TaskError> {
    let [generator] = cargo::build([Target::Example("example_meshes")])?;
    execute(Command::new(generator).arg(folder()))
}

/// Bakes the meshes whose field is missing, or is of another format version, with the command `visfield`.
pub(crate) fn bake_missing(visfield: &Path) -> Result<(), TaskError> {
    for mesh in meshes(&folder())? {
        if is_readable(visfield, &mesh.with_extension("vfield"))? {
            continue;
        }
        println!("baking {}", mesh.display());
        execute(Command::new(visfield).arg("bake").arg(mesh))?;
    }
    Ok(())
}

fn folder() -> PathBuf {
    cargo::workspace().join("assets").join("meshes")
}

/// All example meshes and their fields, sorted.
pub(crate) fn files() -> Result<Vec<PathBuf>, TaskError> {
    entries(&folder())
}

/// The mesh files in a folder, sorted.
fn meshes(folder: &Path) -> Result<Vec<PathBuf>, TaskError> {
    let mut meshes = entries(folder)?;
    meshes.retain(|path| path.extension().is_some_and(|e| e == "glb"));
    Ok(meshes)
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>, TaskError> {
    let entries = fs::read_dir(folder).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let entries = entries.map_err(|source| TaskError::Folder { path: folder.to_owned(), source })?;
    let mut paths: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).collect();
    paths.sort();
    Ok(paths)
}

/// Whether a field is there and this build reads it: the command that reads fields decides.
fn is_readable(visfield: &Path, field: &Path) -> Result<bool, TaskError> {
    let mut inspect = Command::new(visfield);
    inspect.arg("inspect").arg(field).stdout(Stdio::null()).stderr(Stdio::null());
    match execute(&mut inspect) {
        Ok(()) => Ok(true),
        Err(TaskError::Failed { .. }) => Ok(false),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_meshes_are_listed() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["b.glb", "a.glb", "a.vfield", "glb"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        assert_eq!(meshes(folder.path()).unwrap(), ["a.glb", "b.glb"].map(|name| folder.path().join(name)));
        let missing = meshes(&folder.path().join("missing")).unwrap_err();
        assert!(missing.to_string().contains("missing"), "{missing}");
    }

    #[cfg(unix)]
    #[test]
    fn a_field_counts_only_if_it_is_read() {
        let field = Path::new("x.vfield");
        assert!(is_readable(Path::new("true"), field).unwrap());
        assert!(!is_readable(Path::new("false"), field).unwrap());
        assert!(is_readable(Path::new("/no/such/command"), field).is_err());
    }
}
