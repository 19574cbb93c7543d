// The caps pass: ambient occlusion by cap grids, without rays and without noise. Twins: field/cap_grid/{warp,cap,mod,batch}.rs
// and estimate/caps.rs, same names, same order of operations. Joined after frame.wgsl and instance.wgsl.

// Points of the sphere (64 × ambient_rays), points of the disc (16 × shadow_rays), then one point of the sphere for each
// direction along which caps are combined.
@group(0) @binding(6) var<storage, read> samples: array<vec4<f32>>;
// Ambient visibility in r; the other channels read as "no shadows".
@group(0) @binding(7) var caps_texture: texture_storage_2d<rgba16float, write>;

// How grids combine: as soft caps, or as a product; and over how many directions they are looked at. Constants, so that loops
// over directions unroll, and what is kept for each of them stays in registers.
override SOFT_CAPS: bool = true;
override DIRECTIONS: u32 = 8u;

const MAX_DIRECTIONS: u32 = 16u;
const Y0: f32 = 0.2820948;
const Y1: f32 = 0.4886025;
const TAU: f32 = 6.2831855;
const SMALLEST_SOLID_ANGLE: f32 = 1.0e-6;
const CUTOFF: f32 = 1.0 / 2040.0;
const CONTACT_REACH: f32 = 0.06;
const KNEE: f32 = 0.65;
const FARTHEST: f32 = 1.0e12;
const SMALLEST_MEAN: f32 = 1.0e-4;
const SMALLEST: f32 = 1.1754944e-38;
const MEAN_COSINE: f32 = 2.0 / 3.0;

struct GridPoint {
    first: vec3<f32>,
    fraction: vec3<f32>,
    weight: f32,
}

struct Cap {
    axis: vec3<f32>,
    cosine: f32,
    opacity: f32,
}

// What a receiver gets from all objects.
struct Ambient {
    bent_normal: vec3<f32>,
    occlusion: f32,
}

// AxisWarp::coordinate, for the three axes at once.
fn coordinate(grid: u32, position: vec3<f32>) -> vec3<f32> {
    let beyond = abs(position) - cap_grids[grid].knee;
    let outer = KNEE + beyond / (cap_grids[grid].slope + cap_grids[grid].curvature * beyond);
    let inner = abs(position) * cap_grids[grid].inverse_slope;
    let u = select(inner, outer, beyond > vec3<f32>(0.0));
    return select(u, -u, position < vec3<f32>(0.0));
}

fn storage_scale(position: vec3<f32>) -> f32 {
    return max(dot(position, position), 1.0);
}

fn grid_point(grid: u32, far_position: vec3<f32>) -> GridPoint {
    let position = clamp(far_position, vec3<f32>(-FARTHEST), vec3<f32>(FARTHEST));
    let beyond = abs(position) * cap_grids[grid].inverse_extent;
    let pull = 1.0 / max(max(max(beyond.x, beyond.y), beyond.z), 1.0);
    let pulled = position * pull;
    let last = f32(cap_grids[grid].points - 1u);
    let at = clamp((coordinate(grid, pulled) + 1.0) * (0.5 * last), vec3<f32>(0.0), vec3<f32>(last));
    let first = min(floor(at), vec3<f32>(last - 1.0));
    return GridPoint(first, at - first, pull * pull / storage_scale(pulled));
}

// Four bytes, or halves, of one grid point, as they are stored.
fn texel(grid: u32, index: u32) -> vec4<f32> {
    let first = cap_grids[grid].first_texel;
    if cap_grids[grid].encoding == 0u {
        return unpack4x8unorm(tables[first + index]) * 255.0;
    }
    return vec4<f32>(unpack2x16float(tables[first + 2u * index]), unpack2x16float(tables[first + 2u * index + 1u]));
}

// The first four harmonics at a position, interpolated.
fn harmonics_at(grid: u32, position: vec3<f32>) -> vec4<f32> {
    let at = grid_point(grid, position);
    let side = cap_grids[grid].points;
    let first = (u32(at.first.z) * side + u32(at.first.y)) * side + u32(at.first.x);
    let near = layer(grid, first, side, at.fraction.xy);
    let far = layer(grid, first + side * side, side, at.fraction.xy);
    let stored = between(near, far, at.fraction.z);
    return (cap_grids[grid].low + cap_grids[grid].step * stored) * at.weight;
}

// Between four points of the same z.
fn layer(grid: u32, first: u32, side: u32, fraction: vec2<f32>) -> vec4<f32> {
    let near = between(texel(grid, first), texel(grid, first + 1u), fraction.x);
    let far = between(texel(grid, first + side), texel(grid, first + side + 1u), fraction.x);
    return between(near, far, fraction.y);
}

