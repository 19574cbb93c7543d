//! Many rays against one table at once: the same lookups as in [`query`](super::query), several lanes wide.
//!
//! Rays are taken in blocks of [`LANES`]. The lookups of a block are computed in loops over its lanes, by the very functions
//! that single rays use; compiled for the widest instructions that the processor has (crate `pulp` finds them out at run
//! time), such a loop becomes a few vector instructions. Nothing is contracted or reordered, so that a batch gives the same
//! answers as its rays one by one, bit for bit. Rays that need more than one lookup are few, and are asked one by one.

#![expect(
    clippy::needless_range_loop,
    clippy::needless_bitwise_bool,
    reason = "lane by lane through several arrays, and without branches: that is what becomes vector instructions"
)]

use glam::Vec3;
use pulp::{Arch, NullaryFnOnce};

use super::chord::line_chord;
use super::encoding::{Codes, Encoding, NO_HIT_CODE, decode_u8};
use super::lookup::{Aim, ChordGrid, Grid, Lookup, lookup};
use super::query::{QueryOptions, Ray, Resolution, finite, is_ordinary, not_behind, rises_above};
use super::table::ChordTable;

/// Rays of a block: a few vectors of the widest kind, so that their reads from the table overlap.
pub const LANES: usize = 64;

type Lanes<T> = [T; LANES];

impl ChordTable {
    /// [`VisibilityField::hit_batch`](super::VisibilityField::hit_batch), for as many `hits` as `rays`.
    pub(super) fn hit_batch(&self, rays: &[Ray], options: &QueryOptions, hits: &mut [f32]) {
        self.batch::<_, true>(rays, options, hits, |t, _| t, |ray| self.hit(ray, options).unwrap_or(f32::INFINITY));
    }

    /// [`VisibilityField::distance_batch`](super::VisibilityField::distance_batch), for as many `distances` as `rays`.
    pub(super) fn distance_batch(&self, rays: &[Ray], options: &QueryOptions, distances: &mut [f32]) {
        let distance = |t: f32, ray: &Ray| if t < f32::INFINITY { finite(t * ray.direction.length()) } else { t };
        self.batch::<_, true>(rays, options, distances, distance, |ray| self.distance(ray, options));
    }

    /// [`VisibilityField::occluded_batch`](super::VisibilityField::occluded_batch), for as many `occluded` as `rays`.
    pub(super) fn occluded_batch(&self, rays: &[Ray], options: &QueryOptions, occluded: &mut [bool]) {
        self.batch::<_, false>(rays, options, occluded, |t, _| t < f32::INFINITY, |ray| self.occluded(ray, options));
    }

    /// Asks block by block. `answer` makes an answer of t, the parameter of a hit or infinity: of the first known hit if
    /// `NEAREST`, else of any. `single` answers a ray by itself.
    fn batch<A, const NEAREST: bool>(
        &self,
        rays: &[Ray],
        options: &QueryOptions,
        answers: &mut [A],
        answer: impl Fn(f32, &Ray) -> A,
        single: impl Fn(&Ray) -> A,
    ) {
        match self.grid() {
            Grid::TwoPoint(grid) => {
                let batch = Batch::<_, _, _, _, NEAREST> { table: self, grid, rays, options, answers, answer, single };
                match options.aim {
                    Aim::Point => Arch::new().dispatch(Snapped::<_, true>(batch)),
                    Aim::Plain => Arch::new().dispatch(Snapped::<_, false>(batch)),
                }
            }
            // The papers' grid needs trigonometry, which vectors do not have.
            Grid::Hemisphere(_) => {
                for (out, ray) in answers.iter_mut().zip(rays) {
                    *out = single(ray);
                }
            }
        }
    }
}

/// A batch's work.
struct Batch<'a, G, A, F, S, const NEAREST: bool> {
    table: &'a ChordTable,
    grid: G,
    rays: &'a [Ray],
    options: &'a QueryOptions,
    answers: &'a mut [A],
    answer: F,
    single: S,
}

/// A batch whose rays are snapped in one way, to be compiled for each kind of processor.
struct Snapped<B, const AIMED: bool>(B);

