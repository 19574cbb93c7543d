//! An adapter to measure on: buffers, kernels, and how long they take.

use std::time::Instant;

use bytemuck::Pod;
use thiserror::Error;
use wgpu::BufferUsages;

use crate::bake::BakeError;
use crate::measure::speed::median;

/// Threads of a work group, `GROUP` in the shaders.
const GROUP: u32 = 64;
/// Largest number of work groups along a row: a power of two below the limit of every adapter, 65,535.
const GROUPS_IN_A_ROW: u32 = 32_768;
/// How often everything is timed; the median counts.
const REPEATS: usize = 7;
/// How long a timing lasts at least, in seconds, by repeating what is timed.
const SHORTEST: f64 = 0.01;
/// The most repetitions within a timing.
const MOST_RUNS: f64 = 64.0;

/// Why nothing was measured on a GPU. Every message is one line.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum GpuError {
    /// There is nothing to run shaders on.
    #[error(
        "no GPU adapter found: install a driver for Vulkan, Metal or DirectX 12; on Debian or Ubuntu the package \
         mesa-vulkan-drivers brings a software adapter"
    )]
    NoAdapter,
    /// The adapter gives no device.
    #[error("the adapter {adapter} gives no device: {source}; update its driver")]
    Device {
        /// Name of the adapter.
        adapter: String,
        /// What it said.
        source: wgpu::RequestDeviceError,
    },
    /// A mesh or a field cannot be baked.
    #[error(transparent)]
    Bake(#[from] BakeError),
    /// The adapter's storage bindings are too small for the fields.
    #[error("{0}; measure with smaller tables")]
    Pool(#[from] visfield::gpu::PoolError),
}

/// A device, and how its time is told.
pub(in crate::measure) struct Gpu {
    pub(in crate::measure) device: wgpu::Device,
    pub(in crate::measure) queue: wgpu::Queue,
    pub(in crate::measure) info: wgpu::AdapterInfo,
    timestamps: Option<Timestamps>,
}

/// The begin and the end of a pass, told by the adapter itself.
struct Timestamps {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    /// Of one tick.
    seconds: f64,
}

/// One dispatch of an entry point, ready to run.
pub(in crate::measure) struct Kernel {
    label: &'static str,
    pipeline: wgpu::ComputePipeline,
    bindings: wgpu::BindGroup,
    groups: [u32; 2],
}

impl Gpu {
    /// The fastest adapter; software ones too, if there is nothing else.
    pub(in crate::measure) fn new() -> Result<Self, GpuError> {
        let instance = wgpu::Instance::default();
        let power_preference = wgpu::PowerPreference::HighPerformance;
        let options = wgpu::RequestAdapterOptions { power_preference, ..Default::default() };
        let adapter = pollster::block_on(instance.request_adapter(&options)).map_err(|_| GpuError::NoAdapter)?;
        let info = adapter.get_info();
        let required_features = adapter.features() & wgpu::Features::TIMESTAMP_QUERY;
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("visfield measure"),
            required_features,
            ..Default::default()
        });
        let (device, queue) =
            pollster::block_on(request).map_err(|source| GpuError::Device { adapter: info.name.clone(), source })?;
        let timestamps = (!required_features.is_empty()).then(|| Timestamps::new(&device, &queue));
        Ok(Self { device, queue, info, timestamps })
    }

    /// Whether the adapter runs on the processor.
    pub(in crate::measure) fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// How time is told, in words.
    pub(in crate::measure) fn timer(&self) -> &'static str {
        if self.timestamps.is_some() { "timestamps of the adapter" } else { "wall time" }
    }

    /// A buffer that shaders read.
    pub(in crate::measure) fn buffer<T: Pod>(&self, label: &'static str, content: &[T]) -> wgpu::Buffer {
        let bytes = bytemuck::cast_slice(content);
        let usage = BufferUsages::STORAGE | BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let buffer = self.create_buffer(label, bytes.len() as u64, usage);
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    /// A buffer of so many words that shaders write.
    pub(in crate::measure) fn answers(&self, count: usize) -> wgpu::Buffer {
        self.create_buffer("answers", count as u64 * 4, BufferUsages::STORAGE | BufferUsages::COPY_SRC)
    }

    fn create_buffer(&self, label: &'static str, size: u64, usage: BufferUsages) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage,
            mapped_at_creation: false,
        })
    }

    pub(in crate::measure) fn module(&self, label: &'static str, parts: &[&str]) -> wgpu::ShaderModule {
        let source = wgpu::ShaderSource::Wgsl(parts.concat().into());
        self.device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source })
    }

    /// An entry point of a module for so many threads.
    pub(in crate::measure) fn kernel(
        &self,
        entry_point: &'static str,
        module: &wgpu::ShaderModule,
        constants: &[(&str, f64)],
        buffers: &[(u32, &wgpu::Buffer)],
        threads: usize,
    ) -> Kernel {
        let pipeline = self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry_point),
            layout: None,
            module,
            entry_point: Some(entry_point),
            compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
            cache: None,
        });
        let bound = buffers.iter().copied();
        let entries: Vec<_> = bound
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        let layout = pipeline.get_bind_group_layout(0);
        let bindings = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(entry_point),
            layout: &layout,
            entries: &entries,
        });
        let groups = (threads as u32).div_ceil(GROUP);
        let row = groups.min(GROUPS_IN_A_ROW);
        Kernel { label: entry_point, pipeline, bindings, groups: [row, groups.div_ceil(row.max(1))] }
    }

    /// Runs a kernel once, and gives back what it wrote.
    pub(in crate::measure) fn run<T: Pod>(&self, kernel: &Kernel, answers: &wgpu::Buffer) -> Vec<T> {
        self.seconds(kernel, 1);
        bytemuck::pod_collect_to_vec(&self.read(answers))
    }

    fn read(&self, buffer: &wgpu::Buffer) -> Vec<u8> {
        let staging = self.create_buffer("read back", buffer.size(), BufferUsages::COPY_DST | BufferUsages::MAP_READ);
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, buffer.size());
        self.queue.submit([encoder.finish()]);
        staging.slice(..).map_async(wgpu::MapMode::Read, |result| result.expect("a staging buffer maps"));
        self.wait();
        staging.slice(..).get_mapped_range().to_vec()
    }

    fn wait(&self) {
        self.device.poll(wgpu::PollType::wait_indefinitely()).expect("a wait without end does not time out");
    }

    /// Seconds of one of so many runs in a row.
    fn seconds(&self, kernel: &Kernel, runs: u32) -> f64 {
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some(kernel.label),
                timestamp_writes: self.timestamps.as_ref().map(|timestamps| wgpu::ComputePassTimestampWrites {
                    query_set: &timestamps.queries,
                    beginning_of_pass_write_index: Some(0),
                    end_of_pass_write_index: Some(1),
                }),
            });
            pass.set_pipeline(&kernel.pipeline);
            pass.set_bind_group(0, &kernel.bindings, &[]);
            for _ in 0..runs {
                pass.dispatch_workgroups(kernel.groups[0], kernel.groups[1], 1);
            }
        }
        if let Some(timestamps) = &self.timestamps {
            encoder.resolve_query_set(&timestamps.queries, 0..2, &timestamps.resolved, 0);
        }
        // Uploads before the work are not part of it.
        self.queue.submit([]);
        self.wait();
        let start = Instant::now();
        self.queue.submit([encoder.finish()]);
        self.wait();
        let wall = start.elapsed().as_secs_f64();
        let told = self.timestamps.as_ref().map(|timestamps| {
            let ticks: Vec<u64> = bytemuck::pod_collect_to_vec(&self.read(&timestamps.resolved));
            ticks[1].saturating_sub(ticks[0]) as f64 * timestamps.seconds
        });
        // A driver that tells nothing has the feature all the same.
        told.filter(|seconds| *seconds > 0.0).unwrap_or(wall) / f64::from(runs)
    }

    /// Median seconds of one run of each kernel, in turn: what slows the machine down for a while slows all of them down. What
    /// takes next to no time runs several times in a row. `between` is called after each of as many timings as there are
    /// kernels × [`TIMINGS`].
    pub(in crate::measure) fn race(&self, kernels: &[&Kernel], between: impl Fn()) -> Vec<f64> {
        // The first run compiles, the second one tells how many are needed.
        let runs: Vec<u32> = kernels
            .iter()
            .map(|kernel| {
                self.seconds(kernel, 1);
                let once = self.seconds(kernel, 1);
                between();
                (SHORTEST / once.max(1.0e-9)).ceil().clamp(1.0, MOST_RUNS) as u32
            })
            .collect();
        let mut times = vec![Vec::new(); kernels.len()];
        for _ in 0..REPEATS {
            for ((kernel, runs), times) in kernels.iter().zip(&runs).zip(&mut times) {
                times.push(self.seconds(kernel, *runs));
                between();
            }
        }
        times.into_iter().map(median).collect()
    }
}

/// How often [`Gpu::race`] says that it has come further, for each kernel.
pub(in crate::measure) const TIMINGS: u64 = REPEATS as u64 + 1;

impl Timestamps {
    fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Self {
        let queries = device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("begin and end"),
            ty: wgpu::QueryType::Timestamp,
            count: 2,
        });
        let resolved = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("begin and end"),
            size: 16,
            usage: BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        Self { queries, resolved, seconds: f64::from(queue.get_timestamp_period()) * 1.0e-9 }
    }
}
