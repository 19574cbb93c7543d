//! Cap grids receiver by receiver: occlusion, bent normals and the contact term of the shader are those of its twins.

use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DQuat, DVec3, Vec3, dvec3};
use visfield::estimate::caps::{CapCombination, CapOccluder, CapSettings, ambient};
use visfield::estimate::frame::Casting;
use visfield::estimate::sampling::sphere_samples;
use visfield::estimate::source::Wanted;
use visfield::field::cap_grid::cap::contact_occlusion;
use visfield::field::example_caps;
use visfield::gpu::FieldPool;
use visfield::gpu::layout::{FrameUniform, InstanceData};
use visfield::scene::Placement;

use super::device::{buffer_with, device, run_probe};

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Probe {
    position: [f32; 3],
    distance: f32,
    normal: [f32; 3],
    facing: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Answer {
    bent_normal: [f32; 3],
    occlusion: f32,
    contact: f32,
    padding: [f32; 3],
}

/// Receivers among the objects, near and far.
fn probes() -> Vec<Probe> {
    let normals = sphere_samples(2000);
    let places = sphere_samples(1999).into_iter().rev().cycle();
    let probe = |(i, (normal, place)): (usize, (&Vec3, Vec3))| Probe {
        position: (place * (0.01 * i as f32)).to_array(),
        distance: 1e-4 * i as f32,
        normal: normal.to_array(),
        facing: normal.x,
    };
    normals.iter().zip(places).enumerate().map(probe).collect()
}

#[test]
fn receivers_get_what_they_get_from_the_twins() {
    let Some((device, queue)) = device() else { return };
    let field = example_caps();
    let mut pool = FieldPool::new(&device);
    let slot = pool.insert(&device, &queue, &field).unwrap();
    let placements = [
        DAffine3::from_translation(dvec3(2.0, 0.0, 0.0)),
        DAffine3::from_scale_rotation_translation(
            dvec3(1.0, -1.0, 1.0),
            DQuat::from_rotation_x(0.4),
            dvec3(-2.0, 1.0, 0.0),
        ),
        DAffine3::from_scale_rotation_translation(
            dvec3(0.5, 1.0, 2.0),
            DQuat::from_rotation_x(0.4),
            dvec3(0.0, -3.0, 1.0),
        ),
    ]
    .map(|place| Placement::new(&field.header().bounds, place, DVec3::ZERO).unwrap());
    let occluders: Vec<_> =
        placements.iter().map(|place| CapOccluder::new(*place, &field, Wanted::CAPS).unwrap()).collect();
    let probes = probes();
    for combination in [CapCombination::Product, CapCombination::default(), CapCombination::SoftCaps { directions: 16 }]
    {
        let settings = CapSettings { combination, max_distance: 6.0, ..CapSettings::default() };
        let answers = on_gpu(
            &device,
            &queue,
            &pool,
            &placements.map(|place| InstanceData::new(&slot, &place, Casting::default(), Wanted::CAPS)),
            &settings,
            &probes,
        );
        let mut bent = 0;
        for (probe, answer) in probes.iter().zip(answers) {
            let normal = Vec3::from(probe.normal);
            let found = ambient(&occluders, Vec3::from(probe.position), normal, &settings);
            assert!((found.occlusion - answer.occlusion).abs() < 1e-3, "{} and {}", found.occlusion, answer.occlusion);
            let difference = (found.bent_normal - Vec3::from(answer.bent_normal)).length();
            // Where nearly all is hidden, what is left open has no stable direction.
            assert!(difference < 2e-3 || found.occlusion > 0.6, "{} and {:?}", found.bent_normal, answer.bent_normal);
            bent += usize::from((found.bent_normal - normal).length() > 0.05);
            let contact = contact_occlusion(probe.distance, 2.0, probe.facing);
            assert!((contact - answer.contact).abs() < 1e-5, "{contact} and {}", answer.contact);
        }
        assert!(bent > 300, "objects bend {bent} normals");
    }
}

fn on_gpu(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    pool: &FieldPool,
    instances: &[InstanceData],
    settings: &CapSettings,
    probes: &[Probe],
) -> Vec<Answer> {
    let source = [visfield::gpu::caps_source(), include_str!("caps.wgsl").to_owned()].concat();
    let directions = settings.combination.directions();
    let soft = f64::from(u8::from(settings.combination != CapCombination::Product));
    let constants = [("SOFT_CAPS", soft), ("DIRECTIONS", directions as f64)];
    let frame = FrameUniform {
        instance_count: instances.len() as u32,
        max_distance: settings.max_distance,
        ..FrameUniform::zeroed()
    };
    let samples: Vec<_> = sphere_samples(directions as u32).into_iter().map(|p| p.extend(0.0).to_array()).collect();
    let storage = wgpu::BufferUsages::STORAGE;
    let frame = buffer_with(device, queue, bytemuck::bytes_of(&frame), wgpu::BufferUsages::UNIFORM);
    let instances = buffer_with(device, queue, bytemuck::cast_slice(instances), storage);
    let samples = buffer_with(device, queue, bytemuck::cast_slice(&samples), storage);
    let probes_buffer = buffer_with(device, queue, bytemuck::cast_slice(probes), storage);
    let pool = pool.buffer();
    let lists = buffer_with(device, queue, &[0; 4], storage);
    let buffers = [(0, &frame), (3, pool), (4, &instances), (5, pool), (6, &samples), (7, &lists), (8, &probes_buffer)];
    run_probe((device, queue), source, &constants, &buffers, (9, probes.len()))
}
