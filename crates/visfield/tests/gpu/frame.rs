//! Whole passes: a small frame on the GPU against the same frame on the CPU.

use glam::{DAffine3, DVec3, EulerRot, Mat4, UVec2, Vec2, Vec3, Vec4, dvec3, uvec2, vec2, vec3, vec4};
use visfield::estimate::Falloff;
use visfield::estimate::caps::CapCombination;
use visfield::estimate::frame::accumulate::accumulate;
use visfield::estimate::frame::denoise::denoise;
use visfield::estimate::frame::resolve::{resolve, visibility};
use visfield::estimate::frame::trace::trace;
use visfield::estimate::frame::{
    Casting, Channels, FrameOccluder, GeometryBuffer, MAX_LIGHTS, TraceResolution, TraceSettings,
};
use visfield::estimate::light::Light;
use visfield::field::cap_grid::{self, CapGridError, CapGridFormat, CapGridHeader, CapPrecision, HarmonicOrder};
use visfield::field::{FieldParts, VisibilityField, ball_field};
use visfield::gpu::layout::InstanceData;
use visfield::gpu::{FieldPool, FrameInputs, OUTPUT_FORMAT, OcclusionPasses, OcclusionView};
use visfield::scene::Placement;

use super::device::{device, read_buffer, texture};

/// The viewport, and where it lies in larger textures.
const SIZE: UVec2 = uvec2(48, 40);
const ORIGIN: UVec2 = uvec2(8, 4);
const TARGET: UVec2 = uvec2(64, 48);
/// Pages of the output.
const PAGES: u32 = 3;
const NEAR: f32 = 0.1;

/// A camera above a ground plane with a step in it and a crease (edges that the denoiser must keep) and sky at the top.
fn geometry() -> GeometryBuffer {
    let projection = Mat4::perspective_infinite_reverse_rh(1.0, SIZE.x as f32 / SIZE.y as f32, NEAR);
    let world_from_view = Mat4::look_to_rh(Vec3::ZERO, vec3(0.0, -0.6, -0.8), Vec3::Y).inverse();
    let mut geometry = GeometryBuffer {
        world_from_clip: world_from_view * projection.inverse(),
        size: SIZE,
        depth: vec![],
        normals: vec![vec4(0.0, 1.0, 0.0, 1.0); (SIZE.x * SIZE.y) as usize],
    };
    for pixel in geometry.pixels() {
        let along = geometry.position_at(pixel.as_vec2(), 0.5).normalize();
        let height = if pixel.x < 20 { -2.0 } else { -1.5 };
        let hit = along * (height / along.y);
        let view_depth = world_from_view.inverse().transform_point3(hit).z;
        let visible = along.y < -0.05;
        // As wide as one pixel: where every second one is traced, none of it is.
        if pixel.x == 27 {
            geometry.normals[(pixel.y * SIZE.x + pixel.x) as usize] = vec4(0.8, 0.6, 0.0, 1.0);
        }
        if pixel.x > 36 {
            geometry.normals[(pixel.y * SIZE.x + pixel.x) as usize] = vec4(-0.8, 0.6, 0.0, 1.0);
        }
        geometry.depth.push(if visible { NEAR / -view_depth } else { 0.0 });
    }
    geometry
}

/// A depth texture cannot be written from the CPU; a tiny pass draws the values into it.
fn depth_texture(device: &wgpu::Device, queue: &wgpu::Queue, depth: &[f32]) -> wgpu::Texture {
    let usages = wgpu::TextureUsages::TEXTURE_BINDING;
    let values = texture(device, TARGET, wgpu::TextureFormat::R32Float, usages | wgpu::TextureUsages::COPY_DST);
    upload(queue, &values, bytemuck::cast_slice(depth), 4);
    let target =
        texture(device, TARGET, wgpu::TextureFormat::Depth32Float, usages | wgpu::TextureUsages::RENDER_ATTACHMENT);
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(include_str!("depth.wgsl").into()),
    });
    let bindings = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty: wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Float { filterable: false },
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            },
            count: None,
        }],
    });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(&bindings)],
        immediate_size: 0,
    });
    let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: wgpu::TextureFormat::Depth32Float,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Always),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[],
        }),
        multiview_mask: None,
        cache: None,
    });
    let bind_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &bindings,
        entries: &[wgpu::BindGroupEntry {
            binding: 0,
            resource: wgpu::BindingResource::TextureView(&values.create_view(&wgpu::TextureViewDescriptor::default())),
        }],
    });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &target.create_view(&wgpu::TextureViewDescriptor::default()),
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.draw(0..3, 0..1);
    }
    queue.submit([encoder.finish()]);
    target
}

