//! A visibility field: what it holds, and how rays ask it.
//!
//! A field is a header and optional parts. Its [`table`] answers rays: [`octahedral`] numbers the cells of a sphere,
//! [`chord`] finds the part of a ray inside the unit sphere, [`lookup`] picks the table entry that stands for a ray,
//! [`encoding`] reads it, and [`query`] turns it into an answer, [`batch`] for many rays at once. What a frame needs of them
//! has a WGSL twin of the same name in `shaders/field.wgsl`. [`hemisphere`] and [`directions`] are the papers' own grid, which
//! other representations are compared with. [`measured`] says what a field was found to get wrong.

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
mod rays;
pub mod table;

use glam::{Affine3A, DAffine3, DMat3, DVec3, Vec3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use cap_grid::{CapGrid, CapGridFormat};
pub use encoding::Encoding;
pub use table::{ChordTable, MAX_SIDE, MAX_TABLE_BYTES, Representation, TableFormat};

use crate::distance::{DistanceField, DistanceGrid, MAX_VOXELS, MIN_VOXELS, Solid};
use crate::shape::{Shape, ShapeError};
use measured::Measured;

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

/// What a field tells of its mesh, whatever its parts.
///
/// ```
/// use visfield::{BoundingEllipsoid, FieldHeader};
/// let header = FieldHeader {
///     name: "Mesh0/Primitive0".to_owned(),
///     bounds: BoundingEllipsoid::sphere([0.0; 3], 1.0),
///     triangles: 12,
///     measured: Vec::new(),
/// };
/// assert_eq!(header.validate(), Ok(()));
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldHeader {
    /// Which mesh of its source file this is, named as Bevy names it: `Mesh0/Primitive0`.
    pub name: String,
    /// The ellipsoid that becomes the unit sphere of field space.
    pub bounds: BoundingEllipsoid,
    /// Number of triangles that were baked.
    pub triangles: u32,
    /// What the field was measured to get wrong; empty if it was not measured.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub measured: Vec<Measured>,
}

impl FieldHeader {
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
        Ok(())
    }
}

/// What a field can hold of its mesh. Each part is there or not, and serves queries of its own.
///
/// ```
/// # let field = visfield::field::example_field();
/// let parts = visfield::FieldParts::from(field.table().unwrap().clone());
/// assert_eq!(&parts, field.parts());
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FieldParts {
    /// Answers rays.
    pub table: Option<ChordTable>,
    /// Answers ambient occlusion, without rays.
    pub cap_grid: Option<CapGrid>,
    /// Answers rays: all of them, or beside a table those that start inside the bounds. Gives soft shadows without rays.
    pub distance: Option<DistanceField>,
}

impl From<ChordTable> for FieldParts {
    /// A table alone.
    fn from(table: ChordTable) -> Self {
        Self { table: Some(table), ..Self::default() }
    }
}

impl From<CapGrid> for FieldParts {
    /// A cap grid alone.
    fn from(cap_grid: CapGrid) -> Self {
        Self { cap_grid: Some(cap_grid), ..Self::default() }
    }
}

impl From<DistanceGrid> for FieldParts {
    /// A distance grid alone.
    fn from(grid: DistanceGrid) -> Self {
        Self { distance: Some(grid.into()), ..Self::default() }
    }
}

impl FieldParts {
    /// Size of all parts in memory, in bytes.
    pub fn bytes(&self) -> u64 {
        let table = self.table.as_ref().map_or(0, |table| table.format().bytes());
        let cap_grid = self.cap_grid.as_ref().map_or(0, |grid| grid.header().format.bytes());
        table + cap_grid + self.distance.as_ref().map_or(0, DistanceField::bytes)
    }

    fn is_empty(&self) -> bool {
        self.table.is_none() && self.cap_grid.is_none() && self.distance.is_none()
    }
}

/// Why a header and parts do not make a field.
#[derive(Clone, Debug, PartialEq, Error)]
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
    #[error(
        "a cap grid of {points} points along each axis is outside {} to {}",
        cap_grid::MIN_POINTS,
        cap_grid::MAX_POINTS
    )]
    CapPoints {
        /// The number asked for.
        points: u32,
    },
    /// A cap grid has a number that is not finite or out of range, or its header too few of them.
    #[error("the cap grid's box, falloff, value ranges or values are not finite, or out of range")]
    CapGrid,
    /// A distance grid has too few or too many points.
    #[error("a distance grid of {voxels} voxels along its longest axis is outside {MIN_VOXELS} to {MAX_VOXELS}")]
    Voxels {
        /// The number asked for.
        voxels: u32,
    },
    /// A distance grid has a number that is not finite or out of range.
    #[error("the distance grid's points, place or distances are not finite, or out of range")]
    DistanceGrid,
    /// A shape cannot be evaluated.
    #[error(transparent)]
    Shape(#[from] ShapeError),
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
    /// The length of a table or of a cap grid is not what its format says.
    #[error("there are {found} bytes where the format of the part says {expected}")]
    TableLength {
        /// Bytes that the format asks for.
        expected: u64,
        /// Bytes that are there.
        found: u64,
    },
    /// There is no part.
    #[error("a field needs a part that answers something; give it a table, a cap grid, a distance grid or a shape")]
    Empty,
}

/// Baked visibility of one rigid mesh: a header, and at least one part. Cheap to clone: the parts are shared.
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
    parts: FieldParts,
    /// From field space to that of the distances, if there are any.
    distance_from_field: Option<Affine3A>,
}

