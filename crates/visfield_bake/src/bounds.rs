//! The sphere or ellipsoid around a mesh that becomes the unit sphere of field space.

use glam::{DMat3, DMat4, DVec3};
use visfield::BoundingEllipsoid;

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

/// Semi-axis that no ellipsoid goes below, relative to the bounding sphere's radius: flat meshes need a volume too.
const THINNEST: f64 = 0.01;

/// What becomes the unit sphere of field space.
///
/// ```
/// assert_eq!(visfield_bake::BoundsKind::default(), visfield_bake::BoundsKind::Sphere);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BoundsKind {
    /// [`bounding_sphere`]
    #[default]
    Sphere,
    /// [`bounding_ellipsoid`]: for long or flat meshes, which fill little of a sphere.
    Ellipsoid,
}

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
/// assert!((sphere.center[0] - 3.0).abs() < 1e-2 && (sphere.sphere_radius().unwrap() - 1.0).abs() < 1e-2);
/// # Ok::<(), visfield_bake::MeshError>(())
/// ```
///
/// # Errors
/// [`MeshError`] if the mesh cannot be baked.
pub fn bounding_sphere(mesh: &Mesh) -> Result<BoundingEllipsoid, MeshError> {
    bounds_of(&mesh.solid_triangles()?, BoundsKind::Sphere)
}

/// A bounding ellipsoid of the triangles with an area, at most about 0.1 % longer in any direction than the one of least
/// volume. Its axes are not thinner than a hundredth of the bounding sphere's radius.
///
/// The method is Khachiyan's with the away steps of Todd & Yıldırım, *On Khachiyan's Algorithm for the Computation of
/// Minimum-Volume Enclosing Ellipsoids* (2007, §3), on a core that the farthest point joins again and again, as above.
///
/// ```
/// let mesh = visfield_bake::Mesh {
///     name: String::new(),
///     positions: vec![[5.0, 0.0, 0.0], [-5.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]],
///     indices: vec![[0, 2, 4], [1, 3, 5]],
/// };
/// let volume = |bounds: visfield::BoundingEllipsoid| bounds.mesh_from_field().matrix3.determinant();
/// let (sphere, ellipsoid) = (visfield_bake::bounding_sphere(&mesh)?, visfield_bake::bounding_ellipsoid(&mesh)?);
/// assert!(volume(ellipsoid) < 0.05 * volume(sphere));
/// # Ok::<(), visfield_bake::MeshError>(())
/// ```
///
/// # Errors
/// [`MeshError`] if the mesh cannot be baked.
pub fn bounding_ellipsoid(mesh: &Mesh) -> Result<BoundingEllipsoid, MeshError> {
    bounds_of(&mesh.solid_triangles()?, BoundsKind::Ellipsoid)
}

/// The same for triangles that are known to be sound.
pub(crate) fn bounds_of(triangles: &[[DVec3; 3]], kind: BoundsKind) -> Result<BoundingEllipsoid, MeshError> {
    let points = triangles.as_flattened();
    let (center, radius) = enclosing_sphere(points);
    if !(f64::from(RADIUS_RANGE.0)..=f64::from(RADIUS_RANGE.1)).contains(&radius) {
        return Err(MeshError::Extent { radius: radius as f32 });
    }
    Ok(match kind {
        BoundsKind::Sphere => {
            // The radius belongs to the centre as it will be stored.
            let stored_center = center.as_vec3();
            let (_, distance) = farthest_from(stored_center.as_dvec3(), points);
            BoundingEllipsoid::sphere(stored_center.to_array(), (distance * (1.0 + PADDING)) as f32)
        }
        BoundsKind::Ellipsoid => {
            let (center, axes) = enclosing_ellipsoid(points, center, radius);
            // Grown by what rounding the numbers for storage leaves outside.
            let stored = |scale: f64| BoundingEllipsoid {
                center: center.as_vec3().to_array(),
                axes: (axes * scale).to_cols_array_2d().map(|axis| axis.map(|x| x as f32)),
            };
            let field_from_mesh = stored(1.0).field_from_mesh();
            let outside = points.iter().map(|p| field_from_mesh.transform_point3(*p).length()).fold(0.0, f64::max);
            stored(outside * (1.0 + PADDING))
        }
    })
}

