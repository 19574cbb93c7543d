// Ambient occlusion, and that of large lights, by cap grids, without rays and without noise. Twins: field/cap_grid/{warp,cap,mod,harmonics,batch}.rs
// and estimate/caps.rs, same names, same order of operations. Joined after frame.wgsl, light.wgsl, instance.wgsl, lists.wgsl and
// listed.wgsl.

// Points of the sphere (64 × ambient_rays), points of the disc and of the square (16 × shadow_rays each), then one point of the
// sphere for each direction along which caps are combined.
@group(0) @binding(6) var<storage, read> samples: array<vec4<f32>>;

// How grids combine: as soft caps, or as a product; and over how many directions they are looked at. Constants, so that loops
// over directions unroll, and what is kept for each of them stays in registers.
override SOFT_CAPS: bool = true;
override DIRECTIONS: u32 = 8u;

const MAX_DIRECTIONS: u32 = 16u;
const Y0: f32 = 0.2820948;
const Y1: f32 = 0.4886025;
const TAU: f32 = 6.2831855;
const SMALLEST_SOLID_ANGLE: f32 = 1.0e-6;
const KNEE: f32 = 0.65;
const CAP_SHARE: f32 = 0.75;
const FARTHEST: f32 = 1.0e12;
const SMALLEST_MEAN: f32 = 1.0e-4;
const SMALLEST_OPEN: f32 = 1.0e-6;
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
fn texel(grid: u32, first: u32, index: u32) -> vec4<f32> {
    if cap_grids[grid].encoding == 0u {
        return unpack4x8unorm(pool[first + index]) * 255.0;
    }
    return vec4<f32>(unpack2x16float(pool[first + 2u * index]), unpack2x16float(pool[first + 2u * index + 1u]));
}

// Four harmonics at a position, interpolated: the first ones in plane 0.
fn plane_at(grid: u32, plane: u32, at: GridPoint) -> vec4<f32> {
    let side = cap_grids[grid].points;
    let first = (u32(at.first.z) * side + u32(at.first.y)) * side + u32(at.first.x);
    let texels = cap_grids[grid].first_texel + plane * cap_grids[grid].plane_words;
    let near = layer(grid, texels, first, side, at.fraction.xy);
    let far = layer(grid, texels, first + side * side, side, at.fraction.xy);
    let stored = between(near, far, at.fraction.z);
    if plane == 0u {
        return (cap_grids[grid].low + cap_grids[grid].step * stored) * at.weight;
    }
    return (numbers(texels - 8u) + numbers(texels - 4u) * stored) * at.weight;
}

// Four numbers of the pool.
fn numbers(first: u32) -> vec4<f32> {
    return bitcast<vec4<f32>>(vec4<u32>(pool[first], pool[first + 1u], pool[first + 2u], pool[first + 3u]));
}

