//! The passes of one camera's frame: lists of what matters where; trace, denoise and accumulate, if anything needs rays; and
//! resolve, which asks cap grids and writes the frame. Only those run that a frame needs.

use glam::{Mat4, UVec2};
use thiserror::Error;

use super::layout::{FrameUniform, InstanceData, is_source};
use super::view::{Needed, OcclusionView, Prepared};
use super::{FieldPool, accumulate_source, denoise_source, lists, resolve_source, tiles_source, trace_source};
use crate::estimate::caps::CapCombination;
use crate::estimate::frame::accumulate::BLEND;
use crate::estimate::frame::{MAX_LIGHTS, TraceSettings};
use crate::estimate::light::Light;
use crate::estimate::source::OcclusionSource;

/// Format of the occlusion texture: visibility, by pages of four channels one below the other. The first channel is that of
/// ambient light, then comes one for each light.
pub const OUTPUT_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// Format of what is traced and filtered.
pub(super) const TRACED_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// Entries of a tile's list that are shown as a full one.
pub const TILE_LOAD_SHOWN: u32 = 64;

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
/// passes.encode((device, queue, &mut encoder), pool, &mut view, inputs, &mut ());
/// queue.submit([encoder.finish()]);
/// # }
/// ```
#[derive(Debug)]
pub struct OcclusionPasses {
    tile_bounds: wgpu::ComputePipeline,
    list_blocks: wgpu::ComputePipeline,
    list_tiles: wgpu::ComputePipeline,
    trace: wgpu::ComputePipeline,
    denoise_rows: wgpu::ComputePipeline,
    denoise_columns: wgpu::ComputePipeline,
    accumulate: wgpu::ComputePipeline,
    /// Of rays alone.
    resolve: wgpu::ComputePipeline,
    /// Without and with lights; each by [`CapCombination`]: product, soft caps over 8 and over 16 directions.
    resolve_caps: [[wgpu::ComputePipeline; 3]; 2],
}

/// What one camera's frame is made of.
pub struct FrameInputs<'a> {
    /// Depth, reversed z with 0 at infinity; a depth format that can be bound as a texture.
    pub depth: &'a wgpu::TextureView,
    /// World normals as `rgb · 2 − 1`, and [receiver flags](crate::estimate::frame::ReceiverFlags::from_normal_alpha) as alpha.
    pub normals: &'a wgpu::TextureView,
    /// How far each pixel moved since the last frame, as a share of the viewport. With it, frames are accumulated: rays differ
    /// from frame to frame.
    pub motion: Option<&'a wgpu::TextureView>,
    /// Which lights the masks are of, in any numbers of the caller's: frames are joined only with those of the same.
    pub history_key: u64,
    /// Ambient occlusion of another kind to be joined.
    pub screen_space: Option<ScreenSpace<'a>>,
    /// Where the result goes: [`OUTPUT_FORMAT`], with storage usage, as wide as depth and normals, and with room for
    /// [`pages`](Self::pages).
    pub output: &'a wgpu::TextureView,
    /// Rows from a page of the output to the next; at least the viewport's end.
    pub page_rows: u32,
    /// First pixel and size of the camera's viewport in these textures.
    pub viewport: (UVec2, UVec2),
    /// From clip space to the world relative to the camera: the camera's rotation times its inverse projection.
    pub world_from_clip: Mat4,
    /// The occluders, relative to the camera. More than 1,048,576, or than fill what the device can bind, are not seen.
    pub instances: &'a [InstanceData],
    /// The lights, relative to the camera, by their masks: at most [`MAX_LIGHTS`], all [finite](Light::is_finite).
    pub lights: &'a [Light],
    /// Writes how full the list of each pixel's tile is, 1 for empty and 0 for [`TILE_LOAD_SHOWN`] entries, in the place of
    /// ambient visibility.
    pub show_tile_load: bool,
    /// Numbers of rays, reach and bias. Where frames are accumulated, `turn` is counted by the view.
    pub settings: TraceSettings,
}

impl FrameInputs<'_> {
    /// Pages of four channels that this many lights need, beside ambient light.
    pub fn pages(lights: usize) -> u32 {
        (lights.min(MAX_LIGHTS) as u32 + 4) / 4
    }

    /// What the inputs say by themselves.
    fn uniform(&self, lights: &[Light], settings: &TraceSettings) -> FrameUniform {
        let (origin, size) = self.viewport;
        FrameUniform {
            world_from_clip: self.world_from_clip.to_cols_array_2d(),
            viewport_origin: origin.to_array(),
            viewport_size: size.to_array(),
            trace_size: settings.resolution.traced_size(size).to_array(),
            trace_scale: settings.resolution.scale(),
            show_tile_load: if self.show_tile_load { TILE_LOAD_SHOWN } else { 0 },
            screen_space: match self.screen_space.map(|other| other.combination) {
                None => 0,
                Some(ScreenSpaceCombination::Darker) => 1,
                Some(ScreenSpaceCombination::Product) => 2,
            },
            page_rows: self.page_rows,
            ..FrameUniform::new(lights, settings)
        }
    }
}

