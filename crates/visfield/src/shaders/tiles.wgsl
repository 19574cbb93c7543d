// The passes that list, for each tile of the viewport, the instances that can matter there: bounds of every tile's receivers,
// the lists of blocks of tiles, and from them those of tiles. Lists are in the order of the instances, so that the passes that
// add up do so in the same order in every frame. Twin: estimate/frame/tiles.rs. Joined after frame.wgsl, light.wgsl,
// instance.wgsl and lists.wgsl.

@group(0) @binding(7) var<storage, read_write> lists: array<atomic<u32>>;

const THREADS: u32 = 64u;

// Boxes around positions and normals; empty if `low` is above `high`.
struct Bounds {
    low: vec3<f32>,
    high: vec3<f32>,
    normal_low: vec3<f32>,
    normal_high: vec3<f32>,
}

var<workgroup> parts: array<Bounds, THREADS>;
var<workgroup> total: atomic<u32>;
var<workgroup> first_of_list: u32;
var<workgroup> listed: array<atomic<u32>, 2>;

fn empty_bounds() -> Bounds {
    let most = vec3<f32>(ENDLESS);
    return Bounds(most, -most, most, -most);
}

fn joined(a: Bounds, b: Bounds) -> Bounds {
    return Bounds(
        min(a.low, b.low), max(a.high, b.high),
        min(a.normal_low, b.normal_low), max(a.normal_high, b.normal_high),
    );
}

// All parts of the workgroup together.
fn join_parts(thread: u32, own: Bounds) -> Bounds {
    parts[thread] = own;
    workgroupBarrier();
    if thread < 8u {
        var some = parts[thread * 8u];
        for (var i = 1u; i < 8u; i++) {
            some = joined(some, parts[thread * 8u + i]);
        }
        parts[thread * 8u] = some;
    }
    workgroupBarrier();
    var all = parts[0];
    for (var i = 1u; i < 8u; i++) {
        all = joined(all, parts[i * 8u]);
    }
    return all;
}

fn store_bounds(word: u32, bounds: Bounds) {
    for (var i = 0u; i < 3u; i++) {
        atomicStore(&lists[word + i], bitcast<u32>(bounds.low[i]));
        atomicStore(&lists[word + 3u + i], bitcast<u32>(bounds.high[i]));
        atomicStore(&lists[word + 6u + i], bitcast<u32>(bounds.normal_low[i]));
        atomicStore(&lists[word + 9u + i], bitcast<u32>(bounds.normal_high[i]));
    }
}

fn load_three(word: u32) -> vec3<f32> {
    return vec3<f32>(
        bitcast<f32>(atomicLoad(&lists[word])),
        bitcast<f32>(atomicLoad(&lists[word + 1u])),
        bitcast<f32>(atomicLoad(&lists[word + 2u])),
    );
}

fn load_bounds(tile: vec2<u32>) -> Bounds {
    let word = bounds_word(tile);
    return Bounds(load_three(word), load_three(word + 3u), load_three(word + 6u), load_three(word + 9u));
}

