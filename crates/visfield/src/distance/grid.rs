//! Signed distances on a regular grid: what a mesh is baked to.

use std::fmt;
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::field::FieldError;

/// Fewest points along the longest axis of a grid.
pub const MIN_VOXELS: u32 = 8;
/// Most points along an axis: 16 million in all.
pub const MAX_VOXELS: u32 = 256;
/// How far a grid reaches beyond the mesh's box on every side, in voxels: no farther than distances near the surface need.
pub const MARGIN: f32 = 1.0;
/// Farthest from the surface that bytes tell distances, outside and inside, in voxels. What is farther is stored as this far:
/// rays come a little slower through empty space, but bytes tell distances near the surface the finer.
pub const BYTE_REACH: (f32, f32) = (12.0, 3.0);

/// How each distance is stored.
///
/// ```
/// use visfield::distance::DistancePrecision;
/// assert_eq!(DistancePrecision::default().bytes(), 1);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DistancePrecision {
    /// In a byte, up to [`BYTE_REACH`].
    #[default]
    U8,
    /// In two bytes, all the way.
    U16,
}

impl DistancePrecision {
    /// Bytes of a distance.
    pub const fn bytes(self) -> u64 {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
        }
    }

    /// The highest code.
    const fn highest(self) -> f32 {
        match self {
            Self::U8 => 255.0,
            Self::U16 => 65535.0,
        }
    }
}

/// How fine a distance grid is.
///
/// ```
/// use visfield::distance::DistanceGridFormat;
/// let fine = DistanceGridFormat { voxels: 128, ..DistanceGridFormat::DEFAULT };
/// assert_eq!(fine.to_string(), "128 voxels u8");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct DistanceGridFormat {
    /// Points along the longest axis of the mesh's box, [`MIN_VOXELS`] to [`MAX_VOXELS`]. Voxels are cubes: shorter axes have
    /// fewer points.
    pub voxels: u32,
    /// How each distance is stored.
    pub precision: DistancePrecision,
}

impl DistanceGridFormat {
    /// 64 points of a byte along the longest axis: 260 kB at most.
    pub const DEFAULT: Self = Self { voxels: 64, precision: DistancePrecision::U8 };

    /// Checks the number of points.
    ///
    /// # Errors
    /// [`FieldError::Voxels`] if it is out of range.
    pub fn validate(&self) -> Result<(), FieldError> {
        if !(MIN_VOXELS..=MAX_VOXELS).contains(&self.voxels) {
            return Err(FieldError::Voxels { voxels: self.voxels });
        }
        Ok(())
    }
}

impl fmt::Display for DistanceGridFormat {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let precision = match self.precision {
            DistancePrecision::U8 => "u8",
            DistancePrecision::U16 => "u16",
        };
        write!(f, "{} voxels {precision}", self.voxels)
    }
}

/// Where a distance grid lies, and how its codes are read.
///
/// ```
/// use visfield::distance::{DistanceGridFormat, DistanceGridHeader};
/// let header = DistanceGridHeader::around([-1.0, 0.0, -1.0], [1.0, 1.0, 1.0], DistanceGridFormat::DEFAULT);
/// assert_eq!(header.points, [64, 34, 64]);
/// assert!(header.validate().is_ok());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DistanceGridHeader {
    /// How fine it is.
    #[serde(flatten)]
    pub format: DistanceGridFormat,
    /// Points along each axis of the mesh's space, at least 2.
    pub points: [u32; 3],
    /// The first point, in mesh units.
    pub first: [f32; 3],
    /// Side of a voxel, in mesh units.
    pub voxel: f32,
    /// What code 0 stands for, in voxels; negative inside.
    pub low: f32,
    /// What the highest code stands for, less `low`, in voxels.
    pub range: f32,
    /// How far a stored distance may exceed the true one at the surface, in voxels: rays that stop at a distance of more than this
    /// do not pass through.
    pub excess: f32,
}

