//! Real spherical harmonics of bands 0 to 3, orthonormal, in the order (l, m) = (0, 0), (1, x), (1, y), (1, z), (2, −2…2),
//! (3, −3…3).

use glam::Vec3;

use super::cap::{Y0, Y1};

/// Harmonics of bands 0 to 3.
pub const MAX_COEFFICIENTS: usize = 16;

/// First coefficient of each band, and the number of all.
const BANDS: [usize; 5] = [0, 1, 4, 9, 16];

/// The harmonics of a unit direction.
///
/// ```
/// use visfield::field::cap_grid::harmonics::harmonics;
/// // Their squares sum up to 16/4π in any direction (Unsöld's theorem).
/// let sum: f32 = harmonics(glam::Vec3::new(0.6, 0.0, 0.8)).iter().map(|y| y * y).sum();
/// assert!((sum - 4.0 / std::f32::consts::PI).abs() < 1e-5);
/// ```
#[inline]
pub fn harmonics(direction: Vec3) -> [f32; MAX_COEFFICIENTS] {
    let Vec3 { x, y, z } = direction;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        Y0,
        Y1 * x,
        Y1 * y,
        Y1 * z,
        1.092_548_4 * x * y,
        1.092_548_4 * y * z,
        0.315_391_57 * (3.0 * zz - 1.0),
        1.092_548_4 * x * z,
        0.546_274_2 * (xx - yy),
        0.590_043_6 * y * (3.0 * xx - yy),
        2.890_611_4 * x * y * z,
        0.457_045_8 * y * (5.0 * zz - 1.0),
        0.373_176_33 * z * (5.0 * zz - 3.0),
        0.457_045_8 * x * (5.0 * zz - 1.0),
        1.445_305_7 * z * (xx - yy),
        0.590_043_6 * x * (xx - 3.0 * yy),
    ]
}

/// Mean of each Legendre polynomial over a disc of directions with this cosine of its half-angle.
fn legendre_means(cosine: f32) -> [f32; 4] {
    let c = cosine;
    [1.0, (1.0 + c) * 0.5, c * (1.0 + c) * 0.5, (1.0 + c) * (5.0 * c * c - 1.0) * 0.125]
}

/// The mean over a disc around `axis` of a function with these harmonics.
pub fn disc_mean(coefficients: &[f32; MAX_COEFFICIENTS], axis: Vec3, half_angle: f32) -> f32 {
    let basis = harmonics(axis);
    let means = legendre_means(half_angle.cos());
    let band = |l: usize| (BANDS[l]..BANDS[l + 1]).map(|i| coefficients[i] * basis[i]).sum::<f32>();
    (0..4).map(|l| means[l] * band(l)).sum()
}

/// The harmonics of a disc of directions, whose half-angle has this cosine.
pub(super) fn disc(coefficients: &mut [f32; MAX_COEFFICIENTS], axis: Vec3, cosine: f32) {
    let solid_angle = std::f32::consts::TAU * (1.0 - cosine);
    let (basis, means) = (harmonics(axis), legendre_means(cosine));
    for l in 0..4 {
        for i in BANDS[l]..BANDS[l + 1] {
            coefficients[i] = solid_angle * means[l] * basis[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::sampling::sphere_samples;

    #[test]
    fn the_functions_are_orthonormal() {
        let directions = sphere_samples(20_000);
        let weight = 4.0 * std::f32::consts::PI / directions.len() as f32;
        let all: Vec<_> = directions.iter().map(|&d| harmonics(d)).collect();
        for i in 0..MAX_COEFFICIENTS {
            for j in 0..MAX_COEFFICIENTS {
                let product: f32 = all.iter().map(|y| y[i] * y[j]).sum::<f32>() * weight;
                assert!((product - f32::from(u8::from(i == j))).abs() < 2e-3, "{i}, {j}: {product}");
            }
        }
    }

    #[test]
    fn a_disc_is_the_sum_of_its_directions() {
        let (axis, half_angle) = (Vec3::new(2.0, -1.0, 3.0).normalize(), 0.7_f32);
        let mut disc_coefficients = [0.0; MAX_COEFFICIENTS];
        disc(&mut disc_coefficients, axis, half_angle.cos());
        let directions = sphere_samples(40_000);
        let mut summed = [0.0; MAX_COEFFICIENTS];
        for d in directions.iter().filter(|d| d.dot(axis) > half_angle.cos()) {
            for (sum, y) in summed.iter_mut().zip(harmonics(*d)) {
                *sum += y * 4.0 * std::f32::consts::PI / 40_000.0;
            }
        }
        for (one, other) in disc_coefficients.iter().zip(summed) {
            assert!((one - other).abs() < 5e-3, "{one}, {other}");
        }
        // The mean of a function over a disc, in two ways.
        let function = |d: Vec3| 0.5 + d.x * d.y - 0.3 * d.z * d.z * d.z;
        let mut coefficients = [0.0; MAX_COEFFICIENTS];
        for d in &directions {
            for (c, y) in coefficients.iter_mut().zip(harmonics(*d)) {
                *c += function(*d) * y * 4.0 * std::f32::consts::PI / 40_000.0;
            }
        }
        let inside: Vec<f32> =
            directions.iter().filter(|d| d.dot(axis) > half_angle.cos()).map(|d| function(*d)).collect();
        let mean = inside.iter().sum::<f32>() / inside.len() as f32;
        assert!((disc_mean(&coefficients, axis, half_angle) - mean).abs() < 5e-3);
    }
}
