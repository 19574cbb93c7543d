//! The cheap estimators position by position: the shader's are those of its twin.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use visfield::distance::estimators::{
    NormalOcclusion, ShadowMarch, evans_occlusion, hard_shadow, normal_occlusion, penumbra_shadow,
};
use visfield::estimate::sampling::sphere_samples;

use super::device::{buffer_with, device, run_probe};

const COUNT: u32 = 20_000;
/// Of occlusion: a march adds up the rounding of its steps, and a penumbra multiplies it by its scale.
const TOLERANCE: f32 = 2.0e-3;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Probe {
    position: [f32; 3],
    scale: f32,
    normal: [f32; 3],
    bend: f32,
    direction: [f32; 3],
    padding: f32,
}

#[test]
fn cheap_estimates_are_those_of_the_twin() {
    let Some((device, queue)) = device() else { return };
    let center = Vec3::new(1.0, 2.0, 3.0);
    let distance = |p: Vec3| ((p - center).length() - 2.0).min(p.x + 4.0);
    let directions = sphere_samples(COUNT);
    let probe = |i: usize| {
        let at = |turn: usize| directions[i * turn % directions.len()];
        Probe {
            position: (center + at(1) * (2.0 + (i % 13) as f32 * 0.3)).to_array(),
            scale: 4.0 + (i % 5) as f32 * 3.0,
            normal: at(7919).to_array(),
            bend: if i.is_multiple_of(2) { 0.0 } else { 0.5 },
            direction: at(104_729).to_array(),
            padding: 0.0,
        }
    };
    let probes: Vec<Probe> = (0..COUNT as usize).map(probe).collect();
    let source = [include_str!("estimators.wgsl"), visfield::gpu::ESTIMATORS_SOURCE].concat();
    let buffer = buffer_with(&device, &queue, bytemuck::cast_slice(&probes), wgpu::BufferUsages::STORAGE);
    let answers: Vec<[f32; 4]> = run_probe((&device, &queue), source, &[], &[(0, &buffer)], (1, probes.len()));

    let march = ShadowMarch { start: 0.1, threshold: 0.01, max_steps: 64 };
    let (mut between, mut differing) = ([0; 4], 0);
    for (probe, found) in probes.iter().zip(answers) {
        let [position, normal, direction] = [probe.position, probe.normal, probe.direction].map(Vec3::from);
        let settings =
            NormalOcclusion { step: 0.3, samples: 5, base: 1.7, strength: 1.4, bend: probe.bend, up: Vec3::Y };
        let expected = [
            hard_shadow(distance, position, direction, 20.0, &march),
            penumbra_shadow(distance, position, direction, 20.0, probe.scale, &march),
            normal_occlusion(distance, position, normal, &settings),
            evans_occlusion(distance, position, normal, &settings),
        ];
        for i in 0..4 {
            between[i] += i32::from((0.01..0.99).contains(&expected[i]));
        }
        differing += i32::from((0..4).any(|i| (found[i] - expected[i]).abs() > TOLERANCE));
    }
    println!("{differing} of {COUNT} differ; partly occluded: {between:?}");
    // Rays that just meet the surface, or just do not, may end otherwise.
    assert!(differing <= COUNT as i32 / 2000, "{differing} of {COUNT} differ");
    assert!(between[0] == 0 && between[1..].iter().all(|&count| count > COUNT as i32 / 20), "{between:?}");
}