impl DistanceGridHeader {
    /// A grid around a box of mesh space, by its lowest and highest corner, with no distances yet. The box may be flat; if it
    /// has no size at all, voxels are as large as the least normal number.
    pub fn around(low: [f32; 3], high: [f32; 3], format: DistanceGridFormat) -> Self {
        let (low, high) = (DVec3::from(low.map(f64::from)), DVec3::from(high.map(f64::from)));
        let size = (high - low).max(DVec3::ZERO);
        let inner = (f64::from(format.voxels) - 1.0 - 2.0 * f64::from(MARGIN)).max(1.0);
        let voxel = (size.max_element() / inner).max(f64::from(f32::MIN_POSITIVE)) as f32;
        let margin = 2.0 * f64::from(MARGIN);
        let cells = (size / f64::from(voxel) + margin - 1e-3).ceil().max(DVec3::ONE).to_array();
        let points = cells.map(|cells| (cells as u32 + 1).clamp(2, format.voxels.max(2)));
        let span = DVec3::from(points.map(|points| f64::from(points - 1))) * f64::from(voxel);
        let first = ((low + high - span) * 0.5).as_vec3().to_array();
        Self { format, points, first, voxel, low: 0.0, range: 0.0, excess: 0.0 }
    }

    /// Number of points.
    pub fn count(&self) -> u64 {
        self.points.iter().map(|&points| u64::from(points)).product()
    }

    /// Bytes of all codes.
    pub fn bytes(&self) -> u64 {
        self.count() * self.format.precision.bytes()
    }

    /// The map from mesh space to the space of the grid, in which a voxel is 1 and the first point the origin.
    pub fn grid_from_mesh(&self) -> DAffine3 {
        let inverse = 1.0 / f64::from(self.voxel);
        let first = DVec3::from(self.first.map(f64::from));
        DAffine3 { matrix3: DMat3::from_diagonal(DVec3::splat(inverse)), translation: -first * inverse }
    }

    /// A step of the codes, in voxels.
    pub fn step(&self) -> f32 {
        self.range / self.format.precision.highest()
    }

    /// Checks every number against its documented range.
    ///
    /// # Errors
    /// [`FieldError`] names what is out of range.
    pub fn validate(&self) -> Result<(), FieldError> {
        self.format.validate()?;
        let points = self.points.iter().all(|points| (2..=self.format.voxels).contains(points));
        let numbers = self.first.iter().chain([&self.low, &self.range, &self.excess]).all(|x| x.is_finite());
        let place =
            numbers && self.voxel.is_normal() && self.voxel > 0.0 && self.grid_from_mesh().as_affine3a().is_finite();
        if !(points
            && place
            && self.range >= 0.0
            && self.excess >= 0.0
            && self.range <= LARGEST
            && self.low.abs() <= LARGEST)
        {
            return Err(FieldError::DistanceGrid);
        }
        Ok(())
    }
}

/// Largest distance of a header, in voxels: more than any grid spans.
const LARGEST: f32 = 1.0e6;

#[derive(Clone, Debug, PartialEq)]
enum Codes {
    U8(Arc<[u8]>),
    U16(Arc<[u16]>),
}

/// Signed distances of one mesh on a regular grid, negative inside, in voxels. Between points they are interpolated
/// trilinearly (2012, chapter 4).
///
/// ```
/// use glam::Vec3;
/// let ball = visfield::distance::example_ball(); // of radius 1 around the origin
/// let position = ball.header().grid_from_mesh().transform_point3(glam::DVec3::X * 1.05).as_vec3();
/// let distance = ball.distance(position) * ball.header().voxel;
/// assert!((distance - 0.05).abs() < 0.01);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct DistanceGrid {
    header: DistanceGridHeader,
    /// [`DistanceGridHeader::step`]
    step: f32,
    codes: Codes,
}

impl DistanceGrid {
    /// A grid from its codes, x fastest, then y; two bytes are little-endian.
    ///
    /// # Errors
    /// [`FieldError`] if a number of the header is out of range, or if there are not as many bytes as it says.
    pub fn new(header: DistanceGridHeader, bytes: &[u8]) -> Result<Self, FieldError> {
        header.validate()?;
        if bytes.len() as u64 != header.bytes() {
            return Err(FieldError::TableLength { expected: header.bytes(), found: bytes.len() as u64 });
        }
        let codes = match header.format.precision {
            DistancePrecision::U8 => Codes::U8(bytes.into()),
            DistancePrecision::U16 => {
                Codes::U16(bytes.as_chunks().0.iter().map(|&pair| u16::from_le_bytes(pair)).collect())
            }
        };
        Ok(Self { header, step: header.step(), codes })
    }