/// Screen-space ambient occlusion to be joined with that of fields.
///
/// ```
/// use visfield::gpu::{ScreenSpace, ScreenSpaceCombination};
/// fn darker(visibility: &wgpu::TextureView) -> ScreenSpace<'_> {
///     ScreenSpace { visibility, combination: ScreenSpaceCombination::Darker }
/// }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ScreenSpace<'a> {
    /// A texture whose first channel is ambient visibility, as large as the viewport.
    pub visibility: &'a wgpu::TextureView,
    /// How it is joined.
    pub combination: ScreenSpaceCombination,
}

/// How screen-space ambient occlusion joins that of fields.
///
/// ```
/// assert_eq!(visfield::gpu::ScreenSpaceCombination::default(), visfield::gpu::ScreenSpaceCombination::Darker);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ScreenSpaceCombination {
    /// The darker of both: what both see counts once.
    #[default]
    Darker,
    /// Their product: what both see counts twice.
    Product,
}

/// Hears of every group of passes, to time them. `()` does not listen.
///
/// ```
/// struct Names(Vec<&'static str>);
/// impl visfield::gpu::PassTimer for Names {
///     fn begin(&mut self, _: &mut wgpu::CommandEncoder, pass: &'static str) {
///         self.0.push(pass);
///     }
/// }
/// ```
pub trait PassTimer {
    /// What is encoded from here on belongs to a group of passes.
    fn begin(&mut self, _encoder: &mut wgpu::CommandEncoder, _pass: &'static str) {}
    /// The group ends.
    fn end(&mut self, _encoder: &mut wgpu::CommandEncoder) {}
}

impl PassTimer for () {}

impl OcclusionPasses {
    /// The names of the groups of passes, as [`PassTimer`] hears them.
    pub const GROUPS: [&'static str; 5] = ["tiles", "trace", "denoise", "accumulate", "resolve"];

    /// Whether a device can run the passes.
    ///
    /// # Errors
    /// [`MissingCapability`] names the first limit that is too low.
    pub fn check(limits: &wgpu::Limits) -> Result<(), MissingCapability> {
        let needs = [
            ("max_storage_buffers_per_shader_stage", 6, limits.max_storage_buffers_per_shader_stage),
            ("max_storage_textures_per_shader_stage", 1, limits.max_storage_textures_per_shader_stage),
            ("max_compute_invocations_per_workgroup", 64, limits.max_compute_invocations_per_workgroup),
            ("max_compute_workgroup_storage_size", 4352, limits.max_compute_workgroup_storage_size),
        ];
        match needs.into_iter().find(|(_, needed, found)| found < needed) {
            Some((name, needed, found)) => Err(MissingCapability::Limit { name, needed, found }),
            None => Ok(()),
        }
    }

    /// Builds the pipelines. The device must pass [`check`](Self::check).
    pub fn new(device: &wgpu::Device) -> Self {
        let software = device.adapter_info().device_type == wgpu::DeviceType::Cpu;
        let module = |label, source: String| {
            let source = if software { without_uniforms(&source) } else { source };
            let source = wgpu::ShaderSource::Wgsl(source.into());
            device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source })
        };
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
        let tiles = module("field occlusion tiles", tiles_source());
        let denoise = module("field occlusion denoise", denoise_source());
        let resolve = module("field occlusion resolve", resolve_source());
        let resolve_caps = |lights| {
            [(0.0, 8.0), (1.0, 8.0), (1.0, 16.0)].map(|(soft, directions)| {
                let constants = [("SOFT_CAPS", soft), ("DIRECTIONS", directions), ("LIGHTS", lights)];
                pipeline(&resolve, "resolve", &constants)
            })
        };
        Self {
            tile_bounds: pipeline(&tiles, "tile_bounds", &[]),
            list_blocks: pipeline(&tiles, "list_blocks", &[]),
            list_tiles: pipeline(&tiles, "list_tiles", &[]),
            trace: pipeline(&module("field occlusion trace", trace_source()), "trace", &[]),
            denoise_rows: pipeline(&denoise, "denoise_rows", &[]),
            denoise_columns: pipeline(&denoise, "denoise_columns", &[]),
            accumulate: pipeline(&module("field occlusion accumulate", accumulate_source()), "accumulate", &[]),
            resolve: pipeline(&resolve, "resolve", &[("WITHOUT_RAYS", 0.0)]),
            resolve_caps: [0.0, 1.0].map(resolve_caps),
        }
    }

