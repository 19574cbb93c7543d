// Cones through distances: small lights, and ambient occlusion where no cap grid answers, without rays and without noise. Twins:
// distance/cone.rs and estimate/cones.rs, same names, same order of operations. Joined after distance.wgsl, light.wgsl and
// instance.wgsl.

const CONE_STEPS: u32 = 24u;
const CONE_START: f32 = 0.25;
const CONE_LEAST_STEP: f32 = 0.03;
const CONE_LIFT: f32 = 0.3;
const CONTACT_REACH: f32 = 0.06;
const GRADIENT_REACH: f32 = 1.0;

fn disc_occlusion(visible: f32) -> f32 {
    let v = clamp(visible, -1.0, 1.0);
    return 1.0 - (1.0 + v) * (1.0 + v) * (2.0 - v) * 0.25;
}

fn horizon_share(horizon: f32) -> f32 {
    return max(1.0 - disc_occlusion(horizon), 1.0e-3);
}

// DistanceField::cone_visible
fn cone_visible(
    source: DistanceSource,
    position: vec3<f32>,
    normal: vec3<f32>,
    direction: vec3<f32>,
    tangent: f32,
    t_light: f32,
) -> f32 {
    let finer = source.threshold / GRID_THRESHOLD;
    let center = (source.low + source.high) * 0.5;
    let radius = length(source.high - source.low) * 0.5;
    var origin = position;
    if all(clamp(position, source.low, source.high) == position) {
        let lift = CONE_LIFT * finer;
        origin += normal * clamp(lift - field_distance(source, position), 0.0, 2.0 * lift);
    }
    let along = dot(center - origin, direction);
    let t_end = min(along + radius, t_light);
    var t = max(CONE_START * finer, along - radius);
    var visible = 1.0;
    for (var i = 0u; i < CONE_STEPS && t < t_end && visible >= -1.0; i++) {
        let distance = field_distance(source, origin + direction * t);
        visible = min(visible, distance / (t * tangent));
        t += max(abs(distance), CONE_LEAST_STEP * radius);
    }
    return visible;
}

// ConeOccluder::occlusion
fn cone_occlusion(i: u32, position: vec3<f32>, receiver_normal: vec3<f32>, disc: ConeDisc) -> f32 {
    let rows = instances[i].distance_from_world;
    let along = transform(rows, vec4<f32>(disc.direction, 0.0));
    let along_length = length(along);
    let volume = abs(dot(rows[0].xyz, cross(rows[1].xyz, rows[2].xyz)));
    let tangent = disc.tangent * sqrt(volume / (along_length * along_length * along_length));
    let direction = along / along_length;
    let normal = mapped_normal(rows, receiver_normal);
    let local = transform(rows, vec4<f32>(position, 1.0));
    let t_light = select(disc.distance * along_length, ENDLESS, disc.distance == ENDLESS);
    let source = distance_source(instances[i].distance);
    let visible = cone_visible(source, local, normal, direction, tangent, t_light);
    let above = horizon_share(dot(normal, direction) / tangent);
    return 1.0 - min((1.0 - disc_occlusion(visible)) / above, 1.0);
}

fn contact_occlusion(distance: f32, radius: f32, facing: f32) -> f32 {
    return clamp(1.0 - distance / (CONTACT_REACH * radius), 0.0, 1.0) * (1.0 - facing) * 0.5;
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
    let facing = dot(gradient(source, local, GRADIENT_REACH), mapped_normal(rows, normal));
    return contact_occlusion(distance, radius, facing);
}
