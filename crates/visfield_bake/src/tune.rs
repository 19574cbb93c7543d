//! Finds the cheapest field that is good enough for a mesh: a table, distances, or both, by measuring them on that very mesh.
//!
//! Two limits are given, the error and the bytes, and what a game asks of the field: for what, from where, and how far. What
//! is not asked need not be stored. Ambient occlusion of unlimited reach on other objects asks only *whether* a chord hits,
//! so that bits serve it far better than bytes of the same size; on the mesh's own surface, or with a limited reach, bits
//! fail, unless distances beside them answer what starts inside the bounds. The tuner knows none of this: it measures. How fast
//! rays are is no part of the question: distances alone are several times slower than a table.
//!
//! Exact rays do not depend on the field, so they are traced once; a table or distances then cost their bake and one question per
//! ray. Bits are made from bytes of the same chords, so that both take one bake; their mean fractions may differ by a step of
//! 1/254 from those of a bake of bits. A table and distances together cost nothing more: the rays of a receiver start either all
//! inside the bounds or all outside, so that one of the two has answered them already. Only what is chosen in the end is asked
//! itself. No measurement is made with fewer receivers or rays than are reported.
//!
//! Two assumptions save bakes, both about fields with the same parts, encoding and bounds. The error of tables falls no faster than with
//! the square root of the number of chords, so that a table is not tried if a coarser one was too bad, beside the same distances or
//! without (measured errors fall with about its fourth root). And finer cells are no worse: with a limit of bytes alone, and for the report of a failure,
//! only the finest fields that fit are compared.

mod candidate;
mod probe;
mod search;

use thiserror::Error;
use visfield::VisibilityField;
use visfield::field::measured::Measured;

use crate::bake::{BakeError, BakeSettings};
use crate::mesh::Mesh;
use candidate::{Candidate, candidates};
use probe::probes;
use search::Search;

/// Rays per receiver of ambient occlusion.
pub const AMBIENT_RAYS: u32 = 256;
/// Rays per receiver of shadows.
pub const SHADOW_RAYS: u32 = 64;
/// Half of the angle that the measured light covers in the sky, in radians.
pub const ANGULAR_RADIUS: f32 = 0.05;
/// Largest value of [`TuneQuestion::max_rms`]: everything wrong everywhere.
pub const WORST_RMS: f32 = 255.0;

/// Where the receivers are that a field has to serve.
///
/// ```
/// assert_eq!(visfield_bake::tune::TuneReceivers::default(), visfield_bake::tune::TuneReceivers::All);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TuneReceivers {
    /// Anywhere: the mesh itself, and anything else around it.
    #[default]
    All,
    /// Anything else, inside the mesh's bounds and outside. The mesh itself receives nothing of its own field.
    Others,
    /// Anything that is outside the bounds, of the sphere as well as of the ellipsoid.
    Far,
}

/// What a field has to be good for, and its limits. At least one of the two must be given.
///
/// ```
/// use visfield_bake::tune::{TuneQuestion, TuneReceivers};
/// // Ambient occlusion on the ground and on other objects, in at most 300 kB.
/// let question = TuneQuestion {
///     max_bytes: Some(300_000),
///     receivers: TuneReceivers::Others,
///     ..TuneQuestion::default()
/// };
/// assert!(question.ambient && question.max_rms.is_none());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "each of them is a question of its own, and any of them go together")]
pub struct TuneQuestion {
    /// Largest [`Measured::rms_255`] of anything that is required, 0 to [`WORST_RMS`]. Alone: the smallest field that
    /// reaches it.
    pub max_rms: Option<f32>,
    /// Largest table and distances together in bytes, uncompressed. Alone: the most accurate that fit.
    pub max_bytes: Option<u64>,
    /// Whether it is for ambient occlusion.
    pub ambient: bool,
    /// Whether it is for soft shadows.
    pub shadows: bool,
    /// Where the receivers are.
    pub receivers: TuneReceivers,
    /// Reach of ambient occlusion, above 0 and in the mesh's own units. Hits beyond it do not count; infinity counts all.
    pub max_distance: f32,
    /// Whether tables may be chosen. At least one of this and the next must be true.
    pub tables: bool,
    /// Whether distances may be chosen, alone or beside a table.
    pub distances: bool,
}

impl Default for TuneQuestion {
    fn default() -> Self {
        Self {
            max_rms: None,
            max_bytes: None,
            ambient: true,
            shadows: false,
            receivers: TuneReceivers::All,
            max_distance: f32::INFINITY,
            tables: true,
            distances: true,
        }
    }
}

/// What a [tuner](tune) is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum TuneStep {
    /// A field's turn begins. [`BakeSettings::rays`] rays and points follow at most, none for parts that were baked before: the same
    /// chords for another encoding, or a part for a field of both.
    Field(BakeSettings),
    /// So many of them have been done since the last call.
    Rays(u64),
}

/// The field of choice.
#[derive(Clone, Debug)]
pub struct Tuned {
    /// The field, with what was measured in its header: one entry for everything that was required.
    pub field: VisibilityField,
    /// How it was baked.
    pub settings: BakeSettings,
    /// How many fields were measured to find it.
    pub measured_fields: usize,
}

impl Tuned {
    /// The worst of what was measured.
    fn worst(&self) -> Measured {
        worst(&self.field.header().measured)
    }
}

