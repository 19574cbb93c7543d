// Rays of a list through one table. Joined after field.wgsl, in which `byte` is renamed to `fetched_byte`, and rays.wgsl.
// Twins: `VisibilityField::occluded` and `looked_up_index` in mod.rs.

// Whether bytes are read from the table. Without it, everything else is done: the arithmetic limit.
override FETCH: bool = true;

struct Asked {
    shape: TableShape,
    bias: Bias,
}

@group(0) @binding(2) var<storage, read> pool: array<u32>;
@group(0) @binding(3) var<uniform> asked: Asked;
// Of each receiver, in field space.
@group(0) @binding(4) var<storage, read> normals: array<vec4<f32>>;

// Byte `index` of a table, or a number that is made of the same position at the price of one multiplication.
fn byte(shape: TableShape, index: u32) -> u32 {
    if FETCH {
        return fetched_byte(shape, index);
    }
    let at = shape.first_byte + index;
    return (((at >> 2u) * 0x9e3779b1u) >> ((at & 3u) * 8u)) & 0xffu;
}

// One aimed look-up for each ray, as for a ray that starts outside of the bounds: where it is hit.
@compute @workgroup_size(GROUP)
fn look_up(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = thread_number(id, groups);
    if i >= arrayLength(&rays) {
        return;
    }
    let ray = rays[i];
    let c = chord(ray.origin, ray.direction);
    answers[i] = bitcast<u32>(first_hit_on_chord(asked.shape, ray.direction, c));
}

// Whether each ray is occluded, from inside and outside, as frames ask.
@compute @workgroup_size(GROUP)
fn ask(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = thread_number(id, groups);
    if i >= arrayLength(&rays) {
        return;
    }
    let ray = rays[i];
    let normal = normals[ray.receiver].xyz;
    answers[i] = u32(occluded(asked.shape, ray.origin, ray.direction, ray.t_max, normal, asked.bias));
}

fn looked_up_index(shape: TableShape, origin: vec3<f32>, direction: vec3<f32>) -> u32 {
    let c = chord(origin, direction);
    if c.t_half == 0.0 {
        return 0xffffffffu;
    }
    if c.t_middle - c.t_half >= 0.0 {
        return forward_lookup(shape, direction, c).index;
    }
    return reversed_lookup(shape, origin, direction, c).index;
}

// Which byte of the table each ray's answer hangs on.
@compute @workgroup_size(GROUP)
fn index(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = thread_number(id, groups);
    if i >= arrayLength(&rays) {
        return;
    }
    answers[i] = looked_up_index(asked.shape, rays[i].origin, rays[i].direction);
}
