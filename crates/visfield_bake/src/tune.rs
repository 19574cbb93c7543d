//! Finds the cheapest table that is good enough for a mesh, by measuring tables on that very mesh.
//!
//! Two limits are given, the error and the bytes, and what a game asks of the field: for what, from where, and how far. What
//! is not asked need not be stored. Ambient occlusion of unlimited reach on other objects asks only *whether* a chord hits,
//! so that bits serve it far better than bytes of the same size; on the mesh's own surface, or with a limited reach, bits
//! fail. The tuner knows none of this: it measures.
//!
//! Exact rays do not depend on the table, so they are traced once; a table then costs its bake and one look-up per ray. Bits
//! are made from bytes of the same chords, so that both take one bake; their mean fractions may differ by a step of 1/254
//! from those of a bake of bits. No measurement is made with fewer receivers or rays than are reported. Two assumptions save
//! bakes, both about tables of the same encoding and bounds. The error falls no faster than with the square root of the
//! number of chords, so that a table is not tried if a coarser one was too bad (measured errors fall with about its fourth
//! root). And finer cells are no worse: with a limit of bytes alone, and for the report of a failure, only the finest tables
//! that fit are compared.

mod probe;

use thiserror::Error;
use visfield::field::measured::Measured;
use visfield::{Encoding, Representation, TableFormat, VisibilityField};

use crate::bake::{BakeError, BakeSettings, bake, table_of};
use crate::bounds::BoundsKind;
use crate::mesh::Mesh;
use probe::{Probe, probes};

/// Rays per receiver of ambient occlusion.
pub const AMBIENT_RAYS: u32 = 256;
/// Rays per receiver of shadows.
pub const SHADOW_RAYS: u32 = 64;
/// Half of the angle that the measured light covers in the sky, in radians.
pub const ANGULAR_RADIUS: f32 = 0.05;
/// Largest value of [`TuneQuestion::max_rms`]: everything wrong everywhere.
pub const WORST_RMS: f32 = 255.0;

/// Sides of the grids of entries and exits that are tried, at ratios of 1:1 and 2:1. Odd sides of the entries put cell
/// centres on the axes. The largest is 68 MB in bytes, half of the buffer that WebGPU guarantees for all tables together.
const SIDES: [(u32, u32); 11] =
    [(17, 16), (33, 16), (25, 24), (49, 24), (33, 32), (41, 40), (65, 32), (49, 48), (65, 64), (97, 48), (129, 64)];
/// What the sides are combined with.
const FAMILIES: [(Encoding, BoundsKind); 4] = [
    (Encoding::Bit, BoundsKind::Sphere),
    (Encoding::Bit, BoundsKind::Ellipsoid),
    (Encoding::U8, BoundsKind::Sphere),
    (Encoding::U8, BoundsKind::Ellipsoid),
];

/// Chords of the largest table that is baked only to see what its encoding and bounds are worth.
const SAMPLE_CHORDS: u64 = 1_200_000;

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

/// What a table has to be good for, and its limits. At least one of the two must be given.
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
pub struct TuneQuestion {
    /// Largest [`Measured::rms_255`] of anything that is required, 0 to [`WORST_RMS`]. Alone: the smallest table that
    /// reaches it.
    pub max_rms: Option<f32>,
    /// Largest table in bytes, uncompressed. Alone: the most accurate table that fits.
    pub max_bytes: Option<u64>,
    /// Whether it is for ambient occlusion.
    pub ambient: bool,
    /// Whether it is for soft shadows.
    pub shadows: bool,
    /// Where the receivers are.
    pub receivers: TuneReceivers,
    /// Reach of ambient occlusion, above 0 and in the mesh's own units. Hits beyond it do not count; infinity counts all.
    pub max_distance: f32,
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
        }
    }
}

/// What a [tuner](tune) is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum TuneStep {
    /// A table's turn begins. [`BakeSettings::rays`] rays follow, or none if the same chords were traced before for another
    /// encoding.
    Table(BakeSettings),
    /// So many rays of it have been traced since the last call.
    Rays(u64),
}

/// The table of choice.
#[derive(Clone, Debug)]
pub struct Tuned {
    /// The field, with what was measured in its header: one entry for everything that was required.
    pub field: VisibilityField,
    /// How it was baked.
    pub settings: BakeSettings,
    /// How many tables were baked and measured to find it.
    pub measured_tables: usize,
}

