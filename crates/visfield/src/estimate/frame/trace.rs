//! Rays of every pixel that is traced: the twin of `shaders/trace.wgsl`.

use glam::{UVec2, Vec3};

use super::denoise::stored;
use super::tiles::within_reach;
use super::{Channels, FrameOccluder, FrameReceiver, GeometryBuffer, MAX_LIGHTS, TraceSettings, masked, pixels};
use crate::estimate::caps::CapOccluder;
use crate::estimate::light::{Light, LightKind};
use crate::estimate::sampling::{AMBIENT_INTERLEAVE_BITS, LIGHT_INTERLEAVE_BITS, interleave_index, residues};
use crate::estimate::source::{Answers, OcclusionSource};
use crate::estimate::{FacingOccluder, cosine_direction};

/// Traces every pixel of [what is traced](super::TraceResolution::traced_size), row by row. Noisy; see
/// [`denoise`](super::denoise::denoise), and [`visibility`](super::resolve::visibility) for an example.
///
/// # Panics
/// If depth or normals do not hold one value per pixel.
pub fn trace(
    geometry: &GeometryBuffer,
    occluders: &[FrameOccluder],
    lights: &[Light],
    settings: &TraceSettings,
) -> Vec<Channels> {
    let settings = settings.clamped();
    let (sphere, reaches) = (settings.sphere_samples(), settings.reaches());
    let (disc, square) = (settings.disc_samples(), settings.square_samples());
    let trace_pixel = |pixel: UVec2| {
        let mut occlusion = [0.0; 1 + MAX_LIGHTS];
        let receiver = geometry.receiver_at(pixel * settings.resolution.scale());
        if receiver.depth == 0.0 {
            return occlusion;
        }
        // What lies wholly below the horizon blocks no ray that counts.
        let above: Vec<Facing> = occluders.iter().filter_map(|occluder| Facing::new(occluder, &receiver)).collect();
        if !receiver.flags.no_ambient {
            let residue = interleave_index(pixel.x, pixel.y, AMBIENT_INTERLEAVE_BITS);
            let rays = own_samples(&sphere, residue, AMBIENT_INTERLEAVE_BITS);
            let rays = rays.zip(own_samples(&reaches, residue, AMBIENT_INTERLEAVE_BITS));
            let rays: Vec<Ray> = rays
                .map(|((number, &point), (_, &t_max))| Ray {
                    number,
                    direction: cosine_direction(receiver.normal, point),
                    t_max,
                })
                .collect();
            let reached: Vec<_> = above
                .iter()
                .filter(|facing| facing.occluder.casting.ambient && facing.is_reached(settings.max_distance))
                .map(|facing| (facing, facing.share_of_ambient_rays(&settings)))
                .collect();
            occlusion[0] = blocked_share(&rays, residue, &reached, &settings);
        }
        let residue = interleave_index(pixel.x, pixel.y, LIGHT_INTERLEAVE_BITS);
        for (light, occlusion) in masked(lights).iter().zip(&mut occlusion[1..]) {
            let view = light.seen_from(receiver.position);
            if !light.shines_on(&view, receiver.normal) {
                continue;
            }
            let met: Vec<_> = above
                .iter()
                .filter(|facing| {
                    facing.occluder.casting.shadows && view.meets(facing.to_center, facing.occluder.placement.radius)
                })
                .map(|facing| (facing, facing.share_of_light_rays(light, &settings)))
                .collect();
            let points = if light.kind == LightKind::Rectangle { &square } else { &disc };
            // Of the light, only what is above the receiver's horizon counts.
            let rays: Vec<Ray> = own_samples(points, residue, LIGHT_INTERLEAVE_BITS)
                .map(|(number, &point)| Ray { number, direction: view.direction(point), t_max: view.t_max })
                .filter(|ray| receiver.normal.dot(ray.direction) > 0.0)
                .collect();
            *occlusion = blocked_share(&rays, residue, &met, &settings);
        }
        occlusion.map(stored)
    };
    pixels(settings.resolution.traced_size(geometry.size)).map(trace_pixel).collect()
}

struct Ray {
    number: u32,
    direction: Vec3,
    t_max: f32,
}

/// An occluder of which something is above a receiver's horizon.
struct Facing<'a> {
    occluder: &'a FrameOccluder<'a>,
    rays: FacingOccluder<'a>,
    to_center: Vec3,
    position: Vec3,
}

