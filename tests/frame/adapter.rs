//! Whether there is anything to render on.

/// Whether a GPU adapter exists, software ones included. Without one a test is skipped by hand and fails under CI.
pub(crate) fn available() -> bool {
    let instance = wgpu::Instance::default();
    let found = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).is_ok();
    assert!(found || std::env::var_os("CI").is_none(), "CI needs a GPU or a software adapter (mesa-vulkan-drivers)");
    if !found {
        eprintln!("skipped: no GPU adapter found; on Debian or Ubuntu install mesa-vulkan-drivers");
    }
    found
}