impl VisibilityField {
    /// Joins a header and what was baked.
    ///
    /// ```
    /// # let header = visfield::field::example_field().header().clone();
    /// use visfield::{FieldError, FieldParts, VisibilityField};
    /// assert_eq!(VisibilityField::new(header, FieldParts::default()), Err(FieldError::Empty));
    /// ```
    ///
    /// # Errors
    /// [`FieldError`] if a number of the header is out of range, or if there is no part.
    pub fn new(header: FieldHeader, parts: FieldParts) -> Result<Self, FieldError> {
        header.validate()?;
        if parts.is_empty() {
            return Err(FieldError::Empty);
        }
        let mesh_from_field = header.bounds.mesh_from_field();
        let distance_from_field =
            parts.distance.as_ref().map(|distance| (distance.distance_from_mesh() * mesh_from_field).as_affine3a());
        let usable = |map: Affine3A| map.is_finite() && map.matrix3.determinant() != 0.0;
        if !distance_from_field.is_none_or(usable) {
            return Err(FieldError::DistanceGrid);
        }
        Ok(Self { header, parts, distance_from_field })
    }

    /// The field of a shape: it needs no baking. Its space is the shape's own.
    ///
    /// ```
    /// use glam::Vec3;
    /// use visfield::shape::Shape;
    /// use visfield::{QueryOptions, Ray, VisibilityField};
    /// let crate_of_2 = VisibilityField::of_shape(Shape::Box { half_extents: [1.0; 3] })?;
    /// let ahead = Ray::new(crate_of_2.field_from_mesh().transform_point3(Vec3::X * -9.0), Vec3::X);
    /// assert!(crate_of_2.occluded(&ahead, &QueryOptions::default()));
    /// # Ok::<(), visfield::FieldError>(())
    /// ```
    ///
    /// # Errors
    /// [`FieldError::Shape`] if it [cannot be evaluated](Shape::validate).
    pub fn of_shape(shape: Shape) -> Result<Self, FieldError> {
        let solid = Solid::new(shape)?;
        let header =
            FieldHeader { name: "shape".to_owned(), bounds: solid.sphere(), triangles: 0, measured: Vec::new() };
        Self::new(header, FieldParts { distance: Some(solid.into()), ..FieldParts::default() })
    }

    /// The same field with another table of its mesh, without what was measured.
    ///
    /// ```
    /// # let field = visfield::field::example_field();
    /// use visfield::Encoding;
    /// let bits = field.table().unwrap().with_encoding(Encoding::Bit)?;
    /// let smaller = field.clone().with_table(bits);
    /// assert!(smaller.bytes() < field.bytes());
    /// # Ok::<(), visfield::FieldError>(())
    /// ```
    #[must_use]
    pub fn with_table(mut self, table: ChordTable) -> Self {
        self.header.measured.clear();
        self.parts.table = Some(table);
        self
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

    /// What it tells of its mesh.
    pub fn header(&self) -> &FieldHeader {
        &self.header
    }

    /// What it holds.
    pub fn parts(&self) -> &FieldParts {
        &self.parts
    }

    /// The part that answers rays, if it has one.
    #[inline(always)]
    pub fn table(&self) -> Option<&ChordTable> {
        self.parts.table.as_ref()
    }

    /// The part that answers ambient occlusion without rays, if it has one.
    pub fn cap_grid(&self) -> Option<&CapGrid> {
        self.parts.cap_grid.as_ref()
    }

    /// The part that knows distances, if it has one.
    #[inline(always)]
    pub fn distance_field(&self) -> Option<&DistanceField> {
        self.parts.distance.as_ref()
    }

    /// The map from field space to that of the [distances](Self::distance_field), if there are any.
    pub fn distance_from_field(&self) -> Option<Affine3A> {
        self.distance_from_field
    }

    /// Size of all its parts in memory, in bytes.
    pub fn bytes(&self) -> u64 {
        self.parts.bytes()
    }

    /// The map from mesh space to field space.
    pub fn field_from_mesh(&self) -> Affine3A {
        self.header.bounds.field_from_mesh().as_affine3a()
    }

    /// The map from field space to that of the cap grid, if there is one.
    pub fn cap_from_field(&self) -> Option<Affine3A> {
        let cap_from_mesh = self.cap_grid()?.header().cap_space().field_from_mesh();
        Some((cap_from_mesh * self.header.bounds.mesh_from_field()).as_affine3a())
    }
}

/// The cap grid of a ball of radius 1 around the origin, and no table.
#[doc(hidden)]
pub fn example_caps() -> VisibilityField {
    let header = FieldHeader {
        name: "ball".to_owned(),
        bounds: BoundingEllipsoid::sphere([0.0; 3], 1.0),
        triangles: 0,
        measured: Vec::new(),
    };
    VisibilityField::new(header, cap_grid::example_ball().into()).expect("a ball's grid makes a valid field")
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
        triangles: 0,
        measured: Vec::new(),
    };
    let first_hit = |from: Vec3, to: Vec3| {
        let along = to - from;
        let (a, b) = (along.length_squared(), from.dot(along));
        let discriminant = b * b - a * (1.0 - radius * radius);
        (a > 0.0 && discriminant > 0.0).then(|| (-b - discriminant.sqrt()) / a)
    };
    let format = TableFormat { representation, encoding };
    ChordTable::sample(format, |blocks| blocks.into_iter().for_each(|mut block| block.fill(first_hit)))
        .and_then(|table| VisibilityField::new(header, table.into()))
        .expect("a sampled ball is a valid field")
}
