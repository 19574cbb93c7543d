//! The passes of one camera's frame: cap grids, which have no noise; trace, then denoise. Only those run that a frame needs.

use glam::{Mat4, UVec2};
use thiserror::Error;

use super::layout::{FrameUniform, InstanceData, is_source, sample_data};
use super::{FieldPool, caps_source, denoise_source, trace_source};
use crate::estimate::caps::CapCombination;
use crate::estimate::frame::{FrameLight, TraceSettings};
use crate::estimate::source::OcclusionSource;

/// Format of the occlusion texture. Its red channel is ambient visibility; green and blue are the *occlusion* of lights 0
/// and 1, alpha the *visibility* of light 2, so that a texture with only a red channel reads as "no shadows".
pub const OUTPUT_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

const WORKGROUP_SIDE: u32 = 8;

/// What an adapter lacks to run the passes.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum MissingCapability {
    /// A limit of the device is too low.
    #[error("the GPU's limit {name} is {found}, field occlusion needs {needed}")]
    Limit {
        /// The limit, as `wgpu::Limits` names it.
        name: &'static str,
        /// What the passes need.
        needed: u32,
        /// What the device has.
        found: u32,
    },
}

/// The pipelines of the passes, one set per device.
///
/// ```no_run
/// # fn frame(device: &wgpu::Device, queue: &wgpu::Queue, pool: &visfield::gpu::FieldPool, inputs: &visfield::gpu::FrameInputs) {
/// use visfield::gpu::{OcclusionPasses, OcclusionView};
/// let passes = OcclusionPasses::new(device);
/// let mut view = OcclusionView::new(); // one per camera
/// let mut encoder = device.create_command_encoder(&Default::default());
/// passes.encode(device, queue, &mut encoder, pool, &mut view, inputs);
/// queue.submit([encoder.finish()]);
/// # }
/// ```
#[derive(Debug)]
pub struct OcclusionPasses {
    /// Without and with large lights; each by [`CapCombination`]: product, soft caps over 8 and over 16 directions.
    caps: [[wgpu::ComputePipeline; 3]; 2],
    trace: wgpu::ComputePipeline,
    denoise_rows: wgpu::ComputePipeline,
    denoise_columns: wgpu::ComputePipeline,
}

/// What one camera's frame is made of.
pub struct FrameInputs<'a> {
    /// Depth, reversed z with 0 at infinity; a depth format that can be bound as a texture.
    pub depth: &'a wgpu::TextureView,
    /// World normals as `rgb · 2 − 1`.
    pub normals: &'a wgpu::TextureView,
    /// Where the result goes: [`OUTPUT_FORMAT`], with storage usage, as large as depth and normals.
    pub output: &'a wgpu::TextureView,
    /// First pixel and size of the camera's viewport in these textures.
    pub viewport: (UVec2, UVec2),
    /// From clip space to the world relative to the camera: the camera's rotation times its inverse projection.
    pub world_from_clip: Mat4,
    /// The occluders, relative to the camera.
    pub instances: &'a [InstanceData],
    /// The directional lights, at most [`MAX_LIGHTS`](crate::estimate::frame::MAX_LIGHTS), each with a channel of its own.
    pub lights: &'a [FrameLight],
    /// Numbers of rays, reach and bias.
    pub settings: TraceSettings,
}

/// One camera's own resources, kept from frame to frame.
///
/// ```
/// let view = visfield::gpu::OcclusionView::new(); // holds nothing until the first frame is encoded
/// ```
#[derive(Debug, Default)]
pub struct OcclusionView {
    frame: Option<wgpu::Buffer>,
    instances: Option<wgpu::Buffer>,
    /// The sample patterns, and the numbers of rays and directions that they were made for.
    samples: Option<(wgpu::Buffer, [u32; 3])>,
    /// What the trace makes, and what the pass over rows makes of it.
    filter: Option<[wgpu::Texture; 2]>,
    /// What the caps pass makes, where it is not all.
    caps_texture: Option<wgpu::Texture>,
}

impl OcclusionView {
    /// Holds nothing until the first frame is encoded.
    pub fn new() -> Self {
        Self::default()
    }
}

impl OcclusionPasses {
    /// Whether a device can run the passes.
    ///
    /// # Errors
    /// [`MissingCapability`] names the first limit that is too low.
    pub fn check(limits: &wgpu::Limits) -> Result<(), MissingCapability> {
        let needs = [
            ("max_storage_buffers_per_shader_stage", 4, limits.max_storage_buffers_per_shader_stage),
            ("max_storage_textures_per_shader_stage", 1, limits.max_storage_textures_per_shader_stage),
            ("max_compute_invocations_per_workgroup", 64, limits.max_compute_invocations_per_workgroup),
        ];
        match needs.into_iter().find(|(_, needed, found)| found < needed) {
            Some((name, needed, found)) => Err(MissingCapability::Limit { name, needed, found }),
            None => Ok(()),
        }
    }

