//! A device to test on, and reading back from it.

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
