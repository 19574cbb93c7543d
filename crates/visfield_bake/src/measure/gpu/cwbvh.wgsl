// Rays of a list through a compressed wide BVH: Ylitie, Karras, Laine, Efficient Incoherent Ray Traversal on GPUs Through Compressed
// Wide BVHs (2017), in the layout of crate obvhs, which interleaves the minima and maxima of boxes. Joined after rays.wgsl.
//
// Twins: obvhs 0.4 `CwBvhNode::intersect_ray_basic` (`intersect_ray`), `RtTriangle::intersect` (`intersect`), `safe_inverse`, and
// `TriangleBvh::occluded_prepared`.

// As obvhs has it: what is deeper it does not traverse either.
const STACK_SIZE: u32 = 32u;
// The nearest that boxes are entered.
const EPSILON: f32 = 1.0e-4;
const SMALLEST: f32 = 1.1920929e-7;

// Five for each node (`BvhWords::nodes`).
@group(0) @binding(2) var<storage, read> nodes: array<vec4<u32>>;
// Three for each triangle (`BvhWords::triangles`).
@group(0) @binding(3) var<storage, read> triangles: array<vec4<f32>>;

// Children, or triangles, that are still to be visited: the number of the first, and a bit for each.
alias Group = vec2<u32>;

struct PreparedRay {
    origin: vec3<f32>,
    t_max: f32,
    direction: vec3<f32>,
    inverse: vec3<f32>,
    // By which the order of the children is turned, so that those ahead come first: four times the same byte.
    octant: u32,
}

fn safe_inverse(x: vec3<f32>) -> vec3<f32> {
    let tiny = select(vec3<f32>(1.0), vec3<f32>(-1.0), x < vec3<f32>(0.0)) / SMALLEST;
    return select(1.0 / x, tiny, abs(x) <= vec3<f32>(SMALLEST));
}

fn prepare(ray: ListedRay) -> PreparedRay {
    let axes = select(vec3<u32>(0x04040404u, 0x02020202u, 0x01010101u), vec3<u32>(0u), ray.direction < vec3<f32>(0.0));
    return PreparedRay(ray.origin, ray.t_max, ray.direction, safe_inverse(ray.direction), axes.x | axes.y | axes.z);
}

// Four of a node's children: a bit for each that is entered, at its place in the order, and bits for the triangles of leaves.
fn intersect_four(
    ray: PreparedRay,
    meta_bytes: u32,
    scale: vec3<f32>,
    shift: vec3<f32>,
    near: vec3<u32>,
    far: vec3<u32>,
) -> u32 {
    // Of what is no leaf, bits 3 and 4 are set.
    let inner = ((meta_bytes & (meta_bytes << 1u)) & 0x10101010u) >> 4u;
    let places = unpack4xU8((meta_bytes ^ (ray.octant & (inner * 0xffu))) & 0x1f1f1f1fu);
    let bits = unpack4xU8((meta_bytes >> 5u) & 0x07070707u);
    let near_x = vec4<f32>(unpack4xU8(near.x)) * scale.x + shift.x;
    let near_y = vec4<f32>(unpack4xU8(near.y)) * scale.y + shift.y;
    let near_z = vec4<f32>(unpack4xU8(near.z)) * scale.z + shift.z;
    let far_x = vec4<f32>(unpack4xU8(far.x)) * scale.x + shift.x;
    let far_y = vec4<f32>(unpack4xU8(far.y)) * scale.y + shift.y;
    let far_z = vec4<f32>(unpack4xU8(far.z)) * scale.z + shift.z;
    let entry = max(max(near_x, near_y), max(near_z, vec4<f32>(EPSILON)));
    let exit = min(min(far_x, far_y), min(far_z, vec4<f32>(ray.t_max)));
    let hits = select(vec4<u32>(0u), bits << places, entry <= exit);
    return hits.x | hits.y | hits.z | hits.w;
}

