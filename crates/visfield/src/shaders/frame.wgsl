// What all passes share: the frame's parameters and receivers. Twin: estimate/frame.rs.

const MAX_LIGHTS: u32 = 3u;

// Layout: gpu/layout.rs, `FrameUniform`.
struct Frame {
    // From clip space to the world relative to the camera.
    world_from_clip: mat4x4<f32>,
    // The camera's viewport in the textures, in pixels.
    viewport_origin: vec2<u32>,
    viewport_size: vec2<u32>,
    instance_count: u32,
    ambient_rays: u32,
    shadow_rays: u32,
    light_count: u32,
    max_distance: f32,
    bias_height: f32,
    bias_along: f32,
    // Whether the caps pass comes before: its result is then part of the frame's.
    caps: u32,
    // First pixel of what the caps pass writes.
    caps_origin: vec2<u32>,
    // A bit for each light that cap grids hide.
    large_lights: u32,
    padding: u32,
    lights: array<Light, MAX_LIGHTS>,
}

// A directional light's disc: the axis towards it, and two tangents as long as its radius at distance 1.
struct Light {
    axis: vec3<f32>,
    // Cosine and sine of the disc's angular radius.
    cosine: f32,
    tangent: vec3<f32>,
    sine: f32,
    bitangent: vec3<f32>,
    // Bevy's index of the light, which is its channel: 0…MAX_LIGHTS−1.
    channel: u32,
}

// A surface point; depth 0 (infinity, reversed z) means there is none.
struct Receiver {
    position: vec3<f32>,
    normal: vec3<f32>,
    depth: f32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var depth_texture: texture_depth_2d;
@group(0) @binding(2) var normal_texture: texture_2d<f32>;

// The point of the camera-relative world behind a position in the viewport, in pixels from its top left corner.
fn position_at(pixel: vec2<f32>, depth: f32) -> vec3<f32> {
    let uv = (pixel + 0.5) / vec2<f32>(frame.viewport_size);
    let ndc = vec2<f32>(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0);
    let position = frame.world_from_clip * vec4<f32>(ndc, depth, 1.0);
    return position.xyz / position.w;
}

fn receiver_at(pixel: vec2<u32>) -> Receiver {
    let texel = pixel + frame.viewport_origin;
    let depth = textureLoad(depth_texture, texel, 0);
    let normal = textureLoad(normal_texture, texel, 0).xyz * 2.0 - 1.0;
    return Receiver(position_at(vec2<f32>(pixel), depth), normalize(normal), depth);
}

// Visibility as Bevy's lighting reads it: r is that of ambient light; g and b are the occlusion of lights 0 and 1; a is the
// visibility of light 2. A texture with only a red channel therefore reads as "no shadows" (textureLoad fills in 0, 0, 1).
fn encode(visibility: vec4<f32>) -> vec4<f32> {
    return vec4<f32>(visibility.x, 1.0 - visibility.y, 1.0 - visibility.z, visibility.w);
}

fn decode(encoded: vec4<f32>) -> vec4<f32> {
    return encode(encoded);
}
