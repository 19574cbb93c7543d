//! Rays through grids and shapes one by one: distances, gradients and ends are those of the CPU twins.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use visfield::distance::sphere_trace::{Exhausted, SphereTracing, Traced, sphere_trace, trace_out_of_convex};
use visfield::distance::{DistanceField, DistanceGridFormat, DistancePrecision, Solid, ball_grid};
use visfield::estimate::sampling::sphere_samples;
use visfield::gpu::layout::{DistanceData, distance_words};
use visfield::shape::Shape;

use super::device::{buffer_with, device, run_probe};

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Probe {
    origin: [f32; 3],
    t_max: f32,
    direction: [f32; 3],
    source: u32,
    settings: [[f32; 4]; 3],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Answer {
    gradient: [f32; 3],
    distance: f32,
    hit: u32,
    t: f32,
    end: f32,
    evaluations: u32,
    escape: f32,
    padding: [f32; 3],
}

const RAYS: u32 = 300;

/// Grids of both precisions, and a shape.
fn fields() -> [DistanceField; 3] {
    let grid = |voxels, precision| ball_grid(1.0, DistanceGridFormat { voxels, precision }).into();
    let carved = Shape::Box { half_extents: [0.5, 0.9, 0.7] }.difference(Shape::Sphere { radius: 0.8 });
    [grid(20, DistancePrecision::U8), grid(13, DistancePrecision::U16), Solid::new(carved).unwrap().into()]
}

/// Settings in which every part of the march differs, and whether a convex solid is left.
fn settings() -> Vec<(SphereTracing, bool)> {
    let plain = SphereTracing { relaxation: 1.0, max_steps: 40, from_inside: true, ..SphereTracing::default() };
    let relaxed = SphereTracing { relaxation: 1.6, ..plain };
    let few = SphereTracing { max_steps: 5, pixel: 0.02, ..relaxed };
    vec![
        (plain, false),
        (relaxed, false),
        (SphereTracing { adaptive: false, ..relaxed }, false),
        (SphereTracing { smoothing: 3, pixel: 0.05, ..relaxed }, false),
        (SphereTracing { exhausted: Exhausted::Last, ..few }, false),
        (SphereTracing { exhausted: Exhausted::Nearest, ..few }, false),
        (SphereTracing { from_inside: false, slack: 0.5, slack_reach: 3.0, least_step: 0.3, ..relaxed }, false),
        (plain, true),
    ]
}

#[test]
fn rays_end_where_their_twins_do() {
    let Some((device, queue)) = device() else { return };
    let fields = fields();
    let (mut words, mut probes, mut expected) = (vec![u32::MAX; 5], Vec::new(), Vec::new());
    for field in &fields {
        let source = words.len() as u32;
        words.extend_from_slice(bytemuck::cast_slice(&[DistanceData::new(field, source + 16)]));
        words.extend(distance_words(field));
        let (low, high) = field.bounds();
        let (middle, half) = ((low + high) * 0.5, (high - low) * 0.5);
        let distance = |position| field.distance(position);
        for (settings, convex) in settings() {
            for (number, sample) in (0..).zip(sphere_samples(RAYS)) {
                // Some start far outside the bounds, some inside the solid.
                let origin = middle + half * sample * [0.2, 0.9, 1.4, 3.0][number as usize % 4];
                let towards = middle + half * Vec3::new(sample.z, sample.x, sample.y) * 0.8 - origin;
                let (direction, t_max) = (towards.normalize(), half.length() * 4.0);
                let Traced { hit, t, distance: end, evaluations } = if convex {
                    trace_out_of_convex(distance, origin, direction, t_max, &settings)
                } else {
                    sphere_trace(distance, origin, direction, (0.0, t_max), &settings)
                };
                expected.push(Answer {
                    gradient: field.gradient(origin, 0.5).to_array(),
                    distance: field.distance(origin),
                    hit: u32::from(hit),
                    t,
                    end,
                    evaluations,
                    escape: settings.escape(end),
                    padding: [0.0; 3],
                });
                let flag = |set: bool| f32::from(u8::from(set));
                probes.push(Probe {
                    origin: origin.to_array(),
                    t_max,
                    direction: direction.to_array(),
                    source,
                    settings: [
                        [settings.relaxation, flag(settings.adaptive), settings.max_steps as f32, settings.threshold],
                        [
                            settings.pixel,
                            f32::from(settings.exhausted as u8),
                            settings.smoothing as f32,
                            flag(settings.from_inside),
                        ],
                        [settings.slack, settings.slack_reach, settings.least_step, flag(convex)],
                    ],
                });
            }
        }
    }
    let source = visfield::gpu::distance_source() + include_str!("sphere_trace.wgsl");
    let [words, rays] = [bytemuck::cast_slice(&words), bytemuck::cast_slice(&probes)]
        .map(|content: &[u8]| buffer_with(&device, &queue, content, wgpu::BufferUsages::STORAGE));
    let answers: Vec<Answer> = run_probe((&device, &queue), source, &[], &[(0, &words), (1, &rays)], (2, probes.len()));

    let close = |a: f32, b: f32| (a - b).abs() <= 1.0e-3 * a.abs().max(b.abs()).max(1.0);
    let (mut hits, mut differing) = (0, 0);
    for (found, expected) in answers.iter().zip(&expected) {
        assert!(close(found.distance, expected.distance), "{found:?} {expected:?}");
        let gradients = found.gradient.into_iter().zip(expected.gradient);
        assert!(gradients.into_iter().all(|(a, b)| (a - b).abs() < 2.0e-3), "{found:?} {expected:?}");
        let same = found.hit == expected.hit
            && found.evaluations == expected.evaluations
            && close(found.t, expected.t)
            && close(found.end, expected.end)
            && close(found.escape, expected.escape);
        differing += usize::from(!same);
        hits += expected.hit as usize;
    }
    println!("{hits} of {} rays hit, {differing} differ", answers.len());
    assert!(hits > answers.len() / 3 && hits < answers.len(), "{hits} hits");
    // Where a distance is at a threshold but for rounding, a ray takes another step.
    assert!(differing <= answers.len() / 200, "{differing} of {} differ", answers.len());
}
