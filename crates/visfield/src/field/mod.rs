//! A visibility field: what it holds, and how rays ask it.
//!
//! [`octahedral`] numbers the cells of a sphere, [`chord`] finds the part of a ray inside the unit sphere, [`lookup`] picks
//! the table entry that stands for a ray, and [`query`] turns it into an answer. Each of their functions has a WGSL twin
//! of the same name in `shaders/field.wgsl`.

pub mod chord;
pub mod lookup;
pub mod octahedral;
pub mod query;

use std::sync::Arc;

use glam::{Affine3A, DAffine3, DVec3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use lookup::TableShape;

/// The code of a chord that meets no surface. Codes below it are fractions of the chord, in steps of 1/[`LAST_HIT_CODE`].
pub const NO_HIT_CODE: u8 = 255;
/// The code of a surface at the very end of the chord.
pub const LAST_HIT_CODE: u8 = 254;

/// Largest side of either octahedral grid of a table. 512⁴ cells would be 64 GiB; real tables stop far below.
pub const MAX_SIDE: u32 = 512;
/// Largest table in bytes. Table positions are `u32` byte offsets on the GPU.
pub const MAX_TABLE_BYTES: u64 = 1 << 30;

/// How a field stores visibility (DESIGN §2, *representation*).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
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
}

/// How one chord's answer is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Encoding {
    /// One byte: 0…254 is the first hit as a fraction of the chord, 255 is no hit. The papers divide the distance by the
    /// sphere's diameter; a fraction uses all levels on every chord and survives affine maps.
    U8,
}

/// The sphere around the mesh that becomes the unit sphere of field space.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BoundingSphere {
    /// Centre, in the mesh's own units and axes.
    pub center: [f32; 3],
    /// Radius, in the mesh's units; finite and positive.
    pub radius: f32,
}

impl BoundingSphere {
    /// The map from mesh space to field space.
    pub fn field_from_mesh(&self) -> DAffine3 {
        let scale = 1.0 / f64::from(self.radius);
        let center = DVec3::from(self.center.map(f64::from));
        DAffine3::from_translation(-center * scale) * DAffine3::from_scale(DVec3::splat(scale))
    }

    fn is_valid(&self) -> bool {
        self.center.iter().all(|c| c.is_finite()) && self.radius.is_finite() && self.radius > 0.0
    }
}

/// What a field is, without its table.
///
/// ```
/// use visfield::{BoundingSphere, Encoding, FieldHeader, Representation};
/// let header = FieldHeader {
///     name: "Mesh0/Primitive0".to_owned(),
///     bounds: BoundingSphere { center: [0.0; 3], radius: 1.0 },
///     representation: Representation::TwoPoint { entries: 65, exits: 32 },
///     encoding: Encoding::U8,
///     triangles: 12,
/// };
/// assert_eq!(header.table_bytes(), 65 * 65 * 32 * 32);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldHeader {
    /// Which mesh of its source file this is, named as Bevy names it: `Mesh0/Primitive0`.
    pub name: String,
    /// The sphere that becomes the unit sphere of field space.
    pub bounds: BoundingSphere,
    /// How visibility is stored.
    pub representation: Representation,
    /// How one chord's answer is stored.
    pub encoding: Encoding,
    /// Number of triangles that were baked.
    pub triangles: u32,
}

impl FieldHeader {
    /// Size of the uncompressed table in bytes, saturating.
    pub fn table_bytes(&self) -> u64 {
        let Representation::TwoPoint { entries, exits } = self.representation;
        let Encoding::U8 = self.encoding;
        let square = |side: u32| u64::from(side).saturating_mul(u64::from(side));
        square(entries).saturating_mul(square(exits))
    }

    /// Checks every number against its documented range.
    ///
    /// # Errors
    /// [`FieldError`] names the first value that is out of range.
    pub fn validate(&self) -> Result<(), FieldError> {
        if !self.bounds.is_valid() {
            return Err(FieldError::Bounds);
        }
        let Representation::TwoPoint { entries, exits } = self.representation;
        for side in [entries, exits] {
            if !(1..=MAX_SIDE).contains(&side) {
                return Err(FieldError::Side { side });
            }
        }
        let bytes = self.table_bytes();
        if bytes > MAX_TABLE_BYTES {
            return Err(FieldError::TooLarge { bytes });
        }
        Ok(())
    }
}

/// Why a header and a table do not make a field.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum FieldError {
    /// The bounding sphere has a non-finite centre, or a radius that is not finite and positive.
    #[error("the bounding sphere needs a finite centre and a finite, positive radius")]
    Bounds,
    /// A grid side is outside 1…[`MAX_SIDE`].
    #[error("grid side {side} is outside 1 to {MAX_SIDE}")]
    Side {
        /// The side asked for.
        side: u32,
    },
    /// The table would be larger than [`MAX_TABLE_BYTES`].
    #[error("a table of {bytes} bytes is over the limit of {MAX_TABLE_BYTES}; choose fewer entries or exits")]
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
/// # let field = visfield::field::example_field(); // a ball of radius 1/2, in field space
/// let head_on = field.first_hit(vec3(-3.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0));
/// assert!((head_on.unwrap() - 2.5).abs() < 0.1);
/// assert_eq!(field.first_hit(vec3(-3.0, 0.9, 0.0), vec3(1.0, 0.0, 0.0)), None);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct VisibilityField {
    header: FieldHeader,
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
        Ok(Self { header, table })
    }

    /// What this field is.
    pub fn header(&self) -> &FieldHeader {
        &self.header
    }

    /// The table, one code per chord: entry cells × exit cells, row-major.
    pub fn table(&self) -> &[u8] {
        &self.table
    }

    /// The sides of the table's two grids.
    pub fn shape(&self) -> TableShape {
        let Representation::TwoPoint { entries, exits } = self.header.representation;
        TableShape { entries, exits }
    }

    /// The map from mesh space to field space.
    pub fn field_from_mesh(&self) -> Affine3A {
        self.header.bounds.field_from_mesh().as_affine3a()
    }
}

/// Stores the first hit at `fraction` of the chord, or none, as one byte.
///
/// ```
/// use visfield::field::{decode_u8, encode_u8};
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
pub fn decode_u8(code: u8) -> Option<f32> {
    (code != NO_HIT_CODE).then(|| f32::from(code) * (1.0 / f32::from(LAST_HIT_CODE)))
}

/// A ball of radius 1/2 around the origin, in closed form, for examples and tests.
#[doc(hidden)]
pub fn example_field() -> VisibilityField {
    ball_field(0.5, 33, 17)
}

/// A centred ball of `radius` < 1 in field space, sampled in closed form.
#[doc(hidden)]
pub fn ball_field(radius: f32, entries: u32, exits: u32) -> VisibilityField {
    let table: Vec<u8> = (0..entries * entries)
        .flat_map(|i| (0..exits * exits).map(move |j| (i, j)))
        .map(|(i, j)| {
            let from = octahedral::octahedral_direction(i, entries);
            let along = octahedral::octahedral_direction(j, exits) - from;
            let (a, b) = (along.length_squared(), from.dot(along));
            let discriminant = b * b - a * (1.0 - radius * radius);
            encode_u8((a > 0.0 && discriminant > 0.0).then(|| (-b - discriminant.sqrt()) / a))
        })
        .collect();
    let header = FieldHeader {
        name: "ball".to_owned(),
        bounds: BoundingSphere { center: [0.0; 3], radius: 1.0 },
        representation: Representation::TwoPoint { entries, exits },
        encoding: Encoding::U8,
        triangles: 0,
    };
    VisibilityField::new(header, table).expect("a sampled ball is a valid field")
}
