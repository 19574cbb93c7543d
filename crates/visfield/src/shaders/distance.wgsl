// Signed distances of an object, baked to a grid or in closed form, and rays against them, in the space of the distances. Twins:
// distance/{grid,mod,query}.rs, same names, same order of operations. Joined after shape.wgsl, before sphere_trace.wgsl. The including
// shader declares `pool: array<u32>`, which holds them.

// What distances start with in the pool. Layout: gpu/layout.rs, `DistanceData`.
struct DistanceSource {
    // The lowest and the highest corner of a box that holds the surface.
    low: vec3<f32>,
    // GRID, or how many nodes a shape has.
    nodes: u32,
    high: vec3<f32>,
    // First word of the codes or nodes.
    first_word: u32,
    // Codes of a row of the grid, and of a layer.
    row: u32,
    layer: u32,
    // Bits of a code.
    bits: u32,
    // Below it, a ray has met the surface.
    threshold: f32,
    // What code 0 stands for, and a step.
    code_low: f32,
    code_step: f32,
}

// Stands in the place of a number of nodes.
const GRID: u32 = 0xffffffffu;
const GRID_THRESHOLD: f32 = 0.05;
// How rays ask that only ask whether something is in the way: distance/query.rs.
const SLACK: f32 = 2.0;
const SLACK_REACH: f32 = 4.8;
const LEAST_REACH: f32 = 1.0e-6;
const LEAST_STEP: f32 = 0.25;
const MAX_STEPS: u32 = 64u;
const RELAXATION: f32 = 1.6;
const NO_END: f32 = 3.0e38;

struct GridPlace {
    index: u32,
    fraction: vec3<f32>,
    squared_beyond: f32,
}

fn pool_float(word: u32) -> f32 {
    return bitcast<f32>(pool[word]);
}

// What lies at a word of the pool.
fn distance_source(word: u32) -> DistanceSource {
    return DistanceSource(
        vec3<f32>(pool_float(word), pool_float(word + 1u), pool_float(word + 2u)),
        pool[word + 3u],
        vec3<f32>(pool_float(word + 4u), pool_float(word + 5u), pool_float(word + 6u)),
        pool[word + 7u],
        pool[word + 8u], pool[word + 9u], pool[word + 10u],
        pool_float(word + 11u), pool_float(word + 12u), pool_float(word + 13u),
    );
}

// GridShape::place
fn place(source: DistanceSource, position: vec3<f32>) -> GridPlace {
    let inside = min(max(position, vec3<f32>(0.0)), source.high);
    let beyond = position - inside;
    let cell = min(vec3<i32>(inside), vec3<i32>(source.high) - 1);
    let at = vec3<u32>(cell);
    return GridPlace(at.z * source.layer + at.y * source.row + at.x, inside - vec3<f32>(cell), dot(beyond, beyond));
}

// Two neighbours of a row.
fn code_pair(source: DistanceSource, index: u32) -> vec2<f32> {
    let bit = index * source.bits;
    let word = source.first_word + (bit >> 5u);
    let shift = bit & 31u;
    // Shifts by 32 are not defined.
    let both = (pool[word] >> shift) | ((pool[word + 1u] << 1u) << (31u - shift));
    return vec2<f32>(f32(extractBits(both, 0u, source.bits)), f32(extractBits(both, source.bits, source.bits)));
}

fn interpolate(source: DistanceSource, at: GridPlace) -> f32 {
    let a = code_pair(source, at.index);
    let b = code_pair(source, at.index + source.row);
    let c = code_pair(source, at.index + source.layer);
    let d = code_pair(source, at.index + source.layer + source.row);
    let along_x = vec4<f32>(a.x, b.x, c.x, d.x) + (vec4<f32>(a.y, b.y, c.y, d.y) - vec4<f32>(a.x, b.x, c.x, d.x)) * at.fraction.x;
    let along_y = along_x.xz + (along_x.yw - along_x.xz) * at.fraction.y;
    let distance = source.code_low + source.code_step * (along_y.x + (along_y.y - along_y.x) * at.fraction.z);
    let above = max(distance, 0.0);
    return select(sqrt(at.squared_beyond + above * above), distance, at.squared_beyond == 0.0);
}

// DistanceField::distance
fn field_distance(source: DistanceSource, position: vec3<f32>) -> f32 {
    if source.nodes == GRID {
        return interpolate(source, place(source, position));
    }
    return shape_distance(source.first_word, source.nodes, position);
}

// DistanceField::gradient
fn gradient(source: DistanceSource, position: vec3<f32>, reach: f32) -> vec3<f32> {
    let x = vec3<f32>(reach, 0.0, 0.0);
    let y = vec3<f32>(0.0, reach, 0.0);
    let z = vec3<f32>(0.0, 0.0, reach);
    let along = vec3<f32>(
        field_distance(source, position + x) - field_distance(source, position - x),
        field_distance(source, position + y) - field_distance(source, position - y),
        field_distance(source, position + z) - field_distance(source, position - z),
    );
    return along / (2.0 * reach);
}

// 1 over a component of a direction; finite for zero.
fn inverse(x: f32) -> f32 {
    return 1.0 / select(1.0e-20, x, abs(x) > 1.0e-20);
}

// The part of a ray with a unit direction inside a box.
fn box_segment(origin: vec3<f32>, direction: vec3<f32>, low: vec3<f32>, high: vec3<f32>) -> vec2<f32> {
    let inverses = vec3<f32>(inverse(direction.x), inverse(direction.y), inverse(direction.z));
    let a = (low - origin) * inverses;
    let b = (high - origin) * inverses;
    let near = min(a, b);
    let far = max(a, b);
    return vec2<f32>(max(max(near.x, near.y), near.z), min(min(far.x, far.y), far.z));
}

// An origin on a surface with this unit normal, lifted out of it.
fn lifted(source: DistanceSource, origin: vec3<f32>, normal: vec3<f32>, slack: f32) -> vec3<f32> {
    if slack <= 0.0 || all(normal == vec3<f32>(0.0)) {
        return origin;
    }
    let once = origin + normal * clamp(-field_distance(source, origin), 0.0, slack);
    return once + normal * clamp(-field_distance(source, once), 0.0, slack);
}

// DistanceField::occluded. A ray by its end in multiples of its direction; `normal` is that of the surface it leaves, or zero.
fn distance_occluded(
    source: DistanceSource,
    ray_origin: vec3<f32>,
    ray_direction: vec3<f32>,
    t_max: f32,
    normal: vec3<f32>,
    bias: Bias,
) -> bool {
    let finer = source.threshold / GRID_THRESHOLD;
    let ray_length = sqrt(dot(ray_direction, ray_direction));
    let direction = ray_direction * (1.0 / ray_length);
    let inside = all(clamp(ray_origin, source.low, source.high) == ray_origin);
    let slack = select(0.0, bias.height * (SLACK * finer), inside);
    let origin = lifted(source, ray_origin, normal, slack);
    let part = box_segment(origin, direction, source.low, source.high);
    // No product is infinite.
    let end = select(t_max * ray_length, NO_END, t_max >= NO_END);
    let settings = SphereTracing(
        RELAXATION, true, MAX_STEPS, source.threshold, 0.0, EXHAUSTED_MISSED, 0u, false,
        slack, max(bias.along * (SLACK_REACH * finer), LEAST_REACH),
        select(1.9 * source.threshold, LEAST_STEP, source.nodes == GRID),
    );
    return sphere_trace(source, origin, direction, max(part.x, 0.0), min(part.y, end), settings).hit;
}
