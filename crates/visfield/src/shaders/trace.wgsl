// The trace pass: a few rays per pixel, for ambient occlusion and for each light, against the instances that can matter there.
// Twin: estimate/frame/trace.rs. Joined after field.wgsl, frame.wgsl, light.wgsl, instance.wgsl, lists.wgsl and listed.wgsl.

// Points of the sphere and how far their rays reach (64 × ambient_rays), then points of the disc and of the square (16 ×
// shadow_rays of each).
@group(0) @binding(6) var<storage, read> samples: array<vec4<f32>>;
// Occlusion, by pages. Bytes hold shares of up to 32 rays, and half as much memory.
@group(0) @binding(8) var noisy_texture: texture_storage_2d<rgba8unorm, write>;

const AMBIENT_INTERLEAVE_BITS: u32 = 3u;
const LIGHT_INTERLEAVE_BITS: u32 = 2u;

fn residues(bits: u32) -> u32 {
    return 1u << (2u * bits);
}

// All rays of a number, as bits.
fn all_rays(count: u32) -> u32 {
    return select((1u << count) - 1u, 0xffffffffu, count >= 32u);
}

// The share of the receiver's rays that is blocked.
fn ambient_occlusion(receiver: Receiver, list: List, residue: u32) -> f32 {
    let stride = residues(AMBIENT_INTERLEAVE_BITS);
    let bias = Bias(frame.bias_height, frame.bias_along);
    let all = all_rays(frame.ambient_rays);
    // One bit per ray, until something blocks it.
    var open = all;
    for (var k = 0u; k < list.count && open != 0u; k++) {
        let entry = entry(list, k);
        let i = entry_index(entry);
        let to_center = instances[i].center - receiver.position;
        let radius = instances[i].radius;
        // What lies wholly below the horizon blocks no ray that counts.
        if (entry & AMBIENT_BIT) == 0u
            || !above_surface(to_center, radius, receiver.normal)
            || !within_reach(to_center, radius) {
            continue;
        }
        let share = share_of_rays(instances[i].ambient_source, i, receiver.position);
        if share <= 0.0 || is_spared(i, receiver) {
            continue;
        }
        let asked = asked(i, receiver);
        var rays = open;
        while rays != 0u {
            let ray = firstTrailingBit(rays);
            rays &= rays - 1u;
            if !is_sent(ray, residue, share) {
                continue;
            }
            let point = samples[ray * stride + residue];
            let direction = cosine_direction(receiver.normal, point.xyz);
            if blocks_ray(asked, i, direction, point.w, bias) {
                open &= ~(1u << ray);
            }
        }
    }
    return f32(countOneBits(all & ~open)) / f32(max(frame.ambient_rays, 1u));
}

// The hidden share of a light, of what is above the receiver's horizon.
fn light_occlusion(receiver: Receiver, list: List, residue: u32, l: u32) -> f32 {
    let light = frame.lights[l];
    let view = seen_from(light, receiver.position);
    if !shines_on(light, view, receiver.normal) {
        return 0.0;
    }
    let stride = residues(LIGHT_INTERLEAVE_BITS);
    var first_sample = frame.ambient_rays * residues(AMBIENT_INTERLEAVE_BITS) + residue;
    if light.kind == RECTANGLE {
        first_sample += frame.shadow_rays * stride;
    }
    var above = 0u;
    for (var ray = 0u; ray < frame.shadow_rays; ray++) {
        let direction = light_direction(view, samples[first_sample + ray * stride].xy);
        above |= select(0u, 1u << ray, dot(receiver.normal, direction) > 0.0);
    }
    let bias = Bias(frame.bias_height, frame.bias_along);
    var open = above;
    for (var k = 0u; k < list.count && open != 0u; k++) {
        let entry = entry(list, k);
        let i = entry_index(entry);
        let to_center = instances[i].center - receiver.position;
        let radius = instances[i].radius;
        if (entry & light_bit(l)) == 0u
            || !casts(i, l)
            || !above_surface(to_center, radius, receiver.normal)
            || !meets_light(view, to_center, radius) {
            continue;
        }
        let share = share_of_rays(source_for(i, l), i, receiver.position);
        if share <= 0.0 || is_spared(i, receiver) {
            continue;
        }
        let asked = asked(i, receiver);
        var rays = open;
        while rays != 0u {
            let ray = firstTrailingBit(rays);
            rays &= rays - 1u;
            if !is_sent(ray, residue, share) {
                continue;
            }
            let direction = light_direction(view, samples[first_sample + ray * stride].xy);
            if blocks_ray(asked, i, direction, view.t_max, bias) {
                open &= ~(1u << ray);
            }
        }
    }
    return f32(countOneBits(above & ~open)) / f32(max(countOneBits(above), 1u));
}

