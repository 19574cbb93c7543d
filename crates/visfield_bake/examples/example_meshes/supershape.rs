//! A supershape, as the 2010 paper shows one (figure 5): the product of two superformula curves (Gielis, *A Generic
//! Geometric Transformation that Unifies a Wide Range of Natural and Abstract Shapes*, 2003). Its lobes shadow each other.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec3, dvec3};

use crate::surface::Surface;

/// Lobes around the vertical axis, and from pole to pole.
const LOBES: (f64, f64) = (6.0, 4.0);
/// The superformula's n1 and n2 = n3. Between two lobes the radius falls to 2^((n2/2 − 1)/n1) = 0.59; n2 above 1 keeps the
/// surface free of creases.
const EXPONENTS: (f64, f64) = (0.2, 1.7);
const SCALE: f64 = 0.8;
const SECTORS: usize = 96;
const STACKS: usize = 43;

pub(crate) fn supershape() -> Surface {
    let mut surface = Surface::default();
    surface.positions.push(point(0.0, -FRAC_PI_2));
    for stack in 1..STACKS {
        let latitude = PI * stack as f64 / STACKS as f64 - FRAC_PI_2;
        surface.positions.extend((0..SECTORS).map(|sector| point(TAU * sector as f64 / SECTORS as f64, latitude)));
    }
    let north = surface.positions.len();
    surface.positions.push(point(0.0, FRAC_PI_2));

    let vertex = |stack: usize, sector: usize| 1 + (stack - 1) * SECTORS + sector % SECTORS;
    for sector in 0..SECTORS {
        surface.add_triangle([0, vertex(1, sector), vertex(1, sector + 1)]);
        for stack in 1..STACKS - 1 {
            let (low, high) = (stack, stack + 1);
            surface.add_quad([
                vertex(low, sector),
                vertex(high, sector),
                vertex(high, sector + 1),
                vertex(low, sector + 1),
            ]);
        }
        surface.add_triangle([vertex(STACKS - 1, sector), north, vertex(STACKS - 1, sector + 1)]);
    }
    surface.smooth_normals();
    surface
}

fn point(longitude: f64, latitude: f64) -> DVec3 {
    let around = superformula(LOBES.0, longitude);
    let (sin, cos) = latitude.sin_cos();
    let radius = superformula(LOBES.1, latitude);
    // The cosine of a pole is not quite 0 in floating point.
    let flat = if latitude.abs() < FRAC_PI_2 { around * radius * cos } else { 0.0 };
    dvec3(flat * longitude.cos(), radius * sin, flat * longitude.sin()) * SCALE
}

/// Equation 1 of the paper by Gielis, with a = b = 1.
fn superformula(lobes: f64, angle: f64) -> f64 {
    let (sin, cos) = (lobes * angle / 4.0).sin_cos();
    (cos.abs().powf(EXPONENTS.1) + sin.abs().powf(EXPONENTS.1)).powf(-1.0 / EXPONENTS.0)
}
