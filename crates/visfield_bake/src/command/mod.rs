//! The subcommands.

mod bake;
mod inspect;
mod measure;
mod report;
mod settings;
mod tune;

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::{Parser, Subcommand};
use thiserror::Error;
use visfield::file::FileError;
use visfield_bake::measure::document::DocumentError;
use visfield_bake::measure::gpu::GpuError;
use visfield_bake::tune::TuneError;
use visfield_bake::{BakeError, ReadError};

/// Bake meshes into visibility fields: ambient occlusion and soft shadows of moving rigid objects by look-ups.
#[derive(Debug, Parser)]
#[command(name = "visfield", version, arg_required_else_help = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Bake(bake::Arguments),
    Inspect(inspect::Arguments),
    Measure(measure::Arguments),
    Report(report::Arguments),
}

impl Cli {
    /// Does what the command line asks for.
    pub(crate) fn run(&self) -> Result<(), CommandError> {
        let report = match &self.command {
            Command::Bake(arguments) => arguments.run()?,
            Command::Inspect(arguments) => arguments.run()?,
            Command::Measure(arguments) => arguments.run()?,
            Command::Report(arguments) => arguments.run()?,
        };
        match io::stdout().lock().write_all(report.as_bytes()) {
            // A reader such as `head` has seen enough.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
            other => other.map_err(CommandError::Report),
        }
    }
}

/// Why a command failed. Every message is one line and names the file.
#[derive(Debug, Error)]
pub(crate) enum CommandError {
    #[error(transparent)]
    Read(#[from] ReadError),
    #[error("{path}: {source}")]
    Bake { path: PathBuf, source: BakeError },
    #[error("{path}: {source}")]
    Gpu { path: PathBuf, source: Box<GpuError> },
    #[error("{path}: {source}; nothing is written")]
    Tune { path: PathBuf, source: Box<TuneError> },
    #[error("{path}: choose one of its meshes with --primitive NAME: {names}")]
    WhichMesh { path: PathBuf, names: String },
    #[error("{path}: none of its {meshes} meshes can be baked, see the warnings")]
    NothingBaked { path: PathBuf, meshes: usize },
    #[error("{path}: this file is read, and would be overwritten; choose another output")]
    OutputIsInput { path: PathBuf },
    #[error(
        "{meshes} meshes are more than the {instances} objects of --instances, and some would be left out; raise it, up to \
         64, or name fewer files"
    )]
    TooManyMeshes { meshes: usize, instances: usize },
    #[error(
        "rays and cap grids are measured one at a time: leave cap-grid out of --representation, or name nothing else"
    )]
    TwoWays,
    #[error("{path}: the folder does not exist; create it, or choose another output")]
    NoOutputFolder { path: PathBuf },
    #[error("{0}; choose another output with -o")]
    Write(FileError),
    #[error(transparent)]
    Inspect(FileError),
    #[error(transparent)]
    Document(#[from] DocumentError),
    #[error("the report cannot be written: {0}")]
    Report(io::Error),
}

impl CommandError {
    /// 2 for errors of usage, as clap has it, 1 for others.
    pub(crate) fn exit_code(&self) -> u8 {
        if matches!(self, Self::TooManyMeshes { .. } | Self::TwoWays) { 2 } else { 1 }
    }
}

/// Finds out before the work whether its result could be stored at all, and would not take the place of an input.
fn check_output(inputs: &[PathBuf], output: &Path) -> Result<(), CommandError> {
    let whole = |path: &Path| fs::canonicalize(path).ok();
    if whole(output).is_some_and(|output| inputs.iter().any(|input| whole(input).as_ref() == Some(&output))) {
        return Err(CommandError::OutputIsInput { path: output.to_owned() });
    }
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty());
    // Without an input the folder beside it may be missing too; the input is then what to complain about.
    if inputs.iter().all(|input| input.exists()) && folder.is_some_and(|folder| !folder.is_dir()) {
        return Err(CommandError::NoOutputFolder { path: output.to_owned() });
    }
    Ok(())
}
