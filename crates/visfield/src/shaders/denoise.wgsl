// The denoise passes: average the interleaved patterns over the same surface, along rows and then along columns. Twin:
// estimate/frame.rs. Joined after frame.wgsl.

// Occlusion: ambient, and lights 0, 1, 2.
@group(0) @binding(3) var noisy_texture: texture_2d<f32>;
@group(0) @binding(4) var output_texture: texture_storage_2d<rgba16float, write>;
// What cap grids give, which has no noise, encoded as the output. Some other texture where that pass does not run.
@group(0) @binding(5) var caps_texture: texture_2d<f32>;

// Taps to either side.
const REACH: i32 = 4;

// How much a tap counts for ambient occlusion and for lights, whose patterns repeat every eight and four pixels: each
// residue counts once, those at both ends half each.
fn pattern_weight(offset: i32) -> vec4<f32> {
    let distance = abs(offset);
    let ambient = select(1.0, 0.5, distance == 4);
    let light = select(select(0.0, 0.5, distance == 2), 1.0, distance < 2);
    return vec4<f32>(ambient, light, light, light);
}

// How far a neighbour lies on the same surface, from 1 to 0 across depth edges and creases. `footprint` is the width of a
// pixel at the centre, in world units.
fn bilateral_weight(center: Receiver, neighbor: Receiver, footprint: f32) -> f32 {
    if neighbor.depth == 0.0 {
        return 0.0;
    }
    let off_plane = abs(dot(center.normal, neighbor.position - center.position));
    let same_plane = clamp(2.0 - off_plane / footprint, 0.0, 1.0);
    let same_facing = clamp(dot(center.normal, neighbor.normal) * 4.0 - 3.0, 0.0, 1.0);
    return same_plane * same_facing;
}

// Width of a pixel at a receiver, in world units.
fn pixel_footprint(pixel: vec2<u32>, center: Receiver) -> f32 {
    return distance(position_at(vec2<f32>(pixel) + vec2<f32>(1.0, 0.0), center.depth), center.position);
}

fn denoise_line(pixel: vec2<u32>, along: vec2<i32>) -> vec4<f32> {
    let center = receiver_at(pixel);
    var sum = textureLoad(noisy_texture, pixel, 0);
    var total = vec4<f32>(1.0);
    if center.depth > 0.0 {
        let footprint = pixel_footprint(pixel, center);
        let last = vec2<i32>(frame.viewport_size) - 1;
        for (var offset = -REACH; offset <= REACH; offset++) {
            let at = vec2<i32>(pixel) + along * offset;
            if offset == 0 || any(at < vec2<i32>(0)) || any(at > last) {
                continue;
            }
            let weight = pattern_weight(offset) * bilateral_weight(center, receiver_at(vec2<u32>(at)), footprint);
            sum += textureLoad(noisy_texture, at, 0) * weight;
            total += weight;
        }
    }
    return sum / total;
}

@compute @workgroup_size(8, 8)
fn denoise_rows(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= frame.viewport_size) {
        return;
    }
    textureStore(output_texture, pixel, denoise_line(pixel, vec2<i32>(1, 0)));
}

@compute @workgroup_size(8, 8)
fn denoise_columns(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= frame.viewport_size) {
        return;
    }
    let occlusion = clamp(denoise_line(pixel, vec2<i32>(0, 1)), vec4<f32>(0.0), vec4<f32>(1.0));
    var visibility = 1.0 - occlusion;
    if frame.caps != 0u {
        visibility *= decode(textureLoad(caps_texture, pixel, 0));
    }
    textureStore(output_texture, pixel + frame.viewport_origin, encode(visibility));
}
