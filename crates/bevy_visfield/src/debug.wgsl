// Shows one channel of the occlusion texture in grey: white is visible, black is occluded.

@group(0) @binding(0) var occlusion_texture: texture_2d<f32>;

fn occlusion_at(position: vec4<f32>) -> vec4<f32> {
    return textureLoad(occlusion_texture, vec2<i32>(position.xy), 0);
}

fn grey(visibility: f32) -> vec4<f32> {
    return vec4<f32>(vec3<f32>(visibility), 1.0);
}

@fragment
fn ambient(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return grey(occlusion_at(position).r);
}

@fragment
fn light_0(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return grey(1.0 - occlusion_at(position).g);
}

@fragment
fn light_1(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return grey(1.0 - occlusion_at(position).b);
}

@fragment
fn light_2(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return grey(occlusion_at(position).a);
}
