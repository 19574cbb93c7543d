//! Many receivers against one grid at once. One receiver is a batch of one: there is no other way to read a grid.

use half::f16;

use super::{CapGrid, CapPrecision, GridPoint};
use crate::field::lanes::Vectors;

/// The eight grid points around a position, x running fastest.
const CORNERS: usize = 8;

impl CapGrid {
    /// Four coefficients at each position, interpolated: those of `plane`, in cap space.
    #[inline(always)]
    pub(crate) fn plane_of<const N: usize>(&self, positions: &Vectors<N>, plane: usize) -> [[f32; N]; 4] {
        let points = self.header.format.points;
        let (mut first, mut fraction, mut weight) = ([0; N], Vectors::<N>::ZERO, [0.0; N]);
        for lane in 0..N {
            let at = GridPoint::new(&self.warps, points, positions.get(lane));
            first[lane] = at.index(points);
            fraction.set(lane, at.fraction);
            weight[lane] = at.weight;
        }
        let [low, step] = self.low_and_step(plane);
        let mut four = [[0.0; N]; 4];
        match self.header.format.precision {
            CapPrecision::U8 => {
                let words = self.corners::<N>(&first, self.first_word(plane), 1, 0);
                for i in 0..4 {
                    // Interpolating bytes is interpolating what they stand for.
                    for lane in 0..N {
                        let byte = |corner: usize| ((words[corner][lane] >> (8 * i)) & 0xff) as f32;
                        four[i][lane] = (low[i] + step[i] * interpolate(byte, &fraction, lane)) * weight[lane];
                    }
                }
            }
            CapPrecision::F16 => {
                for i in 0..4 {
                    let words = self.corners::<N>(&first, self.first_word(plane), 2, i / 2);
                    for lane in 0..N {
                        let half =
                            |corner: usize| f16::from_bits((words[corner][lane] >> (16 * (i % 2))) as u16).to_f32();
                        four[i][lane] = (low[i] + step[i] * interpolate(half, &fraction, lane)) * weight[lane];
                    }
                }
            }
        }
        four
    }

    /// Word number `word` of the points around each position. Points have `stride` words.
    #[inline(always)]
    fn corners<const N: usize>(
        &self,
        first: &[u32; N],
        first_word: usize,
        stride: usize,
        word: usize,
    ) -> [[u32; N]; CORNERS] {
        let points = self.header.format.points as usize;
        let words = &self.words[first_word + word..];
        let mut found = [[0; N]; CORNERS];
        // Two points that are next to each other at a time.
        for corner in (0..CORNERS).step_by(2) {
            let offset = points * ((corner >> 1 & 1) + points * (corner >> 2));
            for lane in 0..N {
                let pair = &words[(first[lane] as usize + offset) * stride..][..=stride];
                (found[corner][lane], found[corner + 1][lane]) = (pair[0], pair[stride]);
            }
        }
        found
    }

    /// Where the points of four coefficients start.
    fn first_word(&self, plane: usize) -> usize {
        plane * self.header.words_per_plane()
    }
}

/// Between eight values, x running fastest.
#[inline(always)]
fn interpolate<const N: usize>(value: impl Fn(usize) -> f32, fraction: &Vectors<N>, lane: usize) -> f32 {
    let between = |a: f32, b: f32, share: f32| a + (b - a) * share;
    let row = |corner: usize| between(value(corner), value(corner + 1), fraction.x[lane]);
    let layer = |corner: usize| between(row(corner), row(corner + 2), fraction.y[lane]);
    between(layer(0), layer(4), fraction.z[lane])
}