/// Centre and radius, nearly the smallest.
fn enclosing_sphere(points: &[DVec3]) -> (DVec3, f64) {
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
    (center, farthest_from(center, points).1)
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

/// Centre and axes of nearly the smallest ellipsoid around points that have this bounding sphere.
fn enclosing_ellipsoid(points: &[DVec3], sphere_center: DVec3, sphere_radius: f64) -> (DVec3, DMat3) {
    // In units of the sphere, where numbers are near 1. Six points near the middle give flat meshes a thickness.
    let unit = |p: DVec3| (p - sphere_center) / sphere_radius;
    let mut core: Vec<DVec3> = DMat3::IDENTITY.to_cols_array_2d().map(DVec3::from).map(|axis| axis * THINNEST).to_vec();
    core.extend(core.clone().iter().map(|p| -p));
    let (mut center, mut axes) = (DVec3::ZERO, DMat3::from_diagonal(DVec3::splat(THINNEST)));
    while core.len() < MAX_CORE {
        let inverse = axes.inverse();
        let outside = |p: DVec3| (inverse * (unit(p) - center)).length_squared();
        let farthest =
            points.iter().map(|&p| (outside(p), p)).fold((0.0, DVec3::ZERO), |a, b| if b.0 > a.0 { b } else { a });
        if farthest.0.sqrt() <= 1.0 + TOLERANCE {
            break;
        }
        core.push(unit(farthest.1));
        (center, axes) = core_ellipsoid(&core);
    }
    (sphere_center + center * sphere_radius, axes * sphere_radius)
}

/// Largest relative error of the core's ellipsoid.
const KHACHIYAN_TOLERANCE: f64 = 1.0e-4;

/// Khachiyan's ascent on the weights of points in four homogeneous coordinates: at its end, the points with a weight lie on
/// the ellipsoid, and the weighted scatter of the points is its shape.
fn core_ellipsoid(core: &[DVec3]) -> (DVec3, DMat3) {
    const DIMENSIONS: f64 = 3.0;
    const TARGET: f64 = DIMENSIONS + 1.0;
    let mut weights = vec![1.0 / core.len() as f64; core.len()];
    for _ in 0..CENTER_STEPS {
        let scatter = core.iter().zip(&weights).fold(DMat4::ZERO, |sum, (p, w)| {
            let q = p.extend(1.0);
            sum + DMat4::from_cols(q * q.x, q * q.y, q * q.z, q) * *w
        });
        let inverse = scatter.inverse();
        let spread = |p: &DVec3| p.extend(1.0).dot(inverse * p.extend(1.0));
        let (mut most, mut least) = ((0, 0.0), (0, f64::INFINITY));
        for (i, point) in core.iter().enumerate() {
            let spread = spread(point);
            if spread > most.1 {
                most = (i, spread);
            }
            if weights[i] > 0.0 && spread < least.1 {
                least = (i, spread);
            }
        }
        let (too_far, too_near) = (most.1 - TARGET, TARGET - least.1);
        if too_far.max(too_near) <= KHACHIYAN_TOLERANCE * TARGET {
            break;
        }
        if too_far > too_near {
            let step = too_far / (TARGET * (most.1 - 1.0));
            for w in &mut weights {
                *w *= 1.0 - step;
            }
            weights[most.0] += step;
        } else {
            let weight = weights[least.0];
            let step = (too_near / (TARGET * (least.1 - 1.0))).min(weight / (1.0 - weight));
            for w in &mut weights {
                *w *= 1.0 + step;
            }
            // What rounding leaves of a weight that is taken back wholly would count as a support for ever.
            weights[least.0] = if step < weight / (1.0 - weight) { weights[least.0] - step } else { 0.0 };
        }
    }
    let center = core.iter().zip(&weights).fold(DVec3::ZERO, |sum, (p, w)| sum + p * w);
    let shape = core.iter().zip(&weights).fold(DMat3::ZERO, |sum, (p, w)| {
        let v = *p - center;
        sum + DMat3::from_cols(v * v.x, v * v.y, v * v.z) * *w
    });
    (center, cholesky(shape * DIMENSIONS))
}

/// The lower triangular L with L·Lᵀ = m, for a positive definite m: it maps the unit sphere to the ellipsoid.
fn cholesky(m: DMat3) -> DMat3 {
    let [[a, b, c], [_, d, e], [_, _, f]] = m.to_cols_array_2d();
    let l00 = a.sqrt();
    let (l10, l20) = (b / l00, c / l00);
    let l11 = (d - l10 * l10).sqrt();
    let l21 = (e - l20 * l10) / l11;
    let l22 = (f - l20 * l20 - l21 * l21).sqrt();
    DMat3::from_cols(DVec3::new(l00, l10, l20), DVec3::new(0.0, l11, l21), DVec3::new(0.0, 0.0, l22))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, EulerRot, dvec3};
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
            let sphere = bounds_of(&soup(&points), BoundsKind::Sphere).unwrap();
            let excess = f64::from(sphere.sphere_radius().unwrap()) / radius - 1.0;
            assert!((-1e-3..1.5e-3).contains(&excess), "{name}: {excess}");
        }
    }

    #[test]
    fn ellipsoids_are_nearly_minimal() {
        let turned = DMat3::from_quat(DQuat::from_euler(EulerRot::XYZ, 0.4, -1.0, 2.0));
        let stretched = turned * DMat3::from_diagonal(dvec3(1.0, 5.0, 0.2));
        let ball = sphere_samples(5000).iter().map(|p| stretched * p.as_dvec3() + dvec3(7.0, -2.0, 0.5)).collect();
        // The smallest ellipsoid around a box is √3 times the one inside it.
        let corners = (0..8).map(|i| [0, 1, 2].map(|axis| f64::from(i >> axis & 1) * 2.0 - 1.0));
        let corners = corners.map(|p| stretched * DVec3::from(p)).collect::<Vec<_>>();
        for (name, points, scale) in [("ball", ball, 1.0), ("box", corners, 3.0_f64.sqrt())] {
            let bounds = bounds_of(&soup(&points), BoundsKind::Ellipsoid).unwrap();
            let volume = bounds.mesh_from_field().matrix3.determinant().abs();
            let excess = (volume / stretched.determinant()).cbrt() / scale - 1.0;
            assert!((-1e-3..1.5e-3).contains(&excess), "{name}: {excess}");
        }
    }

    #[test]
    fn flat_and_straight_meshes_get_a_volume() {
        let square = [dvec3(0.0, 0.0, 0.0), dvec3(1.0, 0.0, 0.0), dvec3(1.0, 1.0, 0.0), dvec3(0.0, 1.0, 0.0)];
        let needle = [dvec3(-1.0, 1.0, 2.0), dvec3(1.0, 1.0, 2.0), dvec3(0.0, 1.0 + 1e-6, 2.0)];
        for (points, thickness) in [(&square[..], 0.01 * 0.5_f64.sqrt()), (&needle[..], 0.01)] {
            let bounds = bounds_of(&soup(points), BoundsKind::Ellipsoid).unwrap();
            let axes = bounds.mesh_from_field().matrix3;
            // The shortest semi-axis: 1 over the longest image of the inverse.
            let inverse = axes.inverse();
            let longest = sphere_samples(2000).iter().map(|p| (inverse * p.as_dvec3()).length()).fold(0.0, f64::max);
            let shortest = 1.0 / longest;
            assert!((thickness * 0.9..thickness * 2.0).contains(&shortest), "{shortest}");
        }
    }

    #[test]
    fn every_vertex_lies_strictly_inside_in_single_precision() {
        for kind in [BoundsKind::Sphere, BoundsKind::Ellipsoid] {
            for scale in [1e-15, 1e-6, 1.0, 1e6, 1e15] {
                for shift in [0.0, 1.0, 1000.0] {
                    // Rounded to f32 first, as vertices are.
                    let points: Vec<DVec3> = sphere_samples(500)
                        .iter()
                        .map(|p| ((p.as_dvec3() * dvec3(1.0, 0.3, 2.0) + shift) * scale).as_vec3().as_dvec3())
                        .collect();
                    let field_from_mesh = bounds_of(&soup(&points), kind).unwrap().field_from_mesh();
                    for point in points {
                        let length = field_from_mesh.transform_point3(point).as_vec3().length();
                        assert!(length < 1.0, "{kind:?}, scale {scale}, shift {shift}: {length}");
                    }
                }
            }
        }
    }
}