    /// Encodes one camera's frame. Writes every pixel of the viewport in all pages of `inputs.output`; without instances they
    /// all become visible.
    ///
    /// Uploads go through `queue` and take effect at the next submission, so a `view` serves one frame per submission.
    pub fn encode(
        &self,
        (device, queue, encoder): (&wgpu::Device, &wgpu::Queue, &mut wgpu::CommandEncoder),
        pool: &FieldPool,
        view: &mut OcclusionView,
        inputs: &FrameInputs,
        timer: &mut dyn PassTimer,
    ) {
        let size = inputs.viewport.1;
        if size.min_element() == 0 {
            return;
        }
        let settings = inputs.settings.clamped();
        let lights = &inputs.lights[..inputs.lights.len().min(MAX_LIGHTS)];
        let instances = &inputs.instances[..inputs.instances.len().min(most_instances(&device.limits()))];
        let Parts { without_rays, lights_without_rays, rays } = parts(instances, lights, &settings);

        let pages = FrameInputs::pages(lights.len());
        let trace_size = settings.resolution.traced_size(size);
        let paged = UVec2::new(trace_size.x, trace_size.y * pages);
        let needed = Needed {
            traced: rays.then_some(paged),
            accumulated: (rays && inputs.motion.is_some()).then_some(inputs.history_key),
        };
        let Prepared { frame, instances: instance_buffer, samples, lists, traced, history, is_history } =
            view.prepare((device, queue), &settings, instances.len(), size, needed);
        let uniform = FrameUniform {
            instance_count: instances.len() as u32,
            traced: u32::from(rays),
            tiles: lists.tiles().to_array(),
            list_capacity: lists.capacity(),
            blend: if is_history { BLEND } else { 1.0 },
            ..inputs.uniform(lights, &settings)
        };
        queue.write_buffer(frame, 0, bytemuck::bytes_of(&uniform));
        queue.write_buffer(instance_buffer, 0, bytemuck::cast_slice(instances));

        let texture = wgpu::BindingResource::TextureView;
        let frame = (0, frame.as_entire_binding());
        let surfaces = [frame.clone(), (1, texture(inputs.depth)), (2, texture(inputs.normals))];
        let instance_binding = (4, instance_buffer.as_entire_binding());
        let list_binding = (7, lists.buffer().as_entire_binding());
        let pool = pool.buffer().as_entire_binding();
        let occluders = [
            (3, pool.clone()),
            instance_binding.clone(),
            (5, pool),
            (6, samples.as_entire_binding()),
            list_binding.clone(),
        ];
        let tile_groups = [lists.tiles().x, lists.tiles().y, 1];
        let blocks = lists::blocks(lists.tiles());
        let groups = |size: UVec2, pages| [size.x.div_ceil(WORKGROUP_SIDE), size.y.div_ceil(WORKGROUP_SIDE), pages];
        let mut encoded = Encoded { device, encoder, timer };

        encoded.group("tiles", |encoded| {
            lists.clear(encoded.encoder);
            let of_surfaces = [&surfaces[..], std::slice::from_ref(&list_binding)].concat();
            encoded.pass("field occlusion tile bounds", &self.tile_bounds, &of_surfaces, tile_groups);
            let of_instances = [frame.clone(), instance_binding, list_binding];
            encoded.pass("field occlusion blocks", &self.list_blocks, &of_instances, [blocks.x, blocks.y, 1]);
            encoded.pass("field occlusion tiles", &self.list_tiles, &of_instances, tile_groups);
            lists.ask(encoded.encoder);
        });
        if let Some([first, second]) = &traced {
            encoded.group("trace", |encoded| {
                let bindings = [&surfaces[..], &occluders, &[(8, texture(first))]].concat();
                encoded.pass("field occlusion trace", &self.trace, &bindings, groups(trace_size, 1));
            });
            encoded.group("denoise", |encoded| {
                let filters = [(&self.denoise_rows, first, second), (&self.denoise_columns, second, first)];
                for (pipeline, from, to) in (0..settings.denoise_passes).flat_map(|_| filters) {
                    let bindings = [&surfaces[..], &[(3, texture(from)), (4, texture(to))]].concat();
                    encoded.pass("field occlusion denoise", pipeline, &bindings, groups(trace_size, pages));
                }
            });
        }
        if let (Some([filtered, _]), Some([before, after]), Some(motion)) = (&traced, &history, inputs.motion) {
            encoded.group("accumulate", |encoded| {
                let textures = [(3, filtered), (4, before), (5, motion), (6, after)];
                let bindings: Vec<_> =
                    [frame.clone()].into_iter().chain(textures.map(|(i, view)| (i, texture(view)))).collect();
                encoded.pass("field occlusion accumulate", &self.accumulate, &bindings, groups(trace_size, pages));
            });
        }
        encoded.group("resolve", |encoded| {
            let pipeline = match Some(settings.caps.unwrap_or_default()).filter(|_| without_rays) {
                Some(combination) => {
                    let [product, over_8, over_16] = &self.resolve_caps[usize::from(lights_without_rays)];
                    match (combination, combination.directions()) {
                        (CapCombination::Product, _) => product,
                        (CapCombination::SoftCaps { .. }, 8) => over_8,
                        (CapCombination::SoftCaps { .. }, _) => over_16,
                    }
                }
                None => &self.resolve,
            };
            let of_rays = history.as_ref().map(|[_, after]| after).or(traced.as_ref().map(|[filtered, _]| filtered));
            let joined = [
                (8, texture(inputs.output)),
                // What is missing is not read.
                (9, texture(of_rays.unwrap_or(inputs.normals))),
                (10, texture(inputs.screen_space.map_or(inputs.normals, |other| other.visibility))),
            ];
            let bindings = [&surfaces[..], &occluders, &joined].concat();
            encoded.pass("field occlusion resolve", pipeline, &bindings, groups(size, 1));
        });
    }
}

