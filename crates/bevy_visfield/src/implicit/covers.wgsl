// One ray through a pixel: where it meets the surface, and where it only brushes it, by the covers of Hart 1996 as in chapter 5 of the
// 2012 thesis. Plain WGSL; needs `surface_distance`.
//
// A cover is the surface moved by the radius of a pixel. A ray that comes to the inner one is covered all over and hits; one that
// comes to the outer one only brushes the surface, and the part of its pixel that is covered follows from how near it came (equation
// 5.4). So one march finds both, if it traces the inner cover: by `f + r` in the place of `f`. It is the level set by which section
// 3.2 of the 2014 paper makes up for its half pixel.

// The pixel as a cone in the space of the field.
struct Cone {
    origin: vec3<f32>,
    // Per world unit along the ray, not of unit length.
    direction: vec3<f32>,
    // The radius of the pixel in units of the field: at the origin, and what it grows per world unit.
    radius: f32,
    growth: f32,
    // The part of the ray to look at, in world units.
    first: f32,
    last: f32,
}

// Where a ray came nearest to a surface that it did not hit.
struct Brush {
    t: f32,
    // The distance to the surface there, in radii of the pixel, from -1 to 1.
    height: f32,
}

struct Meeting {
    hit: bool,
    // On the inner cover or within it.
    t: f32,
    // The last place before that is outside the surface; the start if there is none.
    outside: f32,
    // The nearest ones before the hit, in order.
    brushes: u32,
    first: Brush,
    second: Brush,
}

const MAX_STEPS: u32 = 160u;
// As in the 2014 paper.
const OVER_RELAXATION: f32 = 1.2;
// Distances that fall faster than this along the ray, in units of the fastest, are those of a surface that faces the eye, however thin.
const FACING_SLOPE: f32 = 0.5;
// Brushes end where the ray leaves the outer cover, or has risen by so many radii.
const BRUSH_RISE: f32 = 0.5;

fn cone_radius(cone: Cone, t: f32) -> f32 {
    return cone.radius + cone.growth * t;
}

fn cone_distance(cone: Cone, t: f32) -> f32 {
    return surface_distance(cone.origin + cone.direction * t);
}

fn add_brush(meeting: ptr<function, Meeting>, brush: Brush) {
    if (*meeting).brushes == 0u {
        (*meeting).first = brush;
        (*meeting).brushes = 1u;
    } else if (*meeting).brushes == 1u {
        (*meeting).second = brush;
        (*meeting).brushes = 2u;
    }
}

// Sphere traces the inner cover, with over-relaxation (section 3.1 of the 2014 paper).
fn trace_covers(cone: Cone) -> Meeting {
    var meeting = Meeting(false, cone.last, cone.first, 0u, Brush(0.0, 1.0), Brush(0.0, 1.0));
    let per_unit = length(cone.direction);
    var omega = OVER_RELAXATION;
    var t = cone.first;
    var step = 0.0;
    var last_reach = 0.0;
    var last_distance = 0.0;
    var last_height = 1.0e9;
    var last_t = t;
    var lowest = Brush(t, 1.0e9);
    var rising = false;
    for (var i = 0u; i < MAX_STEPS; i++) {
        let distance = cone_distance(cone, t);
        let radius = cone_radius(cone, t);
        let reach = (distance + radius) / per_unit;
        if omega > 1.0 && abs(reach) + last_reach < step {
            // The spheres do not touch: there may be a surface between them. Back to where the first one ends.
            step *= 1.0 - omega;
            t += step;
            omega = 1.0;
            continue;
        }
        let height = distance / radius;
        let falls = last_distance - distance;
        let faces = i > 0u && distance < 0.0 && last_distance > 0.0 && falls > FACING_SLOPE * (t - last_t) * per_unit;
        if height <= -1.0 || faces {
            meeting.hit = true;
            meeting.t = t;
            return meeting;
        }
        if rising {
            if height < last_height - 0.05 {
                rising = false;
                lowest = Brush(t, height);
            }
        } else if height < lowest.height {
            lowest = Brush(t, height);
        } else if lowest.height < 1.0 && height > min(1.0, lowest.height + BRUSH_RISE) {
            add_brush(&meeting, lowest);
            rising = true;
        }
        if distance > 0.0 {
            meeting.outside = t;
        }
        last_reach = abs(reach);
        last_distance = distance;
        last_height = height;
        last_t = t;
        step = max(reach * omega, 0.25 * radius / per_unit);
        t += step;
        if t > cone.last {
            break;
        }
    }
    if !rising && lowest.height < 1.0 {
        add_brush(&meeting, lowest);
    }
    return meeting;
}

// The gradient of the distance, of unit length where the distance is one.
fn surface_gradient(position: vec3<f32>, h: f32) -> vec3<f32> {
    const a = vec3(1.0, -1.0, -1.0);
    const b = vec3(-1.0, -1.0, 1.0);
    const c = vec3(-1.0, 1.0, -1.0);
    const d = vec3(1.0, 1.0, 1.0);
    let sum = a * surface_distance(position + a * h) + b * surface_distance(position + b * h)
        + c * surface_distance(position + c * h) + d * surface_distance(position + d * h);
    return sum / (4.0 * h);
}

const CROSSING_STEPS: u32 = 6u;

// Where the ray crosses the surface on its way to the inner cover: false position with the Illinois rule. It does what section 3.4 of the
// 2014 paper wants, distances that do not jump from pixel to pixel, and also near outlines, where the fixed-point iteration of that
// section is slow: rays that graze the surface cross it many pixels before they are half a pixel deep.
fn crossing(cone: Cone, meeting: Meeting) -> f32 {
    var outside = meeting.outside;
    var inside = meeting.t;
    var above = cone_distance(cone, outside);
    var below = cone_distance(cone, inside);
    if above <= 0.0 || below >= 0.0 {
        // The eye is inside.
        return inside;
    }
    var side = 0;
    for (var i = 0u; i < CROSSING_STEPS; i++) {
        let t = mix(outside, inside, above / (above - below));
        let distance = cone_distance(cone, t);
        if distance >= 0.0 {
            outside = t;
            above = distance;
            below *= select(1.0, 0.5, side == 1);
            side = 1;
        } else {
            inside = t;
            below = distance;
            above *= select(1.0, 0.5, side == -1);
            side = -1;
        }
    }
    return mix(outside, inside, above / (above - below));
}

// The part of a disc that a half-plane covers whose edge has this signed distance from the disc's centre, in radii (equation 5.4 of the
// 2012 thesis).
fn disc_coverage(height: f32) -> f32 {
    let x = clamp(height, -1.0, 1.0);
    return 0.5 - (x * sqrt(1.0 - x * x) + asin(x)) / 3.14159265;
}