fn table_shape(i: u32) -> TableShape {
    return TableShape(instances[i].first_byte, instances[i].entries, instances[i].exits, instances[i].encoding);
}

// An instance as a receiver asks it: the receiver in the space of the table, or of the distances.
struct Asked {
    origin: vec3<f32>,
    normal: vec3<f32>,
    by_distance: bool,
    shape: TableShape,
    source: DistanceSource,
}

// VisibilityField::answering: of a composite, the table from outside the bounds and the distances from inside.
fn asked(i: u32, receiver: Receiver) -> Asked {
    let origin = transform(instances[i].field_from_world, vec4<f32>(receiver.position, 1.0));
    let distance = instances[i].distance;
    let by_distance = distance != NO_DISTANCE && (instances[i].entries == 0u || dot(origin, origin) < 1.0);
    if by_distance {
        let rows = instances[i].distance_from_world;
        let local = transform(rows, vec4<f32>(receiver.position, 1.0));
        return Asked(local, mapped_normal(rows, receiver.normal), true, TableShape(), distance_source(distance));
    }
    let normal = mapped_normal(instances[i].field_from_world, receiver.normal);
    return Asked(origin, normal, false, table_shape(i), DistanceSource());
}

// Whether it blocks the ray in a direction of the world: FacingOccluder::blocks.
fn blocks_ray(asked: Asked, i: u32, direction: vec3<f32>, t_max: f32, bias: Bias) -> bool {
    if asked.by_distance {
        let along = transform(instances[i].distance_from_world, vec4<f32>(direction, 0.0));
        return distance_occluded(asked.source, asked.origin, along, t_max, asked.normal, bias);
    }
    let along = transform(instances[i].field_from_world, vec4<f32>(direction, 0.0));
    return occluded(asked.shape, asked.origin, along, t_max, asked.normal, bias);
}

@compute @workgroup_size(8, 8)
fn trace(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= frame.trace_size) {
        return;
    }
    let receiver = receiver_at(traced_pixel(pixel));
    var occlusion = array<vec4<f32>, 3>();
    if receiver.depth > 0.0 {
        let list = list_at(traced_pixel(pixel));
        if frame.ambient_rays > 0u && (receiver.flags & NO_AMBIENT) == 0u {
            let residue = interleave_index(pixel.x, pixel.y, AMBIENT_INTERLEAVE_BITS);
            occlusion[0].x = ambient_occlusion(receiver, list, residue);
        }
        let residue = interleave_index(pixel.x, pixel.y, LIGHT_INTERLEAVE_BITS);
        for (var l = 0u; l < frame.light_count && frame.shadow_rays > 0u; l++) {
            let channel = l + 1u;
            occlusion[channel / 4u][channel % 4u] = light_occlusion(receiver, list, residue, l);
        }
    }
    for (var page = 0u; page < pages(); page++) {
        textureStore(noisy_texture, pixel + vec2<u32>(0u, page * frame.trace_size.y), occlusion[page]);
    }
}
