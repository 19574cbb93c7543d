//! A visibility field: what it holds, and how rays ask it.
//!
//! [`octahedral`] numbers the cells of a sphere, [`chord`] finds the part of a ray inside the unit sphere, [`lookup`] picks
//! the table entry that stands for a ray, [`encoding`] reads it, and [`query`] turns it into an answer, [`batch`] for many
//! rays at once. What a frame needs of them has a WGSL twin of the same name in `shaders/field.wgsl`. [`hemisphere`] and
//! [`directions`] are the papers' own grid, which other representations are compared with. [`measured`] says what a field
//! was found to get wrong.

pub mod batch;
pub mod cap_grid;
pub mod chord;
pub mod directions;
pub mod encoding;
pub mod hemisphere;
pub(crate) mod lanes;
pub mod lookup;
pub mod measured;
pub mod octahedral;
pub mod query;

use std::fmt;
use std::sync::Arc;

use glam::{Affine3A, DAffine3, DMat3, DVec3, Vec3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use encoding::Encoding;

use directions::DirectionMap;
use encoding::{Block, Codes};
use hemisphere::HemisphereGrid;
use lookup::{ChordGrid, Grid, TwoPointGrid};
use measured::Measured;

/// Largest side of either octahedral grid of a table. 512⁴ cells would be 64 GiB; real tables stop far below.
pub const MAX_SIDE: u32 = 512;
/// Largest table in bytes. Table positions are `u32` byte offsets on the GPU.
pub const MAX_TABLE_BYTES: u64 = 1 << 30;

/// How a field stores visibility (DESIGN §2, *representation*).
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

/// The ellipsoid around the mesh that becomes the unit sphere of field space.
///
/// ```
/// use visfield::BoundingEllipsoid;
/// let stretched = BoundingEllipsoid { center: [0.0; 3], axes: [[1.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, 0.0, 1.0]] };
/// assert_eq!(stretched.sphere_radius(), None);
/// assert_eq!(BoundingEllipsoid::sphere([0.0; 3], 2.0).sphere_radius(), Some(2.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BoundingEllipsoid {
    /// Centre, in the mesh's own units and axes.
    pub center: [f32; 3],
    /// Three vectors from the centre to the surface, linearly independent, in the mesh's units: where the axes of field space
    /// go. They need not be orthogonal.
    pub axes: [[f32; 3]; 3],
}

impl BoundingEllipsoid {
    /// A sphere, whose field space has the mesh's axes.
    pub const fn sphere(center: [f32; 3], radius: f32) -> Self {
        Self { center, axes: [[radius, 0.0, 0.0], [0.0, radius, 0.0], [0.0, 0.0, radius]] }
    }

    /// The radius if this is a [`sphere`](Self::sphere).
    pub fn sphere_radius(&self) -> Option<f32> {
        let radius = self.axes[0][0];
        (*self == Self::sphere(self.center, radius)).then_some(radius)
    }

    /// The map from field space to mesh space.
    pub fn mesh_from_field(&self) -> DAffine3 {
        let vector = |v: [f32; 3]| DVec3::from(v.map(f64::from));
        DAffine3 {
            matrix3: DMat3::from_cols(vector(self.axes[0]), vector(self.axes[1]), vector(self.axes[2])),
            translation: vector(self.center),
        }
    }

    /// The map from mesh space to field space.
    pub fn field_from_mesh(&self) -> DAffine3 {
        self.mesh_from_field().inverse()
    }

    fn is_valid(&self) -> bool {
        let axes = self.axes.as_flattened();
        let largest = axes.iter().fold(0.0_f32, |largest, x| largest.max(x.abs()));
        if !(self.center.iter().chain(axes).all(|x| x.is_finite()) && largest > 0.0) {
            return false;
        }
        // Relative to the size, so that tiny meshes are not taken for flat ones.
        let shape = self.mesh_from_field().matrix3 * (1.0 / f64::from(largest));
        shape.determinant().abs() > FLATTEST
    }
}

/// Relative volume below which an ellipsoid counts as flat: far below what any bake makes, and far above rounding.
const FLATTEST: f64 = 1.0e-18;

/// What a field is, without its table.
///
/// ```
/// use visfield::{BoundingEllipsoid, Encoding, FieldHeader, Representation};
/// let header = FieldHeader {
///     name: "Mesh0/Primitive0".to_owned(),
///     bounds: BoundingEllipsoid::sphere([0.0; 3], 1.0),
///     representation: Representation::TwoPoint { entries: 65, exits: 32 },
///     encoding: Encoding::U8,
///     triangles: 12,
///     measured: Vec::new(),
/// };
/// assert_eq!(header.table_bytes(), 65 * 65 * 32 * 32);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldHeader {
    /// Which mesh of its source file this is, named as Bevy names it: `Mesh0/Primitive0`.
    pub name: String,
    /// The ellipsoid that becomes the unit sphere of field space.
    pub bounds: BoundingEllipsoid,
    /// How visibility is stored.
    pub representation: Representation,
    /// How one chord's answer is stored.
    pub encoding: Encoding,
    /// Number of triangles that were baked.
    pub triangles: u32,
    /// What the field was measured to get wrong; empty if it was not measured.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub measured: Vec<Measured>,
}

