//! The chord table: for every chord of a grid, where it first meets the mesh. What rays are answered from.

use std::fmt;
use std::sync::Arc;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::FieldError;
use super::directions::DirectionMap;
use super::encoding::{Block, Codes, Encoding, blocks};
use super::hemisphere::HemisphereGrid;
use super::lookup::{Aim, ChordGrid, Grid, TwoPointGrid, lookup};

/// Largest side of either octahedral grid of a table. 512⁴ cells would be 64 GiB; real tables stop far below.
pub const MAX_SIDE: u32 = 512;
/// Largest table in bytes. Table positions are `u32` byte offsets on the GPU.
pub const MAX_TABLE_BYTES: u64 = 1 << 30;
/// Least side of a grid of a [coarser](ChordTable::coarser) table: with fewer cells, objects lose their shape.
const COARSEST_SIDE: u32 = 4;

/// Which chords a table stores (DESIGN §2, *representation*).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Representation {
    /// A table over both ends of the chord: `entries`² × `exits`² cells of two octahedral grids, row-major with the
    /// exit cell running fastest. Replaces the papers' position map × direction map: for cosine-distributed rays the
    /// exit point is uniform on the sphere, which is what their concentric map provides, without its trigonometry.
    TwoPoint {
        /// Side of the grid of chord entries, 1…[`MAX_SIDE`].
        entries: u32,
        /// Side of the grid of chord exits, 1…[`MAX_SIDE`].
        exits: u32,
    },
    /// The papers' own: a map of `directions`² cells over the inward hemisphere at each of `positions` points of the sphere.
    /// Kept as the reference that others are compared with; the GPU passes do not read it.
    Hemisphere {
        /// Number of positions, (2n + 1)² + 1 for some n: 290, 1090, 4226 and 16642 in the papers. At most [`MAX_SIDE`]².
        positions: u32,
        /// Side of each map of directions, 1…[`MAX_SIDE`].
        directions: u32,
        /// How directions become points of the map.
        map: DirectionMap,
    },
}

impl fmt::Display for Representation {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::TwoPoint { entries, exits } => write!(f, "{entries}\u{b2} \u{d7} {exits}\u{b2}"),
            Self::Hemisphere { positions, directions, .. } => write!(f, "{positions} \u{d7} {directions}\u{b2}"),
        }
    }
}

impl Representation {
    /// Its name, without its numbers: `two-point` or `hemisphere`.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::TwoPoint { .. } => "two-point",
            Self::Hemisphere { .. } => "hemisphere",
        }
    }

    /// The chords that a table stores.
    ///
    /// # Errors
    /// [`FieldError`] names the first number that is out of range.
    pub fn grid(&self) -> Result<Grid, FieldError> {
        let check = |side: u32| if (1..=MAX_SIDE).contains(&side) { Ok(side) } else { Err(FieldError::Side { side }) };
        match *self {
            Self::TwoPoint { entries, exits } => {
                Ok(Grid::TwoPoint(TwoPointGrid { entries: check(entries)?, exits: check(exits)? }))
            }
            Self::Hemisphere { positions, directions, map } => HemisphereGrid::new(positions, check(directions)?, map)
                .filter(|_| positions <= MAX_SIDE * MAX_SIDE)
                .map(Grid::Hemisphere)
                .ok_or(FieldError::Positions { positions }),
        }
    }
}

/// What a table stores, without the table: which chords, and how their answers are encoded.
///
/// ```
/// use visfield::{Encoding, Representation, TableFormat};
/// let representation = Representation::TwoPoint { entries: 65, exits: 32 };
/// let format = TableFormat { representation, encoding: Encoding::U16 };
/// assert_eq!(format.chords(), 65 * 65 * 32 * 32);
/// assert_eq!(format.bytes(), 2 * format.chords());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct TableFormat {
    /// Which chords are stored.
    pub representation: Representation,
    /// How one chord's answer is stored.
    pub encoding: Encoding,
}

impl fmt::Display for TableFormat {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{} in {}", self.representation, self.encoding.name())
    }
}

impl TableFormat {
    /// Number of chords; 0 if the representation is not valid.
    pub fn chords(&self) -> u64 {
        let chords = |grid: Grid| u64::from(grid.starts()) * u64::from(grid.chords_per_start());
        self.representation.grid().map_or(0, chords)
    }

    /// Size of the uncompressed table in bytes, saturating; 0 if the representation is not valid.
    pub fn bytes(&self) -> u64 {
        self.representation
            .grid()
            .map_or(0, |grid| self.encoding.table_bytes(grid.starts().into(), grid.chords_per_start().into()))
    }

    /// Checks every number against its documented range, and the size of the whole.
    ///
    /// # Errors
    /// [`FieldError`] names the first value that is out of range.
    pub fn validate(&self) -> Result<(), FieldError> {
        self.representation.grid()?;
        let bytes = self.bytes();
        // Positions in the table are u32 in the shader and in lookups.
        if bytes > MAX_TABLE_BYTES || self.chords() > u64::from(u32::MAX) {
            return Err(FieldError::TooLarge { bytes });
        }
        Ok(())
    }
}

/// Where each chord of a grid first meets the mesh: the part of a field that answers rays. Cheap to clone: the bytes are
/// shared.
///
/// ```
/// # let field = visfield::field::example_field();
/// use visfield::field::lookup::ChordGrid;
/// let table = field.table().unwrap();
/// assert_eq!(table.bytes().len() as u64, table.format().bytes());
/// let chords = table.grid().starts() * table.grid().chords_per_start();
/// assert!((0..chords).any(|chord| table.codes().fraction(chord).is_some()));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ChordTable {
    format: TableFormat,
    grid: Grid,
    bytes: Arc<[u8]>,
}

