// One thread per position: what four estimators find there, around a ball and beside a wall.

struct DistanceSource {
    center: vec3<f32>,
    radius: f32,
}

struct Probe {
    position: vec3<f32>,
    scale: f32,
    normal: vec3<f32>,
    bend: f32,
    direction: vec3<f32>,
    padding: f32,
}

@group(0) @binding(0) var<storage, read> probes: array<Probe>;
@group(0) @binding(1) var<storage, read_write> answers: array<vec4<f32>>;

// Stands in for the one of `distance.wgsl`.
fn field_distance(source: DistanceSource, position: vec3<f32>) -> f32 {
    return min(length(position - source.center) - source.radius, position.x + 4.0);
}

@compute @workgroup_size(64)
fn probe(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&probes) {
        return;
    }
    let probe = probes[id.x];
    let source = DistanceSource(vec3(1.0, 2.0, 3.0), 2.0);
    let march = ShadowMarch(0.1, 0.01, 64u);
    let settings = NormalOcclusion(0.3, 5u, 1.7, 1.4, vec3(0.0, 1.0, 0.0), probe.bend);
    answers[id.x] = vec4(
        hard_shadow(source, probe.position, probe.direction, 20.0, march),
        penumbra_shadow(source, probe.position, probe.direction, 20.0, probe.scale, march),
        normal_occlusion(source, probe.position, probe.normal, settings),
        evans_occlusion(source, probe.position, probe.normal, settings),
    );
}
