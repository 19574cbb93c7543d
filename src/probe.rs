//! Reads a camera's depth, normals and occlusion back, as the node of `bevy_visfield` saw and made them.

use std::sync::{Arc, Mutex, PoisonError};

use bevy::core_pipeline::Core3d;
use bevy::core_pipeline::core_3d::main_opaque_pass_3d;
use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::prelude::*;
use bevy::render::extract_component::{ExtractComponent, ExtractComponentPlugin};
use bevy::render::renderer::{RenderContext, ViewQuery};
use bevy::render::view::ExtractedView;
use bevy::render::{Render, RenderApp, RenderSystems};
use bevy_visfield::{FieldOcclusionFrame, FieldOcclusionSystems};
use visfield::estimate::frame::GeometryBuffer;
use wgpu::util::DeviceExt;

use crate::headless::HeadlessApp;

/// The camera that [`FrameProbe`] reads. It needs `FieldOcclusion`, and there should be one such camera.
///
/// ```
/// use bevy::prelude::*;
/// use bevy_visfield::prelude::*;
/// use visfield_workspace::probe::ProbedCamera;
/// fn camera() -> impl Bundle {
///     (Camera3d::default(), Msaa::Off, FieldOcclusion::default(), ProbedCamera)
/// }
/// ```
#[derive(Component, ExtractComponent, Clone, Copy, Debug, Default)]
pub struct ProbedCamera;

/// One frame, read back.
#[derive(Clone, Debug)]
pub struct ProbedFrame {
    /// Depth and normals of the viewport; positions relative to the camera.
    pub geometry: GeometryBuffer,
    /// Where the camera is in the world.
    pub camera: Vec3,
    /// Per pixel: the unoccluded share of ambient light, and the visible share of the first light.
    pub visibility: Vec<[f32; 2]>,
    /// Per pixel: the alpha channel of the normals.
    pub receivers: Vec<f32>,
}

/// Asks for a frame and hands it over when it has arrived, a few frames later: nothing waits for the GPU.
///
/// ```no_run
/// use visfield_workspace::headless::HeadlessApp;
/// use visfield_workspace::probe;
/// fn mean_ambient_visibility(headless: &mut HeadlessApp) -> f32 {
///     // Installed before the first update, with a camera that has `ProbedCamera`.
///     let frame = probe::read(headless);
///     frame.visibility.iter().map(|visibility| visibility[0]).sum::<f32>() / frame.visibility.len() as f32
/// }
/// ```
#[derive(Resource, Clone, Debug, Default)]
pub struct FrameProbe(Arc<Mutex<State>>);

#[derive(Debug, Default)]
enum State {
    #[default]
    Idle,
    Requested,
    Copying,
    Arrived(ProbedFrame),
}

impl FrameProbe {
    /// Asks for the next frame that is rendered. One that was asked for before is forgotten.
    pub fn request(&self) {
        self.set(State::Requested);
    }

    /// The frame, once it has arrived.
    pub fn take(&self) -> Option<ProbedFrame> {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match std::mem::take(&mut *state) {
            State::Arrived(frame) => Some(frame),
            other => {
                *state = other;
                None
            }
        }
    }

    fn set(&self, new: State) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = new;
    }

    /// Whether a frame is asked for; it no longer is afterwards.
    fn begin(&self) -> bool {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let requested = matches!(*state, State::Requested);
        if requested {
            *state = State::Copying;
        }
        requested
    }
}

/// What waits to be read, of the frame that is being rendered.
#[derive(Resource, Default)]
struct PendingCopy(Option<(wgpu::Buffer, Place)>);

/// Where a frame's pixels are.
#[derive(Clone, Copy)]
struct Place {
    world_from_clip: Mat4,
    camera: Vec3,
    size: UVec2,
}

/// Adds [`FrameProbe`] to an app. Call it before the first update.
pub fn install(app: &mut App) {
    let probe = FrameProbe::default();
    app.insert_resource(probe.clone()).add_plugins(ExtractComponentPlugin::<ProbedCamera>::default());
    app.sub_app_mut(RenderApp)
        .insert_resource(probe)
        .init_resource::<PendingCopy>()
        .add_systems(Core3d, copy.after(FieldOcclusionSystems::Trace).before(main_opaque_pass_3d))
        .add_systems(Render, read_back.in_set(RenderSystems::Cleanup));
}

