// What all kernels over a list of rays share. Layout: rays.rs, `RayWords`.

struct ListedRay {
    origin: vec3<f32>,
    // Of the field: the number of the receiver. Of the triangles: unused.
    receiver: u32,
    direction: vec3<f32>,
    t_max: f32,
}

const GROUP: u32 = 64u;

@group(0) @binding(0) var<storage, read> rays: array<ListedRay>;
// One of each ray.
@group(0) @binding(1) var<storage, read_write> answers: array<u32>;

// Groups come in rows, because there may be more than one dimension takes (device.rs, `Kernel::groups`).
fn thread_number(id: vec3<u32>, groups: vec3<u32>) -> u32 {
    return id.y * groups.x * GROUP + id.x;
}