@compute @workgroup_size(8, 8)
fn tile_bounds(
    @builtin(workgroup_id) tile: vec3<u32>,
    @builtin(local_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    var bounds = empty_bounds();
    for (var i = 0u; i < 4u; i++) {
        let pixel = tile.xy * TILE_SIDE + id.xy * 2u + vec2<u32>(i & 1u, i >> 1u);
        if all(pixel < frame.viewport_size) {
            let receiver = receiver_at(pixel);
            if receiver.depth > 0.0 {
                bounds = joined(
                    bounds,
                    Bounds(receiver.position, receiver.position, receiver.normal, receiver.normal),
                );
            }
        }
    }
    let all = join_parts(thread, bounds);
    if thread == 0u {
        store_bounds(bounds_word(tile.xy), all);
    }
}

// Whether a sphere can block any ray of the hemisphere of any receiver within the bounds: the largest that its centre's height
// above a receiver's surface can be, by intervals.
fn bounds_above_surface(bounds: Bounds, center: vec3<f32>, radius: f32) -> bool {
    let nearest = center - bounds.high;
    let farthest = center - bounds.low;
    let products = max(
        max(nearest * bounds.normal_low, nearest * bounds.normal_high),
        max(farthest * bounds.normal_low, farthest * bounds.normal_high),
    );
    return products.x + products.y + products.z > -radius;
}

// Whether an instance can occlude ambient light of any receiver within the bounds.
fn bounds_reached(bounds: Bounds, center: vec3<f32>, radius: f32) -> bool {
    let outside = max(max(bounds.low - center, center - bounds.high), vec3<f32>(0.0));
    return within_reach(outside, radius);
}

// Whether an instance can block any ray from any receiver within the bounds to a light. Such rays lie in the hull of a ball around
// the receivers and one around the light, or in the cone of a directional light around the first.
fn bounds_meet_light(bounds: Bounds, light: Light, center: vec3<f32>, radius: f32) -> bool {
    let middle = (bounds.low + bounds.high) * 0.5;
    let spread = length(bounds.high - bounds.low) * 0.5;
    let to_center = center - middle;
    let grown = radius + spread;
    if light.kind == DIRECTIONAL {
        return meets_light(seen_from(light, middle), to_center, grown);
    }
    let to_light = light.origin - middle;
    let distance = length(to_light);
    // The disc that a sphere shows is a little larger than the sphere.
    let shown = min(light.radius / max(distance - spread, SMALLEST_DISTANCE), WIDEST_SINE);
    let ball = light.radius / sqrt(1.0 - shown * shown);
    let sine = (ball - spread) / distance;
    // One ball within the other, or no distance at all.
    if !(abs(sine) < 1.0) {
        return true;
    }
    let along = dot(to_center, to_light) / distance;
    let across = length(to_center - to_light * (along / distance));
    return distance - spread < light.range
        && along > -grown
        && along < distance + ball + radius
        && across * sqrt(1.0 - sine * sine) - along * sine < grown;
}

// What an instance can matter for, as bits of its entry.
fn matters(bounds: Bounds, i: u32) -> u32 {
    let center = instances[i].center;
    let radius = instances[i].radius;
    if bounds.low.x > bounds.high.x || !bounds_above_surface(bounds, center, radius) {
        return 0u;
    }
    var bits = 0u;
    if instances[i].ambient_source != SOURCE_NONE && bounds_reached(bounds, center, radius) {
        bits |= AMBIENT_BIT;
    }
    for (var l = 0u; l < frame.light_count; l++) {
        if casts(i, l) && bounds_meet_light(bounds, frame.lights[l], center, radius) {
            bits |= light_bit(l);
        }
    }
    return bits;
}

// The instance of a number in a list; all instances are a list too.
fn candidate(first: u32, k: u32) -> u32 {
    if first == ALL_INSTANCES {
        return k;
    }
    return entry_index(atomicLoad(&lists[first + k]));
}

// Lists those of the candidates that matter within the bounds, and says where at `word`.
fn list(thread: u32, bounds: Bounds, first: u32, count: u32, word: u32) {
    if thread == 0u {
        atomicStore(&total, 0u);
    }
    workgroupBarrier();
    for (var k = thread; k < count; k += THREADS) {
        if matters(bounds, candidate(first, k)) != 0u {
            atomicAdd(&total, 1u);
        }
    }
    workgroupBarrier();
    if thread == 0u {
        let needed = atomicLoad(&total);
        let offset = atomicAdd(&lists[0], needed);
        let fits = offset <= frame.list_capacity && needed <= frame.list_capacity - offset;
        first_of_list = select(ALL_INSTANCES, first_entry() + offset, fits);
        atomicStore(&lists[word], first_of_list);
        atomicStore(&lists[word + 1u], select(frame.instance_count, needed, fits));
        atomicStore(&listed[0], 0u);
        atomicStore(&listed[1], 0u);
    }
    var next = workgroupUniformLoad(&first_of_list);
    if next == ALL_INSTANCES {
        return;
    }
    let end = next + atomicLoad(&total);
    for (var start = 0u; start < count; start += THREADS) {
        var entry = 0u;
        let k = start + thread;
        if k < count {
            let i = candidate(first, k);
            let bits = matters(bounds, i);
            if bits != 0u {
                entry = bits | i;
                atomicOr(&listed[thread >> 5u], 1u << (thread & 31u));
            }
        }
        workgroupBarrier();
        let low = atomicLoad(&listed[0]);
        let high = atomicLoad(&listed[1]);
        workgroupBarrier();
        if thread == 0u {
            atomicStore(&listed[0], 0u);
            atomicStore(&listed[1], 0u);
        }
        // Both times that a candidate is looked at must say the same; were they compiled differently, this keeps other lists whole.
        if entry != 0u && next < end {
            let below = (1u << (thread & 31u)) - 1u;
            let before = select(
                countOneBits(low & below),
                countOneBits(low) + countOneBits(high & below),
                thread >= 32u,
            );
            atomicStore(&lists[min(next + before, end - 1u)], entry);
        }
        next += countOneBits(low) + countOneBits(high);
        workgroupBarrier();
    }
}

@compute @workgroup_size(64)
fn list_blocks(@builtin(workgroup_id) block: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let tile = block.xy * BLOCK_SIDE + vec2<u32>(thread % BLOCK_SIDE, thread / BLOCK_SIDE);
    var bounds = empty_bounds();
    if all(tile < frame.tiles) {
        bounds = load_bounds(tile);
    }
    let all = join_parts(thread, bounds);
    workgroupBarrier();
    list(thread, all, ALL_INSTANCES, frame.instance_count, block_word(block.xy));
}

var<workgroup> of_block: array<u32, 2>;

@compute @workgroup_size(64)
fn list_tiles(@builtin(workgroup_id) tile: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    if thread == 0u {
        let word = block_word(tile.xy / BLOCK_SIDE);
        of_block[0] = atomicLoad(&lists[word]);
        of_block[1] = atomicLoad(&lists[word + 1u]);
    }
    let first_and_count = workgroupUniformLoad(&of_block);
    list(thread, load_bounds(tile.xy), first_and_count[0], first_and_count[1], tile_word(tile.xy));
}