fn between(a: vec4<f32>, b: vec4<f32>, share: f32) -> vec4<f32> {
    return a + (b - a) * share;
}

fn cap(harmonics: vec4<f32>) -> Cap {
    let o1 = harmonics.yzw;
    let length = sqrt(dot(o1, o1));
    let present = harmonics.x * (1.0 / Y0) > SMALLEST_SOLID_ANGLE;
    let solid_angle = select(SMALLEST_SOLID_ANGLE, min(harmonics.x * (1.0 / Y0), 2.0 * TAU), present);
    let mean_cosine = min(length * (1.0 / Y1) / solid_angle, 1.0);
    let cosine = 2.0 * mean_cosine - 1.0;
    let area = TAU * (1.0 - cosine);
    let fits = area > solid_angle;
    let opacity = select(1.0, solid_angle / max(area, SMALLEST), fits);
    return Cap(
        o1 * (1.0 / max(length, SMALLEST)),
        select(1.0 - solid_angle / TAU, cosine, fits),
        select(0.0, opacity, present),
    );
}

// Cap::harmonics
fn cap_harmonics(seen: Cap) -> vec4<f32> {
    let solid_angle = seen.opacity * TAU * (1.0 - seen.cosine);
    return vec4<f32>(Y0 * solid_angle, seen.axis * (Y1 * solid_angle * 0.5 * (1.0 + seen.cosine)));
}

// Cap::mapped by the inverse of a map to cap space: by its cofactors, which are that inverse times the determinant.
fn mapped(seen: Cap, cap_from_world: array<vec4<f32>, 3>) -> Cap {
    let component = max(max(abs(cap_from_world[0].xyz), abs(cap_from_world[1].xyz)), abs(cap_from_world[2].xyz));
    let largest = max(max(component.x, component.y), component.z);
    let x = cap_from_world[0].xyz / largest;
    let y = cap_from_world[1].xyz / largest;
    let z = cap_from_world[2].xyz / largest;
    let determinant = dot(x, cross(y, z));
    let to = (cross(y, z) * seen.axis.x + cross(z, x) * seen.axis.y + cross(x, y) * seen.axis.z) / determinant;
    let squared = max(dot(to, to), SMALLEST);
    let length = sqrt(squared);
    let spread = 1.0 / (abs(determinant) * squared * length);
    let cosine_squared = seen.cosine * seen.cosine;
    let cosine = seen.cosine / sqrt(max(cosine_squared + spread * (1.0 - cosine_squared), SMALLEST));
    return Cap(to / length, cosine, seen.opacity);
}

fn soft_occlusion(seen: Cap, direction: vec3<f32>, softness: f32) -> f32 {
    let sine = sqrt(max(1.0 - seen.cosine * seen.cosine, 0.0));
    let soft_sine = sqrt(1.0 - softness * softness);
    let outer = select(seen.cosine * softness - sine * soft_sine, -1.0, seen.cosine < -softness);
    let inner = select(seen.cosine * softness + sine * soft_sine, 1.0, seen.cosine > softness);
    let inside = (dot(seen.axis, direction) - outer) / (inner - outer);
    let t = select(0.0, min(inside, 1.0), inside > 0.0);
    return seen.opacity * t * t * (3.0 - 2.0 * t);
}

fn cap_occlusion(harmonics: vec4<f32>, seen: Cap, normal: vec3<f32>) -> f32 {
    let facing = dot(seen.axis, normal);
    let sine_squared = 1.0 - seen.cosine * seen.cosine;
    let second = seen.opacity * sine_squared * seen.cosine * (3.0 * facing * facing - 1.0) * (5.0 / 32.0);
    let occlusion = Y0 * harmonics.x + (2.0 / 3.0 * Y1) * dot(harmonics.yzw, normal) + second;
    return select(0.0, min(occlusion, 1.0), occlusion > 0.0);
}

fn above_cutoff(occlusion: f32) -> f32 {
    return occlusion * clamp(occlusion * (1.0 / CUTOFF) - 1.0, 0.0, 1.0);
}

fn contact_occlusion(distance: f32, radius: f32, facing: f32) -> f32 {
    return clamp(1.0 - distance / (CONTACT_REACH * radius), 0.0, 1.0) * (1.0 - facing) * 0.5;
}

fn unit(v: vec3<f32>) -> vec3<f32> {
    return v * (1.0 / max(sqrt(dot(v, v)), SMALLEST));
}

fn reach_of(instance: u32, position: vec3<f32>) -> f32 {
    let to_center = instances[instance].center - position;
    let radius = instances[instance].radius;
    let squared = dot(to_center, to_center);
    let nearest = sqrt(squared) - radius;
    let share = clamp((frame.max_distance - nearest) / (2.0 * radius), 0.0, 1.0);
    return select(0.0, share, radius * radius > CUTOFF * squared);
}