impl ChordTable {
    /// Takes the bytes of a table as what `format` says.
    ///
    /// # Errors
    /// [`FieldError`] if a number is out of range or the table's length is not [`TableFormat::bytes`].
    pub fn new(format: TableFormat, bytes: impl Into<Arc<[u8]>>) -> Result<Self, FieldError> {
        format.validate()?;
        let bytes = bytes.into();
        let (expected, found) = (format.bytes(), bytes.len() as u64);
        if expected != found {
            return Err(FieldError::TableLength { expected, found });
        }
        Ok(Self { format, grid: format.representation.grid()?, bytes })
    }

    /// Makes a table by asking for the first hit of every chord. `fill` is given the blocks of the table, and
    /// [fills](Block::fill) each of them, in any order or in parallel.
    ///
    /// ```
    /// use visfield::{ChordTable, Encoding, Representation, TableFormat};
    /// // The half-space z < 0.
    /// let first_hit = |from: glam::Vec3, to: glam::Vec3| match (from.z < 0.0, to.z < 0.0) {
    ///     (true, _) => Some(0.0),
    ///     (false, true) => Some(from.z / (from.z - to.z)),
    ///     (false, false) => None,
    /// };
    /// let representation = Representation::TwoPoint { entries: 9, exits: 8 };
    /// let format = TableFormat { representation, encoding: Encoding::U8 };
    /// let table = ChordTable::sample(format, |blocks| {
    ///     blocks.into_iter().for_each(|mut block| block.fill(first_hit));
    /// })?;
    /// assert_eq!(table.bytes().len() as u64, format.bytes());
    /// # Ok::<(), visfield::FieldError>(())
    /// ```
    ///
    /// # Errors
    /// [`FieldError`] if a number of the format is out of range; then nothing is asked for.
    pub fn sample(format: TableFormat, fill: impl FnOnce(Vec<Block<'_>>)) -> Result<Self, FieldError> {
        format.validate()?;
        let mut bytes = vec![0; format.bytes() as usize];
        fill(blocks(format.representation.grid()?, format.encoding, &mut bytes).collect());
        Self::new(format, bytes)
    }

    /// The same chords in another encoding. From a coarse encoding this makes no finer one: what was rounded stays rounded.
    ///
    /// ```
    /// # let field = visfield::field::example_field();
    /// use visfield::Encoding;
    /// let table = field.table().unwrap();
    /// let bits = table.with_encoding(Encoding::Bit)?;
    /// assert!(bits.bytes().len() * 7 < table.bytes().len());
    /// assert!((0..1000).all(|chord| bits.codes().fraction(chord).is_some() == table.codes().fraction(chord).is_some()));
    /// # Ok::<(), visfield::FieldError>(())
    /// ```
    ///
    /// # Errors
    /// [`FieldError`] if the table would be too large.
    pub fn with_encoding(&self, encoding: Encoding) -> Result<Self, FieldError> {
        let format = TableFormat { encoding, ..self.format };
        Self::sample(format, |blocks| blocks.into_iter().for_each(|mut block| block.copy(&self.codes())))
    }

    /// A two-point table of half as many cells along each side of both grids, in a sixteenth of the memory. Its chords are
    /// looked up in this one, so the mesh is not needed. `None` for hemispheres, and where fewer than 4 cells would be left along
    /// a side.
    ///
    /// ```
    /// # let field = visfield::field::example_field();
    /// use visfield::Representation::TwoPoint;
    /// let table = field.table().unwrap();
    /// assert_eq!(table.representation(), TwoPoint { entries: 33, exits: 17 });
    /// assert_eq!(table.coarser().unwrap().representation(), TwoPoint { entries: 17, exits: 9 });
    /// ```
    pub fn coarser(&self) -> Option<Self> {
        let (Grid::TwoPoint(fine), Some(format)) = (self.grid, self.coarser_format()) else { return None };
        let codes = self.codes();
        let first_hit = |from: Vec3, to: Vec3| {
            let found = lookup(&fine, from, to, (from + to) * 0.5, Aim::Point);
            let fraction = codes.fraction(found.index)?;
            let length = (to - from).length();
            // The hit lies on the stored chord, which passes through the middle of ours; a chord without length has no middle.
            let along = 0.5 * length + fraction * found.length - found.before;
            Some(if length > 0.0 { along / length } else { fraction })
        };
        Self::sample(format, |blocks| blocks.into_iter().for_each(|mut block| block.fill(first_hit))).ok()
    }

    /// What a [coarser](Self::coarser) table stores, if there is one.
    pub fn coarser_format(&self) -> Option<TableFormat> {
        let Grid::TwoPoint(fine) = self.grid else { return None };
        let [entries, exits] = [fine.entries, fine.exits].map(|side| side.div_ceil(2));
        let representation = Representation::TwoPoint { entries, exits };
        (entries.min(exits) >= COARSEST_SIDE).then_some(TableFormat { representation, ..self.format })
    }

    /// What it stores.
    pub fn format(&self) -> TableFormat {
        self.format
    }

    /// Which chords are stored.
    pub fn representation(&self) -> Representation {
        self.format.representation
    }

    /// How one chord's answer is stored.
    pub fn encoding(&self) -> Encoding {
        self.format.encoding
    }

    /// The table as it is stored: codes, start by start, and for bits the means behind them (see [`Encoding`]).
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The table, decoded chord by chord.
    #[inline(always)]
    pub fn codes(&self) -> Codes<'_> {
        Codes::new(self.format.encoding, &self.bytes, self.grid.starts(), self.grid.chords_per_start())
    }

    /// The chords that the table stores.
    #[inline(always)]
    pub fn grid(&self) -> Grid {
        self.grid
    }
}
