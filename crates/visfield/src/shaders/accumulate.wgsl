// The accumulate pass: joins a filtered frame with those before it, each of which sent other rays. What was accumulated moves with
// its surface, and counts only as far as this frame's neighbourhood could show it too, so that shadows that have left do not stay
// behind. Twin: estimate/frame/accumulate.rs. Joined after frame.wgsl.

// Occlusion, by pages: this frame's, and what was accumulated before it.
@group(0) @binding(3) var filtered_texture: texture_2d<f32>;
@group(0) @binding(4) var history_texture: texture_2d<f32>;
// How far each pixel of the viewport moved since the frame before, as a share of the viewport.
@group(0) @binding(5) var motion_texture: texture_2d<f32>;
@group(0) @binding(6) var accumulated_texture: texture_storage_2d<rgba16float, write>;

// Half over the difference up to which what was accumulated counts fully; at three times that it does not.
const LIKENESS: f32 = 10.0;

fn texel_in_page(pixel: vec2<i32>, page: u32) -> vec2<i32> {
    let within = clamp(pixel, vec2<i32>(0), vec2<i32>(frame.trace_size) - 1);
    return within + vec2<i32>(0, i32(page * frame.trace_size.y));
}

// What was accumulated at a place between pixels.
fn history_at(place: vec2<f32>, page: u32) -> vec4<f32> {
    let first = vec2<i32>(floor(place));
    let share = place - floor(place);
    let upper = mix(
        textureLoad(history_texture, texel_in_page(first, page), 0),
        textureLoad(history_texture, texel_in_page(first + vec2<i32>(1, 0), page), 0),
        share.x,
    );
    let lower = mix(
        textureLoad(history_texture, texel_in_page(first + vec2<i32>(0, 1), page), 0),
        textureLoad(history_texture, texel_in_page(first + vec2<i32>(1, 1), page), 0),
        share.x,
    );
    return mix(upper, lower, share.y);
}

@compute @workgroup_size(8, 8)
fn accumulate(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= frame.trace_size) {
        return;
    }
    let page = id.z;
    let at = vec2<i32>(id.xy);
    let current = textureLoad(filtered_texture, texel_in_page(at, page), 0);
    let pixel = traced_pixel(id.xy);
    let motion = textureLoad(motion_texture, pixel + frame.viewport_origin, 0).xy;
    let place = vec2<f32>(id.xy) - motion * vec2<f32>(frame.viewport_size) / f32(frame.trace_scale);
    var low = current;
    var high = current;
    for (var y = -1; y <= 1; y++) {
        for (var x = -1; x <= 1; x++) {
            let neighbor = textureLoad(filtered_texture, texel_in_page(at + vec2<i32>(x, y), page), 0);
            low = min(low, neighbor);
            high = max(high, neighbor);
        }
    }
    let seen = all(place > vec2<f32>(-0.5)) && all(place < vec2<f32>(frame.trace_size) - 0.5);
    let history = clamp(history_at(place, page), low, high);
    // What differs by more than noise does has changed.
    let unchanged = clamp(1.5 - abs(history - current) * LIKENESS, vec4<f32>(0.0), vec4<f32>(1.0));
    let blend = 1.0 - (1.0 - frame.blend) * unchanged;
    // Chosen, not weighted: a motion that is no number leaves no trace.
    let accumulated = select(current, mix(history, current, blend), seen);
    textureStore(accumulated_texture, texel_in_page(at, page), accumulated);
}
