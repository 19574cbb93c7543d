//! Traces what a field stores.

use std::fmt;

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use thiserror::Error;
use visfield::distance::{DistanceField, DistanceGridFormat};
use visfield::field::encoding::Block;
use visfield::{
    BoundingEllipsoid, CapGridFormat, ChordTable, Encoding, FieldError, FieldHeader, FieldParts, Representation,
    TableFormat, VisibilityField,
};

use crate::bounds::{BoundsKind, bounds_of};
use crate::cap_grid::{self, bake_cap_grid};
use crate::distance::bake_distance_grid;
use crate::mesh::{Mesh, MeshError};
use crate::triangles::TriangleBvh;

/// How a mesh is baked: what its field stores of it.
///
/// ```
/// use visfield::{Encoding, Representation, TableFormat};
/// use visfield_bake::{BakeSettings, BoundsKind};
/// let representation = Representation::TwoPoint { entries: 33, exits: 64 };
/// let settings = BakeSettings {
///     table: Some(TableFormat { representation, encoding: Encoding::Bit }),
///     bounds: BoundsKind::Ellipsoid,
///     cap_grid: None,
///     distance: None,
/// };
/// assert_eq!(settings.rays(), 33 * 33 * 64 * 64);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BakeSettings {
    /// What becomes the unit sphere of field space.
    pub bounds: BoundsKind,
    /// The table that answers rays; without one the field answers none.
    pub table: Option<TableFormat>,
    /// The grid that answers ambient occlusion without rays.
    pub cap_grid: Option<CapGridFormat>,
    /// The grid of distances, which answers rays: all of them, or beside a table those that start inside the bounds.
    pub distance: Option<DistanceGridFormat>,
}

impl Default for BakeSettings {
    /// A cap grid of 16 KiB, and a table of 4.3 million chords, 4.3 MB before compression: 2010's 4226 × 32² maps (DESIGN §7).
    /// An odd side of the entries puts cell centres on the axes.
    fn default() -> Self {
        Self { cap_grid: Some(CapGridFormat::DEFAULT), ..Self::two_point(65, 32) }
    }
}

impl fmt::Display for BakeSettings {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let bounds = match self.bounds {
            BoundsKind::Sphere => "sphere",
            BoundsKind::Ellipsoid => "ellipsoid",
        };
        if let Some(table) = &self.table {
            write!(f, "{table}, {bounds}")?;
        }
        let between = if self.table.is_some() { "; " } else { "" };
        self.cap_grid.iter().try_for_each(|grid| write!(f, "{between}caps {grid}"))?;
        let between = if self.table.is_some() || self.cap_grid.is_some() { "; " } else { "" };
        self.distance.iter().try_for_each(|grid| write!(f, "{between}distances {grid}"))
    }
}

impl BakeSettings {
    /// A two-point table of bytes in a bounding sphere.
    pub const fn two_point(entries: u32, exits: u32) -> Self {
        let representation = Representation::TwoPoint { entries, exits };
        Self::of_table(TableFormat { representation, encoding: Encoding::U8 }, BoundsKind::Sphere)
    }

    /// A cap grid and nothing else.
    pub const fn of_cap_grid(cap_grid: CapGridFormat) -> Self {
        Self { bounds: BoundsKind::Sphere, table: None, cap_grid: Some(cap_grid), distance: None }
    }

    /// A table and nothing else.
    pub const fn of_table(table: TableFormat, bounds: BoundsKind) -> Self {
        Self { bounds, table: Some(table), cap_grid: None, distance: None }
    }

    /// A distance grid and nothing else.
    pub const fn of_distance(distance: DistanceGridFormat) -> Self {
        Self { bounds: BoundsKind::Sphere, table: None, cap_grid: None, distance: Some(distance) }
    }

    /// Number of rays that a bake traces: one per chord of the table, and up to so many for a cap grid; and of points
    /// of a distance grid, up to so many. 0 if the settings are out of range.
    pub fn rays(&self) -> u64 {
        if self.validate().is_err() {
            return 0;
        }
        let points = self.distance.map_or(0, |grid| u64::from(grid.voxels).pow(3));
        self.table.map_or(0, |table| table.chords()) + self.cap_grid.as_ref().map_or(0, cap_grid::rays) + points
    }

    /// Checks every number against its documented range, and that there is something to bake.
    ///
    /// ```
    /// use visfield::FieldError;
    /// use visfield_bake::BakeSettings;
    /// assert_eq!(BakeSettings::default().validate(), Ok(()));
    /// let nothing = BakeSettings { table: None, cap_grid: None, ..BakeSettings::default() };
    /// assert_eq!(nothing.validate(), Err(FieldError::Empty));
    /// ```
    ///
    /// # Errors
    /// [`FieldError`] names the first value that is out of range.
    pub fn validate(&self) -> Result<(), FieldError> {
        if self.table.is_none() && self.cap_grid.is_none() && self.distance.is_none() {
            return Err(FieldError::Empty);
        }
        self.table.as_ref().map_or(Ok(()), TableFormat::validate)?;
        self.cap_grid.as_ref().map_or(Ok(()), CapGridFormat::validate)?;
        self.distance.as_ref().map_or(Ok(()), DistanceGridFormat::validate)
    }
}

/// Why a bake was refused.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum BakeError {
    /// The mesh cannot be baked.
    #[error("{name}: {source}")]
    Mesh {
        /// The mesh's name.
        name: String,
        /// What is wrong with it.
        source: MeshError,
    },
    /// A setting is out of range.
    #[error("these settings cannot be baked: {0}")]
    Settings(#[from] FieldError),
    /// What is measured is the table, and the field has none.
    #[error("{name}: there is no table to measure; bake the field with one, as `--representation two-point` does")]
    NoTable {
        /// The field's name.
        name: String,
    },
}

