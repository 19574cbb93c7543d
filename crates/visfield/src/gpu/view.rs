//! What one camera keeps from frame to frame.

use glam::UVec2;

use super::OUTPUT_FORMAT;
use super::layout::{FrameUniform, InstanceData, sample_data};
use super::lists::TileLists;
use super::passes::{TRACED_FORMAT, most_instances};
use crate::estimate::caps::CapCombination;
use crate::estimate::frame::TraceSettings;

/// One camera's own resources, kept from frame to frame.
///
/// ```
/// let view = visfield::gpu::OcclusionView::new(); // holds nothing until the first frame is encoded
/// assert_eq!(view.tile_entries(), 0);
/// ```
#[derive(Debug, Default)]
pub struct OcclusionView {
    frame: Option<wgpu::Buffer>,
    instances: Option<wgpu::Buffer>,
    /// The sample patterns, and the settings that they were made for.
    samples: Option<(wgpu::Buffer, TraceSettings)>,
    lists: Option<TileLists>,
    /// What the trace makes, and what the pass over rows makes of it.
    traced: Option<[wgpu::Texture; 2]>,
    /// What was accumulated, the latest last.
    history: Option<[wgpu::Texture; 2]>,
    /// [`FrameInputs::history_key`](super::FrameInputs::history_key) of what was accumulated.
    history_key: Option<u64>,
    /// Counts the frames that were accumulated.
    turn: u32,
}

/// Frames after which the rays are those of the first again: many more than are seen at once.
const TURNS: u32 = 64;

/// What a frame needs beside its buffers.
#[derive(Clone, Copy)]
pub(super) struct Needed {
    /// Textures of this size for what is traced.
    pub(super) traced: Option<UVec2>,
    /// And for what is accumulated of it, with frames of this key.
    pub(super) accumulated: Option<u64>,
}

/// A view's resources, fit for a frame.
pub(super) struct Prepared<'a> {
    pub(super) frame: &'a wgpu::Buffer,
    pub(super) instances: &'a wgpu::Buffer,
    pub(super) samples: &'a wgpu::Buffer,
    pub(super) lists: &'a TileLists,
    pub(super) traced: Option<[wgpu::TextureView; 2]>,
    /// What was accumulated before the frame, and with it.
    pub(super) history: Option<[wgpu::TextureView; 2]>,
    /// Whether anything was accumulated before.
    pub(super) is_history: bool,
}

impl OcclusionView {
    /// Holds nothing until the first frame is encoded.
    pub fn new() -> Self {
        Self::default()
    }

    /// Entries of all tiles' lists, of the latest frame that the GPU has told of.
    pub fn tile_entries(&self) -> u32 {
        self.lists.as_ref().map_or(0, TileLists::entries)
    }

    /// Bytes of the buffers and textures that are kept.
    pub fn bytes(&self) -> u64 {
        let buffers = [&self.frame, &self.instances].into_iter().flatten().map(wgpu::Buffer::size).sum::<u64>();
        let samples = self.samples.as_ref().map_or(0, |(buffer, _)| buffer.size());
        let lists = self.lists.as_ref().map_or(0, |lists| lists.buffer().size());
        let textures = [&self.traced, &self.history].into_iter().flatten().flatten();
        let bytes = |texture: &wgpu::Texture| {
            let texel = texture.format().block_copy_size(None).unwrap_or(0);
            u64::from(texture.width()) * u64::from(texture.height()) * u64::from(texel)
        };
        buffers + samples + lists + textures.map(bytes).sum::<u64>()
    }

    /// Makes what is missing or no longer fits.
    pub(super) fn prepare(
        &mut self,
        (device, queue): (&wgpu::Device, &wgpu::Queue),
        settings: &TraceSettings,
        instance_count: usize,
        viewport: UVec2,
        needed: Needed,
    ) -> Prepared<'_> {
        fit_textures(&mut self.traced, device, needed.traced, ("field occlusion, traced", TRACED_FORMAT));
        let kept = self.history.is_some() && self.history_key == needed.accumulated;
        self.history_key = needed.accumulated;
        let size = needed.traced.filter(|_| needed.accumulated.is_some());
        let accumulated = ("field occlusion, accumulated", OUTPUT_FORMAT);
        let is_history = !fit_textures(&mut self.history, device, size, accumulated) && kept;
        if let Some(history) = &mut self.history {
            history.swap(0, 1);
            self.turn = (self.turn + 1) % TURNS;
        }
        TileLists::fit(&mut self.lists, device, viewport);

        let instance_bytes = |count: usize| (size_of::<InstanceData>() * count) as u64;
        // Never empty: a binding needs at least one element.
        let count = instance_count.max(1);
        self.instances.take_if(|buffer| buffer.size() < instance_bytes(count));
        let patterns =
            TraceSettings { turn: if self.history.is_some() { self.turn } else { settings.turn }, ..*settings };
        self.fit_samples((device, queue), patterns);
        let view = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        Prepared {
            frame: self.frame.get_or_insert_with(|| {
                let bytes = size_of::<FrameUniform>() as u64;
                // Which of both depends on the adapter.
                let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::STORAGE;
                create_buffer(device, "field occlusion frame", bytes, usage)
            }),
            instances: self.instances.get_or_insert_with(|| {
                let bytes = instance_bytes(count.next_power_of_two().min(most_instances(&device.limits())));
                create_buffer(device, "field occlusion instances", bytes, wgpu::BufferUsages::STORAGE)
            }),
            samples: &self.samples.as_ref().expect("it was just made to fit").0,
            lists: self.lists.as_ref().expect("it was just made to fit"),
            traced: self.traced.as_ref().map(|textures| textures.each_ref().map(view)),
            history: self.history.as_ref().map(|textures| textures.each_ref().map(view)),
            is_history,
        }
    }

    fn fit_samples(&mut self, (device, queue): (&wgpu::Device, &wgpu::Queue), settings: TraceSettings) {
        // What patterns do not depend on must not make them again.
        let made_for = TraceSettings {
            caps: settings.caps.map(|caps| CapCombination::SoftCaps { directions: caps.directions() as u32 }),
            ambient_rays: settings.ambient_rays,
            shadow_rays: settings.shadow_rays,
            max_distance: settings.max_distance,
            falloff: settings.falloff,
            turn: settings.turn,
            ..TraceSettings::default()
        };
        if self.samples.as_ref().is_some_and(|(_, kept)| *kept == made_for) {
            return;
        }
        let data = sample_data(&settings);
        let bytes = (size_of::<[f32; 4]>() * data.len().max(1)) as u64;
        let kept = self.samples.take().map(|(buffer, _)| buffer).filter(|buffer| buffer.size() == bytes);
        let buffer = kept
            .unwrap_or_else(|| create_buffer(device, "field occlusion samples", bytes, wgpu::BufferUsages::STORAGE));
        queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&data));
        self.samples = Some((buffer, made_for));
    }
}

/// Keeps textures of a size, or none; whether they are new.
fn fit_textures(
    kept: &mut Option<[wgpu::Texture; 2]>,
    device: &wgpu::Device,
    size: Option<UVec2>,
    (label, format): (&str, wgpu::TextureFormat),
) -> bool {
    kept.take_if(|[texture, _]| Some(UVec2::new(texture.width(), texture.height())) != size);
    let Some(size) = size.filter(|_| kept.is_none()) else { return false };
    let texture = || {
        device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        })
    };
    *kept = Some([texture(), texture()]);
    true
}

fn create_buffer(device: &wgpu::Device, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: bytes,
        usage: usage | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}