impl<'a> Facing<'a> {
    fn new(occluder: &'a FrameOccluder<'a>, receiver: &FrameReceiver) -> Option<Self> {
        let to_center = occluder.placement.center - receiver.position;
        if !above_surface(to_center, occluder.placement.radius, receiver.normal) || is_spared(occluder, receiver) {
            return None;
        }
        let rays = FacingOccluder::new(&occluder.placement, occluder.field, receiver.position, receiver.normal);
        Some(Self { occluder, rays, to_center, position: receiver.position })
    }

    fn is_reached(&self, max_distance: f32) -> bool {
        within_reach(self.to_center, self.occluder.placement.radius, max_distance)
    }

    fn share_of_ambient_rays(&self, settings: &TraceSettings) -> f32 {
        self.share_of_rays(Answers::of(self.occluder.field).ambient(settings.wanted()), settings)
    }

    fn share_of_light_rays(&self, light: &Light, settings: &TraceSettings) -> f32 {
        self.share_of_rays(light.source(self.occluder.field, settings.wanted()), settings)
    }

    /// Which share of its rays a receiver sends to an occluder that is asked so.
    fn share_of_rays(&self, source: OcclusionSource, settings: &TraceSettings) -> f32 {
        let cap = || CapOccluder::new(self.occluder.placement, self.occluder.field, settings.wanted());
        source.share_of_rays(|| cap().map_or(0.0, |cap| cap.inside_share(self.position)))
    }
}

/// The share of rays that any of the occluders blocks, each of which is sent some share of them.
fn blocked_share(rays: &[Ray], residue: u32, occluders: &[(&Facing, f32)], settings: &TraceSettings) -> f32 {
    let blocked = |ray: &&Ray| {
        occluders.iter().any(|(facing, share)| {
            is_sent(ray.number, residue, *share) && facing.rays.blocks(ray.direction, ray.t_max, settings.bias)
        })
    };
    rays.iter().filter(blocked).count() as f32 / rays.len().max(1) as f32
}

/// Whether a ray belongs to the share that is sent. The pixels that share a pattern differ in which rays do, so that all of them
/// together send just that share.
fn is_sent(ray: u32, residue: u32, share: f32) -> bool {
    // The radical inverse of both numbers, those of the ray first.
    let turn = ((residue << RAY_BITS) | ray).reverse_bits() >> 8;
    (turn as f32) * (1.0 / 16_777_216.0) < share
}

/// Bits of the number of a ray, below [`MAX_RAYS`](super::MAX_RAYS).
const RAY_BITS: u32 = 5;

/// The samples of a shared pattern that the pixels of a residue take, numbered.
fn own_samples<T>(pattern: &[T], residue: u32, bits: u32) -> impl Iterator<Item = (u32, &T)> {
    (0..).zip(pattern.iter().skip(residue as usize).step_by(residues(bits) as usize))
}

/// Whether a bounding sphere can block any ray of the receiver's hemisphere.
pub(super) fn above_surface(to_center: Vec3, radius: f32, normal: Vec3) -> bool {
    to_center.dot(normal) > -radius
}

/// Whether an instance is the receiver's own, as far as is known, and does not occlude it.
pub(super) fn is_spared(occluder: &FrameOccluder, receiver: &FrameReceiver) -> bool {
    let origin = occluder.placement.field_from_world.transform_point3(receiver.position);
    receiver.flags.own_surface_off && !occluder.casting.own_surface && origin.dot(origin) < 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::vec3;

    #[test]
    fn culling_never_drops_what_can_block() {
        let view = Light::directional(Vec3::Y, 0.1).seen_from(Vec3::ZERO);
        assert!(view.meets(vec3(0.0, 5.0, 0.0), 1.0));
        assert!(view.meets(vec3(1.4, 5.0, 0.0), 1.0), "the cone is 0.5 wide there");
        assert!(!view.meets(vec3(1.6, 5.0, 0.0), 1.0));
        assert!(!view.meets(vec3(0.0, -1.1, 0.0), 1.0), "behind");
        assert!(view.meets(vec3(0.5, -0.5, 0.0), 1.0), "around the receiver");
        assert!(above_surface(vec3(0.0, -0.9, 0.0), 1.0, Vec3::Y));
        assert!(!above_surface(vec3(0.0, -1.1, 0.0), 1.0, Vec3::Y));
    }
}
