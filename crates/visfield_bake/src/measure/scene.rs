//! Where occlusion is measured: receivers around a mesh, or on it, and the rays that they send.
//!
//! Everything lies in the mesh's own space, and lengths are relative to the mesh's bounding sphere: units do not matter.

use glam::{DVec3, Mat3, Vec2, Vec3};
use serde::{Deserialize, Serialize};
use visfield::estimate::sampling::sphere_samples;
use visfield::estimate::{Receiver, cosine_direction};

use crate::bounds::bounding_sphere;
use crate::mesh::{Mesh, MeshError};

/// A set of receivers.
///
/// ```
/// use visfield_bake::measure::MeasureScene;
/// assert_eq!(MeasureScene::Corner.to_string(), "corner");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MeasureScene {
    /// The 2008 paper's: the mesh stands on a floor, close to two walls behind it; each of the three squares has 33 × 33
    /// receivers. Some lie inside the bounding sphere, most outside.
    Corner,
    /// The mesh's own surface: the centres of up to 3267 triangles.
    #[serde(rename = "self")]
    OwnSurface,
}

impl std::fmt::Display for MeasureScene {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            Self::Corner => "corner",
            Self::OwnSurface => "self",
        })
    }
}

/// Receivers along each side of the corner's three squares, as in the paper.
pub const CORNER_SIDE: usize = 33;
/// Side of the corner's squares, in bounding radii.
const CORNER_SIZE: f64 = 4.0;
/// Distance of the walls from the centre of the bounding sphere, in bounding radii: they all but touch it.
const WALL_DISTANCE: f64 = 1.05;

impl MeasureScene {
    /// The scene's receivers: in a corner, row by row of the floor (normal +y), the wall in −z, the wall in −x.
    ///
    /// # Errors
    /// [`MeshError`] if the mesh cannot be baked.
    pub fn receivers(self, mesh: &Mesh) -> Result<Vec<Receiver>, MeshError> {
        self.receivers_by(mesh, CORNER_SIDE)
    }

    /// The same with `side` × `side` receivers on each square of the corner, at least 2 × 2, or up to three times as many on
    /// the mesh itself.
    ///
    /// # Errors
    /// [`MeshError`] if the mesh cannot be baked.
    pub fn receivers_by(self, mesh: &Mesh, side: usize) -> Result<Vec<Receiver>, MeshError> {
        match self {
            Self::Corner => Ok(Corner::around(mesh)?.receivers(side.max(2))),
            Self::OwnSurface => own_surface(mesh, side.max(2)),
        }
    }
}

/// Where the corner's floor and walls meet, and how large they are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    pub(super) origin: DVec3,
    /// Length of the floor's sides.
    pub(super) side: f64,
    /// Height of the walls in lengths of these sides; 1 makes squares of all three.
    pub(super) height: f64,
}

impl Corner {
    pub(super) fn around(mesh: &Mesh) -> Result<Self, MeshError> {
        let bounds = bounding_sphere(mesh)?;
        let center = DVec3::from(bounds.center.map(f64::from));
        let radius = bounds.mesh_from_field().matrix3.x_axis.x;
        let lowest = mesh.solid_triangles()?.as_flattened().iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        let origin = DVec3::new(center.x - WALL_DISTANCE * radius, lowest, center.z - WALL_DISTANCE * radius);
        Ok(Self { origin, side: CORNER_SIZE * radius, height: 1.0 })
    }

    /// Rows of receivers on each wall, at least 2, for so many on the floor.
    pub(super) fn wall_rows(&self, side: usize) -> usize {
        ((side as f64 * self.height).round() as usize).max(2)
    }

    /// Row by row of the floor, `side` × `side`, then of the wall in −z and of the wall in −x, with as many in a row.
    pub(super) fn receivers(&self, side: usize) -> Vec<Receiver> {
        let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z];
        let wall = (self.wall_rows(side), self.side * self.height);
        let mut receivers = Vec::with_capacity((side + 2 * wall.0) * side);
        for (across, along, normal, (rows, length)) in [(x, z, y, (side, self.side)), (x, y, z, wall), (z, y, x, wall)]
        {
            let at = |i: usize, count: usize, length: f64| i as f64 / (count - 1) as f64 * length;
            for row in 0..rows {
                for column in 0..side {
                    let position = self.origin + across * at(column, side, self.side) + along * at(row, rows, length);
                    receivers.push(Receiver { position, normal: normal.as_vec3() });
                }
            }
        }
        receivers
    }
}

/// The centres of up to 3 × `side`² triangles.
pub(super) fn own_surface(mesh: &Mesh, side: usize) -> Result<Vec<Receiver>, MeshError> {
    let triangles = mesh.solid_triangles()?;
    let step = triangles.len().div_ceil(3 * side * side);
    // The triangle's own normal: smooth shading would be another surface.
    let receiver = |[a, b, c]: &[DVec3; 3]| {
        let normal = (b - a).cross(c - a).normalize();
        Receiver { position: (a + b + c) / 3.0, normal: normal.as_vec3() }
    };
    Ok(triangles.iter().step_by(step).map(receiver).collect())
}

/// Directions over the hemisphere of a receiver, cosine-distributed: an even pattern, turned differently around the normal
/// of each receiver, so that what neighbours miss is not alike.
pub fn hemisphere_directions(receiver: &Receiver, index: usize, rays: u32) -> Vec<Vec3> {
    let turn = pattern_turn(index);
    let (tangent, bitangent) = receiver.normal.any_orthonormal_pair();
    let turned = turn.rotate(Vec2::X);
    let frame = Mat3::from_cols(
        tangent * turned.x + bitangent * turned.y,
        bitangent * turned.x - tangent * turned.y,
        receiver.normal,
    );
    sphere_samples(rays).into_iter().map(|sample| cosine_direction(receiver.normal, frame * sample)).collect()
}

/// The unit vector by which receiver `index` turns its pattern: golden turns of golden turns, which do not repeat.
pub(super) fn pattern_turn(index: usize) -> Vec2 {
    const GOLDEN: f64 = 0.618_033_988_749_894_8;
    let turn = (index as f64 * index as f64 * GOLDEN).fract() * std::f64::consts::TAU;
    Vec2::from_angle(turn as f32)
}