impl<G: ChordGrid, A, F: Fn(f32, &Ray) -> A, S: Fn(&Ray) -> A, const AIMED: bool, const NEAREST: bool> NullaryFnOnce
    for Snapped<Batch<'_, G, A, F, S, NEAREST>, AIMED>
{
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Batch { table, grid, rays, options, answers, answer, single } = self.0;
        let (codes, resolution) = (table.codes(), table.resolution());
        for (rays, answers) in rays.chunks(LANES).zip(answers.chunks_mut(LANES)) {
            // Of a length that the compiler knows, wherever possible.
            let block = match rays.as_array() {
                Some(rays) => Block::new(rays),
                None => Block::partial(rays),
            };
            let chords = Chords::of(&block);
            let (hits, again) = if !NEAREST && chords.any_hit_will_do(&block) {
                (any_hits::<G, AIMED>(&grid, &codes, &block, &chords), [false; LANES])
            } else {
                hits::<G, AIMED, NEAREST>(&grid, &codes, resolution, options, &block, &chords)
            };
            if let (Some(rays), Some(answers)) = (rays.as_array::<LANES>(), answers.as_mut_array::<LANES>()) {
                for lane in 0..LANES {
                    answers[lane] = answer(hits[lane], &rays[lane]);
                }
            } else {
                for ((out, t), ray) in answers.iter_mut().zip(hits).zip(rays) {
                    *out = answer(t, ray);
                }
            }
            if any(&again) | any(&chords.extraordinary) {
                for (lane, (out, ray)) in answers.iter_mut().zip(rays).enumerate() {
                    if again[lane] | chords.extraordinary[lane] {
                        *out = single(ray);
                    }
                }
            }
        }
    }
}

type Vectors = super::lanes::Vectors<LANES>;

/// Rays by components. Lanes without a ray have a zero direction, which hits nothing.
struct Block {
    origin: Vectors,
    direction: Vectors,
    t_max: Lanes<f32>,
}

impl Block {
    #[inline(always)]
    fn new(rays: &[Ray; LANES]) -> Self {
        let mut block = Self { origin: Vectors::ZERO, direction: Vectors::ZERO, t_max: [0.0; LANES] };
        for lane in 0..LANES {
            block.origin.set(lane, rays[lane].origin);
            block.direction.set(lane, rays[lane].direction);
            block.t_max[lane] = rays[lane].t_max;
        }
        block
    }

    #[inline(always)]
    fn partial(rays: &[Ray]) -> Self {
        let mut padded = [Ray::new(Vec3::ZERO, Vec3::ZERO); LANES];
        padded[..rays.len()].copy_from_slice(rays);
        Self::new(&padded)
    }
}

#[inline(always)]
fn any(lanes: &Lanes<bool>) -> bool {
    lanes.iter().fold(false, |any, lane| any | lane)
}

/// What the rays of a block have in common with the sphere.
struct Chords {
    middle: Vectors,
    t_middle: Lanes<f32>,
    t_half: Lanes<f32>,
    /// Whether the ray meets the sphere before its end.
    meets: Lanes<bool>,
    /// Whether it starts inside.
    inside: Lanes<bool>,
    /// Whether its direction is too short or too long to be squared: such rays are asked by themselves.
    extraordinary: Lanes<bool>,
}

impl Chords {
    #[inline(always)]
    fn of(block: &Block) -> Self {
        let mut chords = Self {
            middle: Vectors::ZERO,
            t_middle: [0.0; LANES],
            t_half: [0.0; LANES],
            meets: [false; LANES],
            inside: [false; LANES],
            extraordinary: [false; LANES],
        };
        for lane in 0..LANES {
            let direction = block.direction.get(lane);
            let c = line_chord(block.origin.get(lane), direction);
            chords.middle.set(lane, c.middle);
            chords.t_middle[lane] = c.t_middle;
            chords.t_half[lane] = c.t_half;
            chords.meets[lane] = (c.t_half > 0.0) & (c.t_exit() > 0.0) & (c.t_entry() < block.t_max[lane]);
            chords.inside[lane] = c.t_entry() < 0.0;
            chords.extraordinary[lane] = !is_ordinary(direction);
        }
        chords
    }

    /// Whether all rays start outside and have no end, so that any hit will do.
    #[inline(always)]
    fn any_hit_will_do(&self, block: &Block) -> bool {
        let mut otherwise = false;
        for lane in 0..LANES {
            otherwise |= self.meets[lane] & (self.inside[lane] | (block.t_max[lane] < f32::INFINITY));
        }
        !otherwise
    }

    /// The lookup of a lane: forwards from outside, backwards from inside; at a valid position whatever the ray.
    #[inline(always)]
    fn lookup<G: ChordGrid, const AIMED: bool>(&self, grid: &G, block: &Block, lane: usize, inside: bool) -> Lookup {
        let middle = self.middle.get(lane);
        let half = block.direction.get(lane) * self.t_half[lane];
        let half = if inside { -half } else { half };
        let (start, end) = (middle - half, middle + half);
        let aim = if inside { block.origin.get(lane) } else { middle };
        let found = lookup(grid, start, end, aim, if AIMED { Aim::Point } else { Aim::Plain });
        // Rays that miss must not fetch memory either.
        Lookup { index: if self.meets[lane] { found.index } else { 0 }, ..found }
    }
}

