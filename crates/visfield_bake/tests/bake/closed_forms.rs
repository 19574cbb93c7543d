//! Baked shapes against what geometry says about them.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3, dvec3, vec3};
use visfield::field::query::Bias;
use visfield::{QueryOptions, Ray};
use visfield_bake::{BakeSettings, Mesh, bake};

use super::support::{Random, compare};

fn soup(triangles: &[[DVec3; 3]]) -> Mesh {
    Mesh {
        name: "Mesh0/Primitive0".to_owned(),
        positions: triangles.as_flattened().iter().map(|p| p.as_vec3().to_array()).collect(),
        indices: (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
    }
}

fn quad([a, b, c, d]: [DVec3; 4]) -> [[DVec3; 3]; 2] {
    [[a, b, c], [a, c, d]]
}

/// A sphere of 2 × 96 × 48 triangles, at most 0.0006 of its radius inside the true one.
fn sphere(center: DVec3, radius: f64) -> Vec<[DVec3; 3]> {
    let point = |i: u32, j: u32| {
        let (longitude, latitude) = (TAU * f64::from(i) / 96.0, PI * f64::from(j) / 48.0);
        let (sin, cos) = latitude.sin_cos();
        center + radius * dvec3(sin * longitude.cos(), cos, sin * longitude.sin())
    };
    (0..96)
        .flat_map(|i| (0..48).map(move |j| (i, j)))
        .flat_map(|(i, j)| quad([point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)]))
        .collect()
}

/// Two specks that keep the bounding sphere at radius 1 around the origin.
fn specks() -> [[DVec3; 3]; 2] {
    [-1.0, 1.0].map(|x| [dvec3(x, 0.0, 0.0), dvec3(x, 1e-4, 0.0), dvec3(x, 0.0, 1e-4)])
}

/// The first and last of a line's two hits that lie ahead.
fn ahead(enter: f64, leave: f64) -> Option<(f64, f64)> {
    (leave > 0.0).then_some((if enter > 0.0 { enter } else { leave }, leave))
}

#[test]
fn a_sphere_agrees_with_its_equation() {
    let (center, radius) = (dvec3(0.2, -0.1, 0.1), 0.5);
    let mesh = soup(&[sphere(center, radius), specks().to_vec()].concat());
    let field = bake(&mesh, &BakeSettings::two_point(65, 32), |_| ()).unwrap();
    let errors = compare(&field, 20_000, |origin, direction| {
        let (a, b) = (direction.length_squared(), (origin - center).dot(direction));
        let discriminant = b * b - a * ((origin - center).length_squared() - radius * radius);
        (discriminant > 0.0).then(|| ahead((-b - discriminant.sqrt()) / a, (-b + discriminant.sqrt()) / a))?
    });
    // Measured: 0.015, 0.016, 0.013, 0.015.
    errors.assert_below("sphere", [0.020, 0.020, 0.018, 0.020]);
}

#[test]
fn a_box_agrees_with_its_slabs_in_tiny_units_too() {
    for scale in [1.0e-6, 1.0, 1.0e6] {
        let (center, half) = (dvec3(0.3, 2.0, -0.4) * scale, dvec3(0.5, 0.3, 0.7) * scale);
        let corner = |x: f64, y: f64, z: f64| center + half * dvec3(x, y, z);
        let faces = [-1.0, 1.0].map(|s| {
            [
                quad([corner(s, -1.0, -1.0), corner(s, 1.0, -1.0), corner(s, 1.0, 1.0), corner(s, -1.0, 1.0)]),
                quad([corner(-1.0, s, -1.0), corner(1.0, s, -1.0), corner(1.0, s, 1.0), corner(-1.0, s, 1.0)]),
                quad([corner(-1.0, -1.0, s), corner(1.0, -1.0, s), corner(1.0, 1.0, s), corner(-1.0, 1.0, s)]),
            ]
        });
        let field = bake(&soup(faces.as_flattened().as_flattened()), &BakeSettings::two_point(65, 32), |_| ()).unwrap();
        let errors = compare(&field, 20_000, |origin, direction| {
            let (a, b) = ((center - half - origin) / direction, (center + half - origin) / direction);
            let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
            (enter < leave).then(|| ahead(enter, leave))?
        });
        // Measured: 0.019, 0.019, 0.015, 0.016, the same at all scales.
        errors.assert_below(&format!("box in units of {scale}"), [0.025, 0.024, 0.019, 0.021]);
    }
}

#[test]
fn a_sheet_is_seen_from_both_sides() {
    // A square of 8 × 8 × 2 triangles in the plane y = 0.1, of side 2.
    let corner = |i: u32, j: u32| dvec3(f64::from(i) / 4.0 - 1.0, 0.1, f64::from(j) / 4.0 - 1.0);
    let sheet: Vec<_> = (0..8)
        .flat_map(|i| (0..8).map(move |j| (i, j)))
        .flat_map(|(i, j)| quad([corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)]))
        .collect();
    let field = bake(&soup(&sheet), &BakeSettings::two_point(65, 32), |_| ()).unwrap();
    let errors = compare(&field, 20_000, |origin, direction| {
        let t = (0.1 - origin.y) / direction.y;
        let hit = origin + direction * t;
        (t > 0.0 && hit.x.abs() < 1.0 && hit.z.abs() < 1.0).then_some((t, t))
    });
    // Measured: 0.021, 0.023, 0.012, 0.021.
    errors.assert_below("sheet", [0.027, 0.030, 0.016, 0.027]);
}

#[test]
fn segments_end_where_they_end() {
    // Rays from outside towards a sphere of radius 1/2, and segments that stop short of it or reach into it.
    let field =
        bake(&soup(&[sphere(DVec3::ZERO, 0.5), specks().to_vec()].concat()), &BakeSettings::two_point(65, 32), |_| ())
            .unwrap();
    let mut random = Random(7);
    let free = QueryOptions { bias: Bias::NONE, ..QueryOptions::default() };
    for _ in 0..1000 {
        let from = random.in_ball().normalize().as_vec3() * 2.0;
        let occluded = |t_max: f32| field.occluded(&Ray { origin: from, direction: -from * 0.5, t_max }, &free);
        // The surface is at distance 1.5, and so at t = 1.5.
        assert!(!occluded(1.45) && occluded(1.55) && occluded(f32::INFINITY), "from {from}");
    }
    let beside = field.occluded(&Ray::new(vec3(0.0, 0.7, 0.0), Vec3::Z), &free);
    assert!(!beside, "a ray beside the sphere");
}
