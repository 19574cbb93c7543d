//! Cells of the sphere: an octahedral map (Cigolle et al., *Survey of Efficient Representations for Independent Unit
//! Vectors*, JCGT 2014, §3.2) cut into a square grid. Constant-time both ways, without trigonometry.

use glam::{Vec2, Vec3, vec2, vec3};

/// The cell of a grid of `side`² cells that contains direction `p`, row-major, below `side`².
///
/// `p` needs no normalisation; a zero or NaN vector gives some valid cell.
///
/// ```
/// use visfield::field::octahedral::{octahedral_cell, octahedral_direction};
/// let cell = octahedral_cell(glam::vec3(0.3, -0.4, 0.8), 32);
/// assert_eq!(octahedral_cell(octahedral_direction(cell, 32), 32), cell);
/// ```
#[inline(always)]
pub fn octahedral_cell(p: Vec3, side: u32) -> u32 {
    cell_number(octahedral_grid(p, side), side)
}

/// The unit vector to the centre of a cell.
#[inline(always)]
pub fn octahedral_direction(cell: u32, side: u32) -> Vec3 {
    grid_direction(vec2((cell % side) as f32, (cell / side) as f32), side)
}

/// The cell that contains `p`, and the unit vector to its centre: what [`octahedral_cell`] and [`octahedral_direction`]
/// give, without integer division.
#[inline(always)]
pub fn octahedral_snap(p: Vec3, side: u32) -> (u32, Vec3) {
    let grid = octahedral_grid(p, side);
    (cell_number(grid, side), grid_direction(grid, side))
}

/// Column and row of the cell that contains `p`, whole numbers below `side`.
#[inline(always)]
fn octahedral_grid(p: Vec3, side: u32) -> Vec2 {
    let folded = vec2(p.x, p.y) / (p.x.abs() + p.y.abs() + p.z.abs());
    let uv = if p.z < 0.0 { fold(folded) } else { folded };
    let grid = (uv * 0.5 + 0.5) * side as f32;
    let last = (side - 1) as f32;
    // NaN becomes 0, as in the twin.
    vec2(grid.x.floor().max(0.0).min(last), grid.y.floor().max(0.0).min(last))
}

/// Exact for whole numbers below 2²³, and made of nothing but additions: casts of floats saturate in Rust, which costs more.
#[inline(always)]
fn cell_number(grid: Vec2, side: u32) -> u32 {
    const WHOLE: f32 = 8_388_608.0;
    let integer = |x: f32| (x + WHOLE).to_bits() - WHOLE.to_bits();
    integer(grid.y) * side + integer(grid.x)
}

#[inline(always)]
fn grid_direction(grid: Vec2, side: u32) -> Vec3 {
    let uv = (grid + 0.5) / side as f32 * 2.0 - 1.0;
    let z = 1.0 - uv.x.abs() - uv.y.abs();
    let xy = if z < 0.0 { fold(uv) } else { uv };
    vec3(xy.x, xy.y, z).normalize()
}

/// Mean width of a cell on the unit sphere: the square root of its mean solid angle.
#[inline(always)]
pub fn cell_width(side: u32) -> f32 {
    /// √4π
    const SQRT_SPHERE: f32 = 3.544_907_7;
    SQRT_SPHERE / side as f32
}

/// Mirrors the corners of the square onto the lower hemisphere, and back.
#[inline(always)]
fn fold(uv: Vec2) -> Vec2 {
    let sign = vec2(if uv.x >= 0.0 { 1.0 } else { -1.0 }, if uv.y >= 0.0 { 1.0 } else { -1.0 });
    (1.0 - vec2(uv.y.abs(), uv.x.abs())) * sign
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_centre_maps_back_to_its_cell() {
        for side in [1, 2, 7, 32, 65] {
            for cell in 0..side * side {
                assert_eq!(octahedral_cell(octahedral_direction(cell, side), side), cell, "side {side}");
            }
        }
    }

    #[test]
    fn cells_are_near_the_points_they_stand_for() {
        // Octahedral cells are at most about twice the mean width across.
        for (i, point) in crate::estimate::sampling::sphere_samples(5000).iter().enumerate() {
            let cell = octahedral_cell(*point, 65);
            let distance = octahedral_direction(cell, 65).distance(*point);
            assert!(distance < 1.5 * cell_width(65), "sample {i} is {distance} from its cell");
        }
    }

    #[test]
    fn degenerate_input_gives_a_valid_cell() {
        for p in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY, vec3(0.0, 0.0, -0.0)] {
            assert!(octahedral_cell(p, 9) < 81);
        }
    }
}
