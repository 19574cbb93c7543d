//! A tube along the (2, 3) torus knot: smooth, without a boundary, and in its own way everywhere.

use std::f64::consts::TAU;

use glam::{DVec3, dvec3};

use crate::surface::Surface;

/// Turns around the torus' axis, and around its tube.
const TURNS: (f64, f64) = (2.0, 3.0);
/// Radii of the torus and of its tube, and of the tube along the knot, before scaling.
const RADII: (f64, f64, f64) = (2.0, 1.0, 0.42);
/// 6.84 units across become 1.6; the three lobes stand a little less tall.
const SCALE: f64 = 1.6 / (2.0 * (RADII.0 + RADII.1 + RADII.2));
const RINGS: usize = 192;
const SEGMENTS: usize = 16;

pub(crate) fn torus_knot() -> Surface {
    let mut surface = Surface::default();
    for ring in 0..RINGS {
        let (center, tangent, out) = knot(TAU * ring as f64 / RINGS as f64);
        let side = tangent.cross(out);
        for segment in 0..SEGMENTS {
            let (sin, cos) = (TAU * segment as f64 / SEGMENTS as f64).sin_cos();
            let normal = out * cos + side * sin;
            surface.positions.push((center + normal * RADII.2) * SCALE);
            surface.normals.push(normal);
        }
    }
    let vertex = |ring: usize, segment: usize| (ring % RINGS) * SEGMENTS + segment % SEGMENTS;
    for ring in 0..RINGS {
        for segment in 0..SEGMENTS {
            let next = segment + 1;
            surface.add_quad([
                vertex(ring, segment),
                vertex(ring, next),
                vertex(ring + 1, next),
                vertex(ring + 1, segment),
            ]);
        }
    }
    surface
}

/// A point of the knot, its unit tangent, and the torus' normal there: perpendicular to the tangent, so that both give a
/// frame that closes without twisting.
fn knot(t: f64) -> (DVec3, DVec3, DVec3) {
    let (sin_turn, cos_turn) = (TURNS.0 * t).sin_cos();
    let (sin_tube, cos_tube) = (TURNS.1 * t).sin_cos();
    let radius = RADII.0 + RADII.1 * cos_tube;
    let center = dvec3(radius * cos_turn, radius * sin_turn, RADII.1 * sin_tube);
    let along_turn = dvec3(-sin_turn, cos_turn, 0.0) * (radius * TURNS.0);
    let along_tube = dvec3(-sin_tube * cos_turn, -sin_tube * sin_turn, cos_tube) * (RADII.1 * TURNS.1);
    let out = dvec3(cos_tube * cos_turn, cos_tube * sin_turn, sin_tube);
    // A quarter turn puts one of the three lobes on top.
    let upright = |v: DVec3| dvec3(-v.y, v.x, v.z);
    (upright(center), upright((along_turn + along_tube).normalize()), upright(out))
}