fn upload(queue: &wgpu::Queue, texture: &wgpu::Texture, data: &[u8], bytes_per_texel: u32) {
    queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            origin: wgpu::Origin3d { x: ORIGIN.x, y: ORIGIN.y, z: 0 },
            ..texture.as_image_copy()
        },
        data,
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(SIZE.x * bytes_per_texel), rows_per_image: None },
        wgpu::Extent3d { width: SIZE.x, height: SIZE.y, depth_or_array_layers: 1 },
    );
}

/// The viewport's part of all pages.
fn read_pages(device: &wgpu::Device, queue: &wgpu::Queue, texture: &wgpu::Texture) -> Vec<Channels> {
    let row = (TARGET.x * 8).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(row * TARGET.y * PAGES),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None },
        },
        texture.size(),
    );
    queue.submit([encoder.finish()]);
    let bytes = read_buffer(device, queue, &buffer, buffer.size());
    let half = |bytes: &[u8]| half::f16::from_le_bytes([bytes[0], bytes[1]]).to_f32();
    let pixel = |x: u32, y: u32| {
        std::array::from_fn(|channel| {
            let row_of_page = channel as u32 / 4 * TARGET.y + ORIGIN.y + y;
            half(&bytes[(row_of_page * row + (ORIGIN.x + x) * 8) as usize + channel % 4 * 2..])
        })
    };
    (0..SIZE.y).flat_map(|y| (0..SIZE.x).map(move |x| (x, y))).map(|(x, y)| pixel(x, y)).collect()
}

/// What occludes: fields, and instances of them by the fields' numbers.
pub(crate) struct Occluders {
    fields: Vec<VisibilityField>,
    placements: Vec<(Placement, usize)>,
    casting: Vec<Casting>,
}

impl Occluders {
    pub(crate) fn new(fields: Vec<VisibilityField>, instances: impl IntoIterator<Item = (usize, DAffine3)>) -> Self {
        let place = |(field, world_from_mesh): (usize, DAffine3)| {
            let bounds = &fields[field].header().bounds;
            (Placement::new(bounds, world_from_mesh, DVec3::ZERO).unwrap(), field)
        };
        let placements: Vec<_> = instances.into_iter().map(place).collect();
        Self { casting: vec![Casting::default(); placements.len()], placements, fields }
    }
}

/// The frame of the passes, and that of their twins, encoded alike.
pub(crate) fn frames(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    occluders: &Occluders,
    lights: &[Light],
    settings: TraceSettings,
) -> [Vec<Channels>; 2] {
    OcclusionPasses::check(&device.limits()).unwrap();
    let passes = OcclusionPasses::new(device);
    let gpu = gpu_frame(device, queue, (&passes, &mut OcclusionView::new()), occluders, lights, (settings, None));
    (gpu, visibility(&stored_geometry(), &frame_occluders(occluders), lights, &settings)).into()
}

/// What the textures hold: normals of eight bits.
fn stored_geometry() -> GeometryBuffer {
    // The twin sees the normals as the texture holds them.
    let quantised = |n: &Vec4| (((n.truncate() + 1.0) * 127.5).round() / 127.5 - 1.0).extend(n.w);
    let geometry = geometry();
    GeometryBuffer { normals: geometry.normals.iter().map(quantised).collect(), ..geometry }
}

fn frame_occluders(occluders: &Occluders) -> Vec<FrameOccluder<'_>> {
    occluders
        .placements
        .iter()
        .zip(&occluders.casting)
        .map(|((placement, field), casting)| FrameOccluder {
            casting: *casting,
            ..FrameOccluder::new(*placement, &occluders.fields[*field])
        })
        .collect()
}

