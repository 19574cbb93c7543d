//! What a cap grid is, without its numbers: how many points and harmonics, how they are stored, and around which box.

use std::fmt;
use std::hash::{Hash, Hasher};

use glam::{DAffine3, Vec3};
use serde::{Deserialize, Serialize};

use super::harmonics::MAX_COEFFICIENTS;
use super::warp::AxisWarp;
use crate::field::{BoundingEllipsoid, FieldError};

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
/// A grid of a few points cannot follow what changes within a small part of the mesh. A reach ([`Falloff::reach`]) of about the
/// mesh's bounding radius and up is good. Well below it is coarse: around a cow of radius 5.5, one that ends at 1 has a mean
/// error of 0.058, the largest 0.77.
///
/// ```
/// use visfield::field::cap_grid::Falloff;
/// assert_eq!(Falloff::Linear { distance: 2.0 }.weight(0.5), 0.75);
/// assert_eq!(Falloff::Exponential { tau: 4.0 }.reach(), 0.25);
/// ```
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Falloff {
    /// All of it, at any distance.
    #[default]
    None,
    /// Obscurance, e^(−`tau`·distance) (2012, eq. 3.23, as occlusion).
    Exponential {
        /// Per mesh unit; above 0. Coarse well above 1 / the mesh's bounding radius.
        tau: f32,
    },
    /// From 1 at the surface evenly to 0 at `distance`.
    Linear {
        /// In mesh units; above 0. Coarse well below the mesh's bounding radius.
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

    /// How far away surfaces count, in mesh units: the distance where a linear falloff ends, and 1 / `tau`; infinity without
    /// falloff.
    pub fn reach(self) -> f32 {
        match self {
            Self::None => f32::INFINITY,
            Self::Exponential { tau } => tau.recip(),
            Self::Linear { distance } => distance,
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
    pub(super) fn words_per_plane(&self) -> usize {
        (self.format.points as usize).pow(3) * self.format.precision.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let huge = CapGridFormat { points: u32::MAX, ..CapGridFormat::DEFAULT };
        assert_eq!(huge.bytes(), u64::MAX);
    }
}