    /// Builds the pipelines. The device must pass [`check`](Self::check).
    pub fn new(device: &wgpu::Device) -> Self {
        let module = |label, source: String| {
            let source = wgpu::ShaderSource::Wgsl(source.into());
            device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source })
        };
        let caps = module("field occlusion caps", caps_source());
        let trace = module("field occlusion trace", trace_source());
        let denoise = module("field occlusion denoise", denoise_source());
        let pipeline = |module: &wgpu::ShaderModule, entry_point, constants: &[(&str, f64)]| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry_point),
                layout: None,
                module,
                entry_point: Some(entry_point),
                compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
                cache: None,
            })
        };
        let caps_pipelines = |lights| {
            [(0.0, 8.0), (1.0, 8.0), (1.0, 16.0)].map(|(soft, directions)| {
                let constants = [("SOFT_CAPS", soft), ("DIRECTIONS", directions), ("LARGE_LIGHTS", lights)];
                pipeline(&caps, "caps", &constants)
            })
        };
        Self {
            caps: [0.0, 1.0].map(caps_pipelines),
            trace: pipeline(&trace, "trace", &[]),
            denoise_rows: pipeline(&denoise, "denoise_rows", &[]),
            denoise_columns: pipeline(&denoise, "denoise_columns", &[]),
        }
    }

    /// Encodes one camera's frame. Writes every pixel of the viewport of `inputs.output`; without instances they all
    /// become unoccluded.
    ///
    /// Uploads go through `queue` and take effect at the next submission, so a `view` serves one frame per submission.
    pub fn encode(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        pool: &FieldPool,
        view: &mut OcclusionView,
        inputs: &FrameInputs,
    ) {
        let size = inputs.viewport.1;
        if size.min_element() == 0 {
            return;
        }
        let settings = inputs.settings.clamped();
        let any = |of: fn(&InstanceData) -> bool| inputs.instances.iter().any(of);
        let large = settings.caps.is_some() && inputs.lights.iter().any(FrameLight::is_large);
        let ambient_caps =
            settings.caps.is_some() && any(|instance| is_source(instance.ambient_source, OcclusionSource::has_caps));
        let light_caps = large && any(|instance| is_source(instance.light_source, OcclusionSource::has_caps));
        let caps = ambient_caps || light_caps;
        let rays = settings.ambient_rays > 0
            && any(|instance| is_source(instance.ambient_source, OcclusionSource::has_rays))
            || inputs.lights.iter().any(|light| !(large && light.is_large())) && any(|instance| instance.entries > 0)
            || large && any(|instance| is_source(instance.light_source, OcclusionSource::has_rays));
        // What has no noise needs no filter: alone, it goes where the result does.
        let needed = Needed { caps_texture: caps && rays, filter: rays || !caps };
        let count = inputs.instances.len() as u32;
        let caps_origin = caps.then_some(if needed.filter { UVec2::ZERO } else { inputs.viewport.0 });
        let uniform =
            FrameUniform::new(inputs.world_from_clip, inputs.viewport, count, inputs.lights, &settings, caps_origin);
        let Prepared { frame, instances, samples, filter, caps_texture } =
            view.prepare(device, queue, &settings, inputs.instances.len(), size, needed);
        queue.write_buffer(frame, 0, bytemuck::bytes_of(&uniform));
        queue.write_buffer(instances, 0, bytemuck::cast_slice(inputs.instances));
        let texture = wgpu::BindingResource::TextureView;
        let surfaces = [frame.as_entire_binding(), texture(inputs.depth), texture(inputs.normals)];
        let pool = pool.buffer().as_entire_binding();
        let occluders = [pool.clone(), instances.as_entire_binding(), pool, samples.as_entire_binding()];
        let mut run = |label, pipeline, bindings: &[&[wgpu::BindingResource]]| {
            let bind_group = bind_in_order(device, label, pipeline, &bindings.concat());
            let mut pass =
                encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some(label), timestamp_writes: None });
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &bind_group, &[]);
            pass.dispatch_workgroups(size.x.div_ceil(WORKGROUP_SIDE), size.y.div_ceil(WORKGROUP_SIDE), 1);
        };
        if let Some(combination) = settings.caps.filter(|_| caps) {
            let [product, over_8, over_16] = &self.caps[usize::from(light_caps)];
            let pipeline = match (combination, combination.directions()) {
                (CapCombination::Product, _) => product,
                (CapCombination::SoftCaps { .. }, 8) => over_8,
                (CapCombination::SoftCaps { .. }, _) => over_16,
            };
            let output = texture(caps_texture.as_ref().unwrap_or(inputs.output));
            run("field occlusion caps", pipeline, &[&surfaces, &occluders, &[output]]);
        }
        if let Some([noisy, rows]) = &filter {
            run("field occlusion trace", &self.trace, &[&surfaces, &occluders, &[texture(noisy)]]);
            let (label, pipeline) = ("field occlusion denoise rows", &self.denoise_rows);
            run(label, pipeline, &[&surfaces, &[texture(noisy), texture(rows)]]);
            let (label, pipeline) = ("field occlusion denoise columns", &self.denoise_columns);
            // Where the caps pass did not run, its texture is not read either.
            let caps_texture = texture(caps_texture.as_ref().unwrap_or(noisy));
            run(label, pipeline, &[&surfaces, &[texture(rows), texture(inputs.output), caps_texture]]);
        }
    }
}

