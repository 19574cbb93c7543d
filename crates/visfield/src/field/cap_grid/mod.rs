//! Ambient occlusion without rays: on a small grid around a mesh, how much of the sphere of directions the mesh hides.
//!
//! At each point the grid stores the spherical harmonics of *which directions are occluded*, of bands 0 and 1 (four numbers),
//! and on request up to band 3 (sixteen). The four imply a spherical [`cap`], and with the receiver's normal the occlusion. A
//! receiver pays one interpolated read per object, and gets no noise. [`warp`] says where the points lie, [`harmonics`] has the
//! functions, [`batch`] answers many receivers at once; `shaders/caps.wgsl` is the twin of what frames need.
//!
//! Related: Kontkanen & Laine, *Ambient Occlusion Fields* (2005), caps on a cube map; Malmer et al., *Fast Precomputed Ambient
//! Occlusion for Proximity Shadows* (2007), grids of cones. Here the second band is rebuilt from the cap, the grid is warped,
//! and values are scaled by the square of the distance before they are stored.

pub mod batch;
pub mod cap;
pub mod harmonics;
pub mod warp;

use std::array;
use std::fmt;
use std::hash::{Hash, Hasher};
use std::sync::Arc;

use glam::{DAffine3, Mat3, Vec3, Vec4};
use half::f16;
use serde::{Deserialize, Serialize};

use super::lanes::Vectors;
use super::{BoundingEllipsoid, FieldError};
use cap::{Cap, cap_occlusion};
use harmonics::MAX_COEFFICIENTS;
use warp::{AxisWarp, storage_scale};

/// Fewest grid points along an axis.
pub const MIN_POINTS: u32 = 4;
/// Most grid points along an axis.
pub const MAX_POINTS: u32 = 64;

/// How many spherical harmonics each point has.
///
/// ```
/// use visfield::field::cap_grid::HarmonicOrder;
/// assert_eq!(HarmonicOrder::Three.coefficients(), 16);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HarmonicOrder {
    /// Bands 0 and 1: four numbers, enough for ambient occlusion.
    #[default]
    One,
    /// Bands 0 to 3: sixteen numbers, for the soft shadows of large lights too.
    Three,
}

impl HarmonicOrder {
    /// Numbers per point.
    pub const fn coefficients(self) -> usize {
        match self {
            Self::One => 4,
            Self::Three => MAX_COEFFICIENTS,
        }
    }
}

/// How each number is stored.
///
/// ```
/// use visfield::field::cap_grid::CapPrecision;
/// assert_eq!(CapPrecision::U8.bytes(), 1);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CapPrecision {
    /// 8 bits, linear between the coefficient's smallest and largest value in the grid.
    #[default]
    U8,
    /// 16-bit floating point.
    F16,
}

impl CapPrecision {
    /// Bytes per number.
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::F16 => 2,
        }
    }

    /// `rgba8` or `rgba16f`: four numbers as a texel.
    pub const fn name(self) -> &'static str {
        match self {
            Self::U8 => "rgba8",
            Self::F16 => "rgba16f",
        }
    }
}

/// How much a surface at a distance occludes. Baked into the grid, so distances are in the mesh's own units and grow with an
/// instance.
///
/// ```
/// use visfield::field::cap_grid::Falloff;
/// assert_eq!(Falloff::Linear { distance: 2.0 }.weight(0.5), 0.75);
/// ```
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Falloff {
    /// All of it, at any distance.
    #[default]
    None,
    /// Obscurance, e^(−`tau`·distance) (2012, eq. 3.23, as occlusion).
    Exponential {
        /// Per mesh unit; above 0.
        tau: f32,
    },
    /// From 1 at the surface evenly to 0 at `distance`.
    Linear {
        /// In mesh units; above 0.
        distance: f32,
    },
}

impl Falloff {
    /// By bits, so that settings can be keys.
    fn key(self) -> (u8, u32) {
        match self {
            Self::None => (0, 0),
            Self::Exponential { tau } => (1, tau.to_bits()),
            Self::Linear { distance } => (2, distance.to_bits()),
        }
    }

