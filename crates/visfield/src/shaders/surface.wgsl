// Which pixels show the same surface, for the passes that filter. Twin: estimate/frame/denoise.rs. Joined after frame.wgsl.

// How far a neighbour lies on the same surface, from 1 to 0 across depth edges and creases. `footprint` is the width of a
// pixel of what is traced at the centre, in world units.
fn bilateral_weight(center: Receiver, neighbor: Receiver, footprint: f32) -> f32 {
    if neighbor.depth == 0.0 {
        return 0.0;
    }
    let off_plane = abs(dot(center.normal, neighbor.position - center.position));
    let same_plane = clamp(2.0 - off_plane / footprint, 0.0, 1.0);
    let same_facing = clamp(dot(center.normal, neighbor.normal) * 4.0 - 3.0, 0.0, 1.0);
    return same_plane * same_facing;
}

// Width of a pixel of what is traced at a receiver, in world units.
fn pixel_footprint(pixel: vec2<u32>, center: Receiver) -> f32 {
    let beside = position_at(vec2<f32>(pixel) + vec2<f32>(f32(frame.trace_scale), 0.0), center.depth);
    return distance(beside, center.position);
}