    /// A grid from its distances in voxels, x fastest, then y, rounded to the nearest code. Sets what the codes stand for; what
    /// rounding may add to a distance is added to [`excess`](DistanceGridHeader::excess).
    ///
    /// # Errors
    /// [`FieldError`] if a number is not finite or out of range, or if there are not as many as the header says.
    pub fn from_distances(header: DistanceGridHeader, distances: &[f32]) -> Result<Self, FieldError> {
        let points = header.points.iter().all(|points| (2..=MAX_VOXELS).contains(points));
        if !points {
            return Err(FieldError::DistanceGrid);
        }
        if distances.len() as u64 != header.count() {
            let bytes = distances.len() as u64 * header.format.precision.bytes();
            return Err(FieldError::TableLength { expected: header.bytes(), found: bytes });
        }
        if !distances.iter().all(|distance| distance.is_finite()) {
            return Err(FieldError::DistanceGrid);
        }
        let (mut low, mut high) =
            distances.iter().fold((f32::MAX, f32::MIN), |(low, high), &d| (low.min(d), high.max(d)));
        if header.format.precision == DistancePrecision::U8 {
            (low, high) = (low.max(-BYTE_REACH.1), high.min(BYTE_REACH.0));
        }
        let header = DistanceGridHeader { low, range: (high - low).max(0.0), ..header };
        let step = header.step();
        let header = DistanceGridHeader { excess: header.excess + 0.5 * step, ..header };
        header.validate()?;
        let highest = header.format.precision.highest();
        let code = |distance: f32| ((distance - low) / step.max(f32::MIN_POSITIVE)).round().clamp(0.0, highest);
        let codes = match header.format.precision {
            DistancePrecision::U8 => Codes::U8(distances.iter().map(|&d| code(d) as u8).collect()),
            DistancePrecision::U16 => Codes::U16(distances.iter().map(|&d| code(d) as u16).collect()),
        };
        Ok(Self { header, step, codes })
    }

    /// Where it lies, and how its codes are read.
    pub fn header(&self) -> &DistanceGridHeader {
        &self.header
    }

    /// The codes, x fastest, then y; two bytes are little-endian.
    pub fn bytes(&self) -> Vec<u8> {
        match &self.codes {
            Codes::U8(codes) => codes.to_vec(),
            Codes::U16(codes) => codes.iter().flat_map(|code| code.to_le_bytes()).collect(),
        }
    }

    /// The last point: the far corner of what the grid spans.
    pub fn last(&self) -> Vec3 {
        Vec3::from(self.header.points.map(|points| (points - 1) as f32))
    }

    /// The signed distance at a position of the grid's space, in voxels. Outside the grid it is a lower bound that does not show
    /// the grid's own box (the 2012 thesis, algorithms 4.1 and 4.2, steps to the box and then leaves it out of ambient occlusion
    /// by hand): the nearest point of the surface lies in the box, which is convex, so that it is no nearer than the hypotenuse
    /// of the way to the box and of the distance from there.
    #[inline(always)]
    pub fn distance(&self, position: Vec3) -> f32 {
        let shape = self.shape();
        let place = shape.place(position);
        let corners = match &self.codes {
            Codes::U8(codes) => shape.corners(codes, place.index),
            Codes::U16(codes) => shape.corners(codes, place.index),
        };
        shape.interpolate(&corners, place.fraction, place.squared_beyond)
    }

    /// What says where a position lies among the codes.
    #[inline(always)]
    pub(super) fn shape(&self) -> GridShape {
        let [nx, ny, _] = self.header.points;
        GridShape { last: self.last(), row: nx, layer: nx * ny, low: self.header.low, step: self.step }
    }

    pub(super) fn cells(&self) -> Cells<'_> {
        match &self.codes {
            Codes::U8(codes) => Cells::U8(codes),
            Codes::U16(codes) => Cells::U16(codes),
        }
    }
}