fn mean(values: ptr<function, array<f32, MAX_DIRECTIONS>>) -> f32 {
    var sum = 0.0;
    for (var k = 0u; k < DIRECTIONS; k++) {
        sum += (*values)[k];
    }
    return sum / f32(DIRECTIONS);
}

fn distribute(soft: ptr<function, array<f32, MAX_DIRECTIONS>>, occlusion: f32) {
    for (var pass_number = 0u; pass_number < 2u; pass_number++) {
        let scale = occlusion / max(mean(soft), SMALLEST_MEAN);
        for (var k = 0u; k < DIRECTIONS; k++) {
            (*soft)[k] = min((*soft)[k] * scale, 1.0);
        }
    }
    let found = mean(soft);
    let share = clamp((occlusion - found) / max(1.0 - found, SMALLEST_MEAN), 0.0, 1.0);
    for (var k = 0u; k < DIRECTIONS; k++) {
        (*soft)[k] += (1.0 - (*soft)[k]) * share;
    }
}

// How far each direction of the world is occluded.
fn soften(
    instance: u32,
    seen: Cap,
    directions: ptr<function, array<vec3<f32>, MAX_DIRECTIONS>>,
    soft: ptr<function, array<f32, MAX_DIRECTIONS>>,
) {
    let softness = 1.0 - 0.7 / f32(DIRECTIONS);
    for (var k = 0u; k < DIRECTIONS; k++) {
        let direction = unit(transform(instances[instance].cap_from_world, vec4<f32>((*directions)[k], 0.0)));
        (*soft)[k] = soft_occlusion(seen, direction, softness);
    }
}

fn ambient(receiver: Receiver) -> Ambient {
    let first_sample = frame.ambient_rays * 64u + frame.shadow_rays * 16u;
    var directions = array<vec3<f32>, MAX_DIRECTIONS>();
    var visible = array<f32, MAX_DIRECTIONS>();
    for (var k = 0u; k < DIRECTIONS; k++) {
        directions[k] = cosine_direction(receiver.normal, samples[first_sample + k].xyz);
        visible[k] = 1.0;
    }
    var open = receiver.normal * MEAN_COSINE;
    for (var i = 0u; i < frame.instance_count; i++) {
        let source = instances[i].ambient_source;
        if source != AMBIENT_CAP_GRID && source != AMBIENT_CAP_GRID_WITH_RAYS_INSIDE {
            continue;
        }
        let reach = reach_of(i, receiver.position);
        if reach <= 0.0 {
            continue;
        }
        let grid = instances[i].cap_grid;
        let position = transform(instances[i].cap_from_world, vec4<f32>(receiver.position, 1.0));
        if source == AMBIENT_CAP_GRID_WITH_RAYS_INSIDE && contains(grid, position) {
            continue;
        }
        let harmonics = harmonics_at(grid, position);
        let seen = cap(harmonics);
        let normal = unit(transform(instances[i].cap_from_world, vec4<f32>(receiver.normal, 0.0)));
        var occlusion = cap_occlusion(harmonics, seen, normal);
        let stretched = instances[i].stretched;
        if stretched > 0.0 {
            let in_world = mapped(seen, instances[i].cap_from_world);
            occlusion += (cap_occlusion(cap_harmonics(in_world), in_world, receiver.normal) - occlusion) * stretched;
        }
        occlusion = above_cutoff(occlusion * reach);
        if occlusion <= 0.0 {
            continue;
        }
        let rows = instances[i].cap_from_world;
        let towards = unit(rows[0].xyz * seen.axis.x + rows[1].xyz * seen.axis.y + rows[2].xyz * seen.axis.z);
        open -= towards * occlusion;
        if !SOFT_CAPS {
            visible[0] *= 1.0 - occlusion;
            continue;
        }
        var soft = array<f32, MAX_DIRECTIONS>();
        soften(i, seen, &directions, &soft);
        distribute(&soft, occlusion);
        for (var k = 0u; k < DIRECTIONS; k++) {
            visible[k] *= 1.0 - soft[k];
        }
    }
    let visibility = select(visible[0], mean(&visible), SOFT_CAPS);
    return Ambient(unit(open), 1.0 - visibility);
}

@compute @workgroup_size(8, 8)
fn caps(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= frame.viewport_size) {
        return;
    }
    let receiver = receiver_at(pixel);
    var occlusion = 0.0;
    if receiver.depth > 0.0 {
        occlusion = ambient(receiver).occlusion;
    }
    textureStore(caps_texture, pixel + frame.caps_origin, vec4<f32>(1.0 - occlusion, 0.0, 0.0, 1.0));
}
