// Stands in for Bevy's view bindings, and asks `masks.wgsl` about one light after the other.

struct RectLight {
    position: vec3<f32>,
    width: f32,
    right: vec3<f32>,
    height: f32,
    up: vec3<f32>,
    range: f32,
}

struct Lights {
    rect_lights: array<RectLight, 8>,
}

@group(0) @binding(0) var screen_space_ambient_occlusion_texture: texture_2d<f32>;
@group(0) @binding(1) var<uniform> lights: Lights;
// Kind (directional, clustered, rect), light, and pixel.
@group(0) @binding(2) var<storage> questions: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> answers: array<f32>;

@compute @workgroup_size(64)
fn probe(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&questions) {
        return;
    }
    let question = questions[id.x];
    let frag_coord = vec2<f32>(question.zw) + 0.5;
    switch question.x {
        case 0u: { answers[id.x] = visfield_directional_visibility(question.y, frag_coord); }
        case 1u: { answers[id.x] = visfield_clustered_visibility(question.y, frag_coord); }
        default: { answers[id.x] = visfield_rect_visibility(question.y, frag_coord); }
    }
}
