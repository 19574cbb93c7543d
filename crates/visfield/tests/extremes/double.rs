//! The lookup of a two-point table in double precision, and how far each of its decisions is from the other outcome.

use glam::{DVec2, DVec3, dvec2, dvec3};
use visfield::Ray;
use visfield::field::lookup::{Aim, TwoPointGrid};

use crate::BORDER_UNITS;

/// Sine of the angle below which an aimed chord counts as grazing, as in `field/lookup.rs`.
const GRAZING: f64 = 1.0e-3;

/// What double precision finds.
pub(crate) struct Found {
    /// The table index, or none for a line that misses the unit sphere.
    pub(crate) index: Option<u32>,
    /// The least distance of any decision from the other outcome, in units of the error that single precision may make there.
    pub(crate) margin: f64,
}

/// Where a point falls into an octahedral grid, after Cigolle et al. 2014.
struct Cell {
    number: u32,
    /// Distance to the nearest border, in cells.
    to_border: f64,
}

fn fold(uv: DVec2) -> DVec2 {
    let sign = |x: f64| if x >= 0.0 { 1.0 } else { -1.0 };
    dvec2((1.0 - uv.y.abs()) * sign(uv.x), (1.0 - uv.x.abs()) * sign(uv.y))
}

fn cell(p: DVec3, side: u32) -> Cell {
    let folded = dvec2(p.x, p.y) / (p.x.abs() + p.y.abs() + p.z.abs());
    let uv = if p.z < 0.0 { fold(folded) } else { folded };
    let grid = (uv * 0.5 + 0.5) * f64::from(side);
    let whole = grid.floor().clamp(DVec2::ZERO, DVec2::splat(f64::from(side - 1)));
    Cell { number: whole.y as u32 * side + whole.x as u32, to_border: (grid - grid.round()).abs().min_element() }
}

fn center(cell: u32, side: u32) -> DVec3 {
    let uv = (dvec2(f64::from(cell % side), f64::from(cell / side)) + 0.5) / f64::from(side) * 2.0 - 1.0;
    let z = 1.0 - uv.x.abs() - uv.y.abs();
    let xy = if z < 0.0 { fold(uv) } else { uv };
    dvec3(xy.x, xy.y, z).normalize()
}

/// The lookup that answers a ray: forwards from outside the unit sphere, backwards from inside.
///
/// Errors of single precision, in radii: the middle of the chord is off by some `unit = ε (1 + |origin|)`, hence the squared
/// half-chord by twice that, and each end by `unit · (1 + 1 / half-chord)`. A line that is aimed from an exact start at a
/// point `before` away turns by `unit / before`, and its far end, at twice the angle as seen from the centre, moves by twice
/// that.
///
/// A ray that starts on the sphere, to within `BORDER_UNITS`, may count as outside or inside; `outside` then decides.
pub(crate) fn lookup(grid: TwoPointGrid, ray: &Ray, aim: Aim, outside: bool) -> Found {
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3().normalize());
    let unit = f64::from(f32::EPSILON) * (1.0 + origin.length());
    let to_middle = -origin.dot(direction);
    let middle = origin + direction * to_middle;
    let inside = 1.0 - middle.length_squared();
    let tangency = inside.abs() / (2.0 * unit);
    if inside <= 0.0 {
        return Found { index: None, margin: tangency };
    }
    let half = inside.sqrt();
    let (entry, exit) = (middle - direction * half, middle + direction * half);
    let end_unit = unit * (1.0 + 1.0 / half);
    let on_the_sphere = (to_middle - half).abs() <= BORDER_UNITS * end_unit;
    let from_outside = if on_the_sphere { outside } else { to_middle >= half };
    let (start, end, aim_point) = if from_outside { (entry, exit, middle) } else { (exit, entry, origin) };

    let start_cell = cell(start, grid.entries);
    let start_margin = start_cell.to_border / (f64::from(grid.entries) * end_unit);
    let snapped = center(start_cell.number, grid.entries);
    let to_aim = aim_point - snapped;
    let before = to_aim.length();
    let sine = -snapped.dot(to_aim) / before;
    let (far_end, far_unit, grazing) = match aim {
        Aim::Plain => (end, end_unit, f64::INFINITY),
        Aim::Point => {
            let grazing = (sine - GRAZING).abs() * before / unit;
            if sine > GRAZING {
                (snapped + to_aim * (2.0 * sine / before), unit * (1.0 + 2.0 / before), grazing)
            } else {
                (end, end_unit, grazing)
            }
        }
    };
    let end_cell = cell(far_end, grid.exits);
    let end_margin = end_cell.to_border / (f64::from(grid.exits) * far_unit);
    Found {
        index: Some(start_cell.number * grid.exits * grid.exits + end_cell.number),
        margin: [tangency, start_margin, grazing, end_margin].into_iter().fold(f64::INFINITY, f64::min),
    }
}
