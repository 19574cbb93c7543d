//! Shapes that are hard on cap grids, made of boxes.

use glam::{DVec3, Vec3, dvec3};
use visfield::estimate::Receiver;
use visfield_bake::Mesh;

/// A mesh of loose triangles.
pub(crate) fn soup(name: &str, triangles: &[[DVec3; 3]]) -> Mesh {
    Mesh {
        name: name.to_owned(),
        positions: triangles.as_flattened().iter().map(|p| p.as_vec3().to_array()).collect(),
        indices: (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
    }
}

/// The twelve triangles of a box, seen from outside. Negative half-extents turn them inside out.
pub(crate) fn block(center: DVec3, half: DVec3) -> Vec<[DVec3; 3]> {
    let mut triangles = Vec::new();
    for axis in 0..3 {
        let (mut out, mut u, mut v) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
        out[axis] = half[axis];
        u[(axis + 1) % 3] = half[(axis + 1) % 3];
        v[(axis + 2) % 3] = half[(axis + 2) % 3];
        for (face, u) in [(center + out, u), (center - out, -u)] {
            let [a, b, c, d] = [face - u - v, face + u - v, face + u + v, face - u + v];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    triangles
}

fn boxes(name: &str, all: &[(DVec3, DVec3)]) -> Mesh {
    soup(name, &all.iter().flat_map(|&(center, half)| block(center, half)).collect::<Vec<_>>())
}

/// A thousand times as long as thick.
pub(crate) fn needle() -> Mesh {
    boxes("needle", &[(DVec3::ZERO, dvec3(1.0, 0.001, 0.001))])
}

/// A thousand times as wide as thick.
pub(crate) fn plate() -> Mesh {
    boxes("plate", &[(DVec3::ZERO, dvec3(1.0, 0.001, 1.0))])
}

/// A square without any thickness.
pub(crate) fn sheet() -> Mesh {
    let corner = |x: f64, z: f64| dvec3(x, 0.0, z);
    let [a, b, c, d] = [corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)];
    soup("sheet", &[[a, b, c], [a, c, d]])
}

/// One triangle, askew.
pub(crate) fn triangle() -> Mesh {
    soup("triangle", &[[dvec3(0.0, 0.0, 0.0), dvec3(1.0, 0.2, 0.0), dvec3(0.1, 0.3, 0.8)]])
}

/// A closed, hollow box. Its walls are a tenth of its half-extent thick.
pub(crate) fn closed_crate() -> Mesh {
    let inner = block(DVec3::ZERO, DVec3::splat(0.9)).into_iter().map(|[a, b, c]| [a, c, b]);
    soup("closed crate", &block(DVec3::ZERO, DVec3::ONE).into_iter().chain(inner).collect::<Vec<_>>())
}

/// The same without a lid.
pub(crate) fn open_crate() -> Mesh {
    let (side, thin) = (0.95, 0.05);
    boxes(
        "open crate",
        &[
            (dvec3(0.0, -side, 0.0), dvec3(1.0, thin, 1.0)),
            (dvec3(-side, thin, 0.0), dvec3(thin, side, 1.0)),
            (dvec3(side, thin, 0.0), dvec3(thin, side, 1.0)),
            (dvec3(0.0, thin, -side), dvec3(0.9, side, thin)),
            (dvec3(0.0, thin, side), dvec3(0.9, side, thin)),
        ],
    )
}

/// A closed box whose faces have one side only: as far as anyone can tell a solid one.
pub(crate) fn one_sided_crate() -> Mesh {
    boxes("one-sided crate", &[(DVec3::ZERO, DVec3::ONE)])
}

/// The same, with faces that look inwards: a room.
pub(crate) fn room() -> Mesh {
    soup("room", &block(DVec3::ZERO, DVec3::ONE).iter().map(|&[a, b, c]| [a, c, b]).collect::<Vec<_>>())
}

/// Two pillars and a lintel.
pub(crate) fn arch() -> Mesh {
    boxes(
        "arch",
        &[
            (dvec3(-0.8, 0.0, 0.0), dvec3(0.2, 1.0, 0.2)),
            (dvec3(0.8, 0.0, 0.0), dvec3(0.2, 1.0, 0.2)),
            (dvec3(0.0, 0.8, 0.0), dvec3(0.6, 0.2, 0.2)),
        ],
    )
}

/// Two rails and ten bars.
pub(crate) fn fence() -> Mesh {
    let bars = (0..10).map(|i| (dvec3(f64::from(i) * 0.2 - 0.9, 0.0, 0.0), dvec3(0.03, 0.5, 0.03)));
    let rails = [-0.3, 0.3].map(|y| (dvec3(0.0, y, 0.05), dvec3(1.0, 0.03, 0.02)));
    boxes("fence", &bars.chain(rails).collect::<Vec<_>>())
}

/// Hills, 100 units wide and up to 4 high.
pub(crate) fn terrain() -> Mesh {
    let height = |x: f64, z: f64| 2.0 * (0.13 * x).sin() * (0.17 * z).cos() + 2.0 * (0.05 * x + 0.07 * z).sin();
    let point = |i: i32, j: i32| {
        let (x, z) = (f64::from(i - 25) * 2.0, f64::from(j - 25) * 2.0);
        dvec3(x, height(x, z), z)
    };
    let cells = (0..50).flat_map(|i| (0..50).map(move |j| (i, j)));
    let triangles = cells.flat_map(|(i, j)| {
        let [a, b, c, d] = [point(i, j), point(i, j + 1), point(i + 1, j + 1), point(i + 1, j)];
        [[a, b, c], [a, c, d]]
    });
    soup("terrain", &triangles.collect::<Vec<_>>())
}

/// A ball of radius 1.
pub(crate) fn ball() -> Mesh {
    let point = |i: u32, j: u32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / 48.0).sin_cos();
        let (radius, height) = (std::f64::consts::PI * f64::from(j) / 24.0).sin_cos();
        dvec3(radius * sin, height, radius * cos)
    };
    let cells = (0..48).flat_map(|i| (0..24).map(move |j| (i, j)));
    let triangles = cells.flat_map(|(i, j)| {
        let [a, b, c, d] = [point(i, j), point(i, j + 1), point(i + 1, j + 1), point(i + 1, j)];
        [[a, b, c], [a, c, d]]
    });
    soup("ball", &triangles.collect::<Vec<_>>())
}

/// Directions of all kinds.
pub(crate) const NORMALS: [Vec3; 6] = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z];

/// The corner of the 2008 paper: a floor and two walls, 15 × 15 receivers each, at `distance` radii from the centre.
pub(crate) fn corner(center: DVec3, radius: f64, distance: f64) -> Vec<Receiver> {
    let mut receivers = Vec::new();
    for (normal, u, v) in
        [(DVec3::Y, DVec3::X, DVec3::Z), (DVec3::X, DVec3::Y, DVec3::Z), (DVec3::Z, DVec3::X, DVec3::Y)]
    {
        for i in 0..15 {
            for j in 0..15 {
                let along = |k: i32| f64::from(k - 7) / 7.0 * 2.0 * radius;
                let position = center - normal * distance * radius + u * along(i) + v * along(j);
                receivers.push(Receiver { position, normal: normal.as_vec3() });
            }
        }
    }
    receivers
}