impl Tuned {
    /// The worst of what was measured.
    fn worst(&self) -> Measured {
        worst(&self.field.header().measured)
    }
}

/// Why no table was chosen.
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
    /// No table is this small.
    #[error("{name}: no table has {max_bytes} bytes or fewer; the smallest has {smallest}, allow as many")]
    TooFewBytes {
        /// Name of the mesh.
        name: String,
        /// The limit.
        max_bytes: u64,
        /// Bytes of the smallest table.
        smallest: u64,
    },
    /// No table within the bytes reaches the RMS.
    #[error(
        "{name}: no table{} reaches an RMS of {max_rms} \u{d7} 1/255; the most accurate is {best}, {:.2} MB, with {:.2} ({}, \
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
        /// The most accurate table that fits.
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

/// Bakes and measures tables of bits and of bytes, in a sphere and in an ellipsoid, from 17² × 16² to 129² × 64² cells, and
/// chooses the smallest that meets both limits; of equally small ones the more accurate. `watch` is told what is done, from
/// any thread.
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
/// [`TuneError`] if the question makes no sense, the mesh cannot be baked, or no table meets the limits.
pub fn tune(mesh: &Mesh, question: &TuneQuestion, watch: impl Fn(TuneStep) + Sync) -> Result<Tuned, TuneError> {
    check(question)?;
    let tables = tables();
    let fitting: Vec<Table> =
        tables.iter().copied().filter(|table| question.max_bytes.is_none_or(|limit| table.bytes <= limit)).collect();
    if fitting.is_empty() {
        let (max_bytes, smallest) = (question.max_bytes.unwrap_or(u64::MAX), tables[0].bytes);
        return Err(TuneError::TooFewBytes { name: mesh.name.clone(), max_bytes, smallest });
    }
    let probes = probes(mesh, question)?;
    let mut search = Search { mesh, probes, trials: Vec::new(), traced: Vec::new(), best: None, watch };
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

/// A table that can be tried.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Table {
    entries: u32,
    exits: u32,
    family: (Encoding, BoundsKind),
    bytes: u64,
}

/// All tables, from small to large.
fn tables() -> Vec<Table> {
    let of_size = |(entries, exits): (u32, u32)| {
        FAMILIES.map(|family| {
            let bytes = family.0.table_bytes(u64::from(entries).pow(2), u64::from(exits).pow(2));
            Table { entries, exits, family, bytes }
        })
    };
    let mut tables: Vec<Table> = SIDES.into_iter().flat_map(of_size).collect();
    tables.sort_by_key(|table| table.bytes);
    tables
}

impl Table {
    fn settings(&self) -> BakeSettings {
        self.settings_in(self.family.0)
    }

    /// The settings of the same chords and bounds in another encoding.
    fn settings_in(&self, encoding: Encoding) -> BakeSettings {
        let representation = Representation::TwoPoint { entries: self.entries, exits: self.exits };
        BakeSettings::of_table(TableFormat { representation, encoding }, self.family.1)
    }

    /// Whether this has the other's encoding and bounds, and cells nowhere coarser.
    fn refines(&self, other: &Self) -> bool {
        self.family == other.family && self.entries >= other.entries && self.exits >= other.exits
    }

    /// Whether both store the same chords.
    fn has_chords_of(&self, other: &Self) -> bool {
        (self.entries, self.exits, self.family.1) == (other.entries, other.exits, other.family.1)
    }

    /// The least error that can be hoped for, judged by that of a table that this [refines](Self::refines).
    fn least_hope(&self, coarser: &Trial) -> f32 {
        let chords = |table: &Self| table.settings().rays() as f32;
        coarser.rms * (chords(&coarser.table) / chords(self)).sqrt()
    }
}

/// A table that was tried.
struct Trial {
    table: Table,
    rms: f32,
}

struct Search<'a, W> {
    mesh: &'a Mesh,
    probes: Vec<Probe>,
    trials: Vec<Trial>,
    /// Tables of bytes of which the bits may be asked for too, or the other way round: tracing them is what takes the time.
    traced: Vec<(Table, VisibilityField)>,
    /// The most accurate field so far, and its RMS.
    best: Option<(Tuned, f32)>,
    watch: W,
}

