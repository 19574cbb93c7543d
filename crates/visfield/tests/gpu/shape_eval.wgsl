// One thread per position: the distance from it to the shape whose program starts there.

struct Probe {
    position: vec3<f32>,
    first_word: u32,
    nodes: u32,
    padding: array<u32, 3>,
}

@group(0) @binding(0) var<storage, read> pool: array<u32>;
@group(0) @binding(1) var<storage, read> probes: array<Probe>;
@group(0) @binding(2) var<storage, read_write> answers: array<f32>;

@compute @workgroup_size(64)
fn probe(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&probes) {
        return;
    }
    let probe = probes[id.x];
    answers[id.x] = shape_distance(probe.first_word, probe.nodes, probe.position);
}