// Between four points of the same z.
fn layer(grid: u32, texels: u32, first: u32, side: u32, fraction: vec2<f32>) -> vec4<f32> {
    let near = between(texel(grid, texels, first), texel(grid, texels, first + 1u), fraction.x);
    let far = between(texel(grid, texels, first + side), texel(grid, texels, first + side + 1u), fraction.x);
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
    let rows = scaled_rows(cap_from_world);
    let x = rows[0];
    let y = rows[1];
    let z = rows[2];
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

fn unit(v: vec3<f32>) -> vec3<f32> {
    return v * (1.0 / max(sqrt(dot(v, v)), SMALLEST));
}

fn bent_normal(open: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    let above = open - normal * min(dot(open, normal), 0.0);
    if dot(above, above) > SMALLEST_OPEN {
        return unit(above);
    }
    return unit(normal);
}

const SMALLEST_EXPONENT: f32 = 0.01;

// Falloff::mean_weight
fn mean_weight(nearest: f32, depth: f32) -> f32 {
    let within = clamp(frame.max_distance - nearest, 0.0, depth);
    switch frame.falloff {
        case 1u: {
            let middle = nearest + 0.5 * within;
            return within / depth * max(1.0 - middle / max(frame.max_distance, SMALLEST), 0.0);
        }
        case 2u: {
            let x = frame.falloff_tau * within;
            // Where the difference from 1 would be lost in rounding, the first terms of its series.
            let faded = select((1.0 - exp(-x)) / max(x, SMALLEST_EXPONENT), 1.0 - x * (0.5 - x / 6.0), x < SMALLEST_EXPONENT);
            return exp(-frame.falloff_tau * nearest) * (within / depth) * faded;
        }
        default: {
            return within / depth;
        }
    }
}

fn reach_of(to_center: vec3<f32>, radius: f32, normal: vec3<f32>) -> f32 {
    let nearest = max(sqrt(dot(to_center, to_center)) - radius, 0.0);
    let counts = within_reach(to_center, radius) && above_surface(to_center, radius, normal);
    return select(0.0, mean_weight(nearest, 2.0 * radius), counts);
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

// How far an object counts of which cones see all up to the maximum distance, and nothing beyond.
fn cone_reach(to_center: vec3<f32>, radius: f32) -> f32 {
    let nearest = max(sqrt(dot(to_center, to_center)) - radius, 0.0);
    return mean_weight(nearest, min(2.0 * radius, frame.max_distance - nearest));
}

// Tangent of the half-angle of one of as many cones as fill a hemisphere.
fn cone_tangent() -> f32 {
    let cosine = 1.0 - 1.0 / f32(DIRECTIONS);
    return sqrt(1.0 - cosine * cosine) / cosine;
}

// What a receiver gets of an instance's cap grid, and of that in each direction.
fn caps_of(
    i: u32,
    source: u32,
    receiver: Receiver,
    reach: f32,
    directions: ptr<function, array<vec3<f32>, MAX_DIRECTIONS>>,
    soft: ptr<function, array<f32, MAX_DIRECTIONS>>,
    open: ptr<function, vec3<f32>>,
) -> f32 {
    let grid = instances[i].cap_grid;
    let position = transform(instances[i].cap_from_world, vec4<f32>(receiver.position, 1.0));
    let harmonics = plane_at(grid, 0u, grid_point(grid, position));
    let seen = cap(harmonics);
    let normal = unit(transform(instances[i].cap_from_world, vec4<f32>(receiver.normal, 0.0)));
    var occlusion = cap_occlusion(harmonics, seen, normal);
    let stretched = instances[i].stretched;
    if stretched > 0.0 {
        let in_world = mapped(seen, instances[i].cap_from_world);
        occlusion += (cap_occlusion(cap_harmonics(in_world), in_world, receiver.normal) - occlusion) * stretched;
    }
    if instances[i].distance != NO_DISTANCE {
        occlusion = max(occlusion, contact(i, receiver.position, receiver.normal));
    }
    if source != SOURCE_CAP_GRID {
        occlusion *= 1.0 - inside_share(grid, position);
    }
    occlusion = above_cutoff(occlusion * reach);
    if occlusion <= 0.0 {
        return 0.0;
    }
    if SOFT_CAPS {
        soften(i, seen, directions, soft);
        distribute(soft, occlusion);
    } else {
        let rows = instances[i].cap_from_world;
        *open -= unit(rows[0].xyz * seen.axis.x + rows[1].xyz * seen.axis.y + rows[2].xyz * seen.axis.z) * occlusion;
    }
    return occlusion;
}

fn ambient(receiver: Receiver, list: List) -> Ambient {
    let first_sample = frame.ambient_rays * 64u + frame.shadow_rays * 32u;
    var directions = array<vec3<f32>, MAX_DIRECTIONS>();
    var visible = array<f32, MAX_DIRECTIONS>();
    for (var k = 0u; k < DIRECTIONS; k++) {
        directions[k] = cosine_direction(receiver.normal, samples[first_sample + k].xyz);
        visible[k] = 1.0;
    }
    var open = receiver.normal * MEAN_COSINE;
    for (var k = 0u; k < list.count; k++) {
        let entry = entry(list, k);
        let i = entry_index(entry);
        let source = instances[i].ambient_source;
        if (entry & AMBIENT_BIT) == 0u || !needs_no_rays(source) {
            continue;
        }
        let to_center = instances[i].center - receiver.position;
        let reach = reach_of(to_center, instances[i].radius, receiver.normal);
        if reach <= 0.0 || is_spared(i, receiver) {
            continue;
        }
        var soft = array<f32, MAX_DIRECTIONS>();
        var occlusion = 0.0;
        if has_caps(source) {
            occlusion = caps_of(i, source, receiver, reach, &directions, &soft, &open);
        }
        let share = share_of_cones(source, i, receiver.position) * cone_reach(to_center, instances[i].radius);
        if share > 0.0 {
            let tangent = cone_tangent();
            var sum = 0.0;
            for (var k = 0u; k < DIRECTIONS; k++) {
                let disc = ConeDisc(directions[k], tangent, frame.max_distance);
                let hidden = share * edge_occlusion(cone_start(i, receiver.position, receiver.normal, disc));
                soft[k] = min(soft[k] + hidden, 1.0);
                sum += hidden;
            }
            occlusion = min(occlusion + sum / f32(DIRECTIONS), 1.0);
        }
        if occlusion <= 0.0 {
            continue;
        }
        if SOFT_CAPS {
            for (var k = 0u; k < DIRECTIONS; k++) {
                visible[k] *= 1.0 - soft[k];
            }
        } else {
            visible[0] *= 1.0 - occlusion;
        }
    }
    let visibility = select(visible[0], mean(&visible), SOFT_CAPS);
    if SOFT_CAPS {
        // Few directions are not even around the normal: as much as is seen of what they lack is added.
        open = receiver.normal * (MEAN_COSINE * f32(DIRECTIONS) * visibility);
        for (var k = 0u; k < DIRECTIONS; k++) {
            open += directions[k] * (visible[k] - visibility);
        }
    }
    return Ambient(bent_normal(open, receiver.normal), 1.0 - visibility);
}

// Means of the Legendre polynomials of degrees 0 to 3 over a disc with this cosine of its half-angle.
fn legendre_means(c: f32) -> vec4<f32> {
    return vec4<f32>(1.0, (1.0 + c) * 0.5, c * (1.0 + c) * 0.5, (1.0 + c) * (5.0 * c * c - 1.0) * 0.125);
}

// By band, the sum of the products of sixteen harmonics with those of a unit direction.
fn bands_along(planes: array<vec4<f32>, 4>, direction: vec3<f32>) -> vec4<f32> {
    let x = direction.x;
    let y = direction.y;
    let z = direction.z;
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    let band_0 = planes[0].x * Y0;
    let band_1 = dot(planes[0].yzw, direction) * Y1;
    let basis_2 = vec4<f32>(1.0925484 * x * y, 1.0925484 * y * z, 0.31539157 * (3.0 * zz - 1.0), 1.0925484 * x * z);
    let band_2 = dot(planes[1], basis_2) + planes[2].x * (0.5462742 * (xx - yy));
    let basis_3 = vec3<f32>(0.5900436 * y * (3.0 * xx - yy), 2.8906114 * x * y * z, 0.4570458 * y * (5.0 * zz - 1.0));
    let basis_4 = vec4<f32>(
        0.37317633 * z * (5.0 * zz - 3.0),
        0.4570458 * x * (5.0 * zz - 1.0),
        1.4453057 * z * (xx - yy),
        0.5900436 * x * (xx - 3.0 * yy),
    );
    return vec4<f32>(band_0, band_1, band_2, dot(planes[2].yzw, basis_3) + dot(planes[3], basis_4));
}

// Cap::light_occlusion
fn cap_light_occlusion(seen: Cap, axis: vec3<f32>, half_angle: f32) -> f32 {
    let own = acos(clamp(seen.cosine, -1.0, 1.0));
    let apart = acos(clamp(dot(seen.axis, axis), -1.0, 1.0));
    let light_depth = max(1.0 - cos(half_angle), SMALLEST);
    let largest = min((1.0 - seen.cosine) / light_depth, 1.0);
    let within = abs(own - half_angle);
    let beside = own + half_angle;
    let t = clamp((beside - apart) / max(beside - within, SMALLEST), 0.0, 1.0);
    return seen.opacity * largest * t * t * (3.0 - 2.0 * t);
}

fn light_occlusion(planes: array<vec4<f32>, 4>, axis: vec3<f32>, half_angle: f32) -> f32 {
    let seen = cap(planes[0]);
    // The cap's own bands along the axis, by the addition theorem.
    let x = dot(seen.axis, axis);
    let legendre = vec4<f32>(1.0, 3.0 * x, 2.5 * (3.0 * x * x - 1.0), 3.5 * x * (5.0 * x * x - 3.0)) / (2.0 * TAU);
    let solid_angle = TAU * (1.0 - seen.cosine);
    let of_cap = legendre * legendre_means(seen.cosine) * (CAP_SHARE * seen.opacity * solid_angle);
    let known = bands_along(planes, axis) - of_cap;
    let beyond = CAP_SHARE * cap_light_occlusion(seen, axis, half_angle);
    let occlusion = dot(known, legendre_means(cos(half_angle))) + beyond;
    return select(0.0, min(occlusion, 1.0), occlusion > 0.0);
}

// What cap grids and cones leave of a light.
fn light_visibility(receiver: Receiver, list: List, l: u32) -> f32 {
    let light = frame.lights[l];
    let view = seen_from(light, receiver.position);
    if !shines_on(light, view, receiver.normal) {
        return 1.0;
    }
    let disc = disc(view, receiver.normal);
    var visibility = 1.0;
    for (var k = 0u; k < list.count; k++) {
        let entry = entry(list, k);
        let i = entry_index(entry);
        let to_center = instances[i].center - receiver.position;
        let radius = instances[i].radius;
        let source = source_for(i, l);
        if (entry & light_bit(l)) == 0u
            || !needs_no_rays(source)
            || !casts(i, l)
            || !above_surface(to_center, radius, receiver.normal)
            || !meets_light(view, to_center, radius)
            || is_spared(i, receiver) {
            continue;
        }
        var occlusion = 0.0;
        let of_cones = share_of_cones(source, i, receiver.position);
        if has_caps(source) {
            let left = 1.0 - share_of_rays(source, i, receiver.position) - of_cones;
            occlusion = above_cutoff(caps_light_occlusion(i, receiver.position, disc) * left);
        }
        if of_cones > 0.0 {
            occlusion += of_cones * cone_occlusion(cone_start(i, receiver.position, receiver.normal, disc));
        }
        visibility *= 1.0 - occlusion;
    }
    return visibility;
}

// How much of a disc of the sky an instance's cap grid hides.
fn caps_light_occlusion(i: u32, position: vec3<f32>, disc: ConeDisc) -> f32 {
    let grid = instances[i].cap_grid;
    let at = grid_point(grid, transform(instances[i].cap_from_world, vec4<f32>(position, 1.0)));
    var planes = array<vec4<f32>, 4>();
    for (var plane = 0u; plane < 4u; plane++) {
        planes[plane] = plane_at(grid, plane, at);
    }
    let axis = unit(transform(instances[i].cap_from_world, vec4<f32>(disc.direction, 0.0)));
    return light_occlusion(planes, axis, atan(disc.tangent));
}