/// The frame of the passes alone; where it is accumulated, everything moved by as much.
fn gpu_frame(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    (passes, view): (&OcclusionPasses, &mut OcclusionView),
    occluders: &Occluders,
    lights: &[Light],
    (settings, motion): (TraceSettings, Option<Vec2>),
) -> Vec<Channels> {
    let geometry = geometry();
    let mut pool = FieldPool::new(device);
    let slots: Vec<_> = occluders.fields.iter().map(|field| pool.insert(device, queue, field).unwrap()).collect();
    let instances: Vec<_> = occluders
        .placements
        .iter()
        .zip(&occluders.casting)
        .map(|((placement, field), casting)| InstanceData::new(&slots[*field], placement, *casting, settings.wanted()))
        .collect();
    let normals: Vec<u8> = geometry
        .normals
        .iter()
        .flat_map(|n| ((n.truncate() + 1.0) * 127.5).extend(n.w * 255.0).to_array())
        .map(|v| v.round() as u8)
        .collect();
    let usages = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
    let normal_texture = texture(device, TARGET, wgpu::TextureFormat::Rgba8Unorm, usages);
    upload(queue, &normal_texture, &normals, 4);
    let depth_texture = depth_texture(device, queue, &geometry.depth);
    let output = wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::COPY_SRC;
    let output = texture(device, uvec2(TARGET.x, TARGET.y * PAGES), OUTPUT_FORMAT, output);
    let motion_texture = motion.map(|motion| {
        let texture = texture(device, TARGET, wgpu::TextureFormat::Rg16Float, usages);
        let moved = motion.to_array().map(half::f16::from_f32).map(half::f16::to_le_bytes).concat();
        upload(queue, &texture, &moved.repeat(geometry.depth.len()), 4);
        texture
    });
    let view_of = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    passes.encode(
        (device, queue, &mut encoder),
        &pool,
        view,
        &FrameInputs {
            depth: &view_of(&depth_texture),
            normals: &view_of(&normal_texture),
            motion: motion_texture.as_ref().map(view_of).as_ref(),
            history_key: 0,
            screen_space: None,
            output: &view_of(&output),
            page_rows: TARGET.y,
            viewport: (ORIGIN, SIZE),
            world_from_clip: geometry.world_from_clip,
            instances: &instances,
            lights,
            show_tile_load: false,
            settings,
        },
        &mut (),
    );
    queue.submit([encoder.finish()]);
    let mut gpu = read_pages(device, queue, &output);
    for (pixel, depth) in gpu.iter_mut().zip(&geometry.depth) {
        // Other pages are not written.
        pixel[FrameInputs::pages(lights.len()) as usize * 4..].fill(1.0);
        assert!(*depth > 0.0 || *pixel == [1.0; 1 + MAX_LIGHTS], "the sky is not occluded: {pixel:?}");
    }
    gpu
}

/// How many pixels show occlusion, by channel, and how many differ by more than a step of the bytes that are filtered.
pub(crate) fn compare([gpu, cpu]: &[Vec<Channels>; 2]) -> (Channels, usize) {
    let touched = |channel: usize| cpu.iter().filter(|pixel| pixel[channel] < 0.95).count() as f32;
    let differs =
        |(gpu, cpu): &(&Channels, &Channels)| gpu.iter().zip(*cpu).any(|(gpu, cpu)| (gpu - cpu).abs() > 0.005);
    let differing = gpu.iter().zip(cpu).filter(differs).count();
    let touched = std::array::from_fn(touched);
    println!("{differing} of {} pixels differ by more than 0.005; touched {touched:?}", gpu.len());
    (touched, differing)
}

pub(crate) fn squeezed() -> DAffine3 {
    DAffine3::from_scale_rotation_translation(
        dvec3(0.4, -1.2, 0.7),
        glam::DQuat::from_euler(EulerRot::XYZ, 0.4, 0.5, 0.6),
        dvec3(0.9, -1.2, -2.6),
    )
}

pub(crate) fn moved(x: f64, y: f64, z: f64) -> DAffine3 {
    DAffine3::from_translation(dvec3(x, y, z))
}

