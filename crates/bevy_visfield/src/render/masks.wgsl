// Inserted into Bevy's lighting: reads the light masks that lie in the occlusion texture. `masks.rs` says how.

const VISFIELD_RECT_LIGHTS: u32 = 11u;
const VISFIELD_MAX_RECT_LIGHTS: u32 = 8u;
const VISFIELD_CLUSTERED_LIGHTS: u32 = 19u;

// Texel of the header, counted from the marker upwards, row by row from the last.
fn visfield_header(texel: u32) -> vec4<f32> {
    let size = textureDimensions(view_bindings::screen_space_ambient_occlusion_texture);
    let at = vec2<u32>(texel % size.x, size.y - 1u - texel / size.x);
    return textureLoad(view_bindings::screen_space_ambient_occlusion_texture, at, 0);
}

// The mask in a channel, counted through the pages. Channel 0 is no mask.
fn visfield_mask(channel: u32, marker: vec4<f32>, frag_coord: vec2<f32>) -> f32 {
    if channel == 0u {
        return 1.0;
    }
    let size = textureDimensions(view_bindings::screen_space_ambient_occlusion_texture);
    let page_height = (size.y - u32(marker.b)) / u32(marker.g);
    let at = vec2<u32>(frag_coord) + vec2<u32>(0u, (channel / 4u) * page_height);
    return textureLoad(view_bindings::screen_space_ambient_occlusion_texture, at, 0)[channel % 4u];
}

// The mask that a texel of the header names.
fn visfield_visibility(texel: u32, frag_coord: vec2<f32>) -> f32 {
    let marker = visfield_header(0u);
    let size = textureDimensions(view_bindings::screen_space_ambient_occlusion_texture);
    // Bevy's own texture has but a red channel: no pages.
    if marker.g == 0.0 || texel >= u32(marker.b) * size.x {
        return 1.0;
    }
    return visfield_mask(u32(visfield_header(texel).r), marker, frag_coord);
}

fn visfield_directional_visibility(light: u32, frag_coord: vec2<f32>) -> f32 {
    return visfield_visibility(1u + light, frag_coord);
}

fn visfield_clustered_visibility(light: u32, frag_coord: vec2<f32>) -> f32 {
    return visfield_visibility(VISFIELD_CLUSTERED_LIGHTS + light, frag_coord);
}

fn visfield_mix_key(key: u32, values: vec3<f32>) -> u32 {
    var mixed = key;
    for (var i = 0; i < 3; i++) {
        // Denormal numbers count as 0, which devices may make of them anyway.
        let bits = select(bitcast<u32>(values[i]), 0u, abs(values[i]) < 1.1754944e-38);
        mixed = (mixed ^ bits) * 16777619u;
        mixed ^= mixed >> 15u;
    }
    return mixed;
}

// Rectangles are told apart by what they are: Bevy's order of them is not known outside it.
fn visfield_rect_visibility(light: u32, frag_coord: vec2<f32>) -> f32 {
    let marker = visfield_header(0u);
    if marker.g == 0.0 {
        return 1.0;
    }
    let rect = &view_bindings::lights.rect_lights[light];
    var mixed = visfield_mix_key(2166136261u, (*rect).position);
    mixed = visfield_mix_key(mixed, (*rect).right);
    mixed = visfield_mix_key(mixed, (*rect).up);
    mixed = visfield_mix_key(mixed, vec3<f32>((*rect).width, (*rect).height, (*rect).range));
    let key = vec3<f32>(vec3<u32>(mixed, mixed >> 11u, mixed >> 22u) & vec3<u32>(2047u));
    for (var i = 0u; i < VISFIELD_MAX_RECT_LIGHTS; i++) {
        let entry = visfield_header(VISFIELD_RECT_LIGHTS + i);
        if entry.r > 0.0 && all(entry.gba == key) {
            return visfield_mask(u32(entry.r), marker, frag_coord);
        }
    }
    return 1.0;
}
