//! Reads a frame's depth, normals and occlusion back, as the node saw and made them.

use bevy::core_pipeline::Core3d;
use bevy::core_pipeline::core_3d::main_opaque_pass_3d;
use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::prelude::*;
use bevy::render::RenderApp;
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use bevy::render::view::ExtractedView;
use bevy_visfield::{FieldOcclusionFrame, FieldOcclusionSystems};
use visfield::estimate::frame::GeometryBuffer;

/// One frame, read back.
pub(crate) struct ProbedFrame {
    /// Depth and normals; positions relative to the camera.
    pub(crate) geometry: GeometryBuffer,
    /// Where the camera is in the world.
    pub(crate) camera: Vec3,
    /// Per pixel: the unoccluded share of ambient light, and the visible share of the first light.
    pub(crate) visibility: Vec<[f32; 2]>,
    /// Per pixel: the alpha channel of the normals.
    pub(crate) receivers: Vec<f32>,
}

#[derive(Resource, Default)]
struct Probe {
    pixels: Option<wgpu::Buffer>,
    world_from_clip: Mat4,
    camera: Vec3,
    size: UVec2,
}

/// Has the render world copy every frame's textures. Add before the first update.
pub(crate) fn install(app: &mut App) {
    let render_app = app.sub_app_mut(RenderApp);
    render_app
        .init_resource::<Probe>()
        .add_systems(Core3d, copy.after(FieldOcclusionSystems::Trace).before(main_opaque_pass_3d));
}

fn copy(
    view: ViewQuery<(&ExtractedView, &FieldOcclusionFrame, &ViewPrepassTextures)>,
    mut probe: ResMut<Probe>,
    mut context: RenderContext,
) {
    let (view, frame, prepass) = view.into_inner();
    let device = context.render_device().wgpu_device().clone();
    let size = UVec2::new(prepass.size.width, prepass.size.height);
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("probed pixels"),
        size: u64::from(size.x * size.y) * 32,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(include_str!("probe.wgsl").into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: None,
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let textures = [prepass.depth_view().unwrap(), prepass.normal_view().unwrap(), &frame.output.default_view];
    let mut entries: Vec<_> = (0..)
        .zip(textures)
        .map(|(binding, view)| wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::TextureView(view) })
        .collect();
    entries.push(wgpu::BindGroupEntry { binding: 3, resource: buffer.as_entire_binding() });
    let layout = pipeline.get_bind_group_layout(0);
    let bind_group =
        device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries });
    {
        let mut pass = context.command_encoder().begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.dispatch_workgroups(size.x.div_ceil(8), size.y.div_ceil(8), 1);
    }
    *probe = Probe {
        pixels: Some(buffer),
        world_from_clip: Mat4::from_mat3a(view.world_from_view.affine().matrix3) * view.clip_from_view.inverse(),
        camera: view.world_from_view.translation(),
        size,
    };
}

/// The last frame that was rendered.
pub(crate) fn read(app: &App) -> ProbedFrame {
    let world = app.sub_app(RenderApp).world();
    let probe = world.resource::<Probe>();
    let pixels = probe.pixels.as_ref().expect("a frame was rendered with FieldOcclusion");
    let (device, queue) = (world.resource::<RenderDevice>().wgpu_device(), world.resource::<RenderQueue>());
    let staging = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("read back"),
        size: pixels.size(),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_buffer_to_buffer(pixels, 0, &staging, 0, pixels.size());
    queue.submit([encoder.finish()]);
    staging.slice(..).map_async(wgpu::MapMode::Read, |result| result.expect("the staging buffer maps"));
    device.poll(wgpu::PollType::wait_indefinitely()).expect("the device finishes");
    let bytes = staging.slice(..).get_mapped_range().to_vec();
    let (pixels, _rest) = bytemuck::cast_slice::<u8, [f32; 4]>(&bytes).as_chunks::<2>();
    ProbedFrame {
        geometry: GeometryBuffer {
            world_from_clip: probe.world_from_clip,
            size: probe.size,
            depth: pixels.iter().map(|[geometry, _]| geometry[3]).collect(),
            normals: pixels.iter().map(|[g, occlusion]| Vec4::new(g[0], g[1], g[2], occlusion[3])).collect(),
        },
        camera: probe.camera,
        visibility: pixels.iter().map(|[_, occlusion]| [occlusion[0], occlusion[1]]).collect(),
        receivers: pixels.iter().map(|[_, occlusion]| occlusion[3]).collect(),
    }
}