/// A wide one, whose disc dips below the horizon of the tilted part, and a narrow one.
fn lights() -> [Light; 2] {
    [Light::directional(vec3(0.5, 1.0, 0.3).normalize(), 0.9), Light::directional(Vec3::Y, 0.02)]
}

#[test]
fn the_passes_compute_what_their_twins_compute() {
    let Some((device, queue)) = device() else { return };
    // The last one lies to the right of the tilted part, mostly below its horizon.
    let instances =
        [(0, moved(-0.5, -1.4, -3.0)), (1, squeezed()), (1, moved(0.2, -1.5, -2.0)), (0, moved(2.4, -1.1, -2.8))];
    let occluders = Occluders::new(vec![ball_field(0.9, 33, 16), ball_field(0.5, 17, 9)], instances);
    let settings = TraceSettings { ambient_rays: 5, shadow_rays: 3, max_distance: 2.5, ..TraceSettings::default() };
    let frames = frames(&device, &queue, &occluders, &lights(), settings);
    let (touched, differing) = compare(&frames);
    assert!(touched[0] > 200.0 && touched[1] > 50.0 && touched[2] > 50.0, "the frame shows something: {touched:?}");
    assert_eq!(touched[3], 0.0, "there is no third light");
    // A rounding difference moves a ray's table index at a cell border, and the ray's answer with it: seldom.
    assert!(differing <= frames[0].len() / 200, "{differing} pixels differ");
}

/// Balls with a cap grid alone, with both parts, with a grid that must not be asked inside its box, with a table alone, and
/// with grids that hide large lights: alone, and not inside its box.
fn caps_of_all_kinds() -> Vec<VisibilityField> {
    let table = ball_field(0.5, 33, 16);
    let grid = |order: HarmonicOrder, precision, points, inside| {
        let numbers = vec![0.0; order.coefficients()];
        Some(cap_grid::ball(CapGridHeader {
            format: CapGridFormat { order, precision, points, ..CapGridFormat::DEFAULT },
            half_extents: [0.5; 3],
            error: Some(CapGridError { outside: 0.0, inside }),
            low: numbers.clone(),
            range: numbers,
            ..CapGridHeader::default()
        }))
    };
    let (one, three) = (HarmonicOrder::One, HarmonicOrder::Three);
    let (bytes, halves) = (CapPrecision::U8, CapPrecision::F16);
    let with_table = table.table().cloned();
    let parts = [
        FieldParts { cap_grid: grid(one, bytes, 16, 0.0), table: None, distance: None },
        FieldParts { cap_grid: grid(one, halves, 9, 0.0), table: with_table.clone(), distance: None },
        FieldParts { cap_grid: grid(one, bytes, 16, 1.0), table: with_table.clone(), distance: None },
        FieldParts { cap_grid: None, table: with_table.clone(), distance: None },
        FieldParts { cap_grid: grid(three, bytes, 16, 0.0), table: None, distance: None },
        FieldParts { cap_grid: grid(three, halves, 9, 1.0), table: with_table, distance: None },
    ];
    parts.map(|parts| VisibilityField::new(table.header().clone(), parts).unwrap()).into()
}

/// Lights of every kind, near and far, more than one page holds.
pub(crate) fn all_lights() -> [Light; MAX_LIGHTS] {
    let ball = Light::sphere(vec3(0.6, -0.2, -2.0), 0.3, 20.0);
    let spot = Light::spot(vec3(-0.8, 0.0, -1.6), 0.1, 20.0, vec3(0.3, -0.9, -0.3).normalize(), 0.7);
    let panel = Light::rectangle(vec3(0.0, -0.1, -3.0), Vec3::X * 0.8, Vec3::Z * 0.3, -Vec3::Y, 20.0);
    // It shines into a face of the ground: most of its surface lies below the horizon of the rest.
    let low = Light::rectangle(vec3(-2.5, -1.6, -2.5), Vec3::Z * 0.8, Vec3::Y * 0.5, Vec3::X, 20.0);
    let dim = Light::sphere(vec3(0.6, -0.2, -2.0), 0.3, 1.7);
    let [large, small] = lights();
    [ball, large, spot, panel, small, low, dim, spot, ball, panel, small]
}

