//! Filters what rays found: the twin of `shaders/{denoise,surface}.wgsl`.

use glam::{IVec2, UVec2, Vec2};

use super::{Channels, FrameReceiver, GeometryBuffer, MAX_LIGHTS, TraceResolution, TraceSettings, index, pixels};
use crate::estimate::sampling::interleave_index;

/// Averages the interleaved patterns over the same surface, along rows and then along columns, as often as the settings say.
///
/// # Panics
/// If depth or normals do not hold one value per pixel, or `noisy` one per pixel that is traced.
pub fn denoise(geometry: &GeometryBuffer, noisy: Vec<Channels>, settings: &TraceSettings) -> Vec<Channels> {
    let resolution = settings.resolution;
    let filter = |picture: Vec<Channels>, along| {
        let line = |pixel| {
            let filtered = denoise_line(geometry, &picture, resolution, pixel, along);
            filtered.map(|occlusion| stored(occlusion + dither(pixel)))
        };
        pixels(resolution.traced_size(geometry.size)).map(line).collect()
    };
    (0..settings.clamped().denoise_passes).fold(noisy, |picture, _| filter(filter(picture, IVec2::X), IVec2::Y))
}

/// What a byte keeps of a share.
pub(super) fn stored(share: f32) -> f32 {
    (share.clamp(0.0, 1.0) * 255.0).round() / 255.0
}

/// What is added before a value becomes a byte, so that the bytes of a surface are right in their mean: less than half a step, so
/// that 0 and 1 stay what they are.
fn dither(pixel: UVec2) -> f32 {
    (interleave_index(pixel.x, pixel.y, 3) as f32 - 31.5) / 64.0 / 255.0
}

/// Taps to either side.
const REACH: i32 = 4;

fn denoise_line(
    geometry: &GeometryBuffer,
    noisy: &[Channels],
    resolution: TraceResolution,
    pixel: UVec2,
    along: IVec2,
) -> Channels {
    let size = resolution.traced_size(geometry.size);
    let last = size.as_ivec2() - 1;
    let center = geometry.receiver_at(pixel * resolution.scale());
    let own = noisy[index(pixel, size)];
    let mut sum = own;
    let mut total = [1.0; 1 + MAX_LIGHTS];
    if center.depth > 0.0 {
        let footprint = pixel_footprint(geometry, resolution, pixel * resolution.scale(), &center);
        for offset in -REACH..=REACH {
            let at = pixel.as_ivec2() + along * offset;
            if offset == 0 || at.cmplt(IVec2::ZERO).any() || at.cmpgt(last).any() {
                continue;
            }
            let at = at.as_uvec2();
            let neighbor = geometry.receiver_at(at * resolution.scale());
            let same = bilateral_weight(&center, &neighbor, footprint);
            for (channel, found) in noisy[index(at, size)].iter().enumerate() {
                let weight = pattern_weight(offset, channel) * likeness(own[channel], *found, channel) * same;
                sum[channel] += found * weight;
                total[channel] += weight;
            }
        }
    }
    std::array::from_fn(|channel| sum[channel] / total[channel])
}

/// How much a tap counts for ambient occlusion and for lights, whose patterns repeat every eight and four pixels: each
/// residue counts once, those at both ends half each.
fn pattern_weight(offset: i32, channel: usize) -> f32 {
    match (channel, offset.abs()) {
        (0, 4) | (1.., 2) => 0.5,
        (0, _) | (_, 0 | 1) => 1.0,
        _ => 0.0,
    }
}

/// 1 over the difference up to which taps count fully; at twice that they do not.
const LIKENESS: f32 = 3.0;

/// How far what a tap found can be the same as what the centre found, but for noise: across the edge of a shadow it is not.
/// Ambient occlusion has no such edges.
fn likeness(center: f32, found: f32, channel: usize) -> f32 {
    if channel == 0 { 1.0 } else { (2.0 - (found - center).abs() * LIKENESS).clamp(0.0, 1.0) }
}

/// How far a neighbour lies on the same surface, from 1 to 0 across depth edges and creases. `footprint` is the width of a
/// pixel of what is traced at the centre, in world units.
pub(super) fn bilateral_weight(center: &FrameReceiver, neighbor: &FrameReceiver, footprint: f32) -> f32 {
    if neighbor.depth == 0.0 {
        return 0.0;
    }
    let off_plane = center.normal.dot(neighbor.position - center.position).abs();
    let same_plane = (2.0 - off_plane / footprint).clamp(0.0, 1.0);
    let same_facing = (center.normal.dot(neighbor.normal) * 4.0 - 3.0).clamp(0.0, 1.0);
    same_plane * same_facing
}

/// Width of a pixel of what is traced at a receiver, in world units.
pub(super) fn pixel_footprint(
    geometry: &GeometryBuffer,
    resolution: TraceResolution,
    pixel: UVec2,
    center: &FrameReceiver,
) -> f32 {
    let beside = pixel.as_vec2() + Vec2::new(resolution.scale() as f32, 0.0);
    geometry.position_at(beside, center.depth).distance(center.position)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::frame::FrameOccluder;
    use crate::estimate::frame::tests::ground_from_above;
    use crate::estimate::frame::trace::trace;
    use crate::estimate::light::Light;
    use crate::field::ball_field;
    use crate::scene::Placement;
    use glam::{DAffine3, DVec3, Vec3, dvec3, vec3};

    #[test]
    fn denoising_hides_the_pattern_on_a_plane() {
        const SIDE: u32 = 96;
        let geometry = ground_from_above(UVec2::splat(SIDE));
        let field = ball_field(0.9, 65, 32);
        let world_from_mesh = DAffine3::from_translation(dvec3(0.0, -1.9, 0.0));
        let placement = Placement::new(&field.header().bounds, world_from_mesh, DVec3::ZERO).unwrap();
        // The first one shines from below.
        let lights = [Light::directional(-Vec3::Y, 0.2), Light::directional(vec3(0.3, 1.0, 0.1).normalize(), 0.2)];
        let noisy = trace(&geometry, &[FrameOccluder::new(placement, &field)], &lights, &TraceSettings::default());
        let smooth = denoise(&geometry, noisy.clone(), &TraceSettings::default());
        // Mean second difference along the middle rows: 0 for anything that changes evenly.
        let roughness = |image: &[Channels], channel: usize| {
            let curvature = |x: u32, y: u32| {
                let at = |x: u32| image[(y * SIDE + x) as usize][channel];
                (at(x) - 2.0 * at(x + 1) + at(x + 2)).abs()
            };
            (32..64).flat_map(|y| (32..62).map(move |x| curvature(x, y))).sum::<f32>() / (32.0 * 30.0)
        };
        assert!(roughness(&noisy, 0) > 0.05, "the pattern is there: {}", roughness(&noisy, 0));
        assert!(roughness(&smooth, 0) < 0.006, "and gone: {}", roughness(&smooth, 0));
        assert!(smooth.iter().all(|p| p[1] == 0.0 && p[3] == 0.0), "channels of absent lights stay empty");
        let center = smooth[(SIDE / 2 * SIDE + SIDE / 2) as usize];
        assert!((center[0] - 0.67).abs() < 0.03, "0.9²/1.1² of the sky: {}", center[0]);
        assert!(center[2] > 0.95, "in the umbra: {}", center[2]);
    }
}