    /// The weight of a hit at a distance in mesh units, from 1 to 0.
    pub fn weight(self, at: f32) -> f32 {
        match self {
            Self::None => 1.0,
            Self::Exponential { tau } => (-tau * at).exp(),
            Self::Linear { distance } => (1.0 - at / distance).clamp(0.0, 1.0),
        }
    }

    fn is_valid(self) -> bool {
        match self {
            Self::None => true,
            Self::Exponential { tau: number } | Self::Linear { distance: number } => number.is_finite() && number > 0.0,
        }
    }
}

impl PartialEq for Falloff {
    fn eq(&self, other: &Self) -> bool {
        self.key() == other.key()
    }
}

impl Eq for Falloff {}

impl Hash for Falloff {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.key().hash(state);
    }
}

/// What a cap grid was found to get wrong, of occlusion from 0 to 1, by points between the grid's and fresh exact rays.
///
/// ```
/// use visfield::field::cap_grid::CapGridError;
/// let crate_of_boards = CapGridError { outside: 0.01, inside: 0.2 };
/// assert!(!crate_of_boards.serves_inside());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CapGridError {
    /// Mean absolute error at points outside the mesh's bounding box, within about its size.
    pub outside: f32,
    /// Mean absolute error at points inside the box and outside the mesh, near to its surface: 0 if nothing fits in there.
    pub inside: f32,
}

impl CapGridError {
    /// Error inside the box above which the grid should not be asked there.
    ///
    /// At 16³, models without an inside have 0.02 to 0.05 (bunny, cow, spot, suzanne, fandisk, igea, and the teapot, whose
    /// inside nobody sees), and an arch 0.06. A crate with or without a lid has 0.105, a fence 0.11 and a room 0.15: their
    /// walls are thinner than a cell, so that their two sides are blended. At 8³ some models come to 0.08 too.
    pub const LARGEST_INSIDE: f32 = 0.07;

    /// Whether receivers inside the mesh's bounding box can be answered too.
    pub fn serves_inside(&self) -> bool {
        self.inside <= Self::LARGEST_INSIDE
    }
}

/// What is stored at how many points: also what a bake is asked for.
///
/// ```
/// use visfield::CapGridFormat;
/// assert_eq!(CapGridFormat::default().bytes(), 16 * 1024);
/// assert_eq!(CapGridFormat { points: 8, ..CapGridFormat::default() }.to_string(), "8\u{b3} in rgba8");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct CapGridFormat {
    /// Grid points along each axis, [`MIN_POINTS`] to [`MAX_POINTS`].
    pub points: u32,
    /// Harmonics per point.
    pub order: HarmonicOrder,
    /// How numbers are stored.
    pub precision: CapPrecision,
    /// How much a surface at a distance occludes.
    pub falloff: Falloff,
}

impl CapGridFormat {
    /// 16³ points of four bytes: 16 KiB.
    pub const DEFAULT: Self =
        Self { points: 16, order: HarmonicOrder::One, precision: CapPrecision::U8, falloff: Falloff::None };

    /// Size of the uncompressed grid in bytes, saturating.
    pub fn bytes(&self) -> u64 {
        let per_point = (self.order.coefficients() * self.precision.bytes()) as u64;
        u64::from(self.points).saturating_pow(3).saturating_mul(per_point)
    }

    /// Checks every number against its documented range.
    ///
    /// # Errors
    /// [`FieldError::CapPoints`] or [`FieldError::CapGrid`].
    pub fn validate(&self) -> Result<(), FieldError> {
        if !(MIN_POINTS..=MAX_POINTS).contains(&self.points) {
            return Err(FieldError::CapPoints { points: self.points });
        }
        if self.falloff.is_valid() { Ok(()) } else { Err(FieldError::CapGrid) }
    }
}

impl Default for CapGridFormat {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl fmt::Display for CapGridFormat {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}\u{b3} in {}", self.points, self.precision.name())
    }
}

