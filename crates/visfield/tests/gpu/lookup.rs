//! Single rays: the shader picks the table entries that its CPU twin picks.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;
use visfield::field::ball;
use visfield::field::chord::chord;
use visfield::field::lookup::{Aim, TwoPointGrid, forward_lookup, reversed_lookup};
use visfield::field::query::Bias;
use visfield::gpu::layout::encoding_number;
use visfield::{ChordTable, Encoding, QueryOptions, Ray, Representation, VisibilityField};

use super::device::{buffer_with, device, run_probe};

const RAYS: usize = 100_000;
const GRID: TwoPointGrid = TwoPointGrid { entries: 65, exits: 32 };
const NONE: u32 = u32::MAX;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Probe {
    origin: [f32; 3],
    t_max: f32,
    direction: [f32; 3],
    padding: u32,
    normal: [f32; 3],
    padding_2: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Answer {
    forward_index: u32,
    reversed_index: u32,
    fraction: f32,
    occluded: u32,
    bias_height: f32,
}

/// Rays from inside and outside the sphere, in all directions, of lengths 0.1 to 10, most of which meet the sphere.
fn random_probes() -> Vec<Probe> {
    let mut runner = TestRunner::deterministic();
    let unit = || prop::array::uniform3(-1.0_f32..1.0);
    let ray = (unit(), unit(), 0.1_f32..3.0, 0.1_f32..10.0, 0.1_f32..20.0, unit());
    let mut probe = || {
        let (from, target, distance, length, t_max, normal) = ray.new_tree(&mut runner).unwrap().current();
        let origin = Vec3::from(from).normalize_or(Vec3::X) * distance;
        let target = Vec3::from(target) * 0.7;
        let direction = (target - origin).normalize_or(Vec3::Y) * length;
        // Some rays leave no surface.
        let normal = if t_max < 2.0 { Vec3::ZERO } else { Vec3::from(normal).normalize_or_zero() };
        Probe {
            origin: origin.to_array(),
            t_max,
            direction: direction.to_array(),
            padding: 0,
            normal: normal.to_array(),
            padding_2: 0,
        }
    };
    (0..RAYS).map(|_| probe()).collect()
}

fn on_gpu(device: &wgpu::Device, queue: &wgpu::Queue, table: &ChordTable, probes: &[Probe]) -> Vec<Answer> {
    let source = [visfield::gpu::FIELD_SOURCE, include_str!("lookup.wgsl")].concat();
    let storage = wgpu::BufferUsages::STORAGE;
    let shape = [GRID.entries, GRID.exits, encoding_number(table.encoding())];
    // Whole words, as the pool has them.
    let mut words = table.bytes().to_vec();
    words.resize(words.len().next_multiple_of(4), 0);
    let [words, rays, shape] = [&words, bytemuck::cast_slice(probes), bytemuck::cast_slice(&shape)]
        .map(|content: &[u8]| buffer_with(device, queue, content, storage));
    run_probe((device, queue), source, &[], &[(0, &words), (1, &rays), (3, &shape)], (2, probes.len()))
}

/// Whether two table positions are of the same or of touching cells, at both ends of the chord.
fn at_most_one_cell_away(a: u32, b: u32) -> bool {
    let exits = GRID.exits * GRID.exits;
    let near = |a: u32, b: u32, side: u32| {
        let touch = |x: u32, y: u32| (x % side).abs_diff(y % side) <= 1 && (x / side).abs_diff(y / side) <= 1;
        // The map folds the square's edge onto itself: cells that touch there are mirrored along it.
        let last = side - 1;
        let mirrored = |cell: u32| match (cell % side, cell / side) {
            (x, y) if x == 0 || x == last => (last - y) * side + x,
            (x, y) if y == 0 || y == last => y * side + last - x,
            _ => cell,
        };
        touch(a, b) || touch(mirrored(a), b)
    };
    a != NONE && b != NONE && near(a / exits, b / exits, GRID.entries) && near(a % exits, b % exits, GRID.exits)
}

#[test]
fn the_shader_picks_the_same_table_entries_as_its_twin() {
    let Some((device, queue)) = device() else { return };
    let probes = random_probes();
    for encoding in Encoding::ALL {
        let field = ball(0.6, Representation::TwoPoint { entries: GRID.entries, exits: GRID.exits }, encoding);
        compare(&field, &probes, &on_gpu(&device, &queue, field.table().unwrap(), &probes));
    }
}

fn compare(field: &VisibilityField, probes: &[Probe], answers: &[Answer]) {
    let table = field.table().unwrap();
    let (mut different, mut meeting, mut different_hits) = (0, 0, 0);
    for (probe, answer) in probes.iter().zip(answers) {
        let (origin, direction) = (Vec3::from(probe.origin), Vec3::from(probe.direction));
        let options = QueryOptions { normal: Vec3::from(probe.normal), bias: Bias::default(), aim: Aim::Point };
        let (mut forward, mut reversed) = (NONE, NONE);
        if let Some(c) = chord(origin, direction) {
            meeting += 1;
            forward = forward_lookup(&GRID, direction, &c, Aim::Point).index;
            if forward == answer.forward_index {
                let fraction = table.codes().fraction(forward).unwrap_or(3.0e38);
                assert!(
                    (answer.fraction - fraction).abs() < 1e-6 * fraction.max(1.0),
                    "{} and {fraction}",
                    answer.fraction
                );
            }
            let lookup = reversed_lookup(&GRID, origin, direction, &c, Aim::Point);
            reversed = lookup.index;
            if reversed == answer.reversed_index {
                let height = options.bias.height(table.resolution(), lookup.before, lookup.length);
                assert!((answer.bias_height - height).abs() <= 1e-4 * height, "{} and {height}", answer.bias_height);
            }
        }
        for (mine, theirs) in [(forward, answer.forward_index), (reversed, answer.reversed_index)] {
            if mine != theirs {
                different += 1;
                assert!(at_most_one_cell_away(mine, theirs), "{mine} and {theirs} for {origin} → {direction}");
            }
        }
        let occluded = field.occluded(&Ray { origin, direction, t_max: probe.t_max }, &options);
        different_hits += usize::from(occluded != (answer.occluded == 1));
    }
    let encoding = table.encoding();
    println!(
        "{encoding:?}: {different} of {} indices and {different_hits} of {RAYS} hits differ; {meeting} rays meet",
        2 * meeting
    );
    assert!(meeting > RAYS * 9 / 10, "only {meeting} rays meet the sphere");
    assert!(different <= 2 * meeting / 10_000, "{different} of {} indices differ", 2 * meeting);
    assert!(different_hits <= RAYS / 10_000, "{different_hits} of {RAYS} hits differ");
}
