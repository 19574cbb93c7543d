//! The sphere around a mesh that becomes the unit sphere of field space.

use glam::DVec3;
use visfield::BoundingSphere;

use crate::mesh::{Mesh, MeshError, RADIUS_RANGE};

/// Relative padding of the radius: after the vertices are rounded to `f32` in field space, all of them still lie strictly
/// inside the unit sphere, so that chords start and end outside the mesh.
const PADDING: f64 = 1.0e-5;

/// Relative distance outside the core's ball at which no further point is worth adding.
const TOLERANCE: f64 = 1.0e-4;

/// Most points that are added to the core. Each step costs one pass over the mesh; real meshes need about ten.
const MAX_CORE: usize = 64;

/// Steps towards the core's centre. The core is tiny, so that many steps cost little.
const CENTER_STEPS: u32 = 4000;

/// A bounding sphere of the triangles with an area, at most about 0.1 % larger than the smallest one.
///
/// The method is the core-set of Bădoiu & Clarkson, *Smaller Core-Sets for Balls* (2003): again and again the point
/// farthest from the centre joins the core, and the core's own ball is found by their simple iteration, which moves the
/// centre by 1/(i + 1) of the way to the core's farthest point. In `f64` throughout, so that units do not matter.
///
/// ```
/// let mesh = visfield_bake::Mesh {
///     name: String::new(),
///     positions: vec![[2.0, 0.0, 0.0], [4.0, 0.0, 0.0], [3.0, 0.5, 0.0]],
///     indices: vec![[0, 1, 2]],
/// };
/// let sphere = visfield_bake::bounding_sphere(&mesh)?;
/// assert!((sphere.center[0] - 3.0).abs() < 1e-2 && (sphere.radius - 1.0).abs() < 1e-2);
/// # Ok::<(), visfield_bake::MeshError>(())
/// ```
///
/// # Errors
/// [`MeshError`] if the mesh cannot be baked.
pub fn bounding_sphere(mesh: &Mesh) -> Result<BoundingSphere, MeshError> {
    enclosing_sphere(&mesh.solid_triangles()?)
}

/// The same for triangles that are known to be sound.
pub(crate) fn enclosing_sphere(triangles: &[[DVec3; 3]]) -> Result<BoundingSphere, MeshError> {
    let points = triangles.as_flattened();
    let mut center = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    let mut core: Vec<DVec3> = Vec::new();
    while core.len() < MAX_CORE {
        let (farthest, distance) = farthest_from(center, points);
        let core_radius = if core.is_empty() { 0.0 } else { farthest_from(center, &core).1 };
        if distance <= core_radius * (1.0 + TOLERANCE) {
            break;
        }
        core.push(farthest);
        center = core_center(&core);
    }
    // The radius belongs to the centre as it will be stored.
    let stored_center = center.as_vec3();
    let (_, distance) = farthest_from(stored_center.as_dvec3(), points);
    let radius = (distance * (1.0 + PADDING)) as f32;
    if !(RADIUS_RANGE.0..=RADIUS_RANGE.1).contains(&radius) {
        return Err(MeshError::Extent { radius });
    }
    Ok(BoundingSphere { center: stored_center.to_array(), radius })
}

fn core_center(core: &[DVec3]) -> DVec3 {
    let mut center = core[0];
    for i in 1..=CENTER_STEPS {
        let (farthest, _) = farthest_from(center, core);
        center += (farthest - center) / f64::from(i + 1);
    }
    center
}

/// The first of the points that are farthest from `center`, and its distance.
fn farthest_from(center: DVec3, points: &[DVec3]) -> (DVec3, f64) {
    let mut farthest = (center, 0.0);
    for &point in points {
        let squared = point.distance_squared(center);
        if squared > farthest.1 {
            farthest = (point, squared);
        }
    }
    (farthest.0, farthest.1.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;
    use visfield::estimate::sampling::sphere_samples;

    fn soup(points: &[DVec3]) -> Vec<[DVec3; 3]> {
        points.iter().map(|&p| [p; 3]).collect()
    }

    #[test]
    fn spheres_are_nearly_minimal() {
        let ball: Vec<DVec3> =
            sphere_samples(5000).iter().map(|p| p.as_dvec3() * 3.0 + dvec3(7.0, -2.0, 0.5)).collect();
        let cube: Vec<DVec3> = (0..8).map(|i| dvec3((i & 1).into(), (i >> 1 & 1).into(), (i >> 2).into())).collect();
        let half: Vec<DVec3> = ball.iter().copied().filter(|p| p.y > -2.0).collect();
        for (name, points, radius) in [("ball", ball, 3.0), ("cube", cube, 0.75_f64.sqrt()), ("half", half, 3.0)] {
            let sphere = enclosing_sphere(&soup(&points)).unwrap();
            let excess = f64::from(sphere.radius) / radius - 1.0;
            assert!((-1e-3..1.5e-3).contains(&excess), "{name}: {excess}");
        }
    }

    #[test]
    fn every_vertex_lies_strictly_inside_in_single_precision() {
        for scale in [1e-15, 1e-6, 1.0, 1e6, 1e15] {
            for shift in [0.0, 1.0, 1000.0] {
                // Rounded to f32 first, as vertices are.
                let points: Vec<DVec3> = sphere_samples(500)
                    .iter()
                    .map(|p| ((p.as_dvec3() * dvec3(1.0, 0.3, 2.0) + shift) * scale).as_vec3().as_dvec3())
                    .collect();
                let sphere = enclosing_sphere(&soup(&points)).unwrap();
                let field_from_mesh = sphere.field_from_mesh();
                for point in points {
                    let length = field_from_mesh.transform_point3(point).as_vec3().length();
                    assert!(length < 1.0, "scale {scale}, shift {shift}: {length}");
                }
            }
        }
    }
}
