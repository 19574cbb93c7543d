// Stands in for the distances of fields until those arrive: closed forms, chosen by their number.

fn surface_distance(position: vec3<f32>) -> f32 {
    if surface.source == 0u {
        return length(position) - 1.0;
    }
    if surface.source >= 2u {
        let half_extents = select(vec3(0.5, 0.7, 0.4), vec3(0.8, 0.5, 0.01), surface.source == 3u);
        let beyond = abs(position) - half_extents;
        return length(max(beyond, vec3(0.0))) + min(max(beyond.x, max(beyond.y, beyond.z)), 0.0);
    }
    return length(vec2(length(position.xz) - 0.75, position.y)) - 0.25;
}
