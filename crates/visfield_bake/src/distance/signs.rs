//! Which points of a grid are inside.
//!
//! The surface is not met on the way from a point of the grid to its neighbour if their distances sum to more than the way is
//! long. Whatever is connected like this is on one side of a closed surface, and a winding number at the points where the
//! distance has a peak tells which. If these disagree, the connection leads through holes: then each point is asked, and
//! each connected region of those inside is judged by its widest opening:
//!
//! - A narrow one, for the room behind it, is a hole that was meant to be closed: the sign jumps there.
//! - A wide one stays open: what is behind it is outside, and the surface there is a sheet with two sides.

use rayon::prelude::*;

/// An opening is wide if its radius is more than this share of the radius of the room behind it. A box without one side is
/// open (1), and the bunny, whose base has holes, is closed (0.3).
const OPEN: f32 = 0.5;

/// How much the distances of neighbours have to sum to beyond a voxel, so that rounding does not connect them.
const MARGIN: f32 = 1.0e-4;

/// Makes the distances of points inside negative. They are in voxels, x fastest. `is_inside` tells which side a point is on
/// as well as it can be known from this point alone. It is asked for few points where surfaces are closed, for none twice but
/// the peaks, and for none that lies on the surface.
pub(crate) fn apply_signs(distances: &mut [f32], points: [u32; 3], is_inside: impl Fn([u32; 3]) -> bool + Sync) {
    let lattice = Lattice { points, distances };
    let is_inside = |index: usize| lattice.distances[index] > 0.0 && is_inside(lattice.place(index));
    let mut parts = Forest::new(lattice.distances.len());
    lattice.for_each_link(|one, other| parts.unite(one, other));
    let parts = parts.roots();

    let peaks: Vec<usize> = (0..parts.len()).into_par_iter().filter(|&index| lattice.is_peak(index)).collect();
    let peaks_inside: Vec<bool> = peaks.par_iter().map(|&index| is_inside(index)).collect();
    let mut sides = vec![[false; 2]; parts.len()];
    for (index, inside) in peaks.into_iter().zip(peaks_inside) {
        sides[parts[index] as usize][usize::from(inside)] = true;
    }
    let side_of_part = |index: usize| match sides[parts[index] as usize] {
        [true, true] => None,
        [_, inside] => Some(inside),
    };
    let mut inside: Vec<bool> =
        (0..parts.len()).into_par_iter().map(|index| side_of_part(index).unwrap_or_else(|| is_inside(index))).collect();
    if sides.contains(&[true, true]) {
        lattice.open_wide_openings(&mut inside);
    }
    for (distance, _) in distances.iter_mut().zip(inside).filter(|(_, inside)| *inside) {
        *distance = -*distance;
    }
}

/// Points of a grid, x fastest, and how far from the surface they are, in voxels.
#[derive(Clone, Copy)]
struct Lattice<'a> {
    points: [u32; 3],
    distances: &'a [f32],
}

impl Lattice<'_> {
    fn place(self, index: usize) -> [u32; 3] {
        let [width, height, _] = self.points.map(|n| n as usize);
        [(index % width) as u32, (index / width % height) as u32, (index / (width * height)) as u32]
    }

    /// Whether the surface cannot pass between two neighbours.
    fn is_linked(self, one: usize, other: usize) -> bool {
        self.distances[one] + self.distances[other] > 1.0 + MARGIN
    }

    /// For each axis, the neighbours before and after a point.
    fn neighbors(self, index: usize) -> [[Option<usize>; 2]; 3] {
        let [width, height, _] = self.points.map(|n| n as usize);
        let steps = [1, width, width * height];
        let place = self.place(index);
        std::array::from_fn(|axis| {
            let before = (place[axis] > 0).then(|| index - steps[axis]);
            [before, (place[axis] + 1 < self.points[axis]).then(|| index + steps[axis])]
        })
    }

    /// Whether none of the points it is linked to is farther from the surface. Of equals, the first is the peak.
    fn is_peak(self, index: usize) -> bool {
        let height = |index: usize| (self.distances[index], std::cmp::Reverse(index));
        let linked =
            self.neighbors(index).into_iter().flatten().flatten().filter(|&other| self.is_linked(index, other));
        linked.into_iter().all(|other| height(other) < height(index))
    }

    fn for_each_link(self, mut link: impl FnMut(usize, usize)) {
        for index in 0..self.distances.len() {
            for other in self.neighbors(index).into_iter().filter_map(|[_, after]| after) {
                if self.is_linked(index, other) {
                    link(index, other);
                }
            }
        }
    }

    /// Turns regions of points inside with a wide opening to the outside.
    fn open_wide_openings(self, inside: &mut [bool]) {
        let mut regions = Forest::new(inside.len());
        self.for_each_link(|one, other| {
            if inside[one] && inside[other] {
                regions.unite(one, other);
            }
        });
        let regions = regions.roots();
        let mut rooms = vec![0.0_f32; inside.len()];
        for (&region, &distance) in regions.iter().zip(self.distances) {
            rooms[region as usize] = rooms[region as usize].max(distance);
        }
        let mut openings = vec![0.0_f32; inside.len()];
        self.for_each_link(|one, other| {
            if inside[one] != inside[other] {
                let region = regions[if inside[one] { one } else { other }] as usize;
                openings[region] = openings[region].max(self.distances[one].min(self.distances[other]));
            }
        });
        for (inside, region) in inside.iter_mut().zip(regions) {
            *inside &= openings[region as usize] <= OPEN * rooms[region as usize];
        }
    }
}

/// Sets that unite (Tarjan & van Leeuwen, *Worst-Case Analysis of Set Union Algorithms*, 1984, §3: linking by index, path halving).
struct Forest {
    parents: Vec<u32>,
}

impl Forest {
    fn new(members: usize) -> Self {
        Self { parents: (0..members as u32).collect() }
    }

    fn root(&mut self, member: usize) -> usize {
        let mut member = member;
        while self.parents[member] as usize != member {
            self.parents[member] = self.parents[self.parents[member] as usize];
            member = self.parents[member] as usize;
        }
        member
    }

    fn unite(&mut self, one: usize, other: usize) {
        let (one, other) = (self.root(one), self.root(other));
        self.parents[one.max(other)] = one.min(other) as u32;
    }

    /// The root of each member.
    fn roots(mut self) -> Vec<u32> {
        (0..self.parents.len()).map(|member| self.root(member) as u32).collect()
    }
}
