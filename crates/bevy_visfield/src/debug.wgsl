// Shows one channel of the occlusion texture: in grey, where white is visible and black is occluded, or as colours.

@group(0) @binding(0) var occlusion_texture: texture_2d<f32>;
// The channel within its page, and the page's first row.
@group(0) @binding(1) var<uniform> place: vec4<u32>;

fn channel_at(position: vec4<f32>) -> f32 {
    let at = vec2<u32>(position.xy) + vec2<u32>(0u, place.y);
    // Pages that there are none of are white.
    if at.y >= textureDimensions(occlusion_texture).y {
        return 1.0;
    }
    return textureLoad(occlusion_texture, at, 0)[place.x];
}

@fragment
fn visible(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4<f32>(vec3<f32>(channel_at(position)), 1.0);
}

@fragment
fn tile_load(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let load = 1.0 - channel_at(position);
    // From dark blue over green and yellow to red, and on the borders of tiles a little darker.
    let color = clamp(
        vec3<f32>(3.0 * load - 0.8, min(3.0 * load, 3.0 - 3.0 * load), 0.5 - 1.5 * load),
        vec3<f32>(0.0),
        vec3<f32>(1.0),
    );
    let at_border = any(vec2<u32>(position.xy) % 16u == vec2<u32>(0u));
    return vec4<f32>(color * select(1.0, 0.7, at_border), 1.0);
}
