//! A device to test on: buffers, textures and single shaders, and reading back from it.

use bytemuck::Pod;
use glam::UVec2;

/// Any adapter, software ones included. Without one the test is skipped by hand and fails under CI.
pub(crate) fn device() -> Option<(wgpu::Device, wgpu::Queue)> {
    let instance = wgpu::Instance::default();
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()));
    let Ok(adapter) = adapter else {
        assert!(std::env::var_os("CI").is_none(), "CI needs a GPU or a software adapter (mesa-vulkan-drivers)");
        eprintln!("skipped: no GPU adapter found; on Debian or Ubuntu install mesa-vulkan-drivers");
        return None;
    };
    let device = adapter.request_device(&wgpu::DeviceDescriptor::default());
    Some(pollster::block_on(device).expect("default limits are met by every adapter"))
}

/// Reads `bytes` bytes of a buffer with `COPY_SRC` usage.
pub(crate) fn read_buffer(device: &wgpu::Device, queue: &wgpu::Queue, buffer: &wgpu::Buffer, bytes: u64) -> Vec<u8> {
    let staging = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("read back"),
        size: bytes,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, bytes);
    queue.submit([encoder.finish()]);
    staging.slice(..).map_async(wgpu::MapMode::Read, |result| result.expect("the staging buffer maps"));
    device.poll(wgpu::PollType::wait_indefinitely()).expect("the device finishes");
    staging.slice(..).get_mapped_range().to_vec()
}

pub(crate) fn buffer_with(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    content: &[u8],
    usage: wgpu::BufferUsages,
) -> wgpu::Buffer {
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("test data"),
        size: content.len() as u64,
        usage: usage | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    queue.write_buffer(&buffer, 0, content);
    buffer
}

/// A two-dimensional texture of `size` pixels.
pub(crate) fn texture(
    device: &wgpu::Device,
    size: UVec2,
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}

/// Runs the entry point `probe` of a shader, 64 threads to a group, once for each of `count` answers, and gives them back. The
/// answers' binding is `answers`; the others have their buffers.
pub(crate) fn run_probe<A: Pod>(
    (device, queue): (&wgpu::Device, &wgpu::Queue),
    source: String,
    constants: &[(&str, f64)],
    buffers: &[(u32, &wgpu::Buffer)],
    (answers, count): (u32, usize),
) -> Vec<A> {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("probe"),
        compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
        cache: None,
    });
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    let output = buffer_with(device, queue, bytemuck::cast_slice(&vec![A::zeroed(); count]), usage);
    let all = buffers.iter().copied().chain([(answers, &output)]);
    let entries: Vec<_> =
        all.map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() }).collect();
    let layout = pipeline.get_bind_group_layout(0);
    let bind_group =
        device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.dispatch_workgroups((count as u32).div_ceil(64), 1, 1);
    }
    queue.submit([encoder.finish()]);
    bytemuck::pod_collect_to_vec(&read_buffer(device, queue, &output, output.size()))
}