#[test]
fn lights_of_every_kind_are_hidden_as_their_twins_say() {
    let Some((device, queue)) = device() else { return };
    let instances =
        [(0, moved(-0.5, -1.4, -3.0)), (1, squeezed()), (1, moved(0.2, -1.5, -2.0)), (0, moved(2.4, -1.1, -2.8))];
    let occluders = Occluders::new(vec![ball_field(0.9, 33, 16), ball_field(0.5, 17, 9)], instances);
    let settings = TraceSettings { ambient_rays: 3, shadow_rays: 4, ..TraceSettings::default() };
    let frames = frames(&device, &queue, &occluders, &all_lights(), settings);
    let (touched, differing) = compare(&frames);
    assert!(touched.iter().all(|touched| *touched > 40.0), "every light is hidden somewhere: {touched:?}");
    assert!(differing <= frames[0].len() / 60, "{differing} pixels differ in any of {MAX_LIGHTS} lights");
}

#[test]
fn settings_do_what_their_twins_do() {
    let Some((device, queue)) = device() else { return };
    let instances =
        [(1, moved(-0.5, -1.4, -3.0)), (2, squeezed()), (3, moved(0.2, -1.5, -2.0)), (1, moved(1.4, -1.1, -2.8))];
    let mut occluders = Occluders::new(caps_of_all_kinds(), instances);
    let rays = TraceSettings { ambient_rays: 5, shadow_rays: 3, max_distance: 2.0, ..TraceSettings::default() };
    let obscurance = Falloff::Obscurance { tau: 0.8 };
    let caps = |settings| TraceSettings { caps: Some(CapCombination::Product), ..settings };
    let all = [
        ("half", TraceSettings { resolution: TraceResolution::Half, ..rays }),
        ("half, with caps", caps(TraceSettings { resolution: TraceResolution::Half, ..rays })),
        ("linear", TraceSettings { falloff: Falloff::Linear, ..rays }),
        ("linear caps", caps(TraceSettings { falloff: Falloff::Linear, ..rays })),
        ("obscurance", TraceSettings { falloff: obscurance, ..rays }),
        ("obscurance by caps", caps(TraceSettings { falloff: obscurance, ..rays })),
        ("intensity", caps(TraceSettings { intensity: 2.5, ..rays })),
        ("unfiltered", TraceSettings { denoise_passes: 0, ..rays }),
        ("filtered twice", TraceSettings { denoise_passes: 2, ..rays }),
        ("another turn", TraceSettings { turn: 5, ..rays }),
    ];
    let mut pictures = vec![frames(&device, &queue, &occluders, &all_lights()[..4], rays)[1].clone()];
    for (name, settings) in all {
        let frames = frames(&device, &queue, &occluders, &all_lights()[..4], settings);
        let (touched, differing) = compare(&frames);
        assert!(touched[0] > 150.0 && touched[1] > 30.0, "{name}: the frame shows something: {touched:?}");
        assert!(differing <= frames[0].len() / 400, "{name}: {differing} pixels differ");
        pictures.push(frames[1].clone());
    }
    for (i, picture) in pictures.iter().enumerate() {
        assert!(pictures[..i].iter().all(|other| other != picture), "setting {i} changes something");
    }
    // What casts nothing.
    occluders.casting[0].ambient = false;
    occluders.casting[1].shadows = false;
    let frames = frames(&device, &queue, &occluders, &all_lights()[..4], caps(rays));
    let (touched, differing) = compare(&frames);
    assert!(touched[0] > 50.0 && differing <= frames[0].len() / 60, "{touched:?}, {differing} pixels differ");
}