/// What a cap grid is, without its numbers.
///
/// ```
/// use visfield::field::cap_grid::CapGridHeader;
/// let around_two_units: CapGridHeader = CapGridHeader { half_extents: [1.0; 3], ..CapGridHeader::default() };
/// assert_eq!(around_two_units.validate(), Ok(()));
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CapGridHeader {
    /// What is stored at how many points.
    #[serde(flatten)]
    pub format: CapGridFormat,
    /// Centre of the mesh's bounding box, in mesh units.
    pub center: [f32; 3],
    /// Half the sides of that box, in mesh units; one of them at least is above 0.
    pub half_extents: [f32; 3],
    /// What an 8-bit 0 stands for, by coefficient; as many as there are coefficients.
    pub low: Vec<f32>,
    /// What 255 stands for, less `low`.
    pub range: Vec<f32>,
    /// What the grid was found to get wrong, if it was measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<CapGridError>,
}

impl Default for CapGridHeader {
    /// In the default format, around a box from −1 to 1, with numbers from 0 to 1.
    fn default() -> Self {
        let format = CapGridFormat::DEFAULT;
        let coefficients = format.order.coefficients();
        Self {
            format,
            center: [0.0; 3],
            half_extents: [1.0; 3],
            low: vec![0.0; coefficients],
            range: vec![1.0; coefficients],
            error: None,
        }
    }
}

impl CapGridHeader {
    /// Checks every number against its documented range.
    ///
    /// # Errors
    /// [`FieldError::CapPoints`] or [`FieldError::CapGrid`].
    pub fn validate(&self) -> Result<(), FieldError> {
        self.format.validate()?;
        let coefficients = self.format.order.coefficients();
        let sound = self.center.iter().all(|x| x.is_finite())
            && self.half_extents.iter().all(|x| x.is_finite() && *x >= 0.0)
            && self.scale().is_normal()
            && self.scale().recip().is_normal()
            && (self.low.len(), self.range.len()) == (coefficients, coefficients)
            && self.low.iter().zip(&self.range).all(|(low, range)| range.is_finite() && (low + range).is_finite())
            && self.error.is_none_or(|error| error.outside.is_finite() && error.inside.is_finite());
        if sound { Ok(()) } else { Err(FieldError::CapGrid) }
    }

    /// Mesh units per unit of cap space: the largest half-extent of the box.
    pub fn scale(&self) -> f32 {
        self.half_extents.iter().fold(0.0, |largest, &x| largest.max(x))
    }

    /// Half the sides of the box in cap space, the largest of them 1.
    pub fn half_extents_in_cap_space(&self) -> Vec3 {
        Vec3::from(self.half_extents) / self.scale()
    }

    /// The sphere that is the unit sphere of cap space. It is as large as the box's largest side, and so does not hold its
    /// corners.
    pub fn cap_space(&self) -> BoundingEllipsoid {
        BoundingEllipsoid::sphere(self.center, self.scale())
    }

    /// The map from cap space to mesh space.
    pub fn mesh_from_cap(&self) -> DAffine3 {
        self.cap_space().mesh_from_field()
    }

    /// The warp of each axis.
    pub fn warps(&self) -> [AxisWarp; 3] {
        self.half_extents_in_cap_space().to_array().map(|half_extent| AxisWarp::new(half_extent, self.format.points))
    }

    /// Where the grid's points lie in cap space, x running fastest.
    pub fn positions(&self) -> Vec<Vec3> {
        let warps = self.warps();
        let n = self.format.points;
        let along = |axis: usize, i: u32| warps[axis].position(2.0 * i as f32 / (n - 1) as f32 - 1.0);
        let row = |y, z| (0..n).map(move |x| Vec3::new(along(0, x), along(1, y), along(2, z)));
        (0..n).flat_map(|z| (0..n).flat_map(move |y| row(y, z))).collect()
    }

    /// The four numbers from which ambient occlusion is taken: words of the first plane.
    fn words_per_plane(&self) -> usize {
        (self.format.points as usize).pow(3) * self.format.precision.bytes()
    }
}

/// One mesh's cap grid. Cheap to clone: the numbers are shared.
///
/// Positions and normals are in *cap space*, see [`CapGridHeader::mesh_from_cap`].
///
/// ```
/// use glam::Vec3;
/// # let grid = visfield::field::cap_grid::example_ball(); // of radius 1 around the origin
/// // On the floor under it: a ball of radius r at height h hides (r/h)².
/// let occlusion = grid.ambient_occlusion(Vec3::Y * -2.0, Vec3::Y);
/// assert!((occlusion - 0.25).abs() < 0.02);
/// assert!(grid.ambient_occlusion(Vec3::Y * -2.0, -Vec3::Y) < 0.01);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct CapGrid {
    header: Arc<CapGridHeader>,
    warps: [AxisWarp; 3],
    words: Arc<[u32]>,
}

