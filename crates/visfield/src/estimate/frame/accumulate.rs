//! Joins frames: the twin of `shaders/accumulate.wgsl`.

use glam::{IVec2, UVec2, Vec2, ivec2};

use super::{Channels, GeometryBuffer, TraceResolution, index, pixels};

/// How much a new frame counts against those before it. About eight frames are seen at once.
pub const BLEND: f32 = 0.15;

/// Half over the difference up to which what was accumulated counts fully; at three times that it does not.
const LIKENESS: f32 = 10.0;

/// Joins a filtered frame with what was accumulated before it, each of which sent other rays. What was accumulated moves with its
/// surface, and counts only as far as this frame's neighbourhood could show it too, so that shadows that have left do not stay
/// behind. `motion` is how far each pixel of the viewport moved since the frame before, as a share of the viewport.
///
/// ```
/// use glam::{Mat4, Vec2, Vec4, uvec2};
/// use visfield::estimate::frame::{GeometryBuffer, TraceResolution, accumulate::accumulate};
/// let size = uvec2(2, 1);
/// let geometry =
///     GeometryBuffer { world_from_clip: Mat4::IDENTITY, size, depth: vec![0.5; 2], normals: vec![Vec4::Z; 2] };
/// let (shadow, lit) = ([1.0; 12], [0.0; 12]);
/// let joined = accumulate(&geometry, TraceResolution::Full, &[lit; 2], &[shadow; 2], &[Vec2::ZERO; 2]);
/// assert_eq!(joined, [lit; 2]); // no neighbour is in the shadow any more
/// ```
///
/// # Panics
/// If `motion` does not hold one value per pixel, or the others one per pixel that is traced.
pub fn accumulate(
    geometry: &GeometryBuffer,
    resolution: TraceResolution,
    filtered: &[Channels],
    history: &[Channels],
    motion: &[Vec2],
) -> Vec<Channels> {
    let size = resolution.traced_size(geometry.size);
    let at = |pixel: UVec2| {
        let current = filtered[index(pixel, size)];
        let moved = motion[index(pixel * resolution.scale(), geometry.size)];
        let place = pixel.as_vec2() - moved * geometry.size.as_vec2() / resolution.scale() as f32;
        let (mut low, mut high) = (current, current);
        for (x, y) in (-1..=1).flat_map(|y| (-1..=1).map(move |x| (x, y))) {
            let neighbor = filtered[index(within(pixel.as_ivec2() + ivec2(x, y), size), size)];
            low = std::array::from_fn(|channel| low[channel].min(neighbor[channel]));
            high = std::array::from_fn(|channel| high[channel].max(neighbor[channel]));
        }
        let seen = place.cmpgt(Vec2::splat(-0.5)).all() && place.cmplt(size.as_vec2() - 0.5).all();
        if !seen {
            return current;
        }
        let history = history_at(history, size, place);
        std::array::from_fn(|channel| {
            let clamped = history[channel].clamp(low[channel], high[channel]);
            // What differs by more than noise does has changed.
            let unchanged = (1.5 - (clamped - current[channel]).abs() * LIKENESS).clamp(0.0, 1.0);
            let blend = 1.0 - (1.0 - BLEND) * unchanged;
            clamped * (1.0 - blend) + current[channel] * blend
        })
    };
    pixels(size).map(at).collect()
}

/// What was accumulated at a place between pixels.
fn history_at(history: &[Channels], size: UVec2, place: Vec2) -> Channels {
    let first = place.floor().as_ivec2();
    let share = place - place.floor();
    let texel = |offset: IVec2| history[index(within(first + offset, size), size)];
    let mix = |a: Channels, b: Channels, share: f32| -> Channels {
        std::array::from_fn(|channel| a[channel] * (1.0 - share) + b[channel] * share)
    };
    let upper = mix(texel(IVec2::ZERO), texel(IVec2::X), share.x);
    let lower = mix(texel(IVec2::Y), texel(IVec2::ONE), share.x);
    mix(upper, lower, share.y)
}

fn within(pixel: IVec2, size: UVec2) -> UVec2 {
    pixel.clamp(IVec2::ZERO, size.as_ivec2() - 1).as_uvec2()
}