/// Bakes a mesh. Uses all threads of rayon's pool; the result does not depend on their number.
///
/// Each chord of the table goes from the centre of an entry cell to the centre of an exit cell; what is stored is the first
/// hit as a fraction of it. `progress` is called now and then, from any thread, with the number of rays traced since the last
/// call; the sum is at most [`BakeSettings::rays`], and no less for a table alone.
///
/// ```
/// use visfield_bake::{BakeError, BakeSettings, Mesh, MeshError, bake};
/// let nothing = Mesh { name: "Mesh0/Primitive0".to_owned(), ..Mesh::default() };
/// let error = bake(&nothing, &BakeSettings::default(), |_rays| ()).unwrap_err();
/// assert!(matches!(error, BakeError::Mesh { source: MeshError::NoTriangles, .. }));
/// ```
///
/// # Errors
/// [`BakeError`] if the settings or the mesh cannot be baked. Settings are checked before anything is traced.
pub fn bake(mesh: &Mesh, settings: &BakeSettings, progress: impl Fn(u64) + Sync) -> Result<VisibilityField, BakeError> {
    let mesh_error = |source| BakeError::Mesh { name: mesh.name.clone(), source };
    // Before anything that takes time.
    settings.validate()?;
    let solid = mesh.solid_triangles().map_err(mesh_error)?;
    let header = FieldHeader {
        name: mesh.name.clone(),
        bounds: bounds_of(&solid, settings.bounds).map_err(mesh_error)?,
        triangles: u32::try_from(solid.len()).unwrap_or(u32::MAX),
        measured: Vec::new(),
    };
    header.validate()?;

    let table = settings.table.map(|format| bake_table(&solid, &header.bounds, format, &progress)).transpose()?;
    let cap_grid = settings.cap_grid.map(|format| bake_cap_grid(&solid, format, &progress)).transpose()?;
    let distance = settings.distance.map(|format| bake_distance_grid(&solid, format, &progress)).transpose()?;
    Ok(VisibilityField::new(header, FieldParts { table, cap_grid, distance: distance.map(DistanceField::Grid) })?)
}

/// The table of triangles in mesh space.
fn bake_table(
    triangles: &[[DVec3; 3]],
    bounds: &BoundingEllipsoid,
    format: TableFormat,
    progress: &(impl Fn(u64) + Sync),
) -> Result<ChordTable, FieldError> {
    let field_from_mesh = bounds.field_from_mesh();
    let in_field: Vec<_> = triangles.iter().map(|t| t.map(|p| field_from_mesh.transform_point3(p))).collect();
    let triangles = TriangleBvh::new(&in_field);
    let trace = |mut block: Block| {
        block.fill(|start, end| first_hit_fraction(&triangles, start, end));
        progress(block.chords());
    };
    ChordTable::sample(format, |blocks| blocks.into_par_iter().for_each(trace))
}

/// The table of a field, for what measures tables.
pub(crate) fn table_of(field: &VisibilityField) -> Result<&ChordTable, BakeError> {
    field.table().ok_or_else(|| BakeError::NoTable { name: field.header().name.clone() })
}

/// Length of the chords below which both ends count as the same point. Such a chord touches the sphere and nothing inside.
const SHORTEST_CHORD: f32 = 1.0e-4;

/// Where along the chord the first surface is met, from 0 at its start to 1 at its end.
fn first_hit_fraction(triangles: &TriangleBvh, start: Vec3, end: Vec3) -> Option<f32> {
    let chord = end - start;
    // The chord itself is the direction, so that the ray parameter is the fraction.
    (chord.length_squared() > SHORTEST_CHORD * SHORTEST_CHORD).then(|| triangles.closest_hit(start, chord, 1.0))?
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    fn tetrahedron() -> Mesh {
        Mesh {
            name: "tetrahedron".to_owned(),
            positions: vec![[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0]],
            indices: vec![[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]],
        }
    }

    #[test]
    fn progress_adds_up_and_threads_do_not_matter() {
        let settings = BakeSettings::two_point(9, 7);
        let rays = AtomicU64::new(0);
        let count = |n| {
            rays.fetch_add(n, Ordering::Relaxed);
        };
        let field = bake(&tetrahedron(), &settings, count).unwrap();
        assert_eq!(rays.into_inner(), settings.rays());
        let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(one_thread.install(|| bake(&tetrahedron(), &settings, |_| ())).unwrap(), field);
    }

    #[test]
    fn a_chord_with_one_end_twice_meets_nothing() {
        let field = bake(&tetrahedron(), &BakeSettings::two_point(5, 5), |_| ()).unwrap();
        let table = field.table().unwrap().bytes();
        for cell in 0..25 {
            assert_eq!(table[cell * 25 + cell], visfield::field::encoding::NO_HIT_CODE);
        }
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        for (entries, exits) in [(0, 32), (65, 0), (513, 1), (1, 513), (512, 512)] {
            let error = bake(&tetrahedron(), &BakeSettings::two_point(entries, exits), |_| ()).unwrap_err();
            assert!(matches!(error, BakeError::Settings(_)), "{entries} and {exits}: {error}");
        }
    }

    #[test]
    fn settings_without_a_part_are_refused_before_the_mesh_is_looked_at() {
        let settings = BakeSettings { table: None, cap_grid: None, ..BakeSettings::default() };
        assert_eq!(bake(&Mesh::default(), &settings, |_| ()), Err(BakeError::Settings(FieldError::Empty)));
        assert_eq!((settings.rays(), settings.to_string()), (0, String::new()));
        assert_eq!(
            BakeSettings::default().to_string(),
            "65\u{b2} \u{d7} 32\u{b2} in u8, sphere; caps 16\u{b3} in rgba8"
        );
    }
}
