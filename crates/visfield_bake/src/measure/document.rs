//! Measurements as JSON files: what `visfield measure … --json` writes and `visfield report` reads.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};
use std::{fs, io};

use serde::{Deserialize, Serialize};
use serde_json::Value;
use thiserror::Error;
use visfield::file::FileError;

use super::ambient::AmbientMeasurement;
use super::distance::DistanceMeasurement;
use super::gpu::GpuMeasurement;
use super::many::Many;
use super::paper2008::Paper2008;
use super::paper2010::Paper2010;
use super::paper2012::Paper2012;
use super::paper2014::Paper2014;
use super::picture::Pictures;
use super::shadow::ShadowMeasurement;
use super::tradeoff::Tradeoff;

/// The version that files are written with, and up to which they are read.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// One measurement of any kind. As JSON it is one object with the fields `kind`, `visfield` (the version that wrote it) and
/// those of the measurement.
///
/// ```
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("measured.json");
/// use visfield_bake::measure::document::{DocumentError, MeasurementDocument};
/// std::fs::write(&path, "{}")?;
/// assert!(matches!(MeasurementDocument::read(&path), Err(DocumentError::NoMeasurement { .. })));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum MeasurementDocument {
    /// Ambient occlusion by one field.
    Ambient {
        /// What was measured, its fields beside `kind`.
        #[serde(flatten)]
        measurement: Box<AmbientMeasurement>,
        /// How it looks, for receivers in a corner.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pictures: Option<Box<Pictures>>,
    },
    /// Soft shadows by one field.
    Shadow {
        /// What was measured, its fields beside `kind`.
        #[serde(flatten)]
        measurement: Box<ShadowMeasurement>,
        /// How it looks, for receivers in a corner.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pictures: Option<Box<Pictures>>,
    },
    /// Distances themselves.
    Distance(Box<DistanceMeasurement>),
    /// The figures of the 2008 paper.
    Paper2008(Box<Paper2008>),
    /// Errors, sizes and speeds of many fields.
    Tradeoff(Box<Tradeoff>),
    /// Ambient occlusion by several objects at once.
    Many(Box<Many>),
    /// Rays through two fields and through triangles on a GPU.
    Gpu(Box<GpuMeasurement>),
    /// The figures of the 2010 paper, on a GPU.
    Paper2010(Box<Paper2010>),
    /// The estimators of the 2012 thesis.
    Paper2012(Box<Paper2012>),
    /// The claims of the 2014 paper on sphere tracing.
    Paper2014(Box<Paper2014>),
}

/// The names of [`MeasurementDocument`]'s variants, as `kind` has them.
const KINDS: [&str; 10] =
    ["ambient", "shadow", "distance", "paper2008", "tradeoff", "many", "gpu", "paper2010", "paper2012", "paper2014"];

#[derive(Serialize)]
struct Versioned<'a> {
    visfield: &'a str,
    #[serde(flatten)]
    document: &'a MeasurementDocument,
}

/// Why a file gives no measurement, or cannot be written. Every message is one line and names the file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DocumentError {
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] FileError),
    /// The file cannot be read.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file is not JSON.
    #[error("{path}: this is not JSON: {source}; name files that `visfield measure \u{2026} --json FILE` wrote")]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// It is JSON, but nothing that `visfield measure` wrote.
    #[error("{path}: this is no measurement; write one with `visfield measure \u{2026} --json FILE`")]
    NoMeasurement {
        /// The file.
        path: PathBuf,
    },
    /// The measurement is of a kind that is not known.
    #[error("{path}: a measurement of the kind {kind:?}; known are {}", KINDS.join(", "))]
    UnknownKind {
        /// The file.
        path: PathBuf,
        /// The kind it has.
        kind: String,
    },
    /// A later version wrote it.
    #[error("{path}: written by visfield {version}, this is {VERSION}; update visfield, or measure again")]
    Newer {
        /// The file.
        path: PathBuf,
        /// The version that wrote it.
        version: String,
    },
    /// A field of the measurement is missing or of another type.
    #[error("{path}: the measurement is damaged or from another version: {source}; measure again")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: serde_json::Error,
    },
}

impl MeasurementDocument {
    /// Writes the document as JSON. The file appears whole, or stays as it was.
    ///
    /// # Errors
    /// [`DocumentError::Write`] names the file.
    pub fn write(&self, path: &Path) -> Result<(), DocumentError> {
        Ok(visfield::file::write_bytes(path, &self.to_json())?)
    }

    fn to_json(&self) -> Vec<u8> {
        let document = Versioned { visfield: VERSION, document: self };
        serde_json::to_vec_pretty(&document).expect("numbers, texts and lists of them become JSON")
    }

    /// Reads a document.
    ///
    /// # Errors
    /// [`DocumentError`] names the file, and what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, DocumentError> {
        let own = || path.to_owned();
        let bytes = fs::read(path).map_err(|source| DocumentError::Io { path: own(), source })?;
        let mut value: Value =
            serde_json::from_slice(&bytes).map_err(|source| DocumentError::Json { path: own(), source })?;
        let text = |field: &str| value.get(field).and_then(Value::as_str).map(str::to_owned);
        let (Some(kind), Some(version)) = (text("kind"), text("visfield")) else {
            return Err(DocumentError::NoMeasurement { path: own() });
        };
        // First, because a later version may know more kinds.
        if compare_versions(&version, VERSION).is_none_or(Ordering::is_gt) {
            return Err(DocumentError::Newer { path: own(), version });
        }
        if !KINDS.contains(&kind.as_str()) {
            return Err(DocumentError::UnknownKind { path: own(), kind });
        }
        if let Some(fields) = value.as_object_mut() {
            fields.remove("visfield");
        }
        serde_json::from_value(value).map_err(|source| DocumentError::Damaged { path: own(), source })
    }
}

/// Compares versions of three numbers; `None` if one is not such a version.
fn compare_versions(a: &str, b: &str) -> Option<Ordering> {
    let numbers = |version: &str| -> Option<[u64; 3]> {
        let parts: Vec<u64> = version.split('.').map(str::parse).collect::<Result<_, _>>().ok()?;
        parts.try_into().ok()
    };
    Some(numbers(a)?.cmp(&numbers(b)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_ordered_by_their_numbers() {
        assert_eq!(compare_versions("0.10.0", "0.9.1"), Some(Ordering::Greater));
        assert_eq!(compare_versions(VERSION, VERSION), Some(Ordering::Equal));
        assert_eq!(compare_versions("1.0", VERSION), None);
    }
}
