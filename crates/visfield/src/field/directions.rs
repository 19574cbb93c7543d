//! Directions of a hemisphere as cells of a square: the second half of the papers' representation.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

use glam::{Vec2, Vec3, vec2};
use serde::{Deserialize, Serialize};

/// How directions of the hemisphere around +z become points of the unit square (2008, §3.4 *Sampling a Hemisphere of
/// Directions*). All of them are cut into a square grid of cells, and each has its inverse.
///
/// ```
/// use visfield::field::directions::DirectionMap;
/// let up = DirectionMap::Concentric.direction(4, 3).unwrap(); // the middle of 3 × 3 cells
/// assert_eq!(up, glam::Vec3::Z);
/// assert_eq!(DirectionMap::Concentric.cell(up, 3), 4);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DirectionMap {
    /// Concentric squares become concentric circles (Shirley & Chiu, *A Low Distortion Map Between Disk and Square*, 1997),
    /// and the disc is projected up to the hemisphere (Malley 1988): cosine-distributed, little distortion. The papers'
    /// choice.
    #[default]
    Concentric,
    /// Azimuth × polar angle in equal steps: crowded around the pole.
    Polar,
    /// Azimuth × height in equal steps: every cell has the same solid angle, and cells near the pole are long and thin.
    Uniform,
    /// The disc as it lies in its square, projected up as for [`Concentric`](Self::Concentric). The papers reject samples
    /// outside of the disc, so that 21.5 % of the cells stay unused.
    Rejection,
}

impl DirectionMap {
    /// All maps, in the order of the paper's Figures 2 and 3.
    pub const ALL: [Self; 4] = [Self::Uniform, Self::Polar, Self::Rejection, Self::Concentric];

    /// The cell of a grid of `side`² cells (`side` at least 1) that contains a unit direction with z ≥ 0, row-major, below `side`².
    ///
    /// Any other vector, NaN included, gives some valid cell.
    #[inline]
    pub fn cell(self, direction: Vec3, side: u32) -> u32 {
        let disc = vec2(direction.x, direction.y);
        let square = match self {
            Self::Concentric => square_from_disc(disc),
            Self::Polar => vec2(turn(disc), direction.z.clamp(0.0, 1.0).acos() / FRAC_PI_2),
            Self::Uniform => vec2(turn(disc), 1.0 - direction.z),
            Self::Rejection => disc * 0.5 + 0.5,
        };
        let grid = square * side as f32;
        let last = side - 1;
        // Casts saturate and send NaN to 0.
        (grid.y as u32).min(last) * side + (grid.x as u32).min(last)
    }

    /// The unit direction that stands for a cell, with `side` at least 1: its centre. `None` for the cells that [`Rejection`](Self::Rejection)
    /// leaves unused; those on its rim are represented by their innermost corner.
    #[inline]
    pub fn direction(self, cell: u32, side: u32) -> Option<Vec3> {
        let grid = vec2((cell % side) as f32, (cell / side) as f32);
        let center = (grid + 0.5) / side as f32;
        match self {
            Self::Concentric => Some(lift(disc_from_square(center))),
            Self::Polar => {
                let (sin, cos) = (center.y * FRAC_PI_2).sin_cos();
                Some((Vec2::from_angle(center.x * TAU) * sin).extend(cos))
            }
            Self::Uniform => {
                let height = 1.0 - center.y;
                Some((Vec2::from_angle(center.x * TAU) * (1.0 - height * height).sqrt()).extend(height))
            }
            Self::Rejection => {
                let disc = center * 2.0 - 1.0;
                let innermost = (disc.abs() - 1.0 / side as f32).max(Vec2::ZERO) * disc.signum();
                [disc, innermost].into_iter().find(|p| p.length_squared() < 1.0).map(lift)
            }
        }
    }
}

/// Azimuth as a fraction of a turn, in [0, 1).
fn turn(disc: Vec2) -> f32 {
    let turn = disc.y.atan2(disc.x) / TAU;
    if turn < 0.0 { turn + 1.0 } else { turn }
}

