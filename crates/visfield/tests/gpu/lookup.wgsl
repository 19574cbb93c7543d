// One thread per ray: which table entries the ray's lookups pick, and whether it is occluded.

struct Probe {
    origin: vec3<f32>,
    t_max: f32,
    direction: vec3<f32>,
    padding: u32,
    normal: vec3<f32>,
    padding_2: u32,
}

struct Answer {
    forward_index: u32,
    reversed_index: u32,
    // Of the forward lookup.
    fraction: f32,
    occluded: u32,
    bias_height: f32,
}

// The sides of the grids and the encoding; the table is the only one.
struct Shape {
    entries: u32,
    exits: u32,
    encoding: u32,
}

@group(0) @binding(0) var<storage, read> pool: array<u32>;
@group(0) @binding(1) var<storage, read> probes: array<Probe>;
@group(0) @binding(2) var<storage, read_write> answers: array<Answer>;
@group(0) @binding(3) var<storage, read> shapes: array<Shape>;

@compute @workgroup_size(64)
fn probe(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&probes) {
        return;
    }
    let shape = TableShape(0u, shapes[0].entries, shapes[0].exits, shapes[0].encoding);
    let bias = Bias(0.15, 0.25);
    let ray = probes[id.x];
    let c = chord(ray.origin, ray.direction);
    var answer = Answer(0xffffffffu, 0xffffffffu, 0.0, 0u, 0.0);
    if c.t_half > 0.0 {
        answer.forward_index = forward_lookup(shape, ray.direction, c).index;
        answer.fraction = fraction(shape, answer.forward_index);
        let reversed = reversed_lookup(shape, ray.origin, ray.direction, c);
        answer.reversed_index = reversed.index;
        answer.bias_height = bias_height(bias, shape, reversed.before, reversed.length);
    }
    answer.occluded = u32(occluded(shape, ray.origin, ray.direction, ray.t_max, ray.normal, bias));
    answers[id.x] = answer;
}
