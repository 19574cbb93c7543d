//! What a frame costs by cap grids and by rays, on the same adapter and in the same run.

use std::path::Path;
use std::time::{Duration, Instant};

use glam::{DAffine3, DQuat, DVec3, Mat4, UVec2, dvec3, uvec2};
use visfield::estimate::caps::CapCombination;
use visfield::estimate::frame::{Casting, TraceSettings};
use visfield::gpu::layout::InstanceData;
use visfield::gpu::{FieldPool, FrameInputs, OUTPUT_FORMAT, OcclusionPasses, OcclusionView};
use visfield::scene::Placement;

use super::device::{device, texture};

const SIZE: UVec2 = uvec2(640, 360);
/// Times each frame is timed, taking turns.
const REPEATS: usize = 7;

/// A camera looks at a wall before which twelve of the example's objects hang.
struct Stage {
    device: wgpu::Device,
    queue: wgpu::Queue,
    passes: OcclusionPasses,
    pool: FieldPool,
    slots: Vec<visfield::gpu::FieldSlot>,
    placements: Vec<(usize, Placement)>,
    depth: wgpu::Texture,
    normals: wgpu::Texture,
    output: wgpu::Texture,
}

const NEAR: f32 = 0.1;
const WALL: f32 = 6.0;

impl Stage {
    fn new(device: wgpu::Device, queue: wgpu::Queue, meshes: &[&str]) -> Self {
        let mut pool = FieldPool::new(&device);
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/meshes");
        let read = |name: &&str| {
            let path = folder.join(name).with_extension("vfield");
            visfield::file::read(&path).expect("the example's fields are committed").remove(0)
        };
        let fields: Vec<_> = meshes.iter().map(read).collect();
        let slots = fields.iter().map(|field| pool.insert(&device, &queue, field).unwrap()).collect();
        let place = |i: usize| {
            let (column, row) = ((i % 4) as f64, (i / 4) as f64);
            let at = dvec3(column * 2.2 - 3.3, row * 2.0 - 2.0, 1.2 - f64::from(WALL));
            let place = DAffine3::from_rotation_translation(DQuat::from_rotation_y(i as f64), at);
            let field = i % fields.len();
            (field, Placement::new(&fields[field].header().bounds, place, DVec3::ZERO).unwrap())
        };
        let texture = |format, usage| texture(&device, SIZE, format, usage | wgpu::TextureUsages::TEXTURE_BINDING);
        let attachment = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let stage = Self {
            passes: OcclusionPasses::new(&device),
            slots,
            placements: (0..12).map(place).collect(),
            depth: texture(wgpu::TextureFormat::Depth32Float, attachment),
            normals: texture(wgpu::TextureFormat::Rgba8Unorm, attachment),
            output: texture(OUTPUT_FORMAT, wgpu::TextureUsages::STORAGE_BINDING),
            pool,
            device,
            queue,
        };
        stage.draw_wall();
        stage
    }

    /// The same depth and the same normal everywhere.
    fn draw_wall(&self) {
        let [depth, normals] =
            [&self.depth, &self.normals].map(|t| t.create_view(&wgpu::TextureViewDescriptor::default()));
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &normals,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color { r: 0.5, g: 0.5, b: 1.0, a: 1.0 }),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(NEAR / WALL),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..wgpu::RenderPassDescriptor::default()
        });
        self.queue.submit([encoder.finish()]);
    }

    /// Time from encoding a frame to its end on the GPU.
    fn time(&self, view: &mut OcclusionView, settings: TraceSettings, occluded: bool) -> Duration {
        let instances: Vec<InstanceData> = self
            .placements
            .iter()
            .filter(|_| occluded)
            .map(|(field, placement)| {
                InstanceData::new(&self.slots[*field], placement, Casting::default(), settings.wanted())
            })
            .collect();
        let view_of = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        let start = Instant::now();
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.passes.encode(
            (&self.device, &self.queue, &mut encoder),
            &self.pool,
            view,
            &FrameInputs {
                depth: &view_of(&self.depth),
                normals: &view_of(&self.normals),
                motion: None,
                history_key: 0,
                screen_space: None,
                output: &view_of(&self.output),
                page_rows: SIZE.y,
                viewport: (UVec2::ZERO, SIZE),
                world_from_clip: Mat4::perspective_infinite_reverse_rh(1.0, SIZE.x as f32 / SIZE.y as f32, NEAR)
                    .inverse(),
                instances: &instances,
                lights: &[],
                show_tile_load: false,
                settings,
            },
            &mut (),
        );
        self.queue.submit([encoder.finish()]);
        self.device.poll(wgpu::PollType::wait_indefinitely()).expect("the device finishes");
        start.elapsed()
    }
}

#[test]
fn caps_are_cheaper_than_rays() {
    let Some((device, queue)) = device() else { return };
    let by = compare(&Stage::new(device.clone(), queue.clone(), &["torus_knot", "supershape"]), "knots, supershapes");
    let [product, soft, _] = by;
    // Grids have a contact term beside them, and rays from inside the bounds go through distances.
    assert!(product > 1.8 && soft > 1.8, "rays cost {product} and {soft} times as much");
    // A chair's grid is known to be wrong inside its box, so that the frame has rays and their filter too.
    compare(&Stage::new(device, queue, &["torus_knot", "supershape", "chair"]), "with chairs");
}

/// How much more 8 rays cost without their filter than caps: as a product, and over 8 and 16 directions.
fn compare(stage: &Stage, name: &str) -> [f64; 3] {
    let rays = TraceSettings { ambient_rays: 8, ..TraceSettings::default() };
    let caps = |combination| TraceSettings { caps: Some(combination), ..rays };
    let frames = [
        // The filter by itself, which no frame of caps alone needs.
        (rays, false),
        (rays, true),
        (caps(CapCombination::Product), true),
        (caps(CapCombination::SoftCaps { directions: 8 }), true),
        (caps(CapCombination::SoftCaps { directions: 16 }), true),
    ];
    let mut views: [OcclusionView; 5] = std::array::from_fn(|_| OcclusionView::new());
    let mut times: [Vec<Duration>; 5] = Default::default();
    // The first round compiles.
    for round in 0..=REPEATS {
        for (i, (settings, occluded)) in frames.iter().enumerate() {
            let time = stage.time(&mut views[i], *settings, *occluded);
            if round > 0 {
                times[i].push(time);
            }
        }
    }
    let [filter, rays, product, soft_8, soft_16] = times.map(|mut times| {
        times.sort();
        times[REPEATS / 2].as_secs_f64() * 1e3
    });
    let traced = rays - filter;
    let ratios = [product, soft_8, soft_16].map(|caps| traced / caps);
    println!(
        "{name}: 8 rays {traced:.1} ms and their filter {filter:.1} ms; caps: product {product:.1} ms, over 8 directions \
         {soft_8:.1} ms, over 16 {soft_16:.1} ms; rays cost {:.1}, {:.1} and {:.1} times as much without the filter",
        ratios[0], ratios[1], ratios[2]
    );
    ratios
}
