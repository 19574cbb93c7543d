//! `masks.wgsl` on a GPU: what it reads from a texture laid out by [`MaskTable`].

use bevy::prelude::*;
use wgpu::util::DeviceExt;

use super::*;

const PAGE: UVec2 = UVec2::new(21, 5);
const PIXELS: [UVec2; 3] = [UVec2::ZERO, UVec2::new(20, 4), UVec2::new(7, 2)];

/// Eight different rectangles, some of them opposite sides of one panel.
fn rects() -> [ExtractedRectLight; 8] {
    std::array::from_fn(|i| ExtractedRectLight {
        color: LinearRgba::WHITE,
        intensity: 1.0,
        range: 20.0,
        width: 1.0 + (i / 4) as f32,
        height: 0.3,
        transform: Transform::from_xyz(0.1, (i / 2) as f32, 1e-41)
            .with_rotation(Quat::from_rotation_y(i as f32 * std::f32::consts::PI))
            .into(),
    })
}

/// As Bevy's `GpuRectLight`.
fn uniform(light: &ExtractedRectLight) -> [f32; 12] {
    let [position, right, up] =
        [light.transform.translation(), light.transform.right().into(), light.transform.up().into()]
            .map(|v| v.to_array());
    let rows = [(position, light.width), (right, light.height), (up, light.range)];
    let rows = rows.map(|([x, y, z], w)| [x, y, z, w]);
    rows.concat().try_into().expect("three rows of four")
}

/// What a channel holds at a pixel.
fn content(channel: usize, pixel: UVec2) -> f32 {
    (channel as u32 * 1000 + pixel.y * PAGE.x + pixel.x) as f32
}

/// The whole texture: pages of [`content`], and the header.
fn texels(table: &MaskTable) -> Vec<[f16; 4]> {
    let pages = (0..table.pages * PAGE.y).flat_map(|row| {
        let (page, y) = (row / PAGE.y, row % PAGE.y);
        (0..PAGE.x)
            .map(move |x| std::array::from_fn(|i| f16::from_f32(content(page as usize * 4 + i, UVec2::new(x, y)))))
    });
    pages.chain(table.header()).collect()
}

fn answers(size: UVec2, texels: &[[f16; 4]], questions: &[[u32; 4]]) -> Option<Vec<f32>> {
    let instance = wgpu::Instance::default();
    let Ok(adapter) = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())) else {
        assert!(std::env::var_os("CI").is_none(), "CI needs a GPU or a software adapter (mesa-vulkan-drivers)");
        eprintln!("skipped: no GPU adapter found; on Debian or Ubuntu install mesa-vulkan-drivers");
        return None;
    };
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default()))
        .expect("default limits are met by every adapter");
    let texture = device.create_texture_with_data(
        &queue,
        &wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba16Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        },
        wgpu::util::TextureDataOrder::LayerMajor,
        &texels.iter().flatten().flat_map(|number| number.to_le_bytes()).collect::<Vec<_>>(),
    );
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    let buffer = |contents: &[u8], usage| {
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
    };
    let lights: Vec<f32> = rects().iter().flat_map(uniform).collect();
    let lights = buffer(bytemuck::cast_slice(&lights), wgpu::BufferUsages::UNIFORM);
    let asked = buffer(bytemuck::cast_slice(questions), wgpu::BufferUsages::STORAGE);
    let answers = buffer(&vec![0; questions.len() * 4], wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
    let source =
        [include_str!("masks_probe.wgsl"), &include_str!("masks.wgsl").replace("view_bindings::", "")].concat();
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: None,
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let buffers = [&lights, &asked, &answers].map(wgpu::Buffer::as_entire_binding);
    let resources = [wgpu::BindingResource::TextureView(&view)].into_iter().chain(buffers);
    let entries: Vec<_> =
        (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
    let layout = pipeline.get_bind_group_layout(0);
    let bind_group =
        device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries });
    let staging = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: answers.size(),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.dispatch_workgroups((questions.len() as u32).div_ceil(64), 1, 1);
    }
    encoder.copy_buffer_to_buffer(&answers, 0, &staging, 0, answers.size());
    queue.submit([encoder.finish()]);
    staging.slice(..).map_async(wgpu::MapMode::Read, |result| result.expect("the staging buffer maps"));
    device.poll(wgpu::PollType::wait_indefinitely()).expect("the device finishes");
    let read = staging.slice(..).get_mapped_range();
    Some(bytemuck::pod_collect_to_vec(&read))
}

/// Every light that a shader may ask for, as `masks_probe.wgsl` counts them.
fn all_lights() -> impl Iterator<Item = (u32, u32)> {
    let of = |kind: u32, count: u32| (0..count).map(move |index| (kind, index));
    of(0, 10).chain(of(1, 70)).chain(of(2, 8))
}

fn shader_light((kind, index): (u32, u32)) -> ShaderLight {
    match kind {
        0 => ShaderLight::Directional(index),
        1 => ShaderLight::Clustered(index),
        _ => ShaderLight::Rect(RectKey::new(&rects()[index as usize])),
    }
}

#[test]
fn every_light_reads_its_own_mask() {
    let masked = [(1, 3), (0, 2), (2, 5), (2, 4), (1, 0), (0, 9), (2, 7), (1, 40), (2, 0), (0, 0), (1, 41)];
    for count in 0..=masked.len() {
        let lights: Vec<_> = masked[..count].iter().map(|light| shader_light(*light)).collect();
        let table = MaskTable::new(&lights, PAGE, 8192).unwrap();
        assert_eq!(table.masks(), count);
        let questions: Vec<_> =
            all_lights().flat_map(|(kind, index)| PIXELS.map(|pixel| [kind, index, pixel.x, pixel.y])).collect();
        let Some(answers) = answers(table.texture_size(), &texels(&table), &questions) else { return };
        for (&[kind, index, x, y], answer) in questions.iter().zip(answers) {
            let mask = masked[..count].iter().position(|light| *light == (kind, index));
            let expected = mask.map_or(1.0, |mask| f16::from_f32(content(mask + 1, UVec2::new(x, y))).to_f32());
            assert_eq!(answer, expected, "{count} masks, light {index} of kind {kind} at {x}, {y}");
        }
    }
}

#[test]
fn a_texture_of_bevys_own_has_no_masks() {
    let questions: Vec<_> = all_lights().map(|(kind, index)| [kind, index, 3, 4]).collect();
    // What a texture with a red channel alone reads as.
    let texels = vec![[0.5, 0.0, 0.0, 1.0].map(f16::from_f32); (PAGE.x * PAGE.y) as usize];
    let Some(answers) = answers(PAGE, &texels, &questions) else { return };
    assert!(answers.iter().all(|answer| *answer == 1.0));
}
