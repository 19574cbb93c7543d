//! `cargo xtask examples`: runs every example without a window, a few small frames each, to see that they work.

use std::process::Command;

use crate::cargo::{self, Target};
use crate::{TaskError, assets, driver, execute};

/// Every example that shows something, and arguments of its own.
const EXAMPLES: [(&str, &[&str]); 6] = [
    ("moving_objects", &["--frames", "2"]),
    ("lights", &["--frames", "1"]),
    ("compare", &["--frames", "1"]),
    ("ten_thousand", &["--frames", "2"]),
    ("implicit_surfaces", &["--frames", "1"]),
    // It writes no frames, but what they cost.
    ("frame_bench", &["--quick", "--frames", "1", "--size", "160x90"]),
];

/// Builds and runs them all; their frames go under `target/examples`.
pub(crate) fn run() -> Result<(), TaskError> {
    driver::ensure()?;
    let [visfield] = cargo::build([Target::Bin("visfield")])?;
    assets::bake_missing(&visfield)?;
    let programs = cargo::build(EXAMPLES.map(|(name, _)| Target::Example(name)))?;
    for ((name, arguments), program) in EXAMPLES.iter().zip(programs) {
        println!("\n{name}");
        let mut command = Command::new(program);
        command.env("CARGO_MANIFEST_DIR", cargo::workspace()).env("BEVY_ASSET_ROOT", cargo::workspace());
        command.args(*arguments);
        if *name != "frame_bench" {
            let out = cargo::workspace().join("target").join("examples").join(name);
            command.args(["--headless", "--size", "320x180", "--out"]).arg(out);
        }
        execute(&mut command)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_example_is_run() {
        let folder = std::fs::read_dir(cargo::workspace().join("examples")).unwrap();
        let mut found: Vec<String> =
            folder.map(|entry| entry.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned()).collect();
        found.sort_unstable();
        let mut run = EXAMPLES.map(|(name, _)| name);
        run.sort_unstable();
        assert_eq!(found, run);
    }
}
