//! Frames must not add to the process's memory. In a process of its own, where no other test does.
#![cfg(target_os = "linux")]

#[expect(dead_code, reason = "the other tests on a device need more of it")]
#[path = "gpu/device.rs"]
mod device;

use glam::{DAffine3, DVec3, Mat4, UVec2, Vec3, dvec3, uvec2};
use visfield::estimate::caps::CapCombination;
use visfield::estimate::frame::{Casting, TraceResolution, TraceSettings};
use visfield::estimate::light::Light;
use visfield::field::{ball_field, cap_grid};
use visfield::gpu::layout::InstanceData;
use visfield::gpu::{FieldPool, FrameInputs, OUTPUT_FORMAT, OcclusionPasses, OcclusionView};
use visfield::scene::Placement;
use visfield::{FieldParts, VisibilityField};

const SIZE: UVec2 = uvec2(48, 32);
/// Frames until all is compiled and kept that will be.
const FIRST_FRAMES: usize = 20;
const FRAMES: usize = 100;
/// What a frame may add, in bytes: far less than the code of any shader.
const MOST_PER_FRAME: usize = 32 << 10;

#[test]
fn frames_leave_no_memory_behind() {
    let Some((device, queue)) = device::device() else { return };
    let passes = OcclusionPasses::new(&device);
    let mut pool = FieldPool::new(&device);
    let ball = ball_field(1.0, 33, 32);
    let parts =
        FieldParts { table: ball.table().cloned(), cap_grid: Some(cap_grid::example_ball()), ..FieldParts::default() };
    let ball = VisibilityField::new(ball.header().clone(), parts).unwrap();
    let slot = pool.insert(&device, &queue, &ball).unwrap();
    let place = DAffine3::from_translation(dvec3(0.0, 0.0, -3.0));
    let placement = Placement::new(&ball.header().bounds, place, DVec3::ZERO).unwrap();

    let view = |format, size, usage| {
        device::texture(&device, size, format, usage).create_view(&wgpu::TextureViewDescriptor::default())
    };
    let bound = wgpu::TextureUsages::TEXTURE_BINDING;
    // All is sky: what could stay is there all the same.
    let depth = view(wgpu::TextureFormat::Depth32Float, SIZE, bound | wgpu::TextureUsages::RENDER_ATTACHMENT);
    let normals = view(wgpu::TextureFormat::Rgba8Unorm, SIZE, bound);
    let motion = view(wgpu::TextureFormat::Rg16Float, SIZE, bound);
    let output = view(OUTPUT_FORMAT, SIZE, wgpu::TextureUsages::STORAGE_BINDING);
    let lights = [Light::directional(Vec3::Y, 0.02), Light::sphere(Vec3::ONE, 0.4, 9.0)];

    let rays = TraceSettings { ambient_rays: 4, ..TraceSettings::default() };
    let half = TraceSettings { resolution: TraceResolution::Half, ..rays };
    let caps = TraceSettings { caps: Some(CapCombination::default()), ..rays };
    for (settings, lights, motion) in [(rays, &lights[..], None), (half, &[], Some(&motion)), (caps, &lights, None)] {
        let mut view = OcclusionView::new();
        let mut frame = || {
            let instance = InstanceData::new(&slot, &placement, Casting::default(), settings.wanted());
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            passes.encode(
                (&device, &queue, &mut encoder),
                &pool,
                &mut view,
                &FrameInputs {
                    depth: &depth,
                    normals: &normals,
                    motion,
                    history_key: 0,
                    screen_space: None,
                    output: &output,
                    page_rows: SIZE.y,
                    viewport: (UVec2::ZERO, SIZE),
                    world_from_clip: Mat4::perspective_infinite_reverse_rh(1.0, 1.5, 0.1).inverse(),
                    instances: &[instance],
                    lights,
                    show_tile_load: false,
                    settings,
                },
                &mut (),
            );
            queue.submit([encoder.finish()]);
            device.poll(wgpu::PollType::wait_indefinitely()).expect("the device finishes");
        };
        (0..FIRST_FRAMES).for_each(|_| frame());
        let before = resident_bytes();
        (0..FRAMES).for_each(|_| frame());
        let grown = resident_bytes().saturating_sub(before);
        println!("{grown} bytes more after {FRAMES} frames of {settings:?}");
        assert!(grown < MOST_PER_FRAME * FRAMES, "{grown} bytes more after {FRAMES} frames of {settings:?}");
    }
}

/// The process's memory that is in use.
fn resident_bytes() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").expect("every process has it");
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("Linux tells");
    let kilobytes = line.trim().trim_end_matches(" kB").parse::<usize>().expect("it is a number");
    kilobytes << 10
}
