//! `cargo xtask demo`: builds, bakes and runs the example, in a window or headless.

use std::env;
use std::ffi::OsString;
use std::path::Path;
use std::process::Command;

use crate::cargo::{self, Target};
use crate::{TaskError, assets, driver, execute};

pub(crate) fn run(arguments: &[OsString]) -> Result<(), TaskError> {
    driver::ensure()?;
    let [example, visfield] = cargo::build([Target::Example("moving_objects"), Target::Bin("visfield")])?;
    assets::bake_missing(&visfield)?;

    let headless = has_flag(arguments, "--headless");
    let display = Display::find(env::consts::OS, |name| env::var_os(name));
    let mut command = Command::new(example);
    // As `cargo run` would: Bevy looks for assets/ where this points. Paths of the user's stay relative to where they stand.
    command.env("CARGO_MANIFEST_DIR", cargo::workspace()).env("BEVY_ASSET_ROOT", cargo::workspace());
    if display == Display::Window && !headless {
        println!("opening a window; without one: cargo xtask demo -- --headless");
        let result = execute(command.args(arguments));
        if matches!(&result, Err(TaskError::Failed { status, .. }) if status.code() == Some(PANICKED)) {
            eprintln!("error: the window failed; if there is no working display: cargo xtask demo -- --headless");
        }
        return result;
    }
    if !headless {
        println!("{}: rendering headless", display.missing());
    }
    // The example's last line says where the animation is.
    execute(command.args(headless_arguments(arguments, &cargo::workspace().join("target").join("demo"))))
}

/// Exit code of a Rust program that panicked, as Bevy does where it cannot open a window.
const PANICKED: i32 = 101;

/// Where the example can be seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Display {
    Window,
    /// A Wayland session that serves no X11 programs; the workspace compiles Bevy for X11 only.
    WaylandOnly,
    None,
}

impl Display {
    fn find(os: &str, variable: impl Fn(&str) -> Option<OsString>) -> Self {
        let is_set = |name| variable(name).is_some_and(|value| !value.is_empty());
        if matches!(os, "macos" | "windows") || is_set("DISPLAY") {
            Self::Window
        } else if is_set("WAYLAND_DISPLAY") || is_set("WAYLAND_SOCKET") {
            Self::WaylandOnly
        } else {
            Self::None
        }
    }

    fn missing(self) -> &'static str {
        match self {
            Self::WaylandOnly => "this Wayland session has no XWayland (DISPLAY is not set)",
            Self::Window | Self::None => "no display (DISPLAY is not set)",
        }
    }
}

/// The example's arguments for a headless run. Its output goes to `default_out`, unless the user says otherwise.
fn headless_arguments(given: &[OsString], default_out: &Path) -> Vec<OsString> {
    let mut arguments = given.to_vec();
    if !has_flag(given, "--headless") {
        arguments.push("--headless".into());
    }
    if !has_flag(given, "--out") {
        arguments.extend(["--out".into(), default_out.into()]);
    }
    arguments
}

/// Whether there is a `--flag`, or a `--flag=VALUE`.
fn has_flag(arguments: &[OsString], flag: &str) -> bool {
    arguments.iter().filter_map(|argument| argument.to_str()).any(|argument| argument.split('=').next() == Some(flag))
}

#[cfg(test)]
mod tests {
    use std::ffi::OsStr;

    use super::*;

    fn display(os: &str, set: &[(&str, &str)]) -> Display {
        let variable = |name: &str| set.iter().find(|(key, _)| *key == name).map(|(_, value)| OsString::from(value));
        Display::find(os, variable)
    }

    #[test]
    fn displays_are_detected() {
        assert_eq!(display("linux", &[("DISPLAY", ":0")]), Display::Window);
        assert_eq!(display("linux", &[("DISPLAY", ":0"), ("WAYLAND_DISPLAY", "wayland-0")]), Display::Window);
        assert_eq!(display("linux", &[("WAYLAND_DISPLAY", "wayland-0")]), Display::WaylandOnly);
        assert_eq!(display("linux", &[("DISPLAY", ""), ("WAYLAND_DISPLAY", "")]), Display::None);
        assert_eq!(display("freebsd", &[]), Display::None);
        for os in ["macos", "windows"] {
            assert_eq!(display(os, &[]), Display::Window);
        }
    }

    #[test]
    fn headless_defaults_give_way_to_arguments() {
        let headless = |given: &str| {
            let given: Vec<OsString> = given.split_whitespace().map(OsString::from).collect();
            headless_arguments(&given, Path::new("demo")).join(OsStr::new(" ")).into_string().unwrap()
        };
        assert_eq!(headless(""), "--headless --out demo");
        assert_eq!(headless("--headless --frames 2"), "--headless --frames 2 --out demo");
        assert_eq!(headless("--out x --mesh m.glb"), "--out x --mesh m.glb --headless");
        assert_eq!(headless("--out=y"), "--out=y --headless");
        assert_eq!(headless("--mesh --out.glb"), "--mesh --out.glb --headless --out demo");
    }
}
