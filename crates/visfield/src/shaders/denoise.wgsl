// The denoise passes: average the interleaved patterns over the same surface, along rows and then along columns. Twin:
// estimate/frame/denoise.rs. Joined after frame.wgsl and surface.wgsl.

// Occlusion, by pages.
@group(0) @binding(3) var noisy_texture: texture_2d<f32>;
@group(0) @binding(4) var filtered_texture: texture_storage_2d<rgba8unorm, write>;

// Taps to either side.
const REACH: i32 = 4;

// 1 over the difference up to which taps count fully; at twice that they do not.
const LIKENESS: f32 = 3.0;

// How much a tap counts for ambient occlusion and for lights, whose patterns repeat every eight and four pixels: each
// residue counts once, those at both ends half each.
fn pattern_weight(offset: i32, page: u32) -> vec4<f32> {
    let distance = abs(offset);
    let ambient = select(1.0, 0.5, distance == 4);
    let light = select(select(0.0, 0.5, distance == 2), 1.0, distance < 2);
    return vec4<f32>(select(light, ambient, page == 0u), light, light, light);
}

// How far what a tap found can be the same as what the centre found, but for noise: across the edge of a shadow it is not.
// Ambient occlusion has no such edges.
fn likeness(center: vec4<f32>, found: vec4<f32>, page: u32) -> vec4<f32> {
    let light = clamp(2.0 - abs(found - center) * LIKENESS, vec4<f32>(0.0), vec4<f32>(1.0));
    return vec4<f32>(select(light.x, 1.0, page == 0u), light.yzw);
}

fn denoise_line(pixel: vec2<u32>, page: u32, along: vec2<i32>) -> vec4<f32> {
    let center = receiver_at(traced_pixel(pixel));
    let page_start = vec2<i32>(0, i32(page * frame.trace_size.y));
    let own = textureLoad(noisy_texture, vec2<i32>(pixel) + page_start, 0);
    var sum = own;
    var total = vec4<f32>(1.0);
    if center.depth > 0.0 {
        let footprint = pixel_footprint(traced_pixel(pixel), center);
        let last = vec2<i32>(frame.trace_size) - 1;
        for (var offset = -REACH; offset <= REACH; offset++) {
            let at = vec2<i32>(pixel) + along * offset;
            if offset == 0 || any(at < vec2<i32>(0)) || any(at > last) {
                continue;
            }
            let neighbor = receiver_at(traced_pixel(vec2<u32>(at)));
            let found = textureLoad(noisy_texture, at + page_start, 0);
            let same = bilateral_weight(center, neighbor, footprint);
            let weight = pattern_weight(offset, page) * likeness(own, found, page) * same;
            sum += found * weight;
            total += weight;
        }
    }
    return sum / total;
}

// What is added before a value becomes a byte, so that the bytes of a surface are right in their mean: less than half a step, so
// that 0 and 1 stay what they are.
fn dither(pixel: vec2<u32>) -> f32 {
    return (f32(interleave_index(pixel.x, pixel.y, 3u)) - 31.5) * (1.0 / 64.0 / 255.0);
}

// One page of a pixel, from its neighbours along rows or columns.
fn denoise(id: vec3<u32>, along: vec2<i32>) {
    if any(id.xy >= frame.trace_size) {
        return;
    }
    let filtered = denoise_line(id.xy, id.z, along) + dither(id.xy);
    textureStore(filtered_texture, id.xy + vec2<u32>(0u, id.z * frame.trace_size.y), filtered);
}

@compute @workgroup_size(8, 8)
fn denoise_rows(@builtin(global_invocation_id) id: vec3<u32>) {
    denoise(id, vec2<i32>(1, 0));
}

@compute @workgroup_size(8, 8)
fn denoise_columns(@builtin(global_invocation_id) id: vec3<u32>) {
    denoise(id, vec2<i32>(0, 1));
}