/// 0 for the rays that hit anything, infinity for the others, where [any hit will do](Chords::any_hit_will_do).
#[inline(always)]
fn any_hits<G: ChordGrid, const AIMED: bool>(grid: &G, codes: &Codes, block: &Block, chords: &Chords) -> Lanes<f32> {
    let mut indices = [0; LANES];
    for lane in 0..LANES {
        indices[lane] = chords.lookup::<G, AIMED>(grid, block, lane, false).index;
    }
    let met = read_any(codes, &indices);
    let mut hits = [f32::INFINITY; LANES];
    for lane in 0..LANES {
        hits[lane] = if chords.meets[lane] & met[lane] { 0.0 } else { f32::INFINITY };
    }
    hits
}

/// The ray parameters of hits before the ends of the rays, or infinity; and which rays need a second lookup.
#[inline(always)]
fn hits<G: ChordGrid, const AIMED: bool, const NEAREST: bool>(
    grid: &G,
    codes: &Codes,
    resolution: Resolution,
    options: &QueryOptions,
    block: &Block,
    chords: &Chords,
) -> (Lanes<f32>, Lanes<bool>) {
    let mut indices = [0; LANES];
    let (mut before, mut length) = ([0.0; LANES], [0.0; LANES]);
    let (mut starts, mut ends) = (Vectors::ZERO, Vectors::ZERO);
    for lane in 0..LANES {
        let lookup = chords.lookup::<G, AIMED>(grid, block, lane, chords.inside[lane]);
        (indices[lane], before[lane], length[lane]) = (lookup.index, lookup.before, lookup.length);
        starts.set(lane, lookup.start);
        ends.set(lane, lookup.end);
    }
    let fractions = read_fractions(codes, &indices);
    let (mut hits, mut again) = ([f32::INFINITY; LANES], [false; LANES]);
    for lane in 0..LANES {
        let (fraction, t_max) = (fractions[lane], block.t_max[lane]);
        let unit = block.direction.get(lane).length();
        let (before, length) = (before[lane], length[lane]);
        let lookup = Lookup { index: 0, before, length, start: starts.get(lane), end: ends.get(lane) };
        let t_first = chords.t_middle[lane] + (fraction * length - before) / unit;
        // From inside; a fraction of infinity gives −infinity, behind any bias.
        let t_last = (before - fraction * length) / unit;
        let rises = rises_above(resolution, &lookup, fraction, block.origin.get(lane), options)
            & (t_last > not_behind(options.bias.along(resolution, before, length) / unit));
        let inside = chords.inside[lane];
        let within = (if inside { t_last } else { t_first }) < t_max;
        let known = chords.meets[lane] & if inside { rises } else { within };
        again[lane] = known & inside & (NEAREST | !within);
        hits[lane] = if known { if inside { t_last } else { not_behind(t_first) } } else { f32::INFINITY };
    }
    (hits, again)
}

/// Whether the chords meet anything.
#[inline(always)]
fn read_any(codes: &Codes, indices: &Lanes<u32>) -> Lanes<bool> {
    let mut met = [false; LANES];
    match codes.encoding() {
        Encoding::U8 => {
            let bytes = codes.bytes();
            for lane in 0..LANES {
                met[lane] = bytes[indices[lane] as usize] != NO_HIT_CODE;
            }
        }
        Encoding::Bit => {
            for lane in 0..LANES {
                met[lane] = codes.bit(indices[lane]);
            }
        }
        Encoding::U16 | Encoding::F32 => {
            for lane in 0..LANES {
                met[lane] = codes.fraction(indices[lane]).is_some();
            }
        }
    }
    met
}

/// Where the chords first meet anything, or infinity.
#[inline(always)]
fn read_fractions(codes: &Codes, indices: &Lanes<u32>) -> Lanes<f32> {
    let mut fractions = [f32::INFINITY; LANES];
    if codes.encoding() == Encoding::U8 {
        let bytes = codes.bytes();
        let mut raw = [NO_HIT_CODE; LANES];
        for lane in 0..LANES {
            raw[lane] = bytes[indices[lane] as usize];
        }
        for lane in 0..LANES {
            fractions[lane] = decode_u8(raw[lane]).unwrap_or(f32::INFINITY);
        }
    } else {
        for lane in 0..LANES {
            fractions[lane] = codes.fraction(indices[lane]).unwrap_or(f32::INFINITY);
        }
    }
    fractions
}
