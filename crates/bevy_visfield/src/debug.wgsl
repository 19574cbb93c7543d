// Shows one channel of the occlusion texture in grey: white is visible, black is occluded.

@group(0) @binding(0) var occlusion_texture: texture_2d<f32>;

fn channel(occlusion: vec4<f32>, index: u32) -> f32 {
    switch index {
        case 1u: { return 1.0 - occlusion.g; }
        case 2u: { return 1.0 - occlusion.b; }
        case 3u: { return occlusion.a; }
        default: { return occlusion.r; }
    }
}

@fragment
fn ambient(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4<f32>(vec3<f32>(channel(textureLoad(occlusion_texture, vec2<i32>(position.xy), 0), 0u)), 1.0);
}

@fragment
fn light_0(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4<f32>(vec3<f32>(channel(textureLoad(occlusion_texture, vec2<i32>(position.xy), 0), 1u)), 1.0);
}

@fragment
fn light_1(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4<f32>(vec3<f32>(channel(textureLoad(occlusion_texture, vec2<i32>(position.xy), 0), 2u)), 1.0);
}

@fragment
fn light_2(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4<f32>(vec3<f32>(channel(textureLoad(occlusion_texture, vec2<i32>(position.xy), 0), 3u)), 1.0);
}
