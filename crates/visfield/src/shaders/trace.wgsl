// The trace pass: a few rays per pixel and estimator, against every instance that can matter. Twin: estimate/frame.rs.
// Joined after field.wgsl, frame.wgsl and instance.wgsl.

// Points of the sphere (64 × ambient_rays), then points of the disc (16 × shadow_rays); what follows is of the caps pass.
@group(0) @binding(6) var<storage, read> samples: array<vec4<f32>>;
// Occlusion: ambient, and lights 0, 1, 2.
@group(0) @binding(7) var noisy_texture: texture_storage_2d<rgba16float, write>;

const AMBIENT_INTERLEAVE_BITS: u32 = 3u;
const LIGHT_INTERLEAVE_BITS: u32 = 2u;

fn residues(bits: u32) -> u32 {
    return 1u << (2u * bits);
}

fn interleave_index(x: u32, y: u32, bits: u32) -> u32 {
    let diagonal = x ^ y;
    var index = 0u;
    for (var bit = 0u; bit < bits; bit++) {
        index = (index << 2u) | (((diagonal >> bit) & 1u) << 1u) | ((y >> bit) & 1u);
    }
    return index;
}

fn disc_direction(light: Light, point: vec2<f32>) -> vec3<f32> {
    return normalize(light.axis + light.tangent * point.x + light.bitangent * point.y);
}

@compute @workgroup_size(8, 8)
fn trace(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= frame.viewport_size) {
        return;
    }
    let receiver = receiver_at(pixel);
    if receiver.depth == 0.0 {
        textureStore(noisy_texture, pixel, vec4<f32>(0.0));
        return;
    }
    let ambient_residue = interleave_index(pixel.x, pixel.y, AMBIENT_INTERLEAVE_BITS);
    let light_residue = interleave_index(pixel.x, pixel.y, LIGHT_INTERLEAVE_BITS);
    let ambient_stride = residues(AMBIENT_INTERLEAVE_BITS);
    let light_stride = residues(LIGHT_INTERLEAVE_BITS);
    let first_disc_sample = frame.ambient_rays * ambient_stride;
    let bias = Bias(frame.bias_height, frame.bias_along);
    // One bit per ray, set once something blocks it.
    var ambient_blocked = 0u;
    var light_blocked = array<u32, MAX_LIGHTS>(0u, 0u, 0u);

    for (var i = 0u; i < frame.instance_count; i++) {
        let to_center = instances[i].center - receiver.position;
        let radius = instances[i].radius;
        // What lies wholly below the horizon blocks no ray that counts.
        if instances[i].entries == 0u || !above_surface(to_center, radius, receiver.normal) {
            continue;
        }
        let within_reach = length(to_center) - radius < frame.max_distance;
        let asked = frame.ambient_rays > 0u && within_reach;
        let ambient_share = select(0.0, share_of_rays(instances[i].ambient_source, i, receiver.position), asked);
        if ambient_share <= 0.0 && frame.light_count == 0u {
            continue;
        }
        let shape = TableShape(
            instances[i].first_byte,
            instances[i].entries,
            instances[i].exits,
            instances[i].encoding,
        );
        let origin = transform(instances[i].field_from_world, vec4<f32>(receiver.position, 1.0));
        let normal = field_normal(instances[i], receiver.normal);
        if ambient_share > 0.0 {
            for (var ray = 0u; ray < frame.ambient_rays; ray++) {
                if (ambient_blocked & (1u << ray)) != 0u || !is_sent(ray, ambient_residue, ambient_share) {
                    continue;
                }
                let point = samples[ray * ambient_stride + ambient_residue].xyz;
                let direction = cosine_direction(receiver.normal, point);
                let along = transform(instances[i].field_from_world, vec4<f32>(direction, 0.0));
                if occluded(shape, origin, along, frame.max_distance, normal, bias) {
                    ambient_blocked |= 1u << ray;
                }
            }
        }
        for (var l = 0u; l < frame.light_count; l++) {
            let light = frame.lights[l];
            if dot(receiver.normal, light.axis) <= 0.0 || !meets_cone(to_center, radius, light) {
                continue;
            }
            var light_share = 1.0;
            if is_large(l) {
                light_share = share_of_rays(instances[i].light_source, i, receiver.position);
            }
            for (var ray = 0u; ray < frame.shadow_rays; ray++) {
                if (light_blocked[l] & (1u << ray)) != 0u || !is_sent(ray, light_residue, light_share) {
                    continue;
                }
                let point = samples[first_disc_sample + ray * light_stride + light_residue].xy;
                let direction = disc_direction(light, point);
                if dot(receiver.normal, direction) <= 0.0 {
                    continue;
                }
                let along = transform(instances[i].field_from_world, vec4<f32>(direction, 0.0));
                if occluded(shape, origin, along, NO_HIT, normal, bias) {
                    light_blocked[l] |= 1u << ray;
                }
            }
        }
    }

    var occlusion = vec4<f32>(0.0);
    occlusion.x = f32(countOneBits(ambient_blocked)) / f32(max(frame.ambient_rays, 1u));
    for (var l = 0u; l < frame.light_count; l++) {
        // Most pixels are lit: nothing to count.
        if light_blocked[l] == 0u {
            continue;
        }
        let light = frame.lights[l];
        // Of the disc, only what is above the receiver's horizon counts.
        var counted = 0u;
        for (var ray = 0u; ray < frame.shadow_rays; ray++) {
            let point = samples[first_disc_sample + ray * light_stride + light_residue].xy;
            counted += u32(dot(receiver.normal, disc_direction(light, point)) > 0.0);
        }
        occlusion[light.channel + 1u] = f32(countOneBits(light_blocked[l])) / f32(max(counted, 1u));
    }
    textureStore(noisy_texture, pixel, occlusion);
}
