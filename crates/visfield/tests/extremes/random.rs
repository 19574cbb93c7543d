//! Random numbers that are the same on every machine.

use glam::{DMat3, DQuat, DVec3, dvec3};

/// `SplitMix64` (Steele et al., *Fast Splittable Pseudorandom Number Generators*, 2014).
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// Uniform in [low, high).
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Ten to a power that is uniform in [low, high).
    pub(crate) fn power_of_ten(&mut self, low: f64, high: f64) -> f64 {
        10.0_f64.powf(self.between(low, high))
    }

    /// A whole number below `count`.
    pub(crate) fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        self.between(0.0, 1.0) < probability
    }

    pub(crate) fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len())]
    }

    /// Uniform on the unit sphere.
    pub(crate) fn direction(&mut self) -> DVec3 {
        let (z, turn) = (self.between(-1.0, 1.0), self.between(0.0, std::f64::consts::TAU));
        let radius = (1.0 - z * z).sqrt();
        dvec3(radius * turn.cos(), radius * turn.sin(), z)
    }

    /// Uniform in the unit ball.
    pub(crate) fn in_ball(&mut self) -> DVec3 {
        self.direction() * self.between(0.0, 1.0).cbrt()
    }

    /// Some rotation.
    pub(crate) fn rotation(&mut self) -> DQuat {
        DQuat::from_axis_angle(self.direction(), self.between(0.0, std::f64::consts::TAU))
    }

    /// Some rotation as a matrix.
    pub(crate) fn rotation_matrix(&mut self) -> DMat3 {
        DMat3::from_quat(self.rotation())
    }
}