impl<W: Fn(TuneStep) + Sync> Search<'_, W> {
    /// The most accurate of some tables if it meets the limit.
    fn good_enough(&mut self, tables: &[Table], max_rms: f32) -> Result<Option<Tuned>, TuneError> {
        let mut chosen: Option<(Tuned, f32)> = None;
        for table in tables {
            if self.is_hopeless(table, max_rms) {
                continue;
            }
            let (tuned, rms) = self.measure(table)?;
            if rms <= max_rms && chosen.as_ref().is_none_or(|(_, least)| rms < *least) {
                chosen = Some((tuned, rms));
            } else {
                self.keep(tuned, rms);
            }
        }
        Ok(chosen.map(|(tuned, _)| self.count_into(tuned)))
    }

    /// The most accurate of all tables, as far as it can be told without trying all.
    fn most_accurate(&mut self, tables: &[Table]) -> Result<Tuned, TuneError> {
        // First something cheap of every family, so that families without prospects show.
        for family in FAMILIES {
            let cheap = |table: &&Table| table.family == family && table.settings().rays() <= SAMPLE_CHORDS;
            if let Some(table) = tables.iter().rfind(cheap) {
                self.try_if_new(table)?;
            }
        }
        let is_finest = |table: &&Table| !tables.iter().any(|other| other != *table && other.refines(table));
        let mut finest: Vec<Table> = tables.iter().filter(is_finest).copied().collect();
        let prospects = |table: &Table| {
            let own = self.trials.iter().filter(|trial| trial.table.family == table.family);
            own.map(|trial| trial.rms).fold(f32::INFINITY, f32::min)
        };
        finest.sort_by(|a, b| prospects(a).total_cmp(&prospects(b)));
        for table in &finest {
            let least = self.best.as_ref().map_or(f32::INFINITY, |(_, rms)| *rms);
            if !self.is_hopeless(table, least) {
                self.try_if_new(table)?;
            }
        }
        let (tuned, _) = self.best.take().expect("a table fits, and the first one is never hopeless");
        Ok(self.count_into(tuned))
    }

    /// Whether a coarser table of its kind was so bad that this one must miss the limit too.
    fn is_hopeless(&self, table: &Table, max_rms: f32) -> bool {
        self.trials.iter().any(|trial| table.refines(&trial.table) && table.least_hope(trial) > max_rms)
    }

    fn try_if_new(&mut self, table: &Table) -> Result<(), TuneError> {
        if !self.trials.iter().any(|trial| trial.table == *table) {
            let (tuned, rms) = self.measure(table)?;
            self.keep(tuned, rms);
        }
        Ok(())
    }

    /// Remembers the field if it is the best so far.
    fn keep(&mut self, tuned: Tuned, rms: f32) {
        if self.best.as_ref().is_none_or(|(_, least)| rms < *least) {
            self.best = Some((tuned, rms));
        }
    }

    /// Bakes a table and measures it.
    fn measure(&mut self, table: &Table) -> Result<(Tuned, f32), TuneError> {
        let settings = table.settings();
        (self.watch)(TuneStep::Table(settings));
        let field = self.trace(table)?;
        let measured: Vec<Measured> = self.probes.iter().map(|probe| probe.measure(&field)).collect();
        let rms = worst(&measured).rms_255;
        self.trials.push(Trial { table: *table, rms });
        Ok((
            Tuned { field: field.with_measured(measured).map_err(BakeError::from)?, settings, measured_tables: 0 },
            rms,
        ))
    }

    /// The field of a table. Bits and bytes of the same chords share their rays, so that this keeps what it traces until it
    /// is asked for the second time.
    fn trace(&mut self, table: &Table) -> Result<VisibilityField, TuneError> {
        let sibling = self.traced.iter().position(|(traced, _)| traced.has_chords_of(table));
        let bytes = if let Some(index) = sibling {
            self.traced.swap_remove(index).1
        } else {
            let bytes = bake(self.mesh, &table.settings_in(Encoding::U8), |rays| (self.watch)(TuneStep::Rays(rays)))?;
            self.traced.push((*table, bytes.clone()));
            bytes
        };
        Ok(match table.family.0 {
            Encoding::U8 => bytes,
            other => {
                let table = table_of(&bytes)?.with_encoding(other).map_err(BakeError::Settings)?;
                bytes.with_table(table)
            }
        })
    }

    fn count_into(&self, tuned: Tuned) -> Tuned {
        Tuned { measured_tables: self.trials.len(), ..tuned }
    }
}
