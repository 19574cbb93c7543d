// Rays against one field, in field space. Twins: field/{octahedral,chord,lookup,encoding,query}.rs, same names, same order of
// operations, so that both sides agree on table indices.
//
// Expects `pool: array<u32>`, the packed bytes of all fields, to be declared by the including shader.

// How a table is encoded (layout::encoding_number).
const U8: u32 = 0u;
const BIT: u32 = 1u;
const U16: u32 = 2u;
const F32: u32 = 3u;
// Stands for "no hit" where Rust has `None`. WGSL has no portable infinity.
const NO_HIT: f32 = 3.0e38;
const GRAZING: f32 = 1.0e-3;
// √4π
const SQRT_SPHERE: f32 = 3.5449077;

// One table in `pool`: its first byte, a multiple of 4, the sides of its two grids, and how it is encoded. Stands for
// what Rust finds in a field: TwoPointGrid, Codes and Resolution.
struct TableShape {
    first_byte: u32,
    entries: u32,
    exits: u32,
    encoding: u32,
}

// t_half is 0 if the line misses the sphere.
struct Chord {
    middle: vec3<f32>,
    t_middle: f32,
    t_half: f32,
}

// A hit at fraction s lies s·length − before past the aim point. The stored chord goes from start to end.
struct Lookup {
    index: u32,
    before: f32,
    length: f32,
    start: vec3<f32>,
    end: vec3<f32>,
}

// What octahedral_snap gives: a cell, and the unit vector to its centre.
struct Snapped {
    cell: u32,
    center: vec3<f32>,
}

fn fold(uv: vec2<f32>) -> vec2<f32> {
    return (1.0 - abs(uv.yx)) * select(vec2<f32>(-1.0), vec2<f32>(1.0), uv >= vec2<f32>(0.0));
}

fn octahedral_grid(p: vec3<f32>, side: u32) -> vec2<f32> {
    let folded = p.xy / (abs(p.x) + abs(p.y) + abs(p.z));
    let uv = select(folded, fold(folded), p.z < 0.0);
    let grid = (uv * 0.5 + 0.5) * f32(side);
    return min(max(floor(grid), vec2<f32>(0.0)), vec2<f32>(f32(side - 1u)));
}

fn cell_number(grid: vec2<f32>, side: u32) -> u32 {
    return u32(grid.y) * side + u32(grid.x);
}

fn octahedral_snap(p: vec3<f32>, side: u32) -> Snapped {
    let grid = octahedral_grid(p, side);
    return Snapped(cell_number(grid, side), grid_direction(grid, side));
}

fn grid_direction(grid: vec2<f32>, side: u32) -> vec3<f32> {
    let uv = (grid + 0.5) / f32(side) * 2.0 - 1.0;
    let z = 1.0 - abs(uv.x) - abs(uv.y);
    let xy = select(uv, fold(uv), z < 0.0);
    return normalize(vec3<f32>(xy, z));
}

fn cell_width(side: u32) -> f32 {
    return SQRT_SPHERE / f32(side);
}

fn chord(origin: vec3<f32>, direction: vec3<f32>) -> Chord {
    let a = dot(direction, direction);
    let t_middle = -dot(origin, direction) / a;
    let middle = origin + direction * t_middle;
    let inside = 1.0 - dot(middle, middle);
    if inside > 0.0 {
        return Chord(middle, t_middle, sqrt(inside / a));
    }
    return Chord(middle, t_middle, 0.0);
}

fn table_index(shape: TableShape, entry: u32, exit: u32) -> u32 {
    return entry * (shape.exits * shape.exits) + exit;
}

fn aimed_lookup(shape: TableShape, start: vec3<f32>, end: vec3<f32>, aim: vec3<f32>) -> Lookup {
    let entry = octahedral_snap(start, shape.entries);
    let to_aim = aim - entry.center;
    let inward = -dot(entry.center, to_aim);
    let squared = dot(to_aim, to_aim);
    let aimed = inward > GRAZING * sqrt(squared);
    let stretch = 2.0 * inward / squared;
    let far_end = select(end, entry.center + to_aim * stretch, aimed);
    let before = select(length(aim - start), sqrt(squared), aimed);
    let chord_length = select(length(end - start), stretch * before, aimed);
    let exit = octahedral_snap(far_end, shape.exits);
    return Lookup(table_index(shape, entry.cell, exit.cell), before, chord_length, entry.center, exit.center);
}

fn forward_lookup(shape: TableShape, direction: vec3<f32>, c: Chord) -> Lookup {
    let half = direction * c.t_half;
    return aimed_lookup(shape, c.middle - half, c.middle + half, c.middle);
}

fn reversed_lookup(shape: TableShape, origin: vec3<f32>, direction: vec3<f32>, c: Chord) -> Lookup {
    let half = direction * c.t_half;
    return aimed_lookup(shape, c.middle + half, c.middle - half, origin);
}

