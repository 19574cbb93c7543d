//! Shapes position by position: the shader's distances are those of its twin.

#[path = "../shape/random.rs"]
mod random;

use std::cell::RefCell;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use proptest::prelude::*;
use visfield::shape::{Shape, ShapeProgram};

use super::device::{buffer_with, device, run_probe};
use random::{check, placed, position, primitive, tree};

/// Trees, and as many single primitives.
const SHAPES: u32 = 1500;
const POSITIONS: usize = 40;
/// Of distances, in parts of the largest of 1, the distance and the position: GPUs may fuse multiplications and additions, and
/// their square roots and divisions are a few units of rounding off.
const TOLERANCE: f32 = 4.0e-6;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Probe {
    position: [f32; 3],
    first_word: u32,
    nodes: u32,
    padding: [u32; 3],
}

#[test]
fn shape_distances_are_those_of_the_twin() {
    let Some((device, queue)) = device() else { return };
    let programs = RefCell::new(vec![(ShapeProgram::default(), vec![Vec3::ZERO; POSITIONS])]);
    let take = |(shape, mut positions): (Shape, Vec<Vec3>)| {
        let program = ShapeProgram::new(&shape, 0.5).unwrap();
        // Some far away.
        positions[0] *= 1.0e5;
        programs.borrow_mut().push((program, positions));
    };
    let positions = || prop::collection::vec(position(), POSITIONS);
    check(SHAPES, &(tree(true), positions()), take);
    check(SHAPES, &(placed(primitive()), positions()), take);
    let programs = programs.into_inner();

    // Programs do not start at the pool's start.
    let mut words = vec![u32::MAX; 3];
    let mut probes = Vec::new();
    for (program, positions) in &programs {
        let probe = |position: &Vec3| Probe {
            position: position.to_array(),
            first_word: words.len() as u32,
            nodes: program.nodes().len() as u32,
            padding: [0; 3],
        };
        probes.extend(positions.iter().map(probe));
        words.extend_from_slice(bytemuck::cast_slice(program.nodes()));
    }
    let source = [visfield::gpu::SHAPE_SOURCE, include_str!("shape_eval.wgsl")].concat();
    let [words, positions] = [bytemuck::cast_slice(&words), bytemuck::cast_slice(&probes)]
        .map(|content: &[u8]| buffer_with(&device, &queue, content, wgpu::BufferUsages::STORAGE));
    let buffers = [(0, &words), (1, &positions)];
    let answers: Vec<f32> = run_probe((&device, &queue), source, &[], &buffers, (2, probes.len()));

    let (mut inside, mut largest) = (0, 0.0_f32);
    let pairs = programs.iter().flat_map(|(program, positions)| positions.iter().map(move |p| (program, *p)));
    for ((program, position), found) in pairs.zip(answers) {
        let expected = program.distance(position);
        let size = position.abs().max_element().max(expected.abs()).max(1.0);
        let difference = (found - expected).abs() / size;
        assert!(difference <= TOLERANCE, "{found} and {expected} at {position} of {program:#?}");
        assert!((found < 0.0) == (expected < 0.0) || difference > 0.0 && expected.abs() < TOLERANCE * size);
        inside += usize::from(found < 0.0);
        largest = largest.max(difference);
    }
    println!("{} positions, {inside} inside; largest relative difference {largest:e}", probes.len());
    assert!(inside > probes.len() / 50, "{inside} of {} are inside", probes.len());
}
