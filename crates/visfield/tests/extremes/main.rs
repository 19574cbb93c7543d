//! Numerical extremes: what the queries, the scenes and the estimators promise for any input, over more than a million
//! generated cases. Every case comes from a fixed seed, so that a failure can be repeated.
//!
//! The numbers below are the promises. README and documentation quote them, so change them with care.

mod answers;
mod batches;
mod caps;
mod double;
mod fields;
mod motion;
mod precision;
mod random;
mod rays;
mod scenes;

/// Rays asked one by one of each field and with each aim.
const SINGLE_RAYS: usize = 4000;

/// Batches asked of each field and with each aim, of 0 to some 200 rays.
const BATCHES: usize = 80;

/// Rays whose table index is compared with the one in double precision, in each class of origins.
const PRECISION_RAYS: usize = 400_000;

/// How near to the border of a cell, in *units of error*, single precision may choose the other cell. A unit is
///
/// `ε · (1 + distance of the origin from the centre, in radii) · (1 + amplification) · side` cells, with ε = 2⁻²³,
///
/// where `side` is the side of the grid. The amplification is 1 / (half the chord, in radii) for an end of the true chord,
/// and 2 / (distance from the snapped start to the aim point) for the far end of an aimed one. See `double.rs`.
const BORDER_UNITS: f64 = 0.25;

/// The bound above is no larger than need be: some ray does choose the other cell at this share of it.
const BORDER_TIGHTNESS: f64 = 0.4;

/// Largest share of rays within [`BORDER_UNITS`] of a border, for origins within 10 radii of the centre.
const NEAR_EXEMPT: f64 = 0.001;

/// The same for origins 10 to 1000 radii away: there the cells of single precision are a good part of the table's.
const FAR_EXEMPT: f64 = 0.02;

/// The same for lines whose half-chord is 0.001 to 0.1 radii, from origins within 10 radii.
const GRAZING_EXEMPT: f64 = 0.03;

/// Scenes of hostile transforms, receivers and settings.
const HOSTILE_SCENES: usize = 20_000;

/// Pairs of a scene and its image under a motion.
const MOTIONS: usize = 100_000;

/// Rays of each estimate of a moved scene.
const MOTION_RAYS: u32 = 256;

/// Largest change of ambient occlusion when scene and receiver are moved together without turning: by up to 10⁷, at a scale
/// from 10⁻⁴ to 10⁴. The rays stay the same, so that only those next to a border of a cell may flip. This is for balls, where
/// few neighbouring cells differ.
const MOVED_MAXIMUM: f32 = 1.5 / 256.0;
/// Mean of the same.
const MOVED_MEAN: f64 = 1.0e-6;

/// The same for fields whose cells have nothing in common with their neighbours.
const MOVED_MAXIMUM_OF_NOISE: f32 = 2.5 / 256.0;
/// Mean of the same.
const MOVED_MEAN_OF_NOISE: f64 = 1.0e-6;

/// Largest change of ambient occlusion when they are turned too: the rays then are others, in the same pattern.
const TURNED_MAXIMUM: f32 = 0.1;
/// Mean of the same.
const TURNED_MEAN: f64 = 0.004;
