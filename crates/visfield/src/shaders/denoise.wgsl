// The denoise pass: averages the sixteen interleaved patterns over the same surface. Twin: estimate/frame.rs.
// Joined after frame.wgsl.

@group(0) @binding(3) var noisy_texture: texture_2d<f32>;
// r: ambient visibility; g, b: occlusion of lights 0 and 1; a: visibility of light 2. A texture with only a red channel
// therefore reads as "no shadows" (textureLoad fills in 0, 0, 1).
@group(0) @binding(4) var output_texture: texture_storage_2d<rgba16float, write>;

// How much a neighbour that the pattern places at `offset` counts: the ends of the five taps share one residue of the
// four, and so half each. Falls to 0 across depth edges and creases.
fn bilateral_weight(center: Receiver, neighbor: Receiver, offset: vec2<i32>, footprint: f32) -> f32 {
    if neighbor.depth == 0.0 {
        return 0.0;
    }
    let ends = select(vec2<f32>(1.0), vec2<f32>(0.5), abs(offset) == vec2<i32>(2));
    let off_plane = abs(dot(center.normal, neighbor.position - center.position));
    let same_plane = clamp(2.0 - off_plane / footprint, 0.0, 1.0);
    let same_facing = clamp(dot(center.normal, neighbor.normal) * 4.0 - 3.0, 0.0, 1.0);
    return ends.x * ends.y * same_plane * same_facing;
}

// Width of a pixel at a receiver, in world units.
fn pixel_footprint(pixel: vec2<u32>, center: Receiver) -> f32 {
    return distance(position_at(vec2<f32>(pixel) + vec2<f32>(1.0, 0.0), center.depth), center.position);
}

@compute @workgroup_size(8, 8)
fn denoise(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= frame.viewport_size) {
        return;
    }
    let center = receiver_at(pixel);
    var sum = textureLoad(noisy_texture, pixel, 0);
    var total = 1.0;
    if center.depth > 0.0 {
        let footprint = pixel_footprint(pixel, center);
        let last = vec2<i32>(frame.viewport_size) - 1;
        for (var y = -2; y <= 2; y++) {
            for (var x = -2; x <= 2; x++) {
                let offset = vec2<i32>(x, y);
                let at = vec2<i32>(pixel) + offset;
                if all(offset == vec2<i32>(0)) || any(at < vec2<i32>(0)) || any(at > last) {
                    continue;
                }
                let weight = bilateral_weight(center, receiver_at(vec2<u32>(at)), offset, footprint);
                sum += textureLoad(noisy_texture, at, 0) * weight;
                total += weight;
            }
        }
    }
    let occlusion = clamp(sum / total, vec4<f32>(0.0), vec4<f32>(1.0));
    let encoded = vec4<f32>(1.0 - occlusion.x, occlusion.y, occlusion.z, 1.0 - occlusion.w);
    textureStore(output_texture, pixel + frame.viewport_origin, encoded);
}
