//! How one chord's answer is stored: the fraction of the chord at which the first surface is met, or none.
//!
//! The papers divide distances by the sphere's diameter. A fraction of the chord uses all levels on every chord, and it
//! survives every affine map.

use std::ops::Range;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::lookup::{ChordGrid, Grid};

/// The code of a chord that meets no surface, with [`Encoding::U8`]. Codes below it are fractions of the chord, in steps of
/// 1/[`LAST_HIT_CODE`].
pub const NO_HIT_CODE: u8 = 255;
/// The code of a surface at the very end of the chord, with [`Encoding::U8`].
pub const LAST_HIT_CODE: u8 = 254;

/// How one chord's answer is stored.
///
/// ```
/// use visfield::Encoding;
/// // 65² starts with 32² chords each; one bit per chord, and a byte for each start.
/// assert_eq!(Encoding::Bit.table_bytes(65 * 65, 32 * 32), 65 * 65 * (32 * 32 / 8 + 1));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Encoding {
    /// One bit: whether the chord meets anything. Where it does is taken from the mean over the chords of its start, one
    /// more byte for each (2008, §4 *Further Memory Optimization*; there it is a mean along the start's normal). For
    /// receivers away from the mesh and rays without end, which ask for no distance.
    Bit,
    /// One byte: 0…254 is the first hit in steps of 1/254 of the chord, 255 is none.
    #[default]
    U8,
    /// Two bytes, little-endian: 0…65534 is the first hit in steps of 1/65534 of the chord, 65535 is none.
    U16,
    /// Four bytes, little-endian: the first hit as a fraction of the chord, or any number outside [0, 1] for none.
    F32,
}

impl Encoding {
    /// All encodings, from small to large.
    pub const ALL: [Self; 4] = [Self::Bit, Self::U8, Self::U16, Self::F32];

    /// Its name: `bit`, `u8`, `u16` or `f32`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bit => "bit",
            Self::U8 => "u8",
            Self::U16 => "u16",
            Self::F32 => "f32",
        }
    }

    /// Size of a table in bytes, saturating.
    pub fn table_bytes(self, starts: u64, chords_per_start: u64) -> u64 {
        let chords = starts.saturating_mul(chords_per_start);
        match self {
            Self::Bit => chords.div_ceil(8).saturating_add(starts),
            Self::U8 => chords,
            Self::U16 => chords.saturating_mul(2),
            Self::F32 => chords.saturating_mul(4),
        }
    }

    /// Half a step of the fraction: how far a decoded hit is off at most. For [`Bit`](Self::Bit), which knows no fraction of a
    /// single chord, the step of the mean.
    #[inline(always)]
    pub fn half_quantum(self) -> f32 {
        match self {
            Self::Bit | Self::U8 => 0.5 / 254.0,
            Self::U16 => 0.5 / 65534.0,
            Self::F32 => 0.0,
        }
    }
}

/// A table, ready to be read.
///
/// ```
/// # let field = visfield::field::example_field();
/// let codes = field.table().unwrap().codes();
/// let hit = (0..1000).find_map(|index| codes.fraction(index)).unwrap();
/// assert!((0.0..=1.0).contains(&hit));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Codes<'a> {
    encoding: Encoding,
    bytes: &'a [u8],
    /// For bits: the mean fractions behind them.
    means: &'a [u8],
    chords_per_start: u32,
}

impl<'a> Codes<'a> {
    /// `bytes` is a table of [`Encoding::table_bytes`].
    pub(super) fn new(encoding: Encoding, bytes: &'a [u8], starts: u32, chords_per_start: u32) -> Self {
        let means = if encoding == Encoding::Bit { starts as usize } else { 0 };
        let (bytes, means) = bytes.split_at(bytes.len() - means);
        Self { encoding, bytes, means, chords_per_start }
    }

    /// How the table is encoded.
    pub fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// Where a chord first meets the mesh, as a fraction of it in [0, 1], or `None` if it does not.
    ///
    /// # Panics
    /// If there is no such chord.
    #[inline(always)]
    pub fn fraction(&self, index: u32) -> Option<f32> {
        let at = index as usize;
        match self.encoding {
            Encoding::Bit => self.bit(index).then(|| self.mean(index)),
            Encoding::U8 => decode_u8(self.bytes[at]),
            Encoding::U16 => decode_u16(u16::from_le_bytes([self.bytes[2 * at], self.bytes[2 * at + 1]])),
            Encoding::F32 => {
                let code: [u8; 4] = self.bytes[4 * at..4 * at + 4].try_into().expect("four bytes");
                Some(f32::from_le_bytes(code)).filter(|fraction| (0.0..=1.0).contains(fraction))
            }
        }
    }