impl FieldHeader {
    /// Size of the uncompressed table in bytes, saturating; 0 if the representation is not valid.
    pub fn table_bytes(&self) -> u64 {
        self.representation
            .grid()
            .map_or(0, |grid| self.encoding.table_bytes(grid.starts().into(), grid.chords_per_start().into()))
    }

    /// Checks every number against its documented range.
    ///
    /// # Errors
    /// [`FieldError`] names the first value that is out of range.
    pub fn validate(&self) -> Result<(), FieldError> {
        if !self.bounds.is_valid() {
            return Err(FieldError::Bounds);
        }
        if !self.measured.iter().all(Measured::is_finite) {
            return Err(FieldError::Measured);
        }
        let grid = self.representation.grid()?;
        let chords = u64::from(grid.starts()) * u64::from(grid.chords_per_start());
        let bytes = self.table_bytes();
        // Positions in the table are u32 in the shader and in lookups.
        if bytes > MAX_TABLE_BYTES || chords > u64::from(u32::MAX) {
            return Err(FieldError::TooLarge { bytes });
        }
        Ok(())
    }
}

/// Why a header and a table do not make a field.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum FieldError {
    /// The bounding ellipsoid has a number that is not finite, or no volume.
    #[error("the bounding ellipsoid needs a finite centre and three finite axes that span a volume")]
    Bounds,
    /// A grid side is outside 1…[`MAX_SIDE`].
    #[error("grid side {side} is outside 1 to {MAX_SIDE}")]
    Side {
        /// The side asked for.
        side: u32,
    },
    /// A cap grid has too few or too many points.
    #[error("a cap grid of {points} points along each axis is outside {} to {}", cap_grid::MIN_POINTS, cap_grid::MAX_POINTS)]
    CapPoints {
        /// The number asked for.
        points: u32,
    },
    /// A cap grid's header has a number that is not finite or out of range, or too few of them.
    #[error("the cap grid's box, falloff or value ranges are not finite, or out of range")]
    CapGrid,
    /// Something that was measured is not finite.
    #[error("what was measured of the field has a number that is not finite")]
    Measured,
    /// No number of rings makes this number of positions.
    #[error("{positions} positions are none of 290, 1090, 4226 and 16642, nor another (2n + 1)² + 1 below 512²")]
    Positions {
        /// The number asked for.
        positions: u32,
    },
    /// The table would be larger than [`MAX_TABLE_BYTES`], or have more chords than a `u32` can number.
    #[error(
        "a table of {bytes} bytes has over {} bytes or {} chords; choose fewer entries or exits",
        MAX_TABLE_BYTES,
        u32::MAX
    )]
    TooLarge {
        /// The size asked for, in bytes.
        bytes: u64,
    },
    /// The table's length is not what the header says.
    #[error("the table holds {found} bytes but its header says {expected}")]
    TableLength {
        /// Bytes that the header asks for.
        expected: u64,
        /// Bytes that are there.
        found: u64,
    },
}

/// Baked visibility of one rigid mesh. Cheap to clone: the table is shared.
///
/// ```
/// use glam::vec3;
/// use visfield::{Ray, field::query::QueryOptions};
/// # let field = visfield::field::example_field(); // a ball of radius 1/2, in field space
/// let hit = |height| field.hit(&Ray::new(vec3(-3.0, height, 0.0), vec3(1.0, 0.0, 0.0)), &QueryOptions::default());
/// assert!((hit(0.0).unwrap() - 2.5).abs() < 0.1);
/// assert_eq!(hit(0.9), None);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct VisibilityField {
    header: FieldHeader,
    grid: Grid,
    table: Arc<[u8]>,
}

impl VisibilityField {
    /// Joins a header and the table it describes.
    ///
    /// # Errors
    /// [`FieldError`] if a number is out of range or the table's length is not [`FieldHeader::table_bytes`].
    pub fn new(header: FieldHeader, table: impl Into<Arc<[u8]>>) -> Result<Self, FieldError> {
        header.validate()?;
        let table = table.into();
        let (expected, found) = (header.table_bytes(), table.len() as u64);
        if expected != found {
            return Err(FieldError::TableLength { expected, found });
        }
        let grid = header.representation.grid()?;
        Ok(Self { header, grid, table })
    }

