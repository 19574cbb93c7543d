//! The two commands of the README, and three for maintainers:
//!
//! - `cargo xtask demo` builds, bakes and runs the example,
//! - `cargo xtask test` runs every test,
//! - `cargo xtask examples` runs every example without a window,
//! - `cargo xtask assets` makes the example meshes and their fields again,
//! - `cargo xtask gpu-bench` packs what measures a GPU, for a machine without a compiler.
//!
//! All of them, and `.ci/run`, select the *whole workspace* in every call of cargo. Cargo unifies features over the packages
//! that it is asked to build: a narrower selection would compile most of Bevy a second time.

mod assets;
mod cargo;
mod demo;
mod driver;
mod examples;
mod gpu_bench;

use std::env;
use std::ffi::OsString;
use std::io;
use std::path::PathBuf;
use std::process::{Command, ExitCode, ExitStatus};

use clap::{Parser, Subcommand};
use thiserror::Error;

/// Tasks of the visfield workspace.
#[derive(Debug, Parser)]
#[command(bin_name = "cargo xtask")]
struct Cli {
    #[command(subcommand)]
    task: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// Build, bake and run the example `moving_objects`: in a window, or headless where there is no display
    Demo {
        /// Passed on to the example, for example `--mesh my.glb` or `--headless --frames 10 --out DIR`; `-- --help` lists all
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<OsString>,
    },
    /// Run every test of the workspace
    Test {
        /// Passed on to `cargo test --workspace`, for example `closed_forms` or `-- --nocapture`
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<OsString>,
    },
    /// Run every example headless, a few small frames each
    Examples,
    /// Make assets/meshes again: the example meshes and their fields
    Assets,
    /// Pack what measures a GPU, with all it needs, for a machine that has one and no compiler
    GpuBench {
        /// A mesh to measure, any number of times; without one, the example meshes are
        #[arg(long = "mesh", value_name = "PATH")]
        meshes: Vec<PathBuf>,
        /// Where the folder and the archive are made; target/gpu-bench if not said
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
}

/// Why a task failed. Every message says what to do, unless the command that failed has said so itself.
#[derive(Debug, Error)]
enum TaskError {
    #[error("{command} cannot be started: {source}")]
    Start { command: String, source: io::Error },
    #[error("{command} failed ({status})")]
    Failed { command: String, status: ExitStatus },
    #[error("cargo did not say where it put {name}")]
    NoExecutable { name: &'static str },
    #[error("{path}: {source}")]
    Folder { path: PathBuf, source: io::Error },
    #[error("{path} has {bytes} bytes, more than {most}; pack fewer or smaller meshes")]
    BundleTooLarge { path: PathBuf, bytes: u64, most: u64 },
    #[error(transparent)]
    Driver(#[from] driver::DriverError),
}

fn main() -> ExitCode {
    let result = match Cli::parse().task {
        Task::Demo { arguments } => demo::run(&arguments),
        Task::Test { arguments } => test(arguments),
        Task::Examples => examples::run(),
        Task::Assets => assets::generate(),
        Task::GpuBench { meshes, out } => gpu_bench::run(&meshes, out.as_deref()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        // It has said itself what is wrong.
        Err(TaskError::Failed { status, .. }) if status.code().is_some() => {
            ExitCode::from(status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1))
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn test(mut arguments: Vec<OsString>) -> Result<(), TaskError> {
    driver::ensure()?;
    // clap takes a leading `--` for itself, but it is `cargo test` that should see it.
    if env::args_os().nth(2).is_some_and(|first| first == "--") {
        arguments.insert(0, "--".into());
    }
    execute(cargo::command().args(["test", "--workspace"]).args(arguments))
}

/// Runs a command to its end, with this process's input and output.
fn execute(command: &mut Command) -> Result<(), TaskError> {
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(TaskError::Failed { command: command_line(command), status }),
        Err(source) => Err(TaskError::Start { command: command_line(command), source }),
    }
}

/// A command as one would type it, for messages.
fn command_line(command: &Command) -> String {
    let program = PathBuf::from(command.get_program());
    let mut line = program.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    for argument in command.get_args() {
        line.push(' ');
        line.push_str(&argument.to_string_lossy());
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_are_passed_on() {
        let parse = |line: &str| Cli::try_parse_from(line.split(' ')).map(|cli| cli.task);
        let passed = ["--mesh", "a.glb", "--headless"].map(OsString::from);
        for line in ["xtask demo --mesh a.glb --headless", "xtask demo -- --mesh a.glb --headless"] {
            assert!(matches!(parse(line), Ok(Task::Demo { arguments }) if arguments == passed), "{line}");
        }
        let passed = ["frame", "--", "--nocapture"].map(OsString::from);
        assert!(
            matches!(parse("xtask test frame -- --nocapture"), Ok(Task::Test { arguments }) if arguments == passed)
        );
        assert!(parse("xtask").is_err());
    }

    #[test]
    fn failures_name_the_command() {
        let mut command = Command::new("/nowhere/at/all/tool.exe");
        let error = execute(command.args(["bake", "x.glb"])).unwrap_err();
        assert!(error.to_string().starts_with("tool bake x.glb cannot be started: "), "{error}");
    }
}