// The children of a node that a ray enters: inner ones in the high byte, triangles of leaves in the others.
fn intersect_ray(ray: PreparedRay, corner: vec4<u32>, children: vec4<u32>, x: vec4<u32>, y: vec4<u32>, z: vec4<u32>) -> u32 {
    let exponents = (vec3<u32>(corner.w) >> vec3<u32>(0u, 8u, 16u)) & vec3<u32>(0xffu);
    let scale = bitcast<vec3<f32>>(exponents << vec3<u32>(23u)) * ray.inverse;
    let shift = (bitcast<vec3<f32>>(corner.xyz) - ray.origin) * ray.inverse;
    // Minima of children 0…3 and 4…7, then maxima.
    let backwards = ray.direction < vec3<f32>(0.0);
    let low_0 = vec3<u32>(x.x, y.x, z.x);
    let low_1 = vec3<u32>(x.y, y.y, z.y);
    let high_0 = vec3<u32>(x.z, y.z, z.z);
    let high_1 = vec3<u32>(x.w, y.w, z.w);
    let near_0 = select(low_0, high_0, backwards);
    let near_1 = select(low_1, high_1, backwards);
    let far_0 = select(high_0, low_0, backwards);
    let far_1 = select(high_1, low_1, backwards);
    return intersect_four(ray, children.z, scale, shift, near_0, far_0)
        | intersect_four(ray, children.w, scale, shift, near_1, far_1);
}

// Möller and Trumbore, with a precomputed normal (https://madmann91.github.io/2021/04/29/an-introduction-to-bvhs.html).
fn intersect(ray: PreparedRay, triangle: u32) -> bool {
    let a = triangles[triangle * 3u];
    let b = triangles[triangle * 3u + 1u];
    let d = triangles[triangle * 3u + 2u];
    let normal = vec3<f32>(a.w, b.w, d.w);
    let c = a.xyz - ray.origin;
    let r = cross(ray.direction, c);
    let inverse = 1.0 / dot(normal, ray.direction);
    let u = dot(r, d.xyz) * inverse;
    let v = dot(r, b.xyz) * inverse;
    let t = dot(normal, c) * inverse;
    // What is NaN or infinite fails.
    return u >= 0.0 && v >= 0.0 && 1.0 - u - v >= 0.0 && t >= 0.0 && t <= ray.t_max;
}

fn occluded_prepared(ray: PreparedRay) -> bool {
    var stack: array<Group, STACK_SIZE>;
    var height = 0u;
    // The root is child 7 of a node that there is not; it has no siblings before it.
    var group = Group(0u, 0x80000000u);
    loop {
        let place = firstLeadingBit(group.y);
        let rest = group.y & ~(1u << place);
        if (rest & 0xff000000u) != 0u {
            stack[height] = Group(group.x, rest);
            height++;
        }
        let slot = (place - 24u) ^ (ray.octant & 0xffu);
        let siblings = countOneBits(group.y & ~(0xffffffffu << slot));
        let node = (group.x + siblings) * 5u;
        let corner = nodes[node];
        let children = nodes[node + 1u];
        let hits = intersect_ray(ray, corner, children, nodes[node + 2u], nodes[node + 3u], nodes[node + 4u]);

        var leaves = hits & 0x00ffffffu;
        while leaves != 0u {
            let leaf = firstLeadingBit(leaves);
            leaves &= ~(1u << leaf);
            if intersect(ray, children.y + leaf) {
                return true;
            }
        }
        group = Group(children.x, (hits & 0xff000000u) | (corner.w >> 24u));
        if (hits & 0xff000000u) == 0u {
            if height == 0u {
                return false;
            }
            height--;
            group = stack[height];
        }
    }
    return false;
}

@compute @workgroup_size(GROUP)
fn trace(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = thread_number(id, groups);
    if i >= arrayLength(&rays) {
        return;
    }
    answers[i] = u32(occluded_prepared(prepare(rays[i])));
}
