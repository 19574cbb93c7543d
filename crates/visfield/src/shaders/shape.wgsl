// Signed distances to shapes, by their programs. Twins: shape/primitive.rs and shape/program.rs, same names, same order of
// operations. The including shader declares `pool: array<u32>`, which holds the nodes.

// Kinds of nodes: primitives, and from the union on operations.
const SHAPE_SPHERE: u32 = 0u;
const SHAPE_BOX: u32 = 1u;
const SHAPE_HALF_SPACE: u32 = 2u;
const SHAPE_CAPSULE: u32 = 3u;
const SHAPE_CYLINDER: u32 = 4u;
const SHAPE_TORUS: u32 = 5u;
const SHAPE_CONE: u32 = 6u;
const SHAPE_UNION: u32 = 7u;
const SHAPE_INTERSECTION: u32 = 8u;
const SHAPE_DIFFERENCE: u32 = 9u;
const SHAPE_SMOOTH_UNION: u32 = 10u;

const SHAPE_NODE_WORDS: u32 = 16u;
// Distances that are kept at once.
const SHAPE_STACK: u32 = 8u;
// The distance to nothing.
const SHAPE_FARTHEST: f32 = 1.0e12;
const SHAPE_SMALLEST: f32 = 1.1754944e-38;

fn from_axis(position: vec3<f32>) -> f32 {
    return length(position.xz);
}

fn sphere_distance(position: vec3<f32>, radius: f32) -> f32 {
    return length(position) - radius;
}

fn box_distance(position: vec3<f32>, half_extents: vec3<f32>) -> f32 {
    let beyond = abs(position) - half_extents;
    let inside = max(beyond.x, max(beyond.y, beyond.z));
    if inside > 0.0 {
        return length(max(beyond, vec3(0.0)));
    }
    return inside;
}

fn half_space_distance(position: vec3<f32>) -> f32 {
    return position.y;
}

fn capsule_distance(position: vec3<f32>, half_length: f32, radius: f32) -> f32 {
    let along = clamp(position.y, -half_length, half_length);
    return length(vec3(position.x, position.y - along, position.z)) - radius;
}

fn cylinder_distance(position: vec3<f32>, half_height: f32, radius: f32) -> f32 {
    let beyond = vec2(from_axis(position) - radius, abs(position.y) - half_height);
    let inside = max(beyond.x, beyond.y);
    if inside > 0.0 {
        return length(max(beyond, vec2(0.0)));
    }
    return inside;
}

fn torus_distance(position: vec3<f32>, major_radius: f32, minor_radius: f32) -> f32 {
    return length(vec2(from_axis(position) - major_radius, position.y)) - minor_radius;
}

fn cone_distance(position: vec3<f32>, height: f32, radius: f32) -> f32 {
    let from_edge = vec2(from_axis(position) - radius, position.y + 0.5 * height);
    let flank = vec2(-radius, height);
    let along = clamp(dot(from_edge, flank) / max(dot(flank, flank), SHAPE_SMALLEST), 0.0, 1.0);
    let to_flank = from_edge - flank * along;
    let to_base = vec2(max(from_edge.x, 0.0), from_edge.y);
    let distance = sqrt(min(dot(to_flank, to_flank), dot(to_base, to_base)));
    let outside_flank = from_edge.x * height + from_edge.y * radius;
    return select(distance, -distance, max(outside_flank, -from_edge.y) < 0.0);
}

fn union_distance(a: f32, b: f32) -> f32 {
    return min(a, b);
}

fn intersection_distance(a: f32, b: f32) -> f32 {
    return max(a, b);
}

fn difference_distance(a: f32, b: f32) -> f32 {
    return max(a, -b);
}

fn smooth_union_distance(a: f32, b: f32, width: f32) -> f32 {
    let overlap = max(width - abs(a - b), 0.0) / width;
    return min(a, b) - overlap * overlap * width * 0.25;
}

fn primitive_distance(kind: u32, parameters: vec3<f32>, position: vec3<f32>) -> f32 {
    switch kind {
        case SHAPE_SPHERE: { return sphere_distance(position, parameters.x); }
        case SHAPE_BOX: { return box_distance(position, parameters); }
        case SHAPE_HALF_SPACE: { return half_space_distance(position); }
        case SHAPE_CAPSULE: { return capsule_distance(position, parameters.x, parameters.y); }
        case SHAPE_CYLINDER: { return cylinder_distance(position, parameters.x, parameters.y); }
        case SHAPE_TORUS: { return torus_distance(position, parameters.x, parameters.y); }
        default: { return cone_distance(position, parameters.x, parameters.y); }
    }
}

fn joint_distance(kind: u32, a: f32, b: f32, width: f32) -> f32 {
    switch kind {
        case SHAPE_UNION: { return union_distance(a, b); }
        case SHAPE_INTERSECTION: { return intersection_distance(a, b); }
        case SHAPE_DIFFERENCE: { return difference_distance(a, b); }
        default: { return smooth_union_distance(a, b, width); }
    }
}

// Four words of the pool.
fn shape_words(first_word: u32) -> vec4<f32> {
    return bitcast<vec4<f32>>(
        vec4(pool[first_word], pool[first_word + 1u], pool[first_word + 2u], pool[first_word + 3u]),
    );
}

// Of a program of so many nodes, which start at a word of the pool: of each, kind, parameters, and rows of the map into the
// primitive's space.
fn shape_distance(first_word: u32, nodes: u32, position: vec3<f32>) -> f32 {
    if nodes == 0u {
        return SHAPE_FARTHEST;
    }
    var stack: array<f32, SHAPE_STACK>;
    var height = 0u;
    let place = vec4(position, 1.0);
    for (var i = 0u; i < nodes; i++) {
        let word = first_word + i * SHAPE_NODE_WORDS;
        let kind = pool[word];
        if kind < SHAPE_UNION {
            let parameters = shape_words(word).yzw;
            let x = dot(shape_words(word + 4u), place);
            let y = dot(shape_words(word + 8u), place);
            let z = dot(shape_words(word + 12u), place);
            stack[height] = primitive_distance(kind, parameters, vec3(x, y, z));
            height += 1u;
        } else {
            height -= 1u;
            let width = bitcast<f32>(pool[word + 1u]);
            stack[height - 1u] = joint_distance(kind, stack[height - 1u], stack[height], width);
        }
    }
    return clamp(stack[0], -SHAPE_FARTHEST, SHAPE_FARTHEST);
}
