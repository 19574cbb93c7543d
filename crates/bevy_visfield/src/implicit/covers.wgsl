// One ray through a pixel: where it meets the surface, and where it only brushes it, by the covers of Hart 1996 as in chapter 5 of the
// 2012 thesis. Plain WGSL, joined after the
// library's distances; needs `surface.distances`, where they are.
//
// A cover is the surface moved by the radius of a pixel. A ray that comes to the inner one is covered all over and hits; one that
// comes to the outer one only brushes the surface, and the part of its pixel that is covered follows from how near it came (equation
// 5.4). So one march finds both, if it traces the inner cover: by `f + r` in the place of `f`. It is the level set by which section
// 3.2 of the 2014 paper makes up for its half pixel.

// The pixel as a cone in the space of the distances.
struct PixelCone {
    origin: vec3<f32>,
    // Per world unit along the ray, not of unit length.
    direction: vec3<f32>,
    // The radius of the pixel in units of the distances: at the origin, and what it grows per world unit.
    radius: f32,
    growth: f32,
    // Units of the distances per world unit across the ray, as the radius has them: the most, where the transform stretches.
    scale: f32,
    stretched: bool,
    local_from_world: mat3x3<f32>,
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

const COVER_STEPS: u32 = 160u;
// The cosine between the normals of a wall's two sides is less.
const OPPOSITE: f32 = -0.7;
// Brushes end where the ray leaves the outer cover, or has risen by so many radii.
const BRUSH_RISE: f32 = 0.5;

fn cone_radius(cone: PixelCone, t: f32) -> f32 {
    return cone.radius + cone.growth * t;
}

fn distance_at(cone: PixelCone, t: f32) -> f32 {
    return field_distance(surface.distances, cone.origin + cone.direction * t);
}

// The width of the differences that gradients are taken from: half a pixel.
fn gradient_width(cone: PixelCone, t: f32) -> f32 {
    // A cell of a grid has no more than one slope along an axis; a shape has the same anywhere within a thousandth of its radius.
    let least = select(0.03, 0.75, surface.distances.nodes == GRID);
    return max(0.5 * cone_radius(cone, t), least);
}

// The gradient of the distance, of unit length where the distance is one.
fn cone_gradient(cone: PixelCone, t: f32) -> vec3<f32> {
    return gradient(surface.distances, cone.origin + cone.direction * t, gradient_width(cone, t));
}

// The radius of the pixel in units of the distances, towards the surface: what the distance changes by over a pixel.
fn facing_radius(cone: PixelCone, t: f32) -> f32 {
    let gradient = transpose(cone.local_from_world) * cone_gradient(cone, t);
    return cone_radius(cone, t) * clamp(length(gradient) / cone.scale, 0.1, 1.0);
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

// Whether the surfaces that are next to two places of a ray turn their backs on each other: what is between them is a wall, which covers
// all of a pixel however thin it is, and not the outline of something that does not.
fn opposite(cone: PixelCone, front: f32, back: f32) -> bool {
    return dot(normalize(cone_gradient(cone, front)), normalize(cone_gradient(cone, back))) < OPPOSITE;
}

// Where a ray that starts inside has left the outer cover: from inside there is nothing to see, as with meshes of one side.
fn leave(cone: PixelCone) -> f32 {
    let per_unit = length(cone.direction);
    var t = cone.first;
    if distance_at(cone, t) >= 0.0 {
        return t;
    }
    for (var i = 0u; i < COVER_STEPS && t <= cone.last; i++) {
        let distance = distance_at(cone, t);
        let radius = cone_radius(cone, t);
        if distance >= radius {
            return t;
        }
        t += max(abs(distance), 0.5 * radius) / per_unit;
    }
    return cone.last;
}

// Sphere traces the inner cover, as `sphere_trace` does surfaces: relaxed where that is safe (section 3.1 of the 2014 paper). That one
// does not tell what a ray brushes.
fn trace_covers(cone: PixelCone) -> Meeting {
    let per_unit = length(cone.direction);
    let steepest = (2.0 - RELAXATION) / RELAXATION;
    var relaxed = true;
    var t = leave(cone);
    var meeting = Meeting(false, cone.last, t, 0u, Brush(0.0, 1.0), Brush(0.0, 1.0));
    var step = 0.0;
    var last_reach = 0.0;
    var last_distance = 1.0e9;
    var last_height = 1.0e9;
    var last_t = t;
    // The last place before it went inside.
    var entry = t;
    var lowest = Brush(t, 1.0e9);
    var rising = false;
    for (var i = 0u; i < COVER_STEPS; i++) {
        let distance = distance_at(cone, t);
        var radius = cone_radius(cone, t);
        if cone.stretched && abs(distance) < 2.0 * radius {
            radius = facing_radius(cone, t);
        }
        let reach = (distance + radius) / per_unit;
        let least_step = 0.25 * radius / per_unit;
        if relaxed && abs(reach) + last_reach < step && step > least_step {
            // The spheres do not touch: there may be a surface between them. Back to where the first one ends.
            t += last_reach - step;
            step = last_reach;
            relaxed = false;
            continue;
        }
        relaxed = last_reach - reach <= steepest * step;
        let height = distance / radius;
        if height <= -1.0 {
            meeting.hit = true;
            meeting.t = t;
            meeting.outside = entry;
            return meeting;
        }
        let passed = (t - last_t) * per_unit;
        if last_distance < 0.0 && distance >= 0.0 && opposite(cone, entry, t) {
            // Through a wall.
            meeting.hit = true;
            meeting.t = select(lowest.t, last_t, lowest.height >= 0.0);
            meeting.outside = entry;
            return meeting;
        }
        if last_distance >= 0.0 && distance >= 0.0 && last_distance + distance < passed {
            // There is room for a wall between the two places. If there is one, the nearest places on both its sides make similar
            // triangles with it.
            let between = mix(last_t, t, last_distance / max(last_distance + distance, 1.0e-30));
            if distance_at(cone, between) < 0.0 && opposite(cone, last_t, t) {
                meeting.hit = true;
                meeting.t = between;
                meeting.outside = last_t;
                return meeting;
            }
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
            entry = t;
        }
        last_reach = abs(reach);
        last_distance = distance;
        last_height = height;
        last_t = t;
        step = max(select(reach, reach * RELAXATION, relaxed), least_step);
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

const CROSSING_STEPS: u32 = 6u;

// Where the ray crosses the surface on its way to the inner cover: false position with the Illinois rule. It does what section 3.4 of the
// 2014 paper wants, distances that do not jump from pixel to pixel, and also near outlines, where the fixed-point iteration of that
// section is slow: rays that graze the surface cross it many pixels before they are half a pixel deep.
fn crossing(cone: PixelCone, meeting: Meeting) -> f32 {
    var outside = meeting.outside;
    var inside = meeting.t;
    var above = distance_at(cone, outside);
    var below = distance_at(cone, inside);
    if above <= 0.0 || below >= 0.0 {
        return inside;
    }
    var side = 0;
    for (var i = 0u; i < CROSSING_STEPS; i++) {
        let t = mix(outside, inside, above / (above - below));
        let distance = distance_at(cone, t);
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
