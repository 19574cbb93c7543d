//! Sample patterns: points of the sphere and of the disc, and how pixels share them.
//!
//! The frame's trace pass reads these patterns from a buffer, so that the GPU needs no trigonometry per ray.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3, vec2, vec3};

/// Pixels share a sample pattern in squares of 2^bits pixels a side: each takes its own residue of the samples, and the
/// denoiser averages the square, and so sees them all (interleaved sampling, Keller & Heidrich 2001). This is for ambient
/// occlusion, 8×8 pixels: smooth, and noisy wherever a direction is missing.
pub const AMBIENT_INTERLEAVE_BITS: u32 = 3;
/// The same for lights, 4×4 pixels: a light's disc needs fewer directions, and its shadows have finer edges to keep.
pub const LIGHT_INTERLEAVE_BITS: u32 = 2;

/// Number of residues: pixels that share one pattern.
///
/// ```
/// use visfield::estimate::sampling::{AMBIENT_INTERLEAVE_BITS, residues};
/// assert_eq!(residues(AMBIENT_INTERLEAVE_BITS), 64);
/// ```
pub const fn residues(bits: u32) -> u32 {
    1 << (2 * bits)
}

/// Fraction of a turn from one sample to the next: the golden angle, which keeps every run of samples well spread.
const GOLDEN: f64 = 0.618_033_988_749_894_8;

/// `count` points spread evenly over the unit sphere: a Fibonacci lattice (González, *Measurement of Areas on a Sphere
/// Using Fibonacci and Latitude–Longitude Lattices*, 2010).
///
/// ```
/// let points = visfield::estimate::sampling::sphere_samples(128);
/// let mean: glam::Vec3 = points.iter().sum::<glam::Vec3>() / 128.0;
/// assert!(mean.length() < 0.02);
/// ```
pub fn sphere_samples(count: u32) -> Vec<Vec3> {
    (0..count)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f32 + 1.0) / count as f32;
            let (sin, cos) = (turned(i, GOLDEN) * TAU).sin_cos();
            let radius = (1.0 - z * z).sqrt();
            vec3(radius * cos, radius * sin, z)
        })
        .collect()
}

/// `count` points spread evenly over the unit disc: Vogel's spiral (*A Better Way to Construct the Sunflower Head*, 1979).
///
/// ```
/// assert!(visfield::estimate::sampling::disc_samples(64).iter().all(|p| p.length() < 1.0));
/// ```
pub fn disc_samples(count: u32) -> Vec<Vec2> {
    (0..count)
        .map(|i| {
            let radius = ((i as f32 + 0.5) / count as f32).sqrt();
            let (sin, cos) = (turned(i, GOLDEN) * TAU).sin_cos();
            vec2(radius * cos, radius * sin)
        })
        .collect()
}

/// `count` points spread evenly over the square from −1 to 1: the R₂ sequence (Roberts, *The Unreasonable Effectiveness of
/// Quasirandom Sequences*, 2018).
///
/// ```
/// let right = visfield::estimate::sampling::square_samples(64).iter().filter(|p| p.x > 0.0).count();
/// assert!((30..=34).contains(&right));
/// ```
pub fn square_samples(count: u32) -> Vec<Vec2> {
    (0..count).map(|i| vec2(turned(i, PLASTIC), turned(i, PLASTIC * PLASTIC)) * 2.0 - 1.0).collect()
}

/// `count` levels spread evenly from 0 to 1, in an order that has nothing to do with that of the points above; other ones for
/// each `turn`.
pub(crate) fn uneven_levels(count: u32, turn: u32) -> Vec<f32> {
    (0..count).map(|i| (turned(i, PLASTIC) + turned(turn, GOLDEN)).fract()).collect()
}

/// Points turned about the z axis, by another angle for each `turn`; not at all for 0.
pub(crate) fn rotated(points: Vec<Vec3>, turn: u32) -> Vec<Vec3> {
    let turn = Vec2::from_angle(turned(turn, PLASTIC) * TAU);
    points.into_iter().map(|point| turn.rotate(point.truncate()).extend(point.z)).collect()
}

/// Points of the square moved around its edges, by another way for each `turn`; not at all for 0.
pub(crate) fn shifted(points: Vec<Vec2>, turn: u32) -> Vec<Vec2> {
    let shift = vec2(turned(turn, GOLDEN), turned(turn, PLASTIC)) * 2.0;
    points.into_iter().map(|point| (point + shift + 1.0).rem_euclid(Vec2::splat(2.0)) - 1.0).collect()
}

