// One thread per ray: where it ends, what the distance and its gradient are at its origin, and how far the next ray would start from
// there.

struct Probe {
    origin: vec3<f32>,
    t_max: f32,
    direction: vec3<f32>,
    source: u32,
    // Of the settings: ω, whether it adapts, steps, threshold; pixel, exhausted, smoothing, from inside; slack and its reach, least
    // step, and whether a convex solid is left.
    stepping: vec4<f32>,
    hits: vec4<f32>,
    leaving: vec4<f32>,
}

struct Answer {
    gradient: vec3<f32>,
    distance: f32,
    hit: u32,
    t: f32,
    end: f32,
    evaluations: u32,
    escape: f32,
    padding: array<f32, 3>,
}

@group(0) @binding(0) var<storage, read> pool: array<u32>;
@group(0) @binding(1) var<storage, read> probes: array<Probe>;
@group(0) @binding(2) var<storage, read_write> answers: array<Answer>;

@compute @workgroup_size(64)
fn probe(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&probes) {
        return;
    }
    let probe = probes[id.x];
    let source = distance_source(probe.source);
    let settings = SphereTracing(
        probe.stepping.x, probe.stepping.y > 0.0, u32(probe.stepping.z), probe.stepping.w,
        probe.hits.x, u32(probe.hits.y), u32(probe.hits.z), probe.hits.w > 0.0,
        probe.leaving.x, probe.leaving.y, probe.leaving.z,
    );
    var traced: Traced;
    if probe.leaving.w > 0.0 {
        traced = trace_out_of_convex(source, probe.origin, probe.direction, probe.t_max, settings);
    } else {
        traced = sphere_trace(source, probe.origin, probe.direction, 0.0, probe.t_max, settings);
    }
    answers[id.x] = Answer(
        gradient(source, probe.origin, 0.5), field_distance(source, probe.origin),
        u32(traced.hit), traced.t, traced.distance, traced.evaluations,
        escape(settings, traced.distance), array<f32, 3>(),
    );
}