/// A grid's codes, as they are stored.
pub(super) enum Cells<'a> {
    U8(&'a [u8]),
    U16(&'a [u16]),
}

/// Where positions lie in a grid, and what its codes stand for.
#[derive(Clone, Copy)]
pub(super) struct GridShape {
    pub(super) last: Vec3,
    /// Codes of a row, and of a layer.
    row: u32,
    layer: u32,
    low: f32,
    step: f32,
}

/// A place in a grid: the first of the eight codes around it, where it is between them, and how far it is from the grid, squared.
pub(super) struct Place {
    pub(super) index: u32,
    pub(super) fraction: Vec3,
    pub(super) squared_beyond: f32,
}

impl GridShape {
    #[inline(always)]
    pub(super) fn place(&self, position: Vec3) -> Place {
        // Not `clamp`: what is no number becomes 0.
        let inside = Vec3::new(
            position.x.max(0.0).min(self.last.x),
            position.y.max(0.0).min(self.last.y),
            position.z.max(0.0).min(self.last.z),
        );
        let beyond = position - inside;
        // Casts to integers cut off fractions, and these are positive.
        let cell = |x: f32, last: f32| (x as i32).min(last as i32 - 1);
        let (x, y, z) = (cell(inside.x, self.last.x), cell(inside.y, self.last.y), cell(inside.z, self.last.z));
        let index = z as u32 * self.layer + y as u32 * self.row + x as u32;
        let fraction = inside - Vec3::new(x as f32, y as f32, z as f32);
        Place { index, fraction, squared_beyond: beyond.dot(beyond) }
    }

    /// The eight codes around a place, x fastest, then y.
    #[inline(always)]
    pub(super) fn corners<C: Copy + Into<f32>>(&self, codes: &[C], index: u32) -> [f32; 8] {
        let (first, row, layer) = (index as usize, self.row as usize, self.layer as usize);
        let pair = |at: usize| {
            let pair = &codes[at..at + 2];
            [pair[0].into(), pair[1].into()]
        };
        let ([a, b], [c, d]) = (pair(first), pair(first + row));
        let ([e, f], [g, h]) = (pair(first + layer), pair(first + layer + row));
        [a, b, c, d, e, f, g, h]
    }

    /// The distance between eight codes.
    #[inline(always)]
    pub(super) fn interpolate(&self, corners: &[f32; 8], fraction: Vec3, squared_beyond: f32) -> f32 {
        let [a, b, c, d, e, f, g, h] = *corners;
        let near = between(between(a, b, fraction.x), between(c, d, fraction.x), fraction.y);
        let far = between(between(e, f, fraction.x), between(g, h, fraction.x), fraction.y);
        let distance = self.low + self.step * between(near, far, fraction.z);
        let above = distance.max(0.0);
        // A place that is no number has no distance either.
        if squared_beyond == 0.0 { distance } else { (squared_beyond + above * above).sqrt() }
    }
}

#[inline(always)]
fn between(a: f32, b: f32, share: f32) -> f32 {
    a + (b - a) * share
}

/// The grid of a ball of radius 1 around the origin, in closed form.
#[doc(hidden)]
pub fn example_ball() -> DistanceGrid {
    ball_grid(1.0, DistanceGridFormat { voxels: 32, ..DistanceGridFormat::DEFAULT })
}

/// The grid of a ball around the origin, in closed form, for examples and tests.
#[doc(hidden)]
pub fn ball_grid(radius: f32, format: DistanceGridFormat) -> DistanceGrid {
    let header = DistanceGridHeader::around([-radius; 3], [radius; 3], format);
    let distances: Vec<f32> =
        grid_positions(&header).map(|position| (position.length() - f64::from(radius)) as f32 / header.voxel).collect();
    DistanceGrid::from_distances(header, &distances).expect("a sampled ball is a valid grid")
}

/// The points of a grid in mesh space, x fastest, then y.
pub fn grid_positions(header: &DistanceGridHeader) -> impl Iterator<Item = DVec3> + use<> {
    let mesh_from_grid = header.grid_from_mesh().inverse();
    let [nx, ny, nz] = header.points;
    let points = (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
    points.map(move |point| mesh_from_grid.transform_point3(DVec3::from(point.map(f64::from))))
}