    /// The bytes of the codes, without the means behind bits.
    pub(super) fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    #[inline(always)]
    pub(super) fn bit(&self, index: u32) -> bool {
        self.bytes[(index >> 3) as usize] >> (index & 7) & 1 == 1
    }

    #[inline(always)]
    fn mean(&self, index: u32) -> f32 {
        let mean = f32::from(self.means[(index / self.chords_per_start) as usize]) * (1.0 / f32::from(LAST_HIT_CODE));
        // A hostile table may hold the code that no bake writes.
        mean.min(1.0)
    }
}

/// A few starts of a table that is being filled, with all their chords. Blocks of a table can be filled in parallel.
///
/// [`ChordTable::sample`](super::ChordTable::sample) shows how.
#[derive(Debug)]
pub struct Block<'a> {
    grid: Grid,
    encoding: Encoding,
    starts: Range<u32>,
    codes: &'a mut [u8],
    means: &'a mut [u8],
}

/// Starts of a block: rows of bits then begin and end with whole bytes, whatever their length.
const STARTS_PER_BLOCK: u32 = 8;

/// Cuts a table of [`Encoding::table_bytes`] into blocks.
pub(super) fn blocks(grid: Grid, encoding: Encoding, table: &mut [u8]) -> impl Iterator<Item = Block<'_>> {
    let starts = grid.starts();
    let means = if encoding == Encoding::Bit { starts as usize } else { 0 };
    let (codes, means) = table.split_at_mut(table.len() - means);
    let block_bytes = encoding.table_bytes(STARTS_PER_BLOCK.into(), grid.chords_per_start().into()) as usize;
    let block_codes = block_bytes - if means.is_empty() { 0 } else { STARTS_PER_BLOCK as usize };
    // Without means, each block gets an empty run of them.
    let means = means.chunks_mut(STARTS_PER_BLOCK as usize).chain(std::iter::repeat_with(|| &mut [][..]));
    codes.chunks_mut(block_codes).zip(means).enumerate().map(move |(block, (codes, means))| {
        let first = block as u32 * STARTS_PER_BLOCK;
        Block { grid, encoding, starts: first..(first + STARTS_PER_BLOCK).min(starts), codes, means }
    })
}

impl Block<'_> {
    /// Number of chords in it.
    pub fn chords(&self) -> u64 {
        self.starts.len() as u64 * u64::from(self.grid.chords_per_start())
    }

    /// Asks `first_hit` for every chord, from one unit vector to another: the fraction of the chord, clamped to [0, 1], at
    /// which it first meets a surface.
    pub fn fill(&mut self, first_hit: impl Fn(Vec3, Vec3) -> Option<f32>) {
        let chords = self.grid.chords_per_start();
        let mut fractions = Vec::with_capacity(self.chords() as usize);
        let grid = self.grid;
        let ends = |start| (0..chords).map(move |chord| grid.end(start, chord)).collect::<Vec<_>>();
        // All starts of a two-point grid have the same ends.
        let shared = matches!(self.grid, Grid::TwoPoint(_)).then(|| ends(Vec3::ZERO));
        for cell in self.starts.clone() {
            let start = self.grid.start(cell);
            let own = if shared.is_none() { ends(start) } else { Vec::new() };
            fractions.extend(shared.as_ref().unwrap_or(&own).iter().map(|end| first_hit(start, (*end)?)));
        }
        self.encode(&fractions);
    }

    /// Takes over what another table says of the same chords.
    pub(super) fn copy(&mut self, codes: &Codes) {
        let chords = self.grid.chords_per_start();
        let indices = self.starts.start * chords..self.starts.end * chords;
        self.encode(&indices.map(|index| codes.fraction(index)).collect::<Vec<_>>());
    }

    fn encode(&mut self, fractions: &[Option<f32>]) {
        match self.encoding {
            Encoding::Bit => {
                for (byte, eight) in self.codes.iter_mut().zip(fractions.chunks(8)) {
                    *byte = (0..).zip(eight).fold(0, |bits, (i, hit)| bits | u8::from(hit.is_some()) << i);
                }
                let rows = fractions.chunks(self.grid.chords_per_start() as usize);
                for (mean, row) in self.means.iter_mut().zip(rows) {
                    let (sum, count) = row.iter().flatten().fold((0.0, 0_u32), |(sum, n), hit| (sum + hit, n + 1));
                    *mean = encode_u8(Some(sum / count.max(1) as f32));
                }
            }
            Encoding::U8 => {
                for (code, hit) in self.codes.iter_mut().zip(fractions) {
                    *code = encode_u8(*hit);
                }
            }
            Encoding::U16 => {
                for (code, hit) in self.codes.chunks_exact_mut(2).zip(fractions) {
                    code.copy_from_slice(&encode_u16(*hit).to_le_bytes());
                }
            }
            Encoding::F32 => {
                for (code, hit) in self.codes.chunks_exact_mut(4).zip(fractions) {
                    code.copy_from_slice(&hit.map_or(-1.0, |s| s.clamp(0.0, 1.0)).to_le_bytes());
                }
            }
        }
    }
}

