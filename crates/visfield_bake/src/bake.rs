//! Traces every chord of a table.

use glam::Vec3;
use rayon::prelude::*;
use thiserror::Error;
use visfield::field::encode_u8;
use visfield::field::octahedral::octahedral_direction;
use visfield::{Encoding, FieldError, FieldHeader, Representation, VisibilityField};

use crate::bounds::enclosing_sphere;
use crate::mesh::{Mesh, MeshError};
use crate::triangles::TriangleBvh;

/// How fine a mesh is baked.
///
/// ```
/// let settings = visfield_bake::BakeSettings { exits: 64, ..Default::default() };
/// assert_eq!(settings.rays(), 65 * 65 * 64 * 64);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BakeSettings {
    /// Side of the grid of chord entries, 1 to [`MAX_SIDE`](visfield::field::MAX_SIDE). An odd side puts cell centres on the
    /// axes.
    pub entries: u32,
    /// Side of the grid of chord exits, 1 to [`MAX_SIDE`](visfield::field::MAX_SIDE).
    pub exits: u32,
}

impl Default for BakeSettings {
    /// 4.3 million chords, 4.3 MB before compression: 2010's 4226 × 32² maps (DESIGN §7).
    fn default() -> Self {
        Self { entries: 65, exits: 32 }
    }
}

impl BakeSettings {
    /// Number of rays that a bake traces, one per chord and byte of the table; saturating.
    pub fn rays(&self) -> u64 {
        let square = |side: u32| u64::from(side).saturating_mul(u64::from(side));
        square(self.entries).saturating_mul(square(self.exits))
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
}

/// Bakes a mesh. Uses all threads of rayon's pool; the result does not depend on their number.
///
/// Each chord goes from the centre of an entry cell to the centre of an exit cell; what is stored is the first hit as a
/// fraction of it. `progress` is called now and then, from any thread, with the number of rays traced since the last call;
/// the sum is [`BakeSettings::rays`].
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
    let BakeSettings { entries, exits } = *settings;
    let mut solid = mesh.solid_triangles().map_err(mesh_error)?;
    let header = FieldHeader {
        name: mesh.name.clone(),
        bounds: enclosing_sphere(&solid).map_err(mesh_error)?,
        representation: Representation::TwoPoint { entries, exits },
        encoding: Encoding::U8,
        triangles: u32::try_from(solid.len()).unwrap_or(u32::MAX),
    };
    header.validate()?;

    let field_from_mesh = header.bounds.field_from_mesh();
    solid.iter_mut().flatten().for_each(|corner| *corner = field_from_mesh.transform_point3(*corner));
    let triangles = TriangleBvh::new(&solid);
    let ends: Vec<Vec3> = (0..exits * exits).map(|cell| octahedral_direction(cell, exits)).collect();
    let mut table = vec![0; header.table_bytes() as usize];
    table.par_chunks_exact_mut(ends.len()).enumerate().for_each(|(cell, row)| {
        let start = octahedral_direction(cell as u32, entries);
        for (code, &end) in row.iter_mut().zip(&ends) {
            *code = encode_u8(first_hit_fraction(&triangles, start, end));
        }
        progress(row.len() as u64);
    });
    Ok(VisibilityField::new(header, table)?)
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
        let settings = BakeSettings { entries: 9, exits: 7 };
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
        let field = bake(&tetrahedron(), &BakeSettings { entries: 5, exits: 5 }, |_| ()).unwrap();
        for cell in 0..25 {
            assert_eq!(field.table()[cell * 25 + cell], visfield::field::NO_HIT_CODE);
        }
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        for (entries, exits) in [(0, 32), (65, 0), (513, 1), (1, 513), (512, 512)] {
            let error = bake(&tetrahedron(), &BakeSettings { entries, exits }, |_| ()).unwrap_err();
            assert!(matches!(error, BakeError::Settings(_)), "{entries} and {exits}: {error}");
        }
    }
}
