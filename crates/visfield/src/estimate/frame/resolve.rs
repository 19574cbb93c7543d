//! A whole frame: the twin of `shaders/resolve.wgsl`.

use glam::{UVec2, Vec2, uvec2};

use super::denoise::{bilateral_weight, denoise, pixel_footprint};
use super::trace::{above_surface, is_spared, trace};
use super::{
    Channels, FrameOccluder, FrameReceiver, GeometryBuffer, MAX_LIGHTS, TraceResolution, TraceSettings, index, masked,
};
use crate::estimate::caps::{CapOccluder, ambient};
use crate::estimate::light::Light;
use crate::estimate::source::Answers;

/// All of a frame's visibility, of every pixel of the viewport: of ambient light, and of each light.
///
/// ```
/// use glam::{Mat4, Vec4, uvec2};
/// use visfield::estimate::frame::{GeometryBuffer, TraceSettings, resolve::visibility};
/// let geometry = GeometryBuffer {
///     world_from_clip: Mat4::perspective_infinite_reverse_rh(1.0, 1.0, 0.1).inverse(),
///     size: uvec2(2, 1),
///     depth: vec![0.05, 0.0], // a wall two units away, and the sky
///     normals: vec![Vec4::new(0.0, 0.0, 1.0, 1.0); 2],
/// };
/// assert_eq!(visibility(&geometry, &[], &[], &TraceSettings::default()), [[1.0; 12]; 2]); // nothing there to occlude
/// ```
///
/// # Panics
/// If depth or normals do not hold one value per pixel.
pub fn visibility(
    geometry: &GeometryBuffer,
    occluders: &[FrameOccluder],
    lights: &[Light],
    settings: &TraceSettings,
) -> Vec<Channels> {
    let noisy = trace(geometry, occluders, lights, settings);
    let filtered = denoise(geometry, noisy, settings);
    resolve(geometry, occluders, lights, settings, &filtered)
}

/// Joins what cap grids give with what was traced and filtered.
///
/// # Panics
/// If depth or normals do not hold one value per pixel, or `traced` one per pixel that is traced.
pub fn resolve(
    geometry: &GeometryBuffer,
    occluders: &[FrameOccluder],
    lights: &[Light],
    settings: &TraceSettings,
    traced: &[Channels],
) -> Vec<Channels> {
    let settings = settings.clamped();
    let wanted = settings.wanted();
    let of = |casts: fn(&FrameOccluder) -> bool| {
        let placed = occluders.iter().filter(move |occluder| casts(occluder));
        placed.filter_map(|occluder| Some((occluder, CapOccluder::new(occluder.placement, occluder.field, wanted)?)))
    };
    let answers_ambient = |occluder: &FrameOccluder| Answers::of(occluder.field).ambient(wanted).needs_no_rays();
    let of_ambient: Vec<_> =
        of(|occluder| occluder.casting.ambient).filter(|(occluder, _)| answers_ambient(occluder)).collect();
    let of_lights: Vec<_> = of(|occluder| occluder.casting.shadows).collect();
    let pixel = |pixel: UVec2| {
        let mut visibility = [1.0; 1 + MAX_LIGHTS];
        let receiver = geometry.receiver_at(pixel);
        if receiver.depth == 0.0 {
            return visibility;
        }
        let found = upsampled(geometry, settings.resolution, traced, pixel, &receiver);
        visibility = found.map(|occlusion| 1.0 - occlusion.clamp(0.0, 1.0));
        if receiver.flags.no_ambient {
            visibility[0] = 1.0;
        } else {
            let caps =
                ambient(&facing(&of_ambient, &receiver), receiver.position, receiver.normal, &settings.cap_settings());
            visibility[0] = (visibility[0] * (1.0 - caps.occlusion)).powf(settings.intensity);
        }
        for (light, visibility) in masked(lights).iter().zip(&mut visibility[1..]) {
            let view = light.seen_from(receiver.position);
            if !light.shines_on(&view, receiver.normal) {
                continue;
            }
            let (from, disc) = (receiver.cone_receiver(), view.disc(receiver.normal));
            for (occluder, cap) in of_lights.iter().filter(|(occluder, _)| !is_spared(occluder, &receiver)) {
                let source = light.source(occluder.field, wanted);
                let (to_center, radius) = (cap.placement().center - receiver.position, cap.placement().radius);
                if source.needs_no_rays()
                    && above_surface(to_center, radius, receiver.normal)
                    && view.meets(to_center, radius)
                {
                    *visibility *= 1.0 - cap.light_occlusion(source, &from, &disc, settings.bias);
                }
            }
        }
        visibility
    };
    geometry.pixels().map(pixel).collect()
}

/// The grids that a receiver is not spared.
fn facing<'a>(asked: &[(&FrameOccluder<'a>, CapOccluder<'a>)], receiver: &FrameReceiver) -> Vec<CapOccluder<'a>> {
    asked.iter().filter(|(occluder, _)| !is_spared(occluder, receiver)).map(|(_, cap)| *cap).collect()
}

/// Smallest sum of weights that is enough to go by.
const SMALLEST_WEIGHT: f32 = 0.01;

/// What was traced at a pixel of the viewport: by the four pixels of what was traced around it, as far as they show the same
/// surface. Where none does, the one that comes nearest to it counts alone.
fn upsampled(
    geometry: &GeometryBuffer,
    resolution: TraceResolution,
    traced: &[Channels],
    pixel: UVec2,
    center: &FrameReceiver,
) -> Channels {
    let size = resolution.traced_size(geometry.size);
    if resolution == TraceResolution::Full {
        return traced[index(pixel, size)];
    }
    let scale = resolution.scale();
    let first = pixel / scale;
    let step = (first + 1).min(size - 1) - first;
    let share = (pixel - first * scale).as_vec2() / scale as f32;
    let footprint = pixel_footprint(geometry, resolution, pixel, center);
    let corners = [uvec2(0, 0), uvec2(1, 0), uvec2(0, 1), uvec2(1, 1)];
    let neighbors = corners.map(|corner| geometry.receiver_at((first + step * corner) * scale));
    let mut weights: [f32; 4] = std::array::from_fn(|i| {
        let along = Vec2::select(corners[i].cmpeq(UVec2::ONE), share, 1.0 - share);
        along.x * along.y * bilateral_weight(center, &neighbors[i], footprint)
    });
    let total: f32 = weights.iter().sum();
    if total > SMALLEST_WEIGHT {
        weights = weights.map(|weight| weight / total);
    } else {
        let likeness = neighbors.map(|neighbor| {
            let off_plane = center.normal.dot(neighbor.position - center.position).abs() / footprint;
            let likeness = (2.0 + center.normal.dot(neighbor.normal)) / (1.0 + off_plane);
            if neighbor.depth > 0.0 { likeness } else { 0.0 }
        });
        let best = (0..4).fold(0, |best, i| if likeness[i] > likeness[best] { i } else { best });
        weights = std::array::from_fn(|i| f32::from(i == best));
    }
    std::array::from_fn(|channel| {
        (0..4).map(|i| traced[index(first + step * corners[i], size)][channel] * weights[i]).sum()
    })
}