/// Malley's projection from the disc up to the hemisphere.
fn lift(disc: Vec2) -> Vec3 {
    disc.extend((1.0 - disc.length_squared()).max(0.0).sqrt())
}

/// Shirley & Chiu 1997, with one case for each pair of opposite quadrants. Both squares are [0, 1]² here.
fn disc_from_square(square: Vec2) -> Vec2 {
    let Vec2 { x, y } = square * 2.0 - 1.0;
    if x == 0.0 && y == 0.0 {
        return Vec2::ZERO;
    }
    let (radius, angle) =
        if x.abs() > y.abs() { (x, FRAC_PI_4 * (y / x)) } else { (y, FRAC_PI_2 - FRAC_PI_4 * (x / y)) };
    Vec2::from_angle(angle) * radius
}

/// The inverse of [`disc_from_square`].
fn square_from_disc(disc: Vec2) -> Vec2 {
    let Vec2 { x, y } = disc;
    let radius = disc.length();
    let square = if x.abs() > y.abs() {
        let side = radius.copysign(x);
        vec2(side, side * (y / x).atan() / FRAC_PI_4)
    } else if y != 0.0 {
        let side = radius.copysign(y);
        vec2(side * (x / y).atan() / FRAC_PI_4, side)
    } else {
        Vec2::ZERO
    };
    square * 0.5 + 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::vec3;

    #[test]
    fn every_direction_maps_back_to_its_cell() {
        for map in DirectionMap::ALL {
            for side in [1, 2, 7, 32, 64] {
                let used = (0..side * side).filter_map(|cell| Some((cell, map.direction(cell, side)?)));
                let mut count = 0;
                for (cell, direction) in used {
                    assert!(
                        (direction.length() - 1.0).abs() < 1e-5 && direction.z > 0.0,
                        "{map:?} {side}: {direction}"
                    );
                    // The innermost corner of a rim cell touches its neighbours; a hair outwards it is inside.
                    let outwards = (direction + vec3(direction.x, direction.y, 0.0) * 1e-4).normalize();
                    let probe = if map == DirectionMap::Rejection { outwards } else { direction };
                    assert_eq!(map.cell(probe, side), cell, "{map:?} of {side}²");
                    count += 1;
                }
                if map != DirectionMap::Rejection {
                    assert_eq!(count, side * side);
                }
            }
        }
    }

    #[test]
    fn every_direction_is_near_the_one_that_stands_for_its_cell() {
        for map in DirectionMap::ALL {
            for direction in crate::estimate::sampling::sphere_samples(20_000) {
                let direction = vec3(direction.x, direction.y, direction.z.abs());
                let stored =
                    map.direction(map.cell(direction, 64), 64).expect("no direction falls into an unused cell");
                // In the disc, where cosine-weighted cells are equal. The innermost ring of uniform cells is wide.
                let apart = (direction - stored).truncate().length();
                let bound = if map == DirectionMap::Uniform { 0.13 } else { 0.06 };
                assert!(apart < bound, "{map:?}: {direction} is {apart} from {stored}");
            }
        }
    }

    #[test]
    fn rejection_leaves_the_corners_unused() {
        let unused = (0..128 * 128).filter(|&cell| DirectionMap::Rejection.direction(cell, 128).is_none()).count();
        let share = unused as f64 / (128.0 * 128.0);
        assert!((0.19..0.215).contains(&share), "{share}");
    }

    #[test]
    fn concentric_cells_have_equal_shares_of_the_disc() {
        let mut counts = [0_u32; 16];
        for point in crate::estimate::sampling::disc_samples(16_000) {
            counts[DirectionMap::Concentric.cell(lift(point), 4) as usize] += 1;
        }
        assert!(counts.iter().all(|count| (950..=1050).contains(count)), "{counts:?}");
    }

    #[test]
    fn broken_directions_give_some_cell() {
        for map in DirectionMap::ALL {
            for direction in [Vec3::NAN, Vec3::ZERO, Vec3::INFINITY, Vec3::NEG_INFINITY, vec3(-0.6, 0.0, -0.8)] {
                assert!(map.cell(direction, 8) < 64, "{map:?} of {direction}");
            }
        }
    }
}
