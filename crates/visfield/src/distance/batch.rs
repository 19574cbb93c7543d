//! Many rays against one distance field at once: the same march as [`query`](super::query), several lanes wide.
//!
//! Rays differ in how many steps they take. So lanes are not blocks: a ray that has ended makes room for the next, and all
//! lanes are at work until the rays run out. The arithmetic of a step is done in loops over the lanes that the compiler makes
//! vector instructions of; only the reads from the grid go lane by lane. Nothing is contracted or reordered, so that a batch
//! gives the same answers as its rays one by one, bit for bit.

#![expect(
    clippy::needless_range_loop,
    clippy::needless_bitwise_bool,
    reason = "lane by lane through several arrays, and without branches: that is what becomes vector instructions"
)]

use std::cell::Cell;

use glam::Vec3;
use pulp::{Arch, NullaryFnOnce};

use super::grid::{Cells, DistanceGrid, GridShape};
use super::query::{LEAST_REACH, LEAST_STEP, MAX_STEPS, RELAXATION, SLACK, SLACK_REACH, Segment, lifted, segment};
use super::sphere_trace::adapted;
use super::{DistanceField, GRID_THRESHOLD};
use crate::field::lanes::Vectors;
use crate::field::query::{Bias, Ray, finite};

/// Rays at work.
const LANES: usize = 32;

impl DistanceField {
    /// [`VisibilityField::hit_batch`](crate::VisibilityField::hit_batch), for rays, a normal and a bias in the space of the
    /// distances, and as many `hits` as `rays`.
    pub(crate) fn hit_batch(&self, rays: &[Ray], normal: Vec3, bias: Bias, hits: &mut [f32]) {
        match self {
            Self::Grid(grid) => {
                let answer = |ray: &Ray, t: f32| {
                    let (rescaled, scale) = ray.rescaled();
                    if t < f32::INFINITY {
                        finite(t / rescaled.direction.length() / scale).min(ray.t_max.next_down())
                    } else {
                        t
                    }
                };
                march(grid, rays, normal, bias, hits, answer);
            }
            // Trees differ too much from ray to ray for lanes.
            Self::Shape(_) => {
                for (hit, ray) in hits.iter_mut().zip(rays) {
                    *hit = self.hit(ray, normal, bias).unwrap_or(f32::INFINITY);
                }
            }
        }
    }

    /// [`VisibilityField::occluded_batch`](crate::VisibilityField::occluded_batch), likewise.
    pub(crate) fn occluded_batch(&self, rays: &[Ray], normal: Vec3, bias: Bias, occluded: &mut [bool]) {
        match self {
            Self::Grid(grid) => march(grid, rays, normal, bias, occluded, |_, t| t < f32::INFINITY),
            Self::Shape(_) => {
                for (occluded, ray) in occluded.iter_mut().zip(rays) {
                    *occluded = self.occluded(ray, normal, bias);
                }
            }
        }
    }
}

/// Marches all rays; `answer` makes an answer of a ray and of how far it came to its hit, or infinity.
fn march<A>(
    grid: &DistanceGrid,
    rays: &[Ray],
    normal: Vec3,
    bias: Bias,
    answers: &mut [A],
    answer: impl Fn(&Ray, f32) -> A,
) {
    match grid.cells() {
        Cells::U8(codes) => {
            Arch::new().dispatch(March { grid: grid.shape(), codes, rays, normal, bias, answers, answer });
        }
        Cells::U16(codes) => {
            Arch::new().dispatch(March { grid: grid.shape(), codes, rays, normal, bias, answers, answer });
        }
    }
}

/// A batch's work, to be compiled for each kind of processor.
struct March<'a, C, A, F> {
    grid: GridShape,
    codes: &'a [C],
    rays: &'a [Ray],
    normal: Vec3,
    bias: Bias,
    answers: &'a mut [A],
    answer: F,
}

/// The rays at work.
struct Lanes {
    /// Which ray is in a lane; none of the batch's in an idle one, which never ends.
    ray: [usize; LANES],
    origin: Vectors<LANES>,
    direction: Vectors<LANES>,
    t: [f32; LANES],
    t_max: [f32; LANES],
    slack: [f32; LANES],
    previous: [f32; LANES],
    step: [f32; LANES],
    evaluations: [u32; LANES],
}

const IDLE: usize = usize::MAX;