impl CapGrid {
    /// Joins a header and the bytes it describes: for each four coefficients all points, x running fastest, each with its four
    /// numbers, little-endian.
    ///
    /// # Errors
    /// [`FieldError`] if a number is out of range or the length is not [`CapGridFormat::bytes`].
    pub fn new(header: CapGridHeader, bytes: &[u8]) -> Result<Self, FieldError> {
        header.validate()?;
        let (expected, found) = (header.format.bytes(), bytes.len() as u64);
        if expected != found {
            return Err(FieldError::TableLength { expected, found });
        }
        let is_finite = |half: &[u8; 2]| f16::from_le_bytes(*half).is_finite();
        if header.format.precision == CapPrecision::F16 && !bytes.as_chunks().0.iter().all(is_finite) {
            return Err(FieldError::CapGrid);
        }
        // A whole number of words, since points have four coefficients at least.
        let words = bytes.as_chunks().0.iter().map(|&word| u32::from_le_bytes(word)).collect();
        Ok(Self { warps: header.warps(), header: Arc::new(header), words })
    }

    /// Stores the coefficients of every point, in the order of [`CapGridHeader::positions`]. They are multiplied by
    /// [`storage_scale`] already; `low` and `range` of the header are found here.
    ///
    /// # Errors
    /// [`FieldError`] if a number is out of range, or there are not as many points as the header says.
    pub fn encode(mut header: CapGridHeader, scaled: &[[f32; MAX_COEFFICIENTS]]) -> Result<Self, FieldError> {
        // Before anything is allocated for it.
        header.format.validate()?;
        let count = header.format.order.coefficients();
        let ends = |i: usize| {
            let values = scaled.iter().map(|point| point[i]);
            values.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
        };
        (header.low, header.range) = (0..count).map(ends).map(|(low, high)| (low, high - low)).unzip();
        let mut bytes = Vec::with_capacity(header.format.bytes() as usize);
        for plane in (0..count).step_by(4) {
            for point in scaled {
                for (i, &value) in point.iter().enumerate().skip(plane).take(4) {
                    match header.format.precision {
                        CapPrecision::U8 => {
                            let share = (value - header.low[i]) / header.range[i].max(f32::MIN_POSITIVE);
                            bytes.push((share * 255.0).round() as u8);
                        }
                        CapPrecision::F16 => bytes.extend(f16::from_f32(value).to_le_bytes()),
                    }
                }
            }
        }
        Self::new(header, &bytes)
    }

    /// What this grid is.
    pub fn header(&self) -> &CapGridHeader {
        &self.header
    }

    /// The numbers as they are stored, four bytes each; see [`CapGrid::new`] for their order.
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// The same as bytes, as [`CapGrid::new`] takes them.
    pub fn bytes(&self) -> Vec<u8> {
        self.words.iter().flat_map(|word| word.to_le_bytes()).collect()
    }

    /// The warp of each axis.
    pub fn warps(&self) -> &[AxisWarp; 3] {
        &self.warps
    }

    /// What 0 stands for, and a step of what is stored, for each of four coefficients: as numbers are stored, value = low +
    /// step · number.
    #[inline(always)]
    pub(crate) fn low_and_step(&self, plane: usize) -> [[f32; 4]; 2] {
        let four = |numbers: &[f32]| array::from_fn(|i| numbers[plane * 4 + i]);
        match self.header.format.precision {
            CapPrecision::U8 => [four(&self.header.low), four(&self.header.range).map(|range| range * (1.0 / 255.0))],
            CapPrecision::F16 => [[0.0; 4], [1.0; 4]],
        }
    }

    /// The harmonics of bands 0 and 1 of what is occluded as seen from a point: (O₀₀, O₁ along x, y, z).
    pub fn harmonics(&self, position: Vec3) -> Vec4 {
        self.plane(position, 0)
    }