/// Why nothing was chosen.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum TuneError {
    /// The mesh cannot be baked.
    #[error(transparent)]
    Bake(#[from] BakeError),
    /// Neither limit is given.
    #[error("tuning needs a limit: of the RMS, of the bytes, or both")]
    NoLimit,
    /// Neither ambient occlusion nor shadows are asked for.
    #[error("tuning needs a purpose: ambient occlusion, shadows, or both")]
    NoPurpose,
    /// Neither tables nor distances may be chosen.
    #[error("tuning needs something to choose from: tables, distances, or both")]
    NoParts,
    /// The limit of the error is out of range.
    #[error("an RMS of {max_rms} is outside 0 to {WORST_RMS}")]
    Rms {
        /// The limit asked for.
        max_rms: f32,
    },
    /// The reach of ambient occlusion is zero, negative or not a number.
    #[error("a reach of {max_distance} is not above 0")]
    Distance {
        /// The reach asked for.
        max_distance: f32,
    },
    /// Nothing is this small.
    #[error(
        "{name}: nothing that could be chosen has {max_bytes} bytes or fewer; the smallest has {smallest}, allow as many"
    )]
    TooFewBytes {
        /// Name of the mesh.
        name: String,
        /// The limit.
        max_bytes: u64,
        /// Bytes of the smallest field.
        smallest: u64,
    },
    /// Nothing within the bytes reaches the RMS.
    #[error(
        "{name}: nothing{} reaches an RMS of {max_rms} \u{d7} 1/255; the most accurate is {best}, {:.2} MB, with {:.2} ({}, \
         {}); allow an RMS of {:.2}{}, or require less of it",
        match max_bytes { Some(bytes) => format!(" of at most {bytes} bytes"), None => String::new() },
        *bytes as f64 * 1e-6,
        worst.rms_255,
        worst.purpose,
        worst.scene,
        TuneError::rounded_up(worst.rms_255),
        if max_bytes.is_some() { " or more bytes" } else { "" }
    )]
    Missed {
        /// Name of the mesh.
        name: String,
        /// The limit of the error.
        max_rms: f32,
        /// The limit of the bytes.
        max_bytes: Option<u64>,
        /// The most accurate field that fits.
        best: BakeSettings,
        /// Its bytes.
        bytes: u64,
        /// Where it is worst.
        worst: Measured,
    },
}

impl TuneError {
    /// To two digits, so that the number that is proposed would have been met.
    fn rounded_up(rms: f32) -> f64 {
        (f64::from(rms) * 100.0).ceil() / 100.0
    }
}

/// Bakes and measures tables of bits and of bytes, in a sphere and in an ellipsoid, from 17² × 16² to 129² × 64² cells, distances of
/// bytes, from 24 to 128 points along the longest axis, and each of those tables beside each of these distances; chooses the
/// smallest field that meets both limits, and of equally small ones the most accurate. `watch` is told what is done, from any thread.
///
/// What is measured does not depend on the number of threads, nor on units.
///
/// ```
/// use visfield_bake::{Mesh, tune::{TuneQuestion, tune}};
/// let mesh = Mesh {
///     name: "tetrahedron".to_owned(),
///     positions: vec![[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0]],
///     indices: vec![[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]],
/// };
/// let question = TuneQuestion { max_rms: Some(6.0), shadows: false, ..TuneQuestion::default() };
/// let tuned = tune(&mesh, &question, |_step| ())?;
/// assert!(tuned.field.header().measured.iter().all(|measured| measured.rms_255 <= 6.0));
/// # Ok::<(), visfield_bake::tune::TuneError>(())
/// ```
///
/// # Errors
/// [`TuneError`] if the question makes no sense, the mesh cannot be baked, or nothing meets the limits.
pub fn tune(mesh: &Mesh, question: &TuneQuestion, watch: impl Fn(TuneStep) + Sync) -> Result<Tuned, TuneError> {
    check(question)?;
    let triangles = mesh.solid_triangles().map_err(|source| BakeError::Mesh { name: mesh.name.clone(), source })?;
    let all = candidates(&triangles, question);
    let fits = |candidate: &&Candidate| question.max_bytes.is_none_or(|limit| candidate.bytes <= limit);
    let fitting: Vec<Candidate> = all.iter().filter(fits).copied().collect();
    if fitting.is_empty() {
        let (max_bytes, smallest) = (question.max_bytes.unwrap_or(u64::MAX), all[0].bytes);
        return Err(TuneError::TooFewBytes { name: mesh.name.clone(), max_bytes, smallest });
    }
    let mut search = Search::new(mesh, probes(mesh, question)?, watch);
    let Some(max_rms) = question.max_rms else {
        return search.most_accurate(&fitting);
    };
    for alike in fitting.chunk_by(|a, b| a.bytes == b.bytes) {
        if let Some(tuned) = search.good_enough(alike, max_rms)? {
            return Ok(tuned);
        }
    }
    let best = search.most_accurate(&fitting)?;
    Err(TuneError::Missed {
        name: mesh.name.clone(),
        max_rms,
        max_bytes: question.max_bytes,
        best: best.settings,
        bytes: best.field.bytes(),
        worst: best.worst(),
    })
}

fn check(question: &TuneQuestion) -> Result<(), TuneError> {
    if question.max_rms.is_none() && question.max_bytes.is_none() {
        return Err(TuneError::NoLimit);
    }
    if !question.tables && !question.distances {
        return Err(TuneError::NoParts);
    }
    if !question.ambient && !question.shadows {
        return Err(TuneError::NoPurpose);
    }
    if let Some(max_rms) = question.max_rms.filter(|rms| !(0.0..=WORST_RMS).contains(rms)) {
        return Err(TuneError::Rms { max_rms });
    }
    let max_distance = question.max_distance;
    if max_distance.is_nan() || max_distance <= 0.0 {
        return Err(TuneError::Distance { max_distance });
    }
    Ok(())
}

/// The worst of several measurements.
fn worst(measured: &[Measured]) -> Measured {
    let by_rms = |a: &&Measured, b: &&Measured| a.rms_255.total_cmp(&b.rms_255);
    *measured.iter().max_by(by_rms).expect("a question has a purpose")
}
