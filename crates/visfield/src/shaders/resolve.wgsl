// The resolve pass: joins what cap grids and cones give, what was traced and filtered, and Bevy's own screen-space ambient occlusion, and
// writes the frame. Twin: estimate/frame/resolve.rs. Joined after frame.wgsl, light.wgsl, instance.wgsl, lists.wgsl, listed.wgsl,
// caps.wgsl and surface.wgsl.

// Whether cap grids or cones are asked: at all, and for lights.
override WITHOUT_RAYS: bool = true;
override LIGHTS: bool = false;

// Visibility, by pages.
@group(0) @binding(8) var output_texture: texture_storage_2d<rgba16float, write>;
// Occlusion, by pages.
@group(0) @binding(9) var traced_texture: texture_2d<f32>;
// Ambient visibility.
@group(0) @binding(10) var screen_space_texture: texture_2d<f32>;

// Smallest sum of weights that is enough to go by.
const SMALLEST_WEIGHT: f32 = 0.01;

// The four pixels of what was traced around a pixel of the viewport, and how much each counts. Where none shows the same surface,
// the one that comes nearest to it counts alone.
struct Neighbors {
    first: vec2<u32>,
    step: vec2<u32>,
    weights: vec4<f32>,
}

fn neighbors(pixel: vec2<u32>, center: Receiver) -> Neighbors {
    let scale = frame.trace_scale;
    let first = pixel / scale;
    let step = min(first + 1u, frame.trace_size - 1u) - first;
    let share = vec2<f32>(pixel - first * scale) / f32(scale);
    let footprint = pixel_footprint(pixel, center);
    var weights = vec4<f32>(0.0);
    var nearest = vec4<f32>(0.0);
    var best = -1.0;
    for (var i = 0u; i < 4u; i++) {
        let corner = vec2<u32>(i & 1u, i >> 1u);
        let neighbor = receiver_at(traced_pixel(first + step * corner));
        let along = select(1.0 - share, share, corner == vec2<u32>(1u));
        weights[i] = along.x * along.y * bilateral_weight(center, neighbor, footprint);
        let off_plane = abs(dot(center.normal, neighbor.position - center.position)) / footprint;
        let likeness = select(0.0, (2.0 + dot(center.normal, neighbor.normal)) / (1.0 + off_plane), neighbor.depth > 0.0);
        if likeness > best {
            best = likeness;
            nearest = vec4<f32>(vec4<u32>(0u, 1u, 2u, 3u) == vec4<u32>(i));
        }
    }
    let total = dot(weights, vec4<f32>(1.0));
    let known = total > SMALLEST_WEIGHT;
    return Neighbors(first, step, select(nearest, weights / max(total, SMALLEST_WEIGHT), known));
}

// What was traced at a pixel of the viewport.
fn upsampled(around: Neighbors, page: u32) -> vec4<f32> {
    var occlusion = vec4<f32>(0.0);
    for (var i = 0u; i < 4u; i++) {
        let at = around.first + around.step * vec2<u32>(i & 1u, i >> 1u);
        occlusion += textureLoad(traced_texture, at + vec2<u32>(0u, page * frame.trace_size.y), 0) * around.weights[i];
    }
    return occlusion;
}

fn with_screen_space(visibility: f32, pixel: vec2<u32>) -> f32 {
    let other = textureLoad(screen_space_texture, pixel, 0).x;
    switch frame.screen_space {
        case 1u: { return min(visibility, other); }
        case 2u: { return visibility * other; }
        default: { return visibility; }
    }
}

@compute @workgroup_size(8, 8)
fn resolve(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= frame.viewport_size) {
        return;
    }
    let receiver = receiver_at(pixel);
    var visibility = array<vec4<f32>, 3>(vec4<f32>(1.0), vec4<f32>(1.0), vec4<f32>(1.0));
    if receiver.depth > 0.0 {
        if frame.traced != 0u {
            var around = Neighbors(pixel, vec2<u32>(0u), vec4<f32>(1.0, 0.0, 0.0, 0.0));
            if frame.trace_scale > 1u {
                around = neighbors(pixel, receiver);
            }
            for (var page = 0u; page < pages(); page++) {
                visibility[page] = 1.0 - clamp(upsampled(around, page), vec4<f32>(0.0), vec4<f32>(1.0));
            }
        }
        let list = list_at(pixel);
        if WITHOUT_RAYS && (receiver.flags & NO_AMBIENT) == 0u {
            visibility[0].x *= 1.0 - ambient(receiver, list).occlusion;
        }
        for (var l = 0u; LIGHTS && l < frame.light_count; l++) {
            let channel = l + 1u;
            visibility[channel / 4u][channel % 4u] *= light_visibility(receiver, list, l);
        }
        // No receiver of ours is also none that is upsampled from its neighbours.
        let of_fields = select(pow(max(visibility[0].x, SMALLEST), frame.intensity), 1.0, (receiver.flags & NO_AMBIENT) != 0u);
        visibility[0].x = with_screen_space(of_fields, pixel);
    }
    if frame.show_tile_load > 0u {
        visibility[0].x = max(1.0 - f32(list_at(pixel).count) / f32(frame.show_tile_load), 0.0);
    }
    for (var page = 0u; page < pages(); page++) {
        let at = pixel + frame.viewport_origin + vec2<u32>(0u, page * frame.page_rows);
        textureStore(output_texture, at, visibility[page]);
    }
}