    /// All harmonics; those of bands that are not stored are 0.
    pub fn all_harmonics(&self, position: Vec3) -> [f32; MAX_COEFFICIENTS] {
        let mut all = [0.0; MAX_COEFFICIENTS];
        for plane in 0..self.header.format.order.coefficients() / 4 {
            all[plane * 4..][..4].copy_from_slice(&self.plane(position, plane).to_array());
        }
        all
    }

    /// Four coefficients, interpolated.
    fn plane(&self, position: Vec3, plane: usize) -> Vec4 {
        let mut one = Vectors::<1>::ZERO;
        one.set(0, position);
        Vec4::from(self.plane_of(&one, plane).map(|[x]| x))
    }

    /// How much of the hemisphere around a unit normal the mesh hides, weighted by the cosine, in [0, 1], at any position.
    pub fn ambient_occlusion(&self, position: Vec3, normal: Vec3) -> f32 {
        let harmonics = self.harmonics(position);
        cap_occlusion(harmonics, &Cap::new(harmonics), normal)
    }

    /// How much of a round light the mesh hides, in [0, 1]: a disc of the sky around `axis`, a unit vector, with a half-angle in
    /// radians. What lies behind the light counts, and so does what lies below the receiver's horizon.
    ///
    /// For large lights, and grids of [`HarmonicOrder::Three`]: over the receivers in a corner that a bunny or a cow shadows at
    /// all, the mean error is 0.14 at 10°, 0.09 at 15°, 0.03 at 30° and 0.015 at 45°.
    pub fn light_occlusion(&self, position: Vec3, axis: Vec3, half_angle: f32) -> f32 {
        let known = self.header.format.order.coefficients();
        cap::light_occlusion(&self.all_harmonics(position)[..known], axis, half_angle)
    }

    /// 1 at positions inside the mesh's bounding box, falling to 0 a tenth of its largest half-extent outside.
    #[inline(always)]
    pub fn inside_share(&self, position: Vec3) -> f32 {
        let beyond = position.abs() - self.header.half_extents_in_cap_space();
        let largest = beyond.x.max(beyond.y).max(beyond.z);
        (1.0 - largest * (1.0 / INSIDE_MARGIN)).clamp(0.0, 1.0)
    }

    /// Whether receivers inside the mesh's bounding box can be answered too, as far as is known.
    pub fn serves_inside(&self) -> bool {
        self.header.error.is_none_or(|error| error.serves_inside())
    }
}

/// How far around the box the change between a grid and rays takes, in units of cap space.
const INSIDE_MARGIN: f32 = 0.1;

/// Farther from the mesh than this, in units of cap space, all positions are alike: nothing is seen of it.
const FARTHEST: f32 = 1.0e12;

/// Where a position lies in a grid.
#[derive(Clone, Copy, Debug)]
pub(super) struct GridPoint {
    /// The grid point before it, along each axis, as whole numbers.
    pub(super) first: Vec3,
    /// How far it lies on the way to the next one, 0 to 1.
    pub(super) fraction: Vec3,
    /// By what interpolated values are multiplied: undoes [`storage_scale`], and the distance beyond the grid.
    pub(super) weight: f32,
}

impl GridPoint {
    /// Beyond the grid, positions are pulled back towards its centre, and what is seen from there falls with the square of the
    /// distance.
    #[inline(always)]
    pub(super) fn new(warps: &[AxisWarp; 3], points: u32, position: Vec3) -> Self {
        // NaN becomes far away too.
        let within = |x: f32| if x > -FARTHEST { x.min(FARTHEST) } else { -FARTHEST };
        let position = Vec3::new(within(position.x), within(position.y), within(position.z));
        let [x, y, z] = warps;
        let beyond = position.abs() * Vec3::new(x.inverse_extent, y.inverse_extent, z.inverse_extent);
        let pull = 1.0 / beyond.x.max(beyond.y).max(beyond.z).max(1.0);
        let pulled = position * pull;
        let u = Vec3::new(x.coordinate(pulled.x), y.coordinate(pulled.y), z.coordinate(pulled.z));
        let last = (points - 1) as f32;
        let grid = ((u + 1.0) * (0.5 * last)).clamp(Vec3::ZERO, Vec3::splat(last));
        let first = grid.floor().min(Vec3::splat(last - 1.0));
        Self { first, fraction: grid - first, weight: pull * pull / storage_scale(pulled) }
    }

