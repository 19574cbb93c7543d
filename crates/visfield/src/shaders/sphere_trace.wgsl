// Sphere tracing through a distance field. Twin: distance/sphere_trace.rs, same names, same order of operations. The including
// shader has `field_distance(source: DistanceSource, position: vec3<f32>) -> f32`.

// Layout of Rust's `SphereTracing`.
struct SphereTracing {
    relaxation: f32,
    adaptive: bool,
    max_steps: u32,
    threshold: f32,
    pixel: f32,
    // EXHAUSTED_…
    exhausted: u32,
    smoothing: u32,
    from_inside: bool,
    slack: f32,
    slack_reach: f32,
    least_step: f32,
}

const EXHAUSTED_MISSED: u32 = 0u;
const EXHAUSTED_LAST: u32 = 1u;
const EXHAUSTED_NEAREST: u32 = 2u;

struct Traced {
    hit: bool,
    t: f32,
    distance: f32,
    evaluations: u32,
}

fn tolerance(settings: SphereTracing, t: f32) -> f32 {
    return max(settings.threshold, settings.pixel * t);
}

// SphereTracing::escape
fn escape(settings: SphereTracing, distance: f32) -> f32 {
    return 2.0 * max(settings.threshold, abs(distance));
}

// SphereTracing::meets
fn meets(settings: SphereTracing, radius: f32, t: f32) -> bool {
    return radius < tolerance(settings, t) - settings.slack * max(1.0 - t / settings.slack_reach, 0.0);
}

const FIRST_RATE: f32 = -0.5;

fn adapted(radius: f32, previous: f32, step: f32, most: f32) -> f32 {
    var rate = FIRST_RATE;
    if step > 0.0 {
        rate = (radius - previous) / step;
    }
    return min(max(1.9 / max(1.0 - rate, 0.5), 1.0), most);
}

fn sphere_trace(
    source: DistanceSource,
    origin: vec3<f32>,
    direction: vec3<f32>,
    t_min: f32,
    t_max: f32,
    settings: SphereTracing,
) -> Traced {
    var relaxation = settings.relaxation;
    var traced = Traced(false, t_min, 0.0, 0u);
    var t = t_min;
    var previous = 0.0;
    var step = 0.0;
    var sign = 1.0;
    var nearest = 3.0e38;
    while traced.evaluations < settings.max_steps && t < t_max {
        let signed = field_distance(source, origin + direction * t);
        traced.evaluations += 1u;
        if settings.from_inside && traced.evaluations == 1u && signed < 0.0 {
            sign = -1.0;
        }
        let radius = sign * signed;
        if step > previous && previous + radius < step && step > settings.least_step {
            t += previous - step;
            step = previous;
            relaxation = 1.0;
            continue;
        }
        if settings.adaptive {
            relaxation = adapted(radius, previous, step, settings.relaxation);
        }
        let relative = radius / tolerance(settings, t);
        if relative < nearest || settings.exhausted == EXHAUSTED_LAST {
            nearest = relative;
            traced.t = t;
            traced.distance = signed;
        }
        if meets(settings, radius, t) {
            traced.hit = true;
            traced.t = t;
            traced.distance = signed;
            break;
        }
        step = max(radius * relaxation, settings.least_step);
        previous = radius;
        t += step;
    }
    if !traced.hit {
        traced.hit = t < t_max && settings.exhausted != EXHAUSTED_MISSED;
        if !traced.hit {
            traced.t = min(t, t_max);
            return traced;
        }
    }
    for (var i = 0u; i < settings.smoothing; i++) {
        traced.t += sign * traced.distance - tolerance(settings, traced.t);
        traced.distance = field_distance(source, origin + direction * traced.t);
        traced.evaluations += 1u;
    }
    return traced;
}

fn trace_out_of_convex(
    source: DistanceSource,
    origin: vec3<f32>,
    direction: vec3<f32>,
    t_bounds: f32,
    settings: SphereTracing,
) -> Traced {
    let end = origin + direction * t_bounds;
    let traced = sphere_trace(source, end, -direction, 0.0, t_bounds, settings);
    return Traced(traced.hit, t_bounds - traced.t, traced.distance, traced.evaluations);
}