#[test]
fn frames_accumulate_as_their_twins_do() {
    let Some((device, queue)) = device() else { return };
    let fields = || vec![ball_field(0.9, 33, 16), ball_field(0.5, 17, 9)];
    let frames = [-0.5, -0.4, 0.6].map(|x| Occluders::new(fields(), [(0, moved(x, -1.4, -3.0)), (1, squeezed())]));
    let geometry = stored_geometry();
    for (resolution, motion) in [(TraceResolution::Full, vec2(0.03125, -0.0625)), (TraceResolution::Half, Vec2::ZERO)] {
        let settings =
            TraceSettings { ambient_rays: 3, shadow_rays: 2, resolution, intensity: 1.0, ..TraceSettings::default() };
        let (passes, mut view) = (OcclusionPasses::new(&device), OcclusionView::new());
        let mut accumulated: Option<Vec<Channels>> = None;
        for (turn, occluders) in (1..).zip(&frames) {
            let on_gpu = (&passes, &mut view);
            let gpu = gpu_frame(&device, &queue, on_gpu, occluders, &lights(), (settings, Some(motion)));
            let settings = TraceSettings { turn, ..settings };
            let noisy = trace(&geometry, &frame_occluders(occluders), &lights(), &settings);
            let filtered = denoise(&geometry, noisy, &settings);
            let joined = match &accumulated {
                Some(history) => {
                    accumulate(&geometry, resolution, &filtered, history, &vec![motion; geometry.depth.len()])
                }
                None => filtered,
            };
            let cpu = resolve(&geometry, &frame_occluders(occluders), &lights(), &settings, &joined);
            accumulated = Some(joined);
            let (touched, differing) = compare(&[gpu, cpu]);
            assert!(touched[0] > 200.0 && touched[1] > 50.0, "the frame shows something: {touched:?}");
            assert!(differing <= geometry.depth.len() / 60, "{resolution:?}, frame {turn}: {differing} pixels differ");
        }
    }
}

#[test]
fn lists_without_room_drop_nothing() {
    let Some((device, queue)) = device() else { return };
    // Many more in one place than lists have room for at first.
    let instances = (0..400).map(|i| {
        let turn = f64::from(i) * 2.4;
        (usize::from(i % 2 == 0), moved(turn.sin() * 0.02 * f64::from(i % 40), -1.5, -2.6 + turn.cos() * 0.5))
    });
    let occluders = Occluders::new(vec![ball_field(0.2, 9, 8), ball_field(0.1, 9, 8)], instances);
    let settings = TraceSettings { ambient_rays: 2, shadow_rays: 2, ..TraceSettings::default() };
    let (passes, mut view) = (OcclusionPasses::new(&device), OcclusionView::new());
    let mut frame = || gpu_frame(&device, &queue, (&passes, &mut view), &occluders, &lights(), (settings, None));
    let (first, second, third) = (frame(), frame(), frame());
    let bytes = |view: &OcclusionView| (view.tile_entries(), view.bytes());
    assert!(first == second && second == third, "with and without room, bit for bit");
    let (entries, kept) = bytes(&view);
    assert!(entries > 9 * 24, "lists outgrew their first room: {entries}");
    assert!(kept > u64::from(entries) * 4, "and have it now");
    let cpu = &frames(&device, &queue, &occluders, &lights(), settings);
    assert!(compare(cpu).1 <= first.len() / 60);
}

#[test]
fn the_caps_pass_computes_what_its_twin_computes() {
    let Some((device, queue)) = device() else { return };
    let turned = DAffine3::from_scale_rotation_translation(
        dvec3(1.5, -1.5, 1.5),
        glam::DQuat::from_euler(EulerRot::XYZ, 0.4, 0.5, 0.6),
        dvec3(-0.7, -1.3, -3.0),
    );
    let instances = [
        (0, turned),
        (1, squeezed()),
        (2, moved(0.2, -1.6, -2.0)),
        (3, moved(-1.2, -1.5, -2.0)),
        (0, moved(1.6, -1.4, -2.4)),
        (4, moved(-0.3, -1.2, -1.4)),
        (5, moved(0.8, -1.6, -3.2)),
    ];
    let all = Occluders::new(caps_of_all_kinds(), instances);
    let alone = Occluders::new(caps_of_all_kinds(), [instances[0], instances[1], instances[4]]);
    let rules = [
        CapCombination::Product,
        CapCombination::SoftCaps { directions: 8 },
        CapCombination::SoftCaps { directions: 16 },
    ];
    for combination in rules {
        for (occluders, lights, max_distance) in [
            (&all, &lights()[..], f32::INFINITY),
            (&all, &[][..], 1.0),
            (&alone, &[][..], f32::INFINITY),
            (&alone, &lights()[..], 2.0),
        ] {
            let caps = Some(combination);
            let settings =
                TraceSettings { caps, ambient_rays: 5, shadow_rays: 3, max_distance, ..TraceSettings::default() };
            let frames = frames(&device, &queue, occluders, lights, settings);
            let (touched, differing) = compare(&frames);
            assert!(touched[0] > 200.0, "the frame shows something: {touched:?}");
            assert!(differing <= frames[0].len() / 200, "{combination:?}: {differing} pixels differ");
        }
    }
}