/// 1 over the plastic number, which spreads well along two axes at once.
const PLASTIC: f64 = 0.754_877_666_246_692_8;

/// Which residue of the shared pattern a pixel takes, below [`residues`]`(bits)`: the Bayer matrix, so that neighbours take
/// samples that are far apart.
///
/// ```
/// use visfield::estimate::sampling::interleave_index;
/// assert_ne!(interleave_index(0, 0, 2), interleave_index(1, 0, 2));
/// assert_eq!(interleave_index(0, 0, 2), interleave_index(4, 8, 2));
/// ```
#[inline]
pub fn interleave_index(x: u32, y: u32, bits: u32) -> u32 {
    let diagonal = x ^ y;
    (0..bits).fold(0, |index, bit| (index << 2) | (((diagonal >> bit) & 1) << 1) | ((y >> bit) & 1))
}

/// The directions towards a light's disc: the light's axis and two scaled tangents.
///
/// ```
/// use glam::{Vec2, Vec3};
/// let basis = visfield::estimate::sampling::DiscBasis::new(Vec3::Y, 0.1);
/// assert_eq!(basis.direction(Vec2::ZERO), Vec3::Y);
/// assert!((basis.direction(Vec2::X).angle_between(Vec3::Y) - 0.1).abs() < 1e-5);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiscBasis {
    /// Unit vector towards the disc's centre.
    pub axis: Vec3,
    /// Tangent of the disc, as long as its radius at distance 1.
    pub tangent: Vec3,
    /// The other tangent, as long.
    pub bitangent: Vec3,
}

impl DiscBasis {
    /// Largest angular radius in radians; wider discs approach a half-space, whose tangents have no end.
    pub const MAX_ANGULAR_RADIUS: f32 = 1.2;

    /// An angular radius in radians as discs have it: 0 to [`Self::MAX_ANGULAR_RADIUS`], NaN becomes 0.
    pub fn clamp_angular_radius(angular_radius: f32) -> f32 {
        if angular_radius.is_nan() { 0.0 } else { angular_radius.clamp(0.0, Self::MAX_ANGULAR_RADIUS) }
    }

    /// The disc around `axis` (a unit vector) with the given [angular radius](Self::clamp_angular_radius).
    pub fn new(axis: Vec3, angular_radius: f32) -> Self {
        let (tangent, bitangent) = axis.any_orthonormal_pair();
        let radius = Self::clamp_angular_radius(angular_radius).tan();
        Self { axis, tangent: tangent * radius, bitangent: bitangent * radius }
    }

    /// The unit direction to a point of the disc, given as a point of the unit disc.
    #[inline]
    pub fn direction(&self, sample: Vec2) -> Vec3 {
        (self.axis + self.tangent * sample.x + self.bitangent * sample.y).normalize()
    }
}

/// A share of a turn, as many times as `i` says, less the whole turns.
fn turned(i: u32, share: f64) -> f32 {
    // In f64: the product loses its fraction in f32 from a few thousand samples on.
    (f64::from(i) * share).fract() as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_of_a_square_takes_another_residue() {
        for bits in [LIGHT_INTERLEAVE_BITS, AMBIENT_INTERLEAVE_BITS] {
            let side = 1 << bits;
            let mut taken: Vec<u32> =
                (0..side).flat_map(|y| (0..side).map(move |x| interleave_index(x, y, bits))).collect();
            taken.sort_unstable();
            assert!(taken.into_iter().eq(0..residues(bits)));
        }
    }

    #[test]
    fn interleaved_subsets_are_even_too() {
        // Every pixel's own 8 samples must already estimate a half-space well.
        let samples = sphere_samples(8 * residues(AMBIENT_INTERLEAVE_BITS));
        for residue in 0..residues(AMBIENT_INTERLEAVE_BITS) as usize {
            let own = samples.iter().skip(residue).step_by(64);
            let above = own.clone().filter(|p| p.x > 0.0).count();
            assert!((2..=6).contains(&above), "residue {residue}: {above} of 8 to one side");
            assert_eq!(own.filter(|p| p.z > 0.0).count(), 4);
        }
    }

    #[test]
    fn disc_samples_are_uniform() {
        let inner = disc_samples(1000).iter().filter(|p| p.length() < 0.5).count();
        assert_eq!(inner, 250);
    }
}
