// Lights as receivers see them. Twin: estimate/light.rs. Joined after frame.wgsl.

const DIRECTIONAL: u32 = 0u;
const SPHERE: u32 = 1u;
const RECTANGLE: u32 = 2u;
const WIDEST_SINE: f32 = 0.9320391;
const SMALLEST_DISTANCE: f32 = 1.0e-18;
const ENDLESS: f32 = 3.0e38;
const PI: f32 = 3.1415927;
const SMALLEST_TANGENT: f32 = 1.0e-3;
const LARGEST_TANGENT: f32 = 1.0e3;

// A light from one point: where its points lie, and a cone that holds them all.
struct LightView {
    // To its centre, and from there to its points. Towards directional lights it is 1 long.
    to_center: vec3<f32>,
    tangent: vec3<f32>,
    bitangent: vec3<f32>,
    // The rays' ends, as a multiple of their direction.
    t_max: f32,
    // The cone. A cosine below 0 means: everything.
    axis: vec3<f32>,
    sine: f32,
    cosine: f32,
    // Areas of a round disc with these radii that the light's is: 4/π of a rectangle.
    areas: f32,
    // Beyond it nothing is between the receiver and the light.
    distance: f32,
}

// Light::seen_from
fn seen_from(light: Light, position: vec3<f32>) -> LightView {
    if light.kind == DIRECTIONAL {
        return LightView(
            light.origin, light.tangent, light.bitangent, ENDLESS,
            light.origin, light.radius, light.cosine, 1.0, ENDLESS,
        );
    }
    let to_center = light.origin - position;
    let distance = max(length(to_center), SMALLEST_DISTANCE);
    let axis = to_center / distance;
    let sine = min(light.radius / distance, WIDEST_SINE);
    let cosine = sqrt(1.0 - sine * sine);
    let farthest = distance + light.radius;
    if light.kind == SPHERE {
        // The disc that the sphere shows.
        let radius = distance * sine / cosine;
        let basis = orthonormal_pair(axis);
        return LightView(to_center, basis[0] * radius, basis[1] * radius, 1.0, axis, sine, cosine, 1.0, farthest);
    }
    let all = light.radius >= distance * WIDEST_SINE;
    return LightView(
        to_center, light.tangent, light.bitangent, 1.0,
        axis, select(sine, 0.0, all), select(cosine, -1.0, all), 4.0 / PI, farthest,
    );
}

// Two unit vectors across a unit vector and each other (Duff et al. 2017, Building an Orthonormal Basis, Revisited).
fn orthonormal_pair(axis: vec3<f32>) -> array<vec3<f32>, 2> {
    let sign = select(-1.0, 1.0, axis.z >= 0.0);
    let a = -1.0 / (sign + axis.z);
    let b = axis.x * axis.y * a;
    return array<vec3<f32>, 2>(
        vec3<f32>(1.0 + sign * axis.x * axis.x * a, sign * b, -sign * axis.x),
        vec3<f32>(b, sign + axis.y * axis.y * a, -axis.y),
    );
}

// Light::shines_on
fn shines_on(light: Light, view: LightView, normal: vec3<f32>) -> bool {
    var above = dot(normal, view.to_center);
    if light.kind == RECTANGLE {
        above += abs(dot(normal, view.tangent)) + abs(dot(normal, view.bitangent));
    }
    let emitted = dot(light.emission, -view.axis) > light.cosine || light.kind == DIRECTIONAL;
    let within = light.kind == DIRECTIONAL || view.distance - light.radius < light.range;
    return above > 0.0 && emitted && within;
}

// LightView::direction
fn light_direction(view: LightView, point: vec2<f32>) -> vec3<f32> {
    return view.to_center + view.tangent * point.x + view.bitangent * point.y;
}

// Whether a sphere can block any ray towards the light: LightView::meets.
fn meets_light(view: LightView, to_center: vec3<f32>, radius: f32) -> bool {
    let along = dot(to_center, view.axis);
    let across = length(to_center - view.axis * along);
    let in_cone = along > -radius && across * view.cosine - along * view.sine < radius;
    return (in_cone || view.cosine < 0.0) && along - radius < view.distance;
}

// A round disc of the sky.
struct ConeDisc {
    direction: vec3<f32>,
    tangent: f32,
    distance: f32,
}

// Half a side of a rectangle, towards a normal.
fn raise(side: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    return side * select(0.5, -0.5, dot(normal, side) < 0.0);
}

// The round disc that stands for a light: LightView::disc.
fn disc(view: LightView, normal: vec3<f32>) -> ConeDisc {
    let below = dot(normal, view.to_center) <= 0.0;
    let raised = view.to_center + raise(view.tangent, normal) + raise(view.bitangent, normal);
    let to_disc = select(view.to_center, raised, below);
    let distance = max(length(to_disc), SMALLEST_DISTANCE);
    let direction = to_disc / distance;
    let area = abs(dot(cross(view.tangent, view.bitangent), direction)) * view.areas * select(1.0, 0.25, below);
    let tangent = clamp(sqrt(area) / distance, SMALLEST_TANGENT, LARGEST_TANGENT);
    return ConeDisc(direction, tangent, select(distance, ENDLESS, view.t_max == ENDLESS));
}
