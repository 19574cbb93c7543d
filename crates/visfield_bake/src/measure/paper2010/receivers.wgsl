// One thread per receiver, which makes its own rays and asks all occluders. Joined after field.wgsl.
// Twins: `hemisphere_directions` in measure/scene.rs, `MeasuredLight` in measure/shadow.rs, `Vec3::any_orthonormal_pair` of glam,
// and visfield::estimate.

// Layout: kernels.rs, `ReceiverWords`.
struct Receiver {
    position: vec3<f32>,
    // A unit vector: by which the receiver turns its pattern.
    turn_x: f32,
    normal: vec3<f32>,
    turn_y: f32,
}

// Layout: kernels.rs, `OccluderWords`.
struct Occluder {
    field_from_world: array<vec4<f32>, 3>,
    shape: TableShape,
    // Of its bounding sphere.
    center: vec3<f32>,
    radius: f32,
}

// Layout: kernels.rs, `LightWords`.
struct Light {
    axis: vec3<f32>,
    // Of the disc's angular radius.
    cosine: f32,
    tangent: vec3<f32>,
    sine: f32,
    bitangent: vec3<f32>,
    padding: u32,
}

// Layout: kernels.rs, `AskedWords`.
struct Asked {
    bias_height: f32,
    bias_along: f32,
    rays: u32,
    padding: u32,
}

const GROUP: u32 = 64u;
// Rays whose answers fit into a word.
const WORD: u32 = 32u;

@group(0) @binding(0) var<storage, read> receivers: array<Receiver>;
// Occluded shares: one of each receiver, or of each receiver and light.
@group(0) @binding(1) var<storage, read_write> answers: array<f32>;
@group(0) @binding(2) var<storage, read> pool: array<u32>;
@group(0) @binding(3) var<storage, read> occluders: array<Occluder>;
@group(0) @binding(4) var<uniform> asked: Asked;
// Points of the sphere, or of the disc.
@group(0) @binding(5) var<storage, read> samples: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> lights: array<Light>;

fn transform(rows: array<vec4<f32>, 3>, v: vec4<f32>) -> vec3<f32> {
    return vec3<f32>(dot(rows[0], v), dot(rows[1], v), dot(rows[2], v));
}

fn cosine_direction(normal: vec3<f32>, point: vec3<f32>) -> vec3<f32> {
    let direction = normal + point;
    let squared = dot(direction, direction);
    if squared > 1.0e-8 {
        return direction / sqrt(squared);
    }
    return normal;
}

// The columns are the tangents.
fn any_orthonormal_pair(v: vec3<f32>) -> mat2x3<f32> {
    let orientation = select(1.0, -1.0, v.z < 0.0);
    let a = -1.0 / (orientation + v.z);
    let b = v.x * v.y * a;
    return mat2x3<f32>(
        vec3<f32>(1.0 + orientation * v.x * v.x * a, orientation * b, -orientation * v.x),
        vec3<f32>(b, orientation + v.y * v.y * a, -v.y),
    );
}

// Around a normal, turned.
fn hemisphere_frame(receiver: Receiver) -> mat3x3<f32> {
    let pair = any_orthonormal_pair(receiver.normal);
    return mat3x3<f32>(
        pair[0] * receiver.turn_x + pair[1] * receiver.turn_y,
        pair[1] * receiver.turn_x - pair[0] * receiver.turn_y,
        receiver.normal,
    );
}

// Whether a sphere can block any ray of the receiver's hemisphere.
fn above_surface(to_center: vec3<f32>, radius: f32, normal: vec3<f32>) -> bool {
    return dot(to_center, normal) > -radius;
}

// Whether a sphere can block any ray towards the light's disc: whether it meets the cone of those rays.
fn meets_cone(to_center: vec3<f32>, radius: f32, light: Light) -> bool {
    let along = dot(to_center, light.axis);
    let across = length(to_center - light.axis * along);
    return along > -radius && across * light.cosine - along * light.sine < radius;
}