/// What a frame needs beside its buffers.
#[derive(Clone, Copy)]
struct Needed {
    /// A texture for what cap grids give, to be joined with what is traced.
    caps_texture: bool,
    /// Textures for what is traced and filtered.
    filter: bool,
}

/// A view's resources, fit for a frame.
struct Prepared<'a> {
    frame: &'a wgpu::Buffer,
    instances: &'a wgpu::Buffer,
    samples: &'a wgpu::Buffer,
    filter: Option<[wgpu::TextureView; 2]>,
    caps_texture: Option<wgpu::TextureView>,
}

impl OcclusionView {
    /// Makes what is missing or no longer fits.
    fn prepare(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        settings: &TraceSettings,
        instance_count: usize,
        size: UVec2,
        needed_textures: Needed,
    ) -> Prepared<'_> {
        let instance_bytes = |count: usize| (size_of::<InstanceData>() * count) as u64;
        // Never empty: a binding needs at least one element.
        let needed = instance_count.max(1);
        self.instances.take_if(|buffer| buffer.size() < instance_bytes(needed));
        let directions = settings.caps.map_or(0, CapCombination::directions) as u32;
        let rays = [settings.ambient_rays, settings.shadow_rays, directions];
        self.samples.take_if(|(_, made_for)| *made_for != rays);
        let fits = |texture: &wgpu::Texture| (texture.width(), texture.height()) == (size.x, size.y);
        self.filter.take_if(|[noisy, _]| !needed_textures.filter || !fits(noisy));
        self.caps_texture.take_if(|texture| !needed_textures.caps_texture || !fits(texture));
        if needed_textures.filter {
            self.filter.get_or_insert_with(|| {
                ["field occlusion, noisy", "field occlusion, rows"].map(|label| create_texture(device, label, size))
            });
        }
        if needed_textures.caps_texture {
            self.caps_texture.get_or_insert_with(|| create_texture(device, "field occlusion, caps", size));
        }
        let view = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());

        let storage = wgpu::BufferUsages::STORAGE;
        Prepared {
            frame: self.frame.get_or_insert_with(|| {
                let bytes = size_of::<FrameUniform>() as u64;
                create_buffer(device, "field occlusion frame", bytes, wgpu::BufferUsages::UNIFORM)
            }),
            instances: self.instances.get_or_insert_with(|| {
                let bytes = instance_bytes(needed.next_power_of_two());
                create_buffer(device, "field occlusion instances", bytes, storage)
            }),
            samples: &self
                .samples
                .get_or_insert_with(|| {
                    let data = sample_data(settings);
                    let bytes = size_of::<[f32; 4]>() * data.len().max(1);
                    let buffer = create_buffer(device, "field occlusion samples", bytes as u64, storage);
                    queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&data));
                    (buffer, rays)
                })
                .0,
            filter: self.filter.as_ref().map(|textures| textures.each_ref().map(view)),
            caps_texture: self.caps_texture.as_ref().map(view),
        }
    }
}

fn create_texture(device: &wgpu::Device, label: &str, size: UVec2) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: OUTPUT_FORMAT,
        usage: wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    })
}

fn bind_in_order(
    device: &wgpu::Device,
    label: &str,
    pipeline: &wgpu::ComputePipeline,
    bindings: &[wgpu::BindingResource],
) -> wgpu::BindGroup {
    let entries: Vec<_> = bindings
        .iter()
        .enumerate()
        .map(|(i, resource)| wgpu::BindGroupEntry { binding: i as u32, resource: resource.clone() })
        .collect();
    let layout = pipeline.get_bind_group_layout(0);
    device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some(label), layout: &layout, entries: &entries })
}

fn create_buffer(device: &wgpu::Device, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: bytes,
        usage: usage | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}