/// Renders frames until the first of them has been read back.
///
/// # Panics
/// If the app has no [`FrameProbe`], or the frame never arrives.
pub fn read(headless: &mut HeadlessApp) -> ProbedFrame {
    let probe = headless.app.world().resource::<FrameProbe>().clone();
    probe.request();
    let mut frame = None;
    headless.update_until(|_| {
        frame = probe.take();
        frame.is_some()
    });
    frame.expect("it was just seen")
}

fn copy(
    view: ViewQuery<(&ExtractedView, &FieldOcclusionFrame, &ViewPrepassTextures, &ProbedCamera)>,
    probe: Res<FrameProbe>,
    mut pending: ResMut<PendingCopy>,
    mut context: RenderContext,
) {
    let (view, frame, prepass, _) = view.into_inner();
    let (Some(depth), Some(normals)) = (prepass.depth_view(), prepass.normal_view()) else { return };
    if !probe.begin() {
        return;
    }
    let device = context.render_device().wgpu_device().clone();
    let size = view.viewport.zw();
    let bytes = u64::from(size.x * size.y) * 32;
    let buffer = |usage| {
        let label = Some("probed pixels");
        device.create_buffer(&wgpu::BufferDescriptor { label, size: bytes, usage, mapped_at_creation: false })
    };
    let pixels = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
    let staging = buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ);
    let viewport = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some("probed viewport"),
        contents: bytemuck::bytes_of(&view.viewport.to_array()),
        usage: wgpu::BufferUsages::UNIFORM,
    });
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("probe"),
        source: wgpu::ShaderSource::Wgsl(include_str!("probe.wgsl").into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("probe"),
        layout: None,
        module: &module,
        entry_point: None,
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let mut entries: Vec<_> = (0..)
        .zip([depth, normals, &frame.output.default_view])
        .map(|(binding, view)| wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::TextureView(view) })
        .collect();
    entries.push(wgpu::BindGroupEntry { binding: 3, resource: pixels.as_entire_binding() });
    entries.push(wgpu::BindGroupEntry { binding: 4, resource: viewport.as_entire_binding() });
    let layout = pipeline.get_bind_group_layout(0);
    let bind_group =
        device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries });
    let encoder = context.command_encoder();
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.dispatch_workgroups(size.x.div_ceil(8), size.y.div_ceil(8), 1);
    }
    encoder.copy_buffer_to_buffer(&pixels, 0, &staging, 0, bytes);
    let world_from_clip = Mat4::from_mat3a(view.world_from_view.affine().matrix3) * view.clip_from_view.inverse();
    pending.0 = Some((staging, Place { world_from_clip, camera: view.world_from_view.translation(), size }));
}

/// After the frame was submitted.
fn read_back(mut pending: ResMut<PendingCopy>, probe: Res<FrameProbe>) {
    let Some((staging, place)) = pending.0.take() else { return };
    let probe = probe.clone();
    staging.clone().slice(..).map_async(wgpu::MapMode::Read, move |mapped| {
        let state = match mapped {
            Ok(()) => State::Arrived(place.frame(&staging.slice(..).get_mapped_range())),
            // The device is lost or being dropped: the frame will not come.
            Err(_) => State::Idle,
        };
        probe.set(state);
    });
}

impl Place {
    fn frame(self, bytes: &[u8]) -> ProbedFrame {
        let numbers: Vec<f32> = bytemuck::pod_collect_to_vec(bytes);
        let (pixels, _rest) = bytemuck::cast_slice::<f32, [f32; 4]>(&numbers).as_chunks::<2>();
        ProbedFrame {
            geometry: GeometryBuffer {
                world_from_clip: self.world_from_clip,
                size: self.size,
                depth: pixels.iter().map(|[geometry, _]| geometry[3]).collect(),
                normals: pixels.iter().map(|[g, occlusion]| Vec4::new(g[0], g[1], g[2], occlusion[3])).collect(),
            },
            camera: self.camera,
            visibility: pixels.iter().map(|[_, occlusion]| [occlusion[0], occlusion[1]]).collect(),
            receivers: pixels.iter().map(|[_, occlusion]| occlusion[3]).collect(),
        }
    }
}
