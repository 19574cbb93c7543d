// What all passes share: the frame's parameters and receivers. Twin: estimate/frame/mod.rs.

const MAX_LIGHTS: u32 = 11u;

// Layout: gpu/layout.rs, `FrameUniform`.
struct Frame {
    // From clip space to the world relative to the camera.
    world_from_clip: mat4x4<f32>,
    // The camera's viewport in the textures, in pixels.
    viewport_origin: vec2<u32>,
    viewport_size: vec2<u32>,
    // What is traced: every pixel of the viewport, or every `trace_scale`th along both axes.
    trace_size: vec2<u32>,
    trace_scale: u32,
    instance_count: u32,
    ambient_rays: u32,
    shadow_rays: u32,
    light_count: u32,
    // A bit for each light that is large enough for cap grids.
    large_lights: u32,
    max_distance: f32,
    bias_height: f32,
    bias_along: f32,
    // 0: binary, 1: linear, 2: obscurance with `falloff_tau`.
    falloff: u32,
    falloff_tau: f32,
    // Exponent of ambient visibility.
    intensity: f32,
    // What is traced is part of the frame.
    traced: u32,
    // 0: none, 1: the darker, 2: the product.
    screen_space: u32,
    // Tiles of the viewport.
    tiles: vec2<u32>,
    // Entries that there is room for in all lists.
    list_capacity: u32,
    // Rows from a page of the output to the next.
    page_rows: u32,
    // How much the new frame counts against the accumulated ones; 1 without them.
    blend: f32,
    // Entries of a tile's list that are shown as a full one, in the place of ambient visibility; 0 shows that.
    show_tile_load: u32,
    lights: array<Light, MAX_LIGHTS>,
}

// A light with a size; which members mean what depends on its kind. Twin: estimate/light.rs.
struct Light {
    // The unit vector towards it, of a directional light; otherwise its centre, relative to the camera.
    origin: vec3<f32>,
    kind: u32,
    // Tangents of a disc in the sky, as long as its radius at distance 1; half the sides of a rectangle.
    tangent: vec3<f32>,
    // How far it shines.
    range: f32,
    bitangent: vec3<f32>,
    // Sine of a disc's angular radius; radius of a sphere; half the diagonal of a rectangle.
    radius: f32,
    // The direction in which spots and rectangles shine.
    emission: vec3<f32>,
    // Cosine of a disc's angular radius; of a spot's outer angle, −2 for a light that is none; 0 for a rectangle.
    cosine: f32,
}

// A surface point; depth 0 (infinity, reversed z) means there is none.
struct Receiver {
    position: vec3<f32>,
    normal: vec3<f32>,
    depth: f32,
    // ReceiverFlags
    flags: u32,
}

const OWN_SURFACE_OFF: u32 = 1u;
const NO_AMBIENT: u32 = 2u;

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

// ReceiverFlags::from_normal_alpha
fn flags_from_normal_alpha(alpha: f32) -> u32 {
    return u32(round((1.0 - alpha) * 3.0));
}

fn receiver_at(pixel: vec2<u32>) -> Receiver {
    let texel = pixel + frame.viewport_origin;
    let depth = textureLoad(depth_texture, texel, 0);
    let stored = textureLoad(normal_texture, texel, 0);
    let normal = normalize(stored.xyz * 2.0 - 1.0);
    return Receiver(position_at(vec2<f32>(pixel), depth), normal, depth, flags_from_normal_alpha(stored.w));
}

// The pixel of the viewport that is traced for a pixel of what is traced.
fn traced_pixel(pixel: vec2<u32>) -> vec2<u32> {
    return pixel * frame.trace_scale;
}

// Pages of four channels: ambient occlusion and one for each light.
fn pages() -> u32 {
    return (frame.light_count + 4u) / 4u;
}

// Which residue of a pattern that 2^bits pixels a side share is a pixel's own.
fn interleave_index(x: u32, y: u32, bits: u32) -> u32 {
    let diagonal = x ^ y;
    var index = 0u;
    for (var bit = 0u; bit < bits; bit++) {
        index = (index << 2u) | (((diagonal >> bit) & 1u) << 1u) | ((y >> bit) & 1u);
    }
    return index;
}