    /// The number of the first of the eight points around it. Whole numbers of this size are exact.
    #[inline(always)]
    pub(super) fn index(&self, points: u32) -> u32 {
        let side = points as f32;
        ((self.first.z * side + self.first.y) * side + self.first.x) as u32
    }
}

/// How far a linear map is from an even scale with a rotation or mirroring: 0 (it is one) and up.
pub fn stretch(linear: Mat3) -> f32 {
    let gram = linear.transpose() * linear;
    let mean = (gram.x_axis.x + gram.y_axis.y + gram.z_axis.z) / 3.0;
    let difference = gram * (1.0 / mean) - Mat3::IDENTITY;
    difference.to_cols_array().iter().fold(0.0, |largest, x| largest.max(x.abs()))
}

/// A ball of radius 1 around the origin, sampled in closed form, for examples and tests.
#[doc(hidden)]
pub fn example_ball() -> CapGrid {
    ball(CapGridHeader::default())
}

/// A ball of radius 1 around the origin.
#[doc(hidden)]
pub fn ball(header: CapGridHeader) -> CapGrid {
    let scaled: Vec<_> = header
        .positions()
        .iter()
        .map(|&p| {
            let mut coefficients = [0.0; MAX_COEFFICIENTS];
            // From inside everything is hidden.
            let sine_squared = 1.0 / p.length_squared().max(1.0);
            let cosine = if p.length_squared() > 1.0 { (1.0 - sine_squared).sqrt() } else { -1.0 };
            let axis = -p.normalize_or_zero();
            harmonics::disc(&mut coefficients, axis, cosine);
            coefficients.map(|x| x * storage_scale(p))
        })
        .collect();
    CapGrid::encode(header, &scaled).expect("a sampled ball is a valid grid")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::sampling::sphere_samples;

    #[test]
    fn a_ball_hides_its_share_at_any_distance() {
        for (order, precision) in [(HarmonicOrder::One, CapPrecision::U8), (HarmonicOrder::Three, CapPrecision::F16)] {
            let format = CapGridFormat { order, precision, ..CapGridFormat::DEFAULT };
            let grid = ball(CapGridHeader { format, ..CapGridHeader::default() });
            for distance in [1.5_f32, 2.0, 4.0, 5.5, 8.0, 30.0, 1e4, 1e20] {
                for direction in sphere_samples(50) {
                    let occlusion = grid.ambient_occlusion(direction * distance, -direction);
                    let exact = distance.powi(-2);
                    let tolerance = 0.06 * exact.sqrt().min(0.5) + 0.1 * exact;
                    assert!(
                        (occlusion - exact).abs() <= tolerance.max(1e-20),
                        "{distance}: {occlusion}, exactly {exact}"
                    );
                    assert!(grid.ambient_occlusion(direction * distance, direction) < 0.03);
                }
            }
        }
    }

    #[test]
    fn bytes_and_halves_agree() {
        for order in [HarmonicOrder::One, HarmonicOrder::Three] {
            let [bytes, halves] = [CapPrecision::U8, CapPrecision::F16].map(|precision| {
                let format = CapGridFormat { order, precision, ..CapGridFormat::DEFAULT };
                ball(CapGridHeader { format, half_extents: [1.0, 0.8, 0.5], ..CapGridHeader::default() })
            });
            assert_eq!(halves.bytes().len(), 2 * bytes.bytes().len());
            // Half a step of the widest range, twice for rounding on the way.
            let step = bytes.header().range.iter().fold(0.0, |widest: f32, x| widest.max(*x)) / 255.0;
            for position in sphere_samples(200).into_iter().zip(0..).map(|(d, i)| d * (0.05 * i as f32)) {
                let (one, other) = (bytes.all_harmonics(position), halves.all_harmonics(position));
                let close = one.iter().zip(other).all(|(a, b)| (a - b).abs() <= step);
                assert!(close, "{position}: {one:?}, {other:?}");
                for normal in [Vec3::Y, Vec3::NEG_X] {
                    let difference =
                        bytes.ambient_occlusion(position, normal) - halves.ambient_occlusion(position, normal);
                    assert!(difference.abs() < 0.01, "{position}: {difference}");
                }
            }
        }
    }

    #[test]
    fn strange_positions_are_answered() {
        let grid = example_ball();
        for x in [0.0, -0.0, f32::MIN_POSITIVE, 1.0, 5.0, 1e30, f32::MAX, f32::INFINITY, f32::NAN] {
            for position in [Vec3::X * x, Vec3::splat(x), Vec3::new(0.3, -x, 0.1), Vec3::new(x, f32::NAN, 1.0)] {
                for normal in [Vec3::Y, Vec3::ZERO, Vec3::NAN] {
                    let occlusion = grid.ambient_occlusion(position, normal);
                    assert!((0.0..=1.0).contains(&occlusion), "{position}: {occlusion}");
                }
            }
        }
        assert!(grid.ambient_occlusion(Vec3::ZERO, Vec3::Y) > 0.99, "inside");
    }

    #[test]
    fn forged_headers_are_refused() {
        let sound = CapGridHeader::default();
        let with_format = |format| CapGridHeader { format, ..sound.clone() };
        assert!(sound.validate().is_ok());
        for points in [0, 3, 65, u32::MAX] {
            let forged = with_format(CapGridFormat { points, ..CapGridFormat::DEFAULT });
            assert!(matches!(forged.validate(), Err(FieldError::CapPoints { .. })));
        }
        let mut forged = vec![
            CapGridHeader { half_extents: [0.0; 3], ..sound.clone() },
            CapGridHeader { half_extents: [f32::NAN; 3], ..sound.clone() },
            CapGridHeader { half_extents: [-1.0; 3], ..sound.clone() },
            CapGridHeader { center: [f32::INFINITY; 3], ..sound.clone() },
            CapGridHeader { low: vec![0.0; 3], ..sound.clone() },
            CapGridHeader { range: vec![f32::NAN; 4], ..sound.clone() },
            CapGridHeader { low: vec![f32::MAX; 4], range: vec![f32::MAX; 4], ..sound.clone() },
            with_format(CapGridFormat { order: HarmonicOrder::Three, ..CapGridFormat::DEFAULT }),
            CapGridHeader { error: Some(CapGridError { outside: f32::NAN, inside: 0.0 }), ..sound.clone() },
        ];
        for number in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            forged.push(with_format(CapGridFormat {
                falloff: Falloff::Linear { distance: number },
                ..CapGridFormat::DEFAULT
            }));
            forged.push(with_format(CapGridFormat {
                falloff: Falloff::Exponential { tau: number },
                ..CapGridFormat::DEFAULT
            }));
        }
        for forged in forged {
            assert_eq!(forged.validate(), Err(FieldError::CapGrid), "{forged:?}");
        }
        assert!(matches!(CapGrid::new(sound.clone(), &[0; 7]), Err(FieldError::TableLength { .. })));
        let huge = CapGridFormat { points: u32::MAX, ..CapGridFormat::DEFAULT };
        assert_eq!(huge.bytes(), u64::MAX);
        assert_eq!(CapGrid::encode(with_format(huge), &[]), Err(FieldError::CapPoints { points: u32::MAX }));
        let halves = with_format(CapGridFormat { precision: CapPrecision::F16, points: 4, ..CapGridFormat::DEFAULT });
        let mut bytes = vec![0; halves.format.bytes() as usize];
        assert!(CapGrid::new(halves.clone(), &bytes).is_ok());
        // Infinity, then NaN.
        for high in [0x7c, 0x7e] {
            bytes[3] = high;
            assert_eq!(CapGrid::new(halves.clone(), &bytes), Err(FieldError::CapGrid));
        }
    }

    #[test]
    fn only_similar_maps_have_no_stretch() {
        let turned = Mat3::from_rotation_x(0.7) * Mat3::from_diagonal(Vec3::new(-3.0, 3.0, 3.0));
        assert!(stretch(turned) < 1e-5);
        assert!(stretch(turned * Mat3::from_diagonal(Vec3::new(1.0, 1.5, 1.0))) > 0.3);
        let sheared = Mat3::from_cols(Vec3::X, Vec3::new(0.5, 1.0, 0.0), Vec3::Z);
        assert!(stretch(sheared) > 0.3);
    }
}
