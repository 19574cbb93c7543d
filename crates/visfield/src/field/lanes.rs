//! Numbers side by side, one for each of several receivers or rays: loops over them become vector instructions.

use glam::Vec3;

/// A vector for each lane, by components.
#[derive(Clone, Copy)]
pub(crate) struct Vectors<const N: usize> {
    pub(crate) x: [f32; N],
    pub(crate) y: [f32; N],
    pub(crate) z: [f32; N],
}

impl<const N: usize> Vectors<N> {
    pub(crate) const ZERO: Self = Self { x: [0.0; N], y: [0.0; N], z: [0.0; N] };

    #[inline(always)]
    pub(crate) fn get(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x[lane], self.y[lane], self.z[lane])
    }

    #[inline(always)]
    pub(crate) fn set(&mut self, lane: usize, v: Vec3) {
        (self.x[lane], self.y[lane], self.z[lane]) = (v.x, v.y, v.z);
    }
}
