// Cones through distances: small lights, and ambient occlusion where no cap grid answers, without rays and without noise. Twins:
// distance/cone.rs and estimate/cones.rs, same names, same order of operations. Joined after distance.wgsl, light.wgsl and
// instance.wgsl.

const CONE_STEPS: u32 = 32u;
const CONE_START: f32 = 0.25;
const CONE_LEAST_STEP: f32 = 0.02;
const CONE_WIDEST_STEP: f32 = 5.0;
const PART_RADIUS: f32 = 0.3779645;
const RING: array<vec2<f32>, 6> = array<vec2<f32>, 6>(
    vec2<f32>(0.70710678, 0.0),
    vec2<f32>(0.3535534, 0.6123724),
    vec2<f32>(-0.3535534, 0.6123724),
    vec2<f32>(-0.70710678, 0.0),
    vec2<f32>(-0.3535534, -0.6123724),
    vec2<f32>(0.3535534, -0.6123724),
);
const CONTACT_REACH: f32 = 0.06;
const GRADIENT_REACH: f32 = 1.0;

// In the space of the distances.
struct LightCone {
    direction: vec3<f32>,
    tangent: f32,
    t_light: f32,
}

struct ConeMarch {
    source: DistanceSource,
    start: f32,
    slack: f32,
    slack_reach: f32,
    least_step: f32,
    center: vec3<f32>,
    radius: f32,
    t_light: f32,
}

// Where cones start, and how they are marched.
struct ConeStart {
    march: ConeMarch,
    origin: vec3<f32>,
    normal: vec3<f32>,
    cone: LightCone,
}

fn disc_occlusion(visible: f32) -> f32 {
    let v = clamp(visible, -1.0, 1.0);
    return 1.0 - (1.0 + v) * (1.0 + v) * (2.0 - v) * 0.25;
}

fn horizon(normal: vec3<f32>, direction: vec3<f32>, tangent: f32) -> f32 {
    return select(dot(normal, direction) / tangent, 1.0, all(normal == vec3<f32>(0.0)));
}

// ConeMarch::visible
fn cone_visible(march: ConeMarch, origin: vec3<f32>, direction: vec3<f32>, tangent: f32) -> f32 {
    let along = dot(march.center - origin, direction);
    let t_end = min(along + march.radius, march.t_light);
    var t = max(march.start, along - march.radius);
    var visible = 3.0e38;
    for (var i = 0u; i < CONE_STEPS && t < t_end; i++) {
        let slack = march.slack * max(1.0 - t / march.slack_reach, 0.0);
        let from_surface = field_distance(march.source, origin + direction * t) - march.source.threshold;
        visible = min(visible, (from_surface + slack) / (t * tangent));
        if visible < -1.0 {
            break;
        }
        t += max(abs(from_surface), march.least_step);
    }
    return visible;
}

// DistanceField::cone_march
fn cone_march(source: DistanceSource, t_light: f32, bias: Bias) -> ConeMarch {
    let center = (source.low + source.high) * 0.5;
    let radius = length(source.high - source.low) * 0.5;
    let voxel = source.threshold / GRID_THRESHOLD;
    return ConeMarch(
        source, CONE_START * voxel, bias.height * SLACK * voxel,
        max(bias.along * SLACK_REACH * voxel, LEAST_REACH), min(CONE_LEAST_STEP * radius, CONE_WIDEST_STEP), center, radius, t_light,
    );
}

// ConeOccluder::seen
fn cone_start(i: u32, position: vec3<f32>, receiver_normal: vec3<f32>, disc: ConeDisc) -> ConeStart {
    let rows = instances[i].distance_from_world;
    let along = transform(rows, vec4<f32>(disc.direction, 0.0));
    let along_length = length(along);
    let scaled = scaled_rows(rows);
    let shape = length(vec3<f32>(dot(scaled[0], disc.direction), dot(scaled[1], disc.direction), dot(scaled[2], disc.direction)));
    let volume = abs(dot(scaled[0], cross(scaled[1], scaled[2])));
    let tangent = disc.tangent * sqrt(volume / (shape * shape * shape));
    let normal = mapped_normal(rows, receiver_normal);
    let local = transform(rows, vec4<f32>(position, 1.0));
    let t_light = select(disc.distance * along_length, ENDLESS, disc.distance >= ENDLESS);
    let bias = Bias(frame.bias_height, frame.bias_along);
    let march = cone_march(distance_source(instances[i].distance), t_light, bias);
    return ConeStart(march, lifted(march.source, local, normal, march.slack), normal, LightCone(along / along_length, tangent, t_light));
}

// ConeMarch::edge_occlusion
fn edge_occlusion(at: ConeStart) -> f32 {
    let above = 1.0 - disc_occlusion(horizon(at.normal, at.cone.direction, at.cone.tangent));
    let visible = cone_visible(at.march, at.origin, at.cone.direction, at.cone.tangent);
    let seen = min(1.0 - disc_occlusion(visible), above);
    return select(0.0, 1.0 - seen / above, above > 0.0);
}

// ConeMarch::occlusion
fn cone_occlusion(at: ConeStart) -> f32 {
    let visible = cone_visible(at.march, at.origin, at.cone.direction, at.cone.tangent);
    if visible >= 1.0 {
        return 0.0;
    }
    if visible <= -1.0 {
        return 1.0;
    }
    let tangent = at.cone.tangent * PART_RADIUS;
    var above = 1.0 - disc_occlusion(horizon(at.normal, at.cone.direction, tangent));
    var seen = min(1.0 - disc_occlusion(visible / PART_RADIUS), above);
    let basis = orthonormal_pair(at.cone.direction);
    for (var k = 0u; k < 6u; k++) {
        var ring = RING;
        let place = ring[k] * at.cone.tangent;
        let direction = normalize(at.cone.direction + basis[0] * place.x + basis[1] * place.y);
        let part_above = 1.0 - disc_occlusion(horizon(at.normal, direction, tangent));
        if part_above > 0.0 {
            let part_visible = cone_visible(at.march, at.origin, direction, tangent);
            seen += min(1.0 - disc_occlusion(part_visible), part_above);
            above += part_above;
        }
    }
    return select(0.0, 1.0 - seen / above, above > 0.0);
}

fn contact_occlusion(distance: f32, radius: f32, facing: f32) -> f32 {
    return clamp(1.0 - distance / (CONTACT_REACH * radius), 0.0, 1.0) * (1.0 - clamp(facing, -1.0, 1.0)) * 0.5;
}

// ConeOccluder::contact
fn contact(i: u32, position: vec3<f32>, normal: vec3<f32>) -> f32 {
    let rows = instances[i].distance_from_world;
    let local = transform(rows, vec4<f32>(position, 1.0));
    let source = distance_source(instances[i].distance);
    let radius = length(source.high - source.low) * 0.5;
    let reach = CONTACT_REACH * radius;
    let beyond = local - clamp(local, source.low, source.high);
    if dot(beyond, beyond) >= reach * reach {
        return 0.0;
    }
    let distance = max(field_distance(source, local), 0.0);
    if distance >= reach {
        return 0.0;
    }
    let ahead = mapped_normal(rows, normal) * GRADIENT_REACH;
    let facing = (field_distance(source, local + ahead) - field_distance(source, local - ahead)) / (2.0 * GRADIENT_REACH);
    return contact_occlusion(distance, radius, facing);
}
