//! `cargo xtask gpu-bench`: what measures a GPU, to be copied to a machine that has one and no compiler.
//!
//! The bundle holds the program `visfield`, the example `frame_bench`, both stripped, the assets, meshes to measure, and a script
//! that runs everything and keeps the results under the adapter's name.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::cargo::{self, Target};
use crate::{TaskError, assets, execute};

/// The name of the folder in the archive.
const NAME: &str = "visfield-gpu-bench";

/// What the archive may weigh, in bytes.
const MOST_BYTES: u64 = 60_000_000;

/// Runs on the other machine.
const SCRIPT: &str = include_str!("gpu_bench.sh");

/// Builds and packs the bundle into `out`, with these meshes, or the example meshes if there are none.
pub(crate) fn run(meshes: &[PathBuf], out: Option<&Path>) -> Result<(), TaskError> {
    let [frame_bench, visfield] = cargo::build([Target::Example("frame_bench"), Target::Bin("visfield")])?;
    assets::bake_missing(&visfield)?;
    let out = out.map_or_else(|| cargo::workspace().join("target").join("gpu-bench"), Path::to_owned);
    let bundle = out.join(NAME);
    if bundle.exists() {
        on(&bundle, fs::remove_dir_all)?;
    }
    for program in [&frame_bench, &visfield] {
        let copied = copy(program, &bundle.join("bin"))?;
        // A copy, so that the build stays as cargo made it.
        execute(Command::new("strip").arg(&copied))?;
    }
    let own = assets::files()?;
    for file in &own {
        copy(file, &bundle.join("assets").join("meshes"))?;
    }
    let is_mesh = |path: &&PathBuf| path.extension().is_some_and(|extension| extension == "glb");
    let generated: Vec<PathBuf> = own.iter().filter(is_mesh).cloned().collect();
    for mesh in if meshes.is_empty() { &generated } else { meshes } {
        copy(mesh, &bundle.join("meshes"))?;
    }
    let script = bundle.join("run.sh");
    on(&script, |path| fs::write(path, SCRIPT))?;
    make_executable(&script)?;
    let archive = out.join(NAME).with_extension("tar.gz");
    execute(Command::new("tar").arg("-czf").arg(&archive).arg("-C").arg(&out).arg(NAME))?;
    report(&bundle, &archive)
}

/// Says how large everything is, and whether that is too large.
fn report(bundle: &Path, archive: &Path) -> Result<(), TaskError> {
    for part in ["bin/frame_bench", "bin/visfield", "assets", "meshes"] {
        println!("{part}: {} kB", bytes(&bundle.join(part))? / 1000);
    }
    let packed = bytes(archive)?;
    println!("{}: {} kB, {} kB unpacked", archive.display(), packed / 1000, bytes(bundle)? / 1000);
    println!("copy it to the machine with the GPU, unpack it there, and run {NAME}/run.sh");
    if packed > MOST_BYTES {
        return Err(TaskError::BundleTooLarge { path: archive.to_owned(), bytes: packed, most: MOST_BYTES });
    }
    Ok(())
}

/// Copies a file into a folder, which is made if it is missing, and says where it is now.
fn copy(file: &Path, folder: &Path) -> Result<PathBuf, TaskError> {
    on(folder, fs::create_dir_all)?;
    let to = folder.join(file.file_name().unwrap_or_default());
    on(file, |file| fs::copy(file, &to))?;
    Ok(to)
}

#[cfg(unix)]
fn make_executable(path: &Path) -> Result<(), TaskError> {
    use std::os::unix::fs::PermissionsExt;
    on(path, |path| fs::set_permissions(path, fs::Permissions::from_mode(0o755)))
}

/// Elsewhere files have no such permission.
#[cfg(not(unix))]
#[allow(clippy::unnecessary_wraps)]
fn make_executable(_: &Path) -> Result<(), TaskError> {
    Ok(())
}

/// Bytes of a file, or of all files in a folder.
fn bytes(path: &Path) -> Result<u64, TaskError> {
    if !path.is_dir() {
        return Ok(on(path, fs::metadata)?.len());
    }
    let entries = on(path, |path| fs::read_dir(path)?.collect::<Result<Vec<_>, _>>())?;
    entries.iter().map(|entry| bytes(&entry.path())).sum()
}

/// Does something with a file or folder, whose name an error tells.
fn on<'a, T>(path: &'a Path, act: impl FnOnce(&'a Path) -> io::Result<T>) -> Result<T, TaskError> {
    act(path).map_err(|source| TaskError::Folder { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_weigh_what_their_files_do() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a");
        fs::write(&file, "12345").unwrap();
        let copied = copy(&file, &folder.path().join("b").join("c")).unwrap();
        assert_eq!(fs::read(&copied).unwrap(), b"12345");
        assert_eq!(bytes(folder.path()).unwrap(), 10);
        let missing = copy(Path::new("/no/such/file"), folder.path()).unwrap_err();
        assert!(missing.to_string().starts_with("/no/such/file: "), "{missing}");
    }
}
