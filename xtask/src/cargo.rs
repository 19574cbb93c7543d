//! Calls of cargo. See the crate's documentation for why they always select the whole workspace.

use std::env;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::{TaskError, command_line};

/// The folder of the workspace's `Cargo.toml`.
pub(crate) fn workspace() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("xtask lies in the workspace")
}

/// The cargo that started this task, on this workspace, wherever the user stands.
pub(crate) fn command() -> Command {
    let mut command = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(workspace());
    command
}

/// Something of the workspace that can be run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Target {
    /// A program.
    Bin(&'static str),
    /// An example.
    Example(&'static str),
}

impl Target {
    /// The flag of cargo, the same word in cargo's messages, and the name.
    fn parts(self) -> (&'static str, &'static str, &'static str) {
        match self {
            Self::Bin(name) => ("--bin", "bin", name),
            Self::Example(name) => ("--example", "example", name),
        }
    }
}

/// Builds targets in one call, and says where each one's executable is.
pub(crate) fn build<const COUNT: usize>(targets: [Target; COUNT]) -> Result<[PathBuf; COUNT], TaskError> {
    let mut command = command();
    command.args(["build", "--workspace", "--message-format", "json-render-diagnostics"]).stdout(Stdio::piped());
    for (flag, _, name) in targets.map(Target::parts) {
        command.args([flag, name]);
    }
    let start_error = |command: &Command, source| TaskError::Start { command: command_line(command), source };
    let mut child = command.spawn().map_err(|source| start_error(&command, source))?;
    let mut found = targets.map(|_| None);
    for line in child.stdout.take().into_iter().flat_map(|stdout| BufReader::new(stdout).lines()).map_while(Result::ok)
    {
        for (target, found) in targets.iter().zip(&mut found) {
            *found = found.take().or_else(|| executable(&line, *target));
        }
    }
    let status = child.wait().map_err(|source| start_error(&command, source))?;
    if !status.success() {
        return Err(TaskError::Failed { command: command_line(&command), status });
    }
    for (target, found) in targets.iter().zip(&found) {
        if found.is_none() {
            return Err(TaskError::NoExecutable { name: target.parts().2 });
        }
    }
    Ok(found.map(Option::unwrap_or_default))
}

/// The path of a target's executable, if this line of cargo's messages tells it.
fn executable(line: &str, target: Target) -> Option<PathBuf> {
    let (_, kind, name) = target.parts();
    let message: Value = serde_json::from_str(line).ok()?;
    let described = &message["target"];
    let kinds = described["kind"].as_array()?;
    if message["reason"] != "compiler-artifact" || described["name"] != name || !kinds.iter().any(|k| k == kind) {
        return None;
    }
    message["executable"].as_str().map(PathBuf::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn executables_are_found_in_messages() {
        let line = r#"{"reason":"compiler-artifact","target":{"kind":["example"],"name":"moving_objects"},
            "executable":"C:\\target\\moving_objects.exe"}"#;
        let example = Target::Example("moving_objects");
        assert_eq!(executable(line, example), Some(PathBuf::from(r"C:\target\moving_objects.exe")));
        assert_eq!(executable(line, Target::Example("other")), None);
        assert_eq!(executable(line, Target::Bin("moving_objects")), None);
        assert_eq!(executable(&line.replace("compiler-artifact", "build-finished"), example), None);
        assert_eq!(executable(r#"{"reason":"build-finished","success":true}"#, example), None);
        assert_eq!(executable("not json", example), None);
    }

    #[test]
    fn the_workspace_is_where_its_manifest_is() {
        let manifest = std::fs::read_to_string(workspace().join("Cargo.toml")).unwrap();
        assert!(manifest.contains("[workspace]"));
    }
}
