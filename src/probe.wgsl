// Copies what the node saw and what it made into a buffer: for each pixel of the viewport the normal and the depth; ambient
// visibility, that of the first two lights, and the flags of the receiver.

struct Viewport {
    origin: vec2<u32>,
    size: vec2<u32>,
}

@group(0) @binding(0) var depth_texture: texture_depth_2d;
@group(0) @binding(1) var normal_texture: texture_2d<f32>;
@group(0) @binding(2) var occlusion_texture: texture_2d<f32>;
@group(0) @binding(3) var<storage, read_write> pixels: array<vec4<f32>>;
@group(0) @binding(4) var<uniform> viewport: Viewport;

@compute @workgroup_size(8, 8)
fn probe(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= viewport.size) {
        return;
    }
    let texel = viewport.origin + id.xy;
    let at = (id.y * viewport.size.x + id.x) * 2u;
    let normal = textureLoad(normal_texture, texel, 0);
    pixels[at] = vec4<f32>(normal.xyz * 2.0 - 1.0, textureLoad(depth_texture, texel, 0));
    pixels[at + 1u] = vec4<f32>(textureLoad(occlusion_texture, texel, 0).xyz, normal.a);
}