/// Stores the first hit at `fraction` of the chord, or none, as one byte.
///
/// ```
/// use visfield::field::encoding::{decode_u8, encode_u8};
/// assert_eq!(decode_u8(encode_u8(None)), None);
/// assert!((decode_u8(encode_u8(Some(0.3))).unwrap() - 0.3).abs() <= 0.5 / 254.0);
/// ```
pub fn encode_u8(fraction: Option<f32>) -> u8 {
    match fraction {
        Some(s) => (s.clamp(0.0, 1.0) * f32::from(LAST_HIT_CODE)).round() as u8,
        None => NO_HIT_CODE,
    }
}

/// The inverse of [`encode_u8`], exact to half a quantum of 1/254.
#[inline(always)]
pub fn decode_u8(code: u8) -> Option<f32> {
    (code != NO_HIT_CODE).then(|| f32::from(code) * (1.0 / f32::from(LAST_HIT_CODE)))
}

fn encode_u16(fraction: Option<f32>) -> u16 {
    fraction.map_or(u16::MAX, |s| (s.clamp(0.0, 1.0) * 65534.0).round() as u16)
}

#[inline(always)]
fn decode_u16(code: u16) -> Option<f32> {
    (code != u16::MAX).then(|| f32::from(code) * (1.0 / 65534.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::field::lookup::TwoPointGrid;

    /// Nine starts with nine chords each, so that the second block is not full and rows of bits do not begin with bytes.
    const GRID: Grid = Grid::TwoPoint(TwoPointGrid { entries: 3, exits: 3 });

    /// A made-up answer for every chord, a third of them none.
    fn answer(from: Vec3, to: Vec3) -> Option<f32> {
        let sum = (from.dot(Vec3::new(0.3, 0.7, 1.1)) + to.dot(Vec3::new(1.3, -0.4, 0.2))).abs();
        (sum % 0.3 < 0.2).then_some((sum * 0.4).min(1.0))
    }

    fn filled(encoding: Encoding) -> Vec<u8> {
        let mut table = vec![0; encoding.table_bytes(9, 9) as usize];
        blocks(GRID, encoding, &mut table).for_each(|mut block| block.fill(answer));
        table
    }

    #[test]
    fn fractions_survive_to_half_a_quantum() {
        for encoding in Encoding::ALL {
            let table = filled(encoding);
            let codes = Codes::new(encoding, &table, 9, 9);
            for index in 0..81 {
                let start = GRID.start(index / 9);
                let expected = answer(start, GRID.end(start, index % 9).unwrap());
                let found = codes.fraction(index);
                assert_eq!(found.is_some(), expected.is_some(), "{encoding:?} at {index}");
                if let (Some(found), Some(expected), true) = (found, expected, encoding != Encoding::Bit) {
                    assert!((found - expected).abs() <= encoding.half_quantum() + 1e-6, "{encoding:?}: {found}");
                }
            }
        }
    }

    #[test]
    fn bits_answer_with_the_mean_of_their_start() {
        let table = filled(Encoding::Bit);
        let codes = Codes::new(Encoding::Bit, &table, 9, 9);
        let start = GRID.start(8);
        let hits: Vec<f32> = (0..9).filter_map(|end| answer(start, GRID.end(start, end)?)).collect();
        let mean = hits.iter().sum::<f32>() / hits.len() as f32;
        let hit = (8 * 9..81).find_map(|index| codes.fraction(index)).unwrap();
        assert!((hit - mean).abs() < 0.5 / 254.0 + 1e-6, "{hit}, mean {mean}");
    }
}
