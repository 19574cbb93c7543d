// The denoise passes: average the interleaved patterns over the same surface, along rows and then along columns. Twin:
// estimate/frame/denoise.rs. Joined after frame.wgsl and surface.wgsl.

// Occlusion, by pages.
@group(0) @binding(3) var noisy_texture: texture_2d<f32>;
@group(0) @binding(4) var filtered_texture: texture_storage_2d<rgba16float, write>;

// Taps to either side.
const REACH: i32 = 4;

// How much a tap counts for ambient occlusion and for lights, whose patterns repeat every eight and four pixels: each
// residue counts once, those at both ends half each.
fn pattern_weight(offset: i32, page: u32) -> vec4<f32> {
    let distance = abs(offset);
    let ambient = select(1.0, 0.5, distance == 4);
    let light = select(select(0.0, 0.5, distance == 2), 1.0, distance < 2);
    return vec4<f32>(select(light, ambient, page == 0u), light, light, light);
}

fn denoise_line(pixel: vec2<u32>, page: u32, along: vec2<i32>) -> vec4<f32> {
    let center = receiver_at(traced_pixel(pixel));
    let page_start = vec2<i32>(0, i32(page * frame.trace_size.y));
    var sum = textureLoad(noisy_texture, vec2<i32>(pixel) + page_start, 0);
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
            let weight = pattern_weight(offset, page) * bilateral_weight(center, neighbor, footprint);
            sum += textureLoad(noisy_texture, at + page_start, 0) * weight;
            total += weight;
        }
    }
    return sum / total;
}

// One page of a pixel, from its neighbours along rows or columns.
fn denoise(id: vec3<u32>, along: vec2<i32>) {
    if any(id.xy >= frame.trace_size) {
        return;
    }
    let filtered = denoise_line(id.xy, id.z, along);
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