    /// Makes a field by asking for the first hit of every chord. `fill` is given the blocks of the table, and
    /// [fills](Block::fill) each of them, in any order or in parallel.
    ///
    /// ```
    /// # let header = visfield::field::example_field().header().clone();
    /// // The half-space z < 0.
    /// let first_hit = |from: glam::Vec3, to: glam::Vec3| match (from.z < 0.0, to.z < 0.0) {
    ///     (true, _) => Some(0.0),
    ///     (false, true) => Some(from.z / (from.z - to.z)),
    ///     (false, false) => None,
    /// };
    /// let field = visfield::VisibilityField::sample(header, |blocks| {
    ///     blocks.into_iter().for_each(|mut block| block.fill(first_hit));
    /// })?;
    /// assert_eq!(field.table().len() as u64, field.header().table_bytes());
    /// # Ok::<(), visfield::FieldError>(())
    /// ```
    ///
    /// # Errors
    /// [`FieldError`] if a number of the header is out of range; then nothing is asked for.
    pub fn sample(header: FieldHeader, fill: impl FnOnce(Vec<Block<'_>>)) -> Result<Self, FieldError> {
        header.validate()?;
        let mut table = vec![0; header.table_bytes() as usize];
        fill(encoding::blocks(header.representation.grid()?, header.encoding, &mut table).collect());
        Self::new(header, table)
    }

    /// The same chords in another encoding, without what was measured. From a coarse encoding this makes no finer one: what was
    /// rounded stays rounded.
    ///
    /// ```
    /// # let field = visfield::field::example_field();
    /// use visfield::Encoding;
    /// let bits = field.with_encoding(Encoding::Bit)?;
    /// assert!(bits.table().len() * 7 < field.table().len());
    /// assert!((0..1000).all(|chord| bits.codes().fraction(chord).is_some() == field.codes().fraction(chord).is_some()));
    /// # Ok::<(), visfield::FieldError>(())
    /// ```
    ///
    /// # Errors
    /// [`FieldError`] if the table would be too large.
    pub fn with_encoding(&self, encoding: Encoding) -> Result<Self, FieldError> {
        let header = FieldHeader { encoding, measured: Vec::new(), ..self.header.clone() };
        Self::sample(header, |blocks| blocks.into_iter().for_each(|mut block| block.copy(&self.codes())))
    }

    /// The same field, with what it was measured to get wrong in its header.
    ///
    /// ```
    /// # let field = visfield::field::example_field();
    /// use visfield::field::measured::{Measured, MeasuredScene, Purpose};
    /// let purpose = Purpose::Shadows { angular_radius: 0.05 };
    /// let measured = Measured { purpose, scene: MeasuredScene::Corner, rays: 64, rms_255: 20.0, mean_abs: 0.05 };
    /// assert_eq!(field.with_measured(vec![measured])?.header().measured, [measured]);
    /// # Ok::<(), visfield::FieldError>(())
    /// ```
    ///
    /// # Errors
    /// [`FieldError::Measured`] if a number is not finite.
    pub fn with_measured(mut self, measured: Vec<Measured>) -> Result<Self, FieldError> {
        self.header.measured = measured;
        self.header.validate()?;
        Ok(self)
    }

    /// What this field is.
    pub fn header(&self) -> &FieldHeader {
        &self.header
    }

    /// The table as it is stored: codes, start by start, and for bits the means behind them (see [`Encoding`]).
    pub fn table(&self) -> &[u8] {
        &self.table
    }

    /// The table, decoded chord by chord.
    #[inline(always)]
    pub fn codes(&self) -> Codes<'_> {
        Codes::new(self.header.encoding, &self.table, self.grid.starts(), self.grid.chords_per_start())
    }

    /// The chords that the table stores.
    #[inline(always)]
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// The map from mesh space to field space.
    pub fn field_from_mesh(&self) -> Affine3A {
        self.header.bounds.field_from_mesh().as_affine3a()
    }
}

/// A ball of radius 1/2 around the origin, in closed form, for examples and tests.
#[doc(hidden)]
pub fn example_field() -> VisibilityField {
    ball_field(0.5, 33, 17)
}

/// A centred ball of `radius` < 1 in field space, on a two-point grid of bytes.
#[doc(hidden)]
pub fn ball_field(radius: f32, entries: u32, exits: u32) -> VisibilityField {
    ball(radius, Representation::TwoPoint { entries, exits }, Encoding::U8)
}

/// A centred ball of `radius` < 1 in field space, sampled in closed form.
#[doc(hidden)]
pub fn ball(radius: f32, representation: Representation, encoding: Encoding) -> VisibilityField {
    let header = FieldHeader {
        name: "ball".to_owned(),
        bounds: BoundingEllipsoid::sphere([0.0; 3], 1.0),
        representation,
        encoding,
        triangles: 0,
        measured: Vec::new(),
    };
    let first_hit = |from: Vec3, to: Vec3| {
        let along = to - from;
        let (a, b) = (along.length_squared(), from.dot(along));
        let discriminant = b * b - a * (1.0 - radius * radius);
        (a > 0.0 && discriminant > 0.0).then(|| (-b - discriminant.sqrt()) / a)
    };
    VisibilityField::sample(header, |blocks| blocks.into_iter().for_each(|mut block| block.fill(first_hit)))
        .expect("a sampled ball is a valid field")
}