// Byte `index` of a table.
fn byte(shape: TableShape, index: u32) -> u32 {
    let at = shape.first_byte + index;
    return (pool[at >> 2u] >> ((at & 3u) * 8u)) & 0xffu;
}

// The fraction of a chord at which the first surface is met, or NO_HIT.
fn fraction(shape: TableShape, index: u32) -> f32 {
    switch shape.encoding {
        case BIT: {
            let word = pool[(shape.first_byte >> 2u) + (index >> 5u)];
            if ((word >> (index & 31u)) & 1u) == 0u {
                return NO_HIT;
            }
            // The means of the starts lie behind the bits.
            let chords_per_start = shape.exits * shape.exits;
            let chords = shape.entries * shape.entries * chords_per_start;
            let mean = byte(shape, (chords >> 3u) + u32((chords & 7u) != 0u) + index / chords_per_start);
            return min(f32(mean) * (1.0 / 254.0), 1.0);
        }
        case U16: {
            let code = (pool[(shape.first_byte >> 2u) + (index >> 1u)] >> ((index & 1u) * 16u)) & 0xffffu;
            return select(f32(code) * (1.0 / 65534.0), NO_HIT, code == 65535u);
        }
        case F32: {
            let value = bitcast<f32>(pool[(shape.first_byte >> 2u) + index]);
            return select(NO_HIT, value, value >= 0.0 && value <= 1.0);
        }
        default: {
            let code = byte(shape, index);
            return select(f32(code) * (1.0 / 254.0), NO_HIT, code == 255u);
        }
    }
}

fn half_quantum(encoding: u32) -> f32 {
    switch encoding {
        case U16: { return 0.5 / 65534.0; }
        case F32: { return 0.0; }
        default: { return 0.5 / 254.0; }
    }
}

fn point_on_chord(lookup: Lookup, fraction: f32) -> vec3<f32> {
    return lookup.start + (lookup.end - lookup.start) * fraction;
}

fn exit_spread(shape: TableShape, before: f32, length: f32) -> f32 {
    return cell_width(shape.exits) * before / max(length, 1.1754944e-38);
}

fn bias_height(bias: Bias, shape: TableShape, before: f32, length: f32) -> f32 {
    return length * half_quantum(shape.encoding) + exit_spread(shape, before, length) * bias.height;
}

fn bias_along(bias: Bias, shape: TableShape, before: f32, length: f32) -> f32 {
    return length * half_quantum(shape.encoding) + exit_spread(shape, before, length) * bias.along;
}

// NaN becomes 0 too.
fn not_behind(t: f32) -> f32 {
    return select(0.0, t, t > 0.0);
}

fn rises_above(
    shape: TableShape,
    lookup: Lookup,
    fraction: f32,
    origin: vec3<f32>,
    normal: vec3<f32>,
    bias: Bias,
) -> bool {
    let height = dot(point_on_chord(lookup, fraction) - origin, normal);
    return all(normal == vec3<f32>(0.0)) || height > bias_height(bias, shape, lookup.before, lookup.length);
}

// NO_HIT where Rust has `None`.
fn first_hit_on_chord(shape: TableShape, direction: vec3<f32>, c: Chord) -> f32 {
    let lookup = forward_lookup(shape, direction, c);
    let fraction = fraction(shape, lookup.index);
    let past_middle = fraction * lookup.length - lookup.before;
    return select(c.t_middle + past_middle / length(direction), NO_HIT, fraction == NO_HIT);
}

fn occluded(
    shape: TableShape,
    origin: vec3<f32>,
    direction: vec3<f32>,
    t_max: f32,
    normal: vec3<f32>,
    bias: Bias,
) -> bool {
    let c = chord(origin, direction);
    let t_entry = c.t_middle - c.t_half;
    if c.t_half == 0.0 || c.t_middle + c.t_half <= 0.0 || t_entry >= t_max {
        return false;
    }
    if t_entry >= 0.0 {
        return first_hit_on_chord(shape, direction, c) < t_max;
    }
    let lookup = reversed_lookup(shape, origin, direction, c);
    let fraction = fraction(shape, lookup.index);
    if fraction == NO_HIT {
        return false;
    }
    let direction_length = length(direction);
    let t_last = (lookup.before - fraction * lookup.length) / direction_length;
    let t_bias = not_behind(bias_along(bias, shape, lookup.before, lookup.length) / direction_length);
    if t_last <= t_bias || !rises_above(shape, lookup, fraction, origin, normal, bias) {
        return false;
    }
    if t_last < t_max {
        return true;
    }
    let t_first = first_hit_on_chord(shape, direction, c);
    return t_first > t_bias && t_first < t_max;
}