#[test]
fn caps_hide_large_lights() {
    let Some((device, queue)) = device() else { return };
    let instances = [(4, moved(-0.3, -1.0, -1.6)), (4, squeezed()), (5, moved(0.2, -1.6, -2.4))];
    let occluders = Occluders::new(caps_of_all_kinds(), instances);
    let alone = Occluders::new(caps_of_all_kinds(), [instances[0], instances[1]]);
    let [large, small] = lights();
    assert!(large.is_large() && !small.is_large());
    let caps = Some(CapCombination::default());
    let settings = TraceSettings { caps, ambient_rays: 5, shadow_rays: 3, ..TraceSettings::default() };
    for (occluders, lights) in [(&occluders, &[large, small][..]), (&occluders, &[large]), (&alone, &[large])] {
        let frames = frames(&device, &queue, occluders, lights, settings);
        let (touched, differing) = compare(&frames);
        assert!(touched[0] > 200.0 && touched[1] > 50.0, "the frame shows something: {touched:?}");
        assert!(differing <= frames[0].len() / 200, "{differing} pixels differ");
    }
    // Without caps they are hidden by rays, or not at all.
    let by_rays = TraceSettings { caps: None, ..settings };
    let [_, unhidden] = frames(&device, &queue, &alone, &[large], by_rays);
    assert!(unhidden.iter().all(|pixel| pixel[1] == 1.0));
}

#[test]
fn caps_alone_make_the_same_frame_again() {
    let Some((device, queue)) = device() else { return };
    let occluders = Occluders::new(caps_of_all_kinds(), [(0, squeezed()), (1, moved(0.2, -1.5, -2.0))]);
    let settings = TraceSettings { caps: Some(CapCombination::default()), ..TraceSettings::default() };
    let [first, _] = frames(&device, &queue, &occluders, &[], settings);
    let [second, _] = frames(&device, &queue, &occluders, &[], settings);
    assert!(first.iter().any(|pixel| pixel[0] < 0.9), "the frame shows something");
    assert!(first == second, "bit for bit");
}

#[test]
fn a_view_keeps_nothing_of_the_frame_before() {
    let Some((device, queue)) = device() else { return };
    let one = [(0, moved(-0.3, -1.2, -2.6))];
    let many =
        [(4, moved(-0.3, -1.0, -1.6)), (1, squeezed()), (2, moved(0.2, -1.6, -2.0)), (3, moved(-1.2, -1.5, -2.0))];
    let [alone, all] = [&one[..], &many].map(|some| Occluders::new(caps_of_all_kinds(), some.iter().copied()));
    let lights = lights();
    let rays = TraceSettings { ambient_rays: 5, shadow_rays: 3, ..TraceSettings::default() };
    let caps = TraceSettings { caps: Some(CapCombination::default()), ..rays };
    let sixteen = TraceSettings { caps: Some(CapCombination::SoftCaps { directions: 16 }), ..rays };
    let passes = OcclusionPasses::new(&device);
    let mut kept = OcclusionView::new();
    for (name, occluders, lights, settings) in [
        ("caps alone", &alone, &[][..], caps),
        ("caps with lights", &all, &lights, caps),
        ("rays", &all, &lights[1..], rays),
        ("caps without ambient rays", &all, &[], TraceSettings { ambient_rays: 0, ..sixteen }),
        ("caps alone again", &alone, &[], caps),
    ] {
        let frame = |view| gpu_frame(&device, &queue, (&passes, view), occluders, lights, (settings, None));
        let (reused, fresh) = (frame(&mut kept), frame(&mut OcclusionView::new()));
        assert!(fresh.iter().filter(|pixel| pixel[0] < 0.95).count() > 50, "{name}: the frame shows something");
        assert!(reused == fresh, "{name}");
    }
}