/// The same with the frame's parameters in a storage buffer. Mesa's lavapipe makes constants of the uniforms that decide on
/// branches: it compiles such shaders again for other values, Mesa 22.3 even in every dispatch, and keeps the code of each.
fn without_uniforms(source: &str) -> String {
    source.replace("var<uniform>", "var<storage, read>")
}

/// Instances that lists can name and a device can bind.
pub(super) fn most_instances(limits: &wgpu::Limits) -> usize {
    let bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    lists::MAX_INSTANCES.min(usize::try_from(bytes).unwrap_or(usize::MAX) / size_of::<InstanceData>())
}

/// What a frame asks.
struct Parts {
    /// What needs no rays, for ambient light or for any light.
    without_rays: bool,
    /// What needs no rays, for any light.
    lights_without_rays: bool,
    rays: bool,
}

fn parts(instances: &[InstanceData], lights: &[Light], settings: &TraceSettings) -> Parts {
    let any = |of: fn(&InstanceData) -> u32, is: fn(OcclusionSource) -> bool| {
        instances.iter().any(|instance| is_source(of(instance), is))
    };
    let any_light = |is: fn(OcclusionSource) -> bool| {
        lights.iter().any(Light::is_large) && any(|instance| instance.light_source, is)
            || lights.iter().any(|light| !light.is_large()) && any(|instance| instance.small_light_source, is)
    };
    let ambient = any(|instance| instance.ambient_source, OcclusionSource::needs_no_rays);
    let lights_without_rays = any_light(OcclusionSource::needs_no_rays);
    let ambient_rays = settings.ambient_rays > 0 && any(|instance| instance.ambient_source, OcclusionSource::has_rays);
    let shadow_rays = settings.shadow_rays > 0 && any_light(OcclusionSource::has_rays);
    Parts { without_rays: ambient || lights_without_rays, lights_without_rays, rays: ambient_rays || shadow_rays }
}

/// Where passes are encoded.
struct Encoded<'a> {
    device: &'a wgpu::Device,
    encoder: &'a mut wgpu::CommandEncoder,
    timer: &'a mut dyn PassTimer,
}

impl Encoded<'_> {
    fn group(&mut self, name: &'static str, encode: impl FnOnce(&mut Self)) {
        self.timer.begin(self.encoder, name);
        encode(self);
        self.timer.end(self.encoder);
    }

    fn pass(
        &mut self,
        label: &str,
        pipeline: &wgpu::ComputePipeline,
        bindings: &[(u32, wgpu::BindingResource)],
        [x, y, z]: [u32; 3],
    ) {
        let entries: Vec<_> = bindings
            .iter()
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding: *binding, resource: resource.clone() })
            .collect();
        let layout = pipeline.get_bind_group_layout(0);
        let bind_group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(label),
            layout: &layout,
            entries: &entries,
        });
        let descriptor = wgpu::ComputePassDescriptor { label: Some(label), timestamp_writes: None };
        let mut pass = self.encoder.begin_compute_pass(&descriptor);
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.dispatch_workgroups(x, y, z);
    }
}
