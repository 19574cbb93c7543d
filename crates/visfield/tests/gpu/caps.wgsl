// One thread per receiver: what it gets from all cap grids, and the contact term.

struct Probe {
    position: vec3<f32>,
    distance: f32,
    normal: vec3<f32>,
    facing: f32,
}

struct Answer {
    bent_normal: vec3<f32>,
    occlusion: f32,
    contact: f32,
}

@group(0) @binding(8) var<storage, read> probes: array<Probe>;
@group(0) @binding(9) var<storage, read_write> answers: array<Answer>;

@compute @workgroup_size(64)
fn probe(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&probes) {
        return;
    }
    let probe = probes[id.x];
    let all = List(ALL_INSTANCES, frame.instance_count);
    let found = ambient(Receiver(probe.position, probe.normal, 1.0, 0u), all);
    let contact = contact_occlusion(probe.distance, 2.0, probe.facing);
    answers[id.x] = Answer(found.bent_normal, found.occlusion, contact);
}
