//! Which points of a grid are inside.
//!
//! The surface is not met on the way from a point of the grid to its neighbour if their distances sum to more than the way is
//! long. Whatever is connected like this is on one side of the surface, and one winding number tells which, unless the
//! connection leads through a hole. So points are taken from the farthest to the nearest: each becomes part of the basin
//! of a neighbour that it is connected to, or else founds a basin of its own, and basins unite where they meet (a watershed:
//! Vincent & Soille, *Watersheds in Digital Spaces*, 1991). Where one inside meets one outside, there is a hole:
//!
//! - A bottleneck, narrow for the room behind it, is closed: the basins stay apart, and the sign jumps between them.
//! - A wide opening stays open: what is behind it becomes outside, and the surface there is a sheet with two sides.

use rayon::prelude::*;

/// An opening is wide if its radius is more than this share of the radius of the room behind it. A box without one side is open
/// (1), and the bunny's base with its holes is closed (below 0.2).
const OPEN: f32 = 0.5;

/// How much the distances of neighbours have to sum to beyond their distance, in voxels, so that rounding does not connect
/// them.
const MARGIN: f32 = 1.0e-4;

/// A set of connected points.
#[derive(Clone, Copy)]
struct Basin {
    inside: bool,
    /// The largest distance.
    peak: f32,
}

/// Makes the distances of points inside negative. They are in voxels, x fastest. `is_inside` tells which side a point is on,
/// as well as it can be known from this point alone; it is asked for few points, and for none that lies on the surface.
pub(crate) fn apply_signs(distances: &mut [f32], points: [u32; 3], is_inside: impl Fn([u32; 3]) -> bool + Sync) {
    let lattice = Lattice::new(points);
    // From the farthest to the nearest, in an order that leaves no ties. The bits of positive numbers are ordered as they are.
    let rank = |index: usize| (u64::from(!distances[index].to_bits()) << 32) | index as u64;
    let mut order: Vec<u64> = (0..distances.len()).map(rank).collect();
    order.par_sort_unstable();

    let connected = |one: usize, other: usize| distances[one] + distances[other] > 1.0 + MARGIN;
    let before = |index: usize| {
        lattice.neighbors(index).filter(move |&other| rank(other) < rank(index) && connected(index, other))
    };
    // By the point that founded it.
    let mut basins: Vec<Option<Basin>> = (0..distances.len())
        .into_par_iter()
        .map(|index| {
            let founds = before(index).next().is_none();
            let peak = distances[index];
            founds.then(|| Basin { inside: peak > 0.0 && is_inside(lattice.place(index)), peak })
        })
        .collect();

    let mut parents: Vec<u32> = (0..distances.len() as u32).collect();
    for index in order.iter().map(|rank| *rank as u32 as usize) {
        let highest = before(index).min_by_key(|&other| rank(other));
        let Some(highest) = highest else { continue };
        parents[index] = find(&mut parents, highest as u32);
        for other in before(index).filter(|&other| other != highest) {
            unite(&mut parents, &mut basins, [highest, other], distances[index]);
        }
    }
    for (index, distance) in distances.iter_mut().enumerate() {
        let root = find(&mut parents, index as u32) as usize;
        if basins[root].is_some_and(|basin| basin.inside) {
            *distance = -*distance;
        }
    }
}

/// Makes one basin of two that meet where the surface is `clearance` away, unless they are the two sides of a bottleneck.
fn unite(parents: &mut [u32], basins: &mut [Option<Basin>], members: [usize; 2], clearance: f32) {
    let roots = members.map(|member| find(parents, member as u32));
    let (Some(one), Some(other)) = (basins[roots[0] as usize], basins[roots[1] as usize]) else { return };
    if roots[0] == roots[1] {
        return;
    }
    if one.inside != other.inside {
        let room = if one.inside { one.peak } else { other.peak };
        if clearance <= OPEN * room {
            return;
        }
    }
    let [low, high] = if one.peak < other.peak { roots } else { [roots[1], roots[0]] };
    parents[low as usize] = high;
    basins[high as usize] = Some(Basin { inside: one.inside && other.inside, peak: one.peak.max(other.peak) });
}

/// The root of a member's tree; halves the way there.
fn find(parents: &mut [u32], member: u32) -> u32 {
    let mut member = member as usize;
    while parents[member] as usize != member {
        parents[member] = parents[parents[member] as usize];
        member = parents[member] as usize;
    }
    member as u32
}

/// Indices of grid points, x fastest.
#[derive(Clone, Copy)]
struct Lattice {
    points: [u32; 3],
}

impl Lattice {
    fn new(points: [u32; 3]) -> Self {
        Self { points }
    }

    fn place(self, index: usize) -> [u32; 3] {
        let [width, height, _] = self.points.map(|n| n as usize);
        [(index % width) as u32, (index / width % height) as u32, (index / (width * height)) as u32]
    }

    /// The up to six points that are one voxel away.
    fn neighbors(self, index: usize) -> impl Iterator<Item = usize> {
        let [width, height, _] = self.points.map(|n| n as usize);
        let steps = [1, width, width * height];
        let place = self.place(index);
        (0..3).flat_map(move |axis| {
            let back = (place[axis] > 0).then(|| index - steps[axis]);
            let ahead = (place[axis] + 1 < self.points[axis]).then(|| index + steps[axis]);
            back.into_iter().chain(ahead)
        })
    }
}