impl<C: Copy + Into<f32>, A, F: Fn(&Ray, f32) -> A> NullaryFnOnce for March<'_, C, A, F> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { grid, codes, rays, normal, bias, answers, answer } = self;
        let bounds = (Vec3::ZERO, grid.last);
        let distance = |position: Vec3| {
            let place = grid.place(position);
            let corners = grid.corners(codes, place.index);
            grid.interpolate(&corners, place.fraction, place.squared_beyond)
        };
        let slack = bias.height * SLACK;
        // Many rays leave each point: where the last one was lifted to is kept.
        let known = Cell::new((Vec3::NAN, Vec3::ZERO));
        let lift = |origin: Vec3| {
            if known.get().0 != origin {
                known.set((origin, lifted(origin, normal, slack, distance)));
            }
            known.get().1
        };
        let mut lanes = Lanes {
            ray: [IDLE; LANES],
            origin: Vectors::ZERO,
            direction: Vectors::ZERO,
            t: [0.0; LANES],
            t_max: [f32::INFINITY; LANES],
            slack: [0.0; LANES],
            previous: [0.0; LANES],
            step: [0.0; LANES],
            evaluations: [0; LANES],
        };
        let mut next = 0;
        let mut at_work = 0;
        let mut ended = [true; LANES];
        loop {
            for lane in 0..LANES {
                if !ended[lane] {
                    continue;
                }
                ended[lane] = false;
                lanes.ray[lane] = IDLE;
                // Rays that pass the bounds by never get into a lane.
                while next < rays.len() {
                    let (ray, _) = rays[next].rescaled();
                    let Segment { origin, direction, t_min, t_max, slack } = segment(&ray, slack, bounds, lift);
                    if t_min < t_max {
                        lanes.ray[lane] = next;
                        lanes.origin.set(lane, origin);
                        lanes.direction.set(lane, direction);
                        (lanes.t[lane], lanes.t_max[lane]) = (t_min, t_max);
                        lanes.slack[lane] = slack;
                        (lanes.previous[lane], lanes.step[lane], lanes.evaluations[lane]) = (0.0, 0.0, 0);
                        at_work += 1;
                        next += 1;
                        break;
                    }
                    answers[next] = answer(&rays[next], f32::INFINITY);
                    next += 1;
                }
                if lanes.ray[lane] == IDLE {
                    (lanes.t[lane], lanes.t_max[lane], lanes.evaluations[lane]) = (0.0, f32::INFINITY, 0);
                }
            }
            if at_work == 0 {
                return;
            }
            let (hit, over) = step(&grid, codes, (bias.along * SLACK_REACH).max(LEAST_REACH), &mut lanes);
            for lane in 0..LANES {
                if over[lane] && lanes.ray[lane] != IDLE {
                    let ray = lanes.ray[lane];
                    answers[ray] = answer(&rays[ray], if hit[lane] { lanes.t[lane] } else { f32::INFINITY });
                    ended[lane] = true;
                    at_work -= 1;
                }
            }
        }
    }
}

/// One step of every lane, as in [`sphere_trace`](super::sphere_trace::sphere_trace): which of them have hit, and which are
/// over.
#[inline(always)]
fn step<C: Copy + Into<f32>>(
    grid: &GridShape,
    codes: &[C],
    slack_reach: f32,
    lanes: &mut Lanes,
) -> ([bool; LANES], [bool; LANES]) {
    let mut index = [0_u32; LANES];
    let (mut fraction, mut squared) = (Vectors::<LANES>::ZERO, [0.0_f32; LANES]);
    for lane in 0..LANES {
        let position = lanes.origin.get(lane) + lanes.direction.get(lane) * lanes.t[lane];
        let place = grid.place(position);
        index[lane] = place.index;
        fraction.set(lane, place.fraction);
        squared[lane] = place.squared_beyond;
    }
    let mut corners = [[0.0_f32; LANES]; 8];
    for lane in 0..LANES {
        let read = grid.corners(codes, index[lane]);
        for (corner, value) in read.into_iter().enumerate() {
            corners[corner][lane] = value;
        }
    }
    let (mut hit, mut over) = ([false; LANES], [false; LANES]);
    for lane in 0..LANES {
        let here: [f32; 8] = std::array::from_fn(|corner| corners[corner][lane]);
        let distance = grid.interpolate(&here, fraction.get(lane), squared[lane]);
        let (previous, last_step) = (lanes.previous[lane], lanes.step[lane]);
        let back = (last_step > previous) & (previous + distance < last_step) & (last_step > LEAST_STEP);
        let slack = lanes.slack[lane] * (1.0 - lanes.t[lane] / slack_reach).max(0.0);
        let met = !back & (distance < GRID_THRESHOLD - slack);
        let step = (distance * adapted(distance, previous, last_step, RELAXATION)).max(LEAST_STEP);
        let t = lanes.t[lane]
            + if back {
                previous - last_step
            } else if met {
                0.0
            } else {
                step
            };
        lanes.evaluations[lane] += 1;
        lanes.step[lane] = if back { previous } else { step };
        lanes.previous[lane] = if back { previous } else { distance };
        hit[lane] = met;
        // What is no number is over, too.
        let goes_on = (t < lanes.t_max[lane]) & (lanes.evaluations[lane] < MAX_STEPS);
        over[lane] = met | !goes_on;
        lanes.t[lane] = t;
    }
    (hit, over)
}
