//! The GPU time of whole frames, by timestamps around everything that Bevy submits.

use std::time::{Duration, Instant};

use bevy::prelude::*;
use bevy::render::RenderApp;
use bevy::render::renderer::{
    PendingCommandBuffers, RenderAdapterInfo, RenderDevice, RenderGraph, RenderGraphSystems, RenderQueue,
};
use visfield_workspace::headless::HeadlessApp;
use wgpu::BufferUsages as Usage;

/// What is written at the start and at the end of a frame; a resource of the render world, on GPUs that have timestamps.
#[derive(Resource)]
struct FrameTimestamps {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    read: wgpu::Buffer,
}

/// Bytes of two timestamps.
const BYTES: u64 = 16;

/// What it took to render a frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameTime {
    /// If the GPU has timestamps.
    pub(crate) gpu: Option<Duration>,
    /// From the start of the update until the GPU is done.
    pub(crate) wall: Duration,
}

/// Runs an app whose frames are timed.
pub(crate) struct TimedApp {
    pub(crate) headless: HeadlessApp,
    installed: bool,
}

impl TimedApp {
    pub(crate) fn new(headless: HeadlessApp) -> Self {
        Self { headless, installed: false }
    }

    pub(crate) fn wait_until_ready(&mut self) {
        self.headless.wait_until_ready();
        if !self.installed {
            self.installed = true;
            install(self.headless.app.sub_app_mut(RenderApp));
        }
    }

    /// What renders.
    pub(crate) fn adapter(&self) -> wgpu::AdapterInfo {
        let render_world = self.headless.app.sub_app(RenderApp).world();
        (*render_world.resource::<RenderAdapterInfo>().0).clone()
    }

    /// Renders a frame and waits for the GPU.
    pub(crate) fn frame(&mut self) -> FrameTime {
        let started = Instant::now();
        self.headless.update();
        let render_world = self.headless.app.sub_app(RenderApp).world();
        let device = render_world.resource::<RenderDevice>().wgpu_device();
        wait(device);
        let wall = started.elapsed();
        let timestamps = render_world.get_resource::<FrameTimestamps>();
        let period = render_world.resource::<RenderQueue>().get_timestamp_period();
        let gpu = timestamps.map(|timestamps| {
            timestamps.read.slice(..).map_async(wgpu::MapMode::Read, |mapped| {
                mapped.expect("a buffer of the GPU's that nothing else maps");
            });
            wait(device);
            let ticks: [u64; 2] = bytemuck::pod_read_unaligned(&timestamps.read.slice(..).get_mapped_range());
            timestamps.read.unmap();
            Duration::from_secs_f64(ticks[1].saturating_sub(ticks[0]) as f64 * f64::from(period) * 1.0e-9)
        });
        FrameTime { gpu, wall }
    }
}

fn wait(device: &wgpu::Device) {
    device.poll(wgpu::PollType::wait_indefinitely()).expect("the GPU is not lost");
}

/// Adds the timestamps, where the GPU has them.
fn install(render_app: &mut SubApp) {
    let device = render_app.world().resource::<RenderDevice>().wgpu_device().clone();
    if !device.features().contains(wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS) {
        return;
    }
    let buffer = |label, usage| {
        let descriptor = wgpu::BufferDescriptor { label: Some(label), size: BYTES, usage, mapped_at_creation: false };
        device.create_buffer(&descriptor)
    };
    render_app.insert_resource(FrameTimestamps {
        queries: device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("frame"),
            ty: wgpu::QueryType::Timestamp,
            count: 2,
        }),
        resolved: buffer("frame timestamps", Usage::QUERY_RESOLVE | Usage::COPY_SRC),
        read: buffer("frame timestamps, read", Usage::COPY_DST | Usage::MAP_READ),
    });
    render_app.add_systems(
        RenderGraph,
        (
            begin.in_set(RenderGraphSystems::Begin),
            end.after(RenderGraphSystems::Render).before(RenderGraphSystems::Submit),
        ),
    );
}

fn begin(timestamps: Res<FrameTimestamps>, device: Res<RenderDevice>, mut pending: ResMut<PendingCommandBuffers>) {
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.write_timestamp(&timestamps.queries, 0);
    // As a finished buffer: encoders that are pending come after all buffers.
    pending.push([encoder.finish()]);
}

fn end(timestamps: Res<FrameTimestamps>, device: Res<RenderDevice>, mut pending: ResMut<PendingCommandBuffers>) {
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.write_timestamp(&timestamps.queries, 1);
    encoder.resolve_query_set(&timestamps.queries, 0..2, &timestamps.resolved, 0);
    encoder.copy_buffer_to_buffer(&timestamps.resolved, 0, &timestamps.read, 0, BYTES);
    pending.push([encoder.finish()]);
}