// `known`, and which rays an occluder blocks of those from `first` to `last`. Occluders are not sheared or
// stretched, so that normals are vectors like others.
fn ambient_blocked(receiver: Receiver, frame: mat3x3<f32>, occluder: u32, first: u32, last: u32, known: u32) -> u32 {
    let rows = occluders[occluder].field_from_world;
    let shape = occluders[occluder].shape;
    let origin = transform(rows, vec4<f32>(receiver.position, 1.0));
    let normal = normalize(transform(rows, vec4<f32>(receiver.normal, 0.0)));
    let to_center = occluders[occluder].center - receiver.position;
    // A loop that does not start costs nothing anywhere; a branch costs software adapters both sides.
    let end = select(first, last, above_surface(to_center, occluders[occluder].radius, receiver.normal));
    var blocked = known;
    for (var ray = first; ray < end; ray++) {
        let bit = 1u << (ray - first);
        if (blocked & bit) != 0u {
            continue;
        }
        let direction = cosine_direction(receiver.normal, frame * samples[ray].xyz);
        let along = transform(rows, vec4<f32>(direction, 0.0));
        blocked |= select(0u, bit, occluded(shape, origin, along, NO_HIT, normal, Bias(asked.bias_height, asked.bias_along)));
    }
    return blocked;
}

@compute @workgroup_size(GROUP)
fn ambient(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * groups.x * GROUP + id.x;
    if i >= arrayLength(&receivers) {
        return;
    }
    let receiver = receivers[i];
    let frame = hemisphere_frame(receiver);
    var count = 0u;
    for (var first = 0u; first < asked.rays; first += WORD) {
        let last = min(first + WORD, asked.rays);
        var blocked = 0u;
        for (var occluder = 0u; occluder < arrayLength(&occluders); occluder++) {
            blocked = ambient_blocked(receiver, frame, occluder, first, last, blocked);
        }
        count += countOneBits(blocked);
    }
    answers[i] = f32(count) / f32(asked.rays);
}

fn disc_direction(light: Light, point: vec2<f32>) -> vec3<f32> {
    return normalize(light.axis + light.tangent * point.x + light.bitangent * point.y);
}

// Towards a sample of the light, in the receiver's turn of the pattern.
fn light_direction(receiver: Receiver, light: Light, ray: u32) -> vec3<f32> {
    let sample = samples[ray].xy;
    let turn = vec2<f32>(receiver.turn_x, receiver.turn_y);
    let turned = vec2<f32>(turn.x * sample.x - turn.y * sample.y, turn.y * sample.x + turn.x * sample.y);
    return disc_direction(light, turned);
}

// `known`, and which of a light's rays an occluder blocks.
fn light_blocked(receiver: Receiver, light: Light, occluder: u32, known: u32) -> u32 {
    let rows = occluders[occluder].field_from_world;
    let shape = occluders[occluder].shape;
    let origin = transform(rows, vec4<f32>(receiver.position, 1.0));
    let normal = normalize(transform(rows, vec4<f32>(receiver.normal, 0.0)));
    let to_center = occluders[occluder].center - receiver.position;
    let end = select(0u, asked.rays, meets_cone(to_center, occluders[occluder].radius, light));
    var blocked = known;
    for (var ray = 0u; ray < end; ray++) {
        let bit = 1u << ray;
        if (blocked & bit) != 0u {
            continue;
        }
        let direction = light_direction(receiver, light, ray);
        let along = transform(rows, vec4<f32>(direction, 0.0));
        let bias = Bias(asked.bias_height, asked.bias_along);
        let counts = dot(receiver.normal, direction) > 0.0;
        blocked |= select(0u, bit, counts && occluded(shape, origin, along, NO_HIT, normal, bias));
    }
    return blocked;
}

// Of each light up to as many rays as a word has bits.
@compute @workgroup_size(GROUP)
fn shadows(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * groups.x * GROUP + id.x;
    if i >= arrayLength(&receivers) {
        return;
    }
    let receiver = receivers[i];
    let count = arrayLength(&lights);
    for (var l = 0u; l < count; l++) {
        let light = lights[l];
        let faces = dot(receiver.normal, light.axis) > 0.0;
        var blocked = 0u;
        for (var occluder = 0u; occluder < select(0u, arrayLength(&occluders), faces); occluder++) {
            blocked = light_blocked(receiver, light, occluder, blocked);
        }
        // Of the disc, only what is above the receiver's horizon counts.
        var above = 0u;
        for (var ray = 0u; ray < select(0u, asked.rays, blocked != 0u); ray++) {
            above += u32(dot(receiver.normal, light_direction(receiver, light, ray)) > 0.0);
        }
        answers[i * count + l] = f32(countOneBits(blocked)) / f32(max(above, 1u));
    }
}
