//! A frame's occlusion on the CPU: the twin of `shaders/{frame,instance,trace,denoise}.wgsl`, function by function.
//!
//! It exists to check the shaders against, and to compute frames without a GPU. All positions are relative to the camera.

use glam::{IVec2, Mat4, UVec2, Vec2, Vec3, Vec4, uvec2, vec2};

use super::caps::{CapCombination, CapOccluder, CapSettings, ambient};
use super::sampling::{
    AMBIENT_INTERLEAVE_BITS, DiscBasis, LIGHT_INTERLEAVE_BITS, disc_samples, interleave_index, residues, sphere_samples,
};
use super::source::{LARGE_LIGHT, OcclusionSource};
use super::{FacingOccluder, cosine_direction};
use crate::field::VisibilityField;
use crate::field::query::Bias;
use crate::scene::Placement;

/// Directional lights that one frame can mask: the occlusion texture's channels beside ambient occlusion.
pub const MAX_LIGHTS: usize = 3;
/// Most rays per pixel and estimator: the bits of the shader's masks.
pub const MAX_RAYS: u32 = 32;

/// How a frame is traced.
///
/// ```
/// use visfield::estimate::frame::TraceSettings;
/// let settings = TraceSettings { ambient_rays: 4, ..TraceSettings::default() };
/// assert_eq!(settings.sphere_samples().len(), 4 * 64); // shared by squares of 8×8 pixels
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceSettings {
    /// Whether ambient occlusion, and that of [large lights](FrameLight::is_large), comes from the cap grids of fields that have
    /// one for it, and how they combine. Others get rays.
    pub caps: Option<CapCombination>,
    /// Ambient occlusion rays per pixel, 0 (none) to [`MAX_RAYS`]. The denoiser sees 64 times as many. Without rays, fields that
    /// no cap grid answers for do not occlude, and neither do others where their grid leaves receivers to rays.
    pub ambient_rays: u32,
    /// Rays per pixel and light, 0 (none) to [`MAX_RAYS`]. The denoiser sees 16 times as many.
    pub shadow_rays: u32,
    /// Ambient occlusion ignores hits beyond this distance, in world units. Infinity counts all.
    pub max_distance: f32,
    /// How near to the receiver hits do not count.
    pub bias: Bias,
}

impl Default for TraceSettings {
    fn default() -> Self {
        Self { caps: None, ambient_rays: 8, shadow_rays: 8, max_distance: f32::INFINITY, bias: Bias::default() }
    }
}

impl TraceSettings {
    /// The same with every number inside its range; a NaN distance becomes infinite.
    #[must_use]
    pub fn clamped(self) -> Self {
        Self {
            caps: self.caps,
            ambient_rays: self.ambient_rays.min(MAX_RAYS),
            shadow_rays: self.shadow_rays.min(MAX_RAYS),
            max_distance: if self.max_distance.is_nan() { f32::INFINITY } else { self.max_distance.max(0.0) },
            bias: self.bias,
        }
    }

    /// How cap grids are asked.
    pub fn cap_settings(&self) -> CapSettings {
        CapSettings { combination: self.caps.unwrap_or_default(), max_distance: self.max_distance }
    }

    /// The points of the sphere that 8×8 pixels share for ambient occlusion.
    pub fn sphere_samples(&self) -> Vec<Vec3> {
        sphere_samples(self.ambient_rays * residues(AMBIENT_INTERLEAVE_BITS))
    }

    /// The points of the disc that 4×4 pixels share for each light.
    pub fn disc_samples(&self) -> Vec<Vec2> {
        disc_samples(self.shadow_rays * residues(LIGHT_INTERLEAVE_BITS))
    }
}

/// A directional light of a frame.
///
/// ```
/// use glam::Vec3;
/// use visfield::estimate::frame::FrameLight;
/// let sun = FrameLight::new(0, Vec3::Y, 0.00465);
/// assert_eq!(sun.channel, 0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameLight {
    /// Which mask of the output it fills, below [`MAX_LIGHTS`]; a light with another channel is ignored.
    pub channel: usize,
    /// The light's disc in the sky.
    pub disc: DiscBasis,
    /// Half the angle that the disc covers, in radians.
    pub angular_radius: f32,
}

impl FrameLight {
    /// The light towards `to_light` (a unit vector) that fills mask `channel`. The angular radius is in radians and is
    /// clamped as [`DiscBasis`] says.
    pub fn new(channel: usize, to_light: Vec3, angular_radius: f32) -> Self {
        let angular_radius = DiscBasis::clamp_angular_radius(angular_radius);
        Self { channel, disc: DiscBasis::new(to_light, angular_radius), angular_radius }
    }

    /// Whether it counts, and shines on surfaces with this normal.
    fn shines_on(&self, normal: Vec3) -> bool {
        self.channel < MAX_LIGHTS && normal.dot(self.disc.axis) > 0.0
    }

    /// Whether cap grids can hide it.
    pub fn is_large(&self) -> bool {
        self.angular_radius >= LARGE_LIGHT
    }
}

/// A surface point of the frame, relative to the camera; depth 0 (infinity, reversed z) means there is none. See
/// [`occlusion`] for an example.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameReceiver {
    /// Where it is, relative to the camera.
    pub position: Vec3,
    /// Its unit normal.
    pub normal: Vec3,
    /// Depth buffer value, 1 at the near plane.
    pub depth: f32,
}

/// A frame's depth and normals, and where they lie. See [`occlusion`] for an example.
#[derive(Clone, Debug)]
pub struct GeometryBuffer {
    /// From clip space to the world relative to the camera.
    pub world_from_clip: Mat4,
    /// Width and height in pixels.
    pub size: UVec2,
    /// Depth per pixel, rows from the top; reversed z.
    pub depth: Vec<f32>,
    /// Normal per pixel.
    pub normals: Vec<Vec3>,
}

impl GeometryBuffer {
    /// The point of the camera-relative world behind a position in the frame, in pixels from its top left corner.
    pub fn position_at(&self, pixel: Vec2, depth: f32) -> Vec3 {
        let uv = (pixel + 0.5) / self.size.as_vec2();
        let ndc = vec2(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0);
        let position = self.world_from_clip * Vec4::new(ndc.x, ndc.y, depth, 1.0);
        position.truncate() / position.w
    }

    /// The receiver at a pixel.
    pub fn receiver_at(&self, pixel: UVec2) -> FrameReceiver {
        let index = self.index(pixel);
        let (depth, normal) = (self.depth[index], self.normals[index]);
        FrameReceiver { position: self.position_at(pixel.as_vec2(), depth), normal: normal.normalize(), depth }
    }

    /// All pixels, row by row.
    pub fn pixels(&self) -> impl Iterator<Item = UVec2> + use<> {
        let size = self.size;
        (0..size.y).flat_map(move |y| (0..size.x).map(move |x| uvec2(x, y)))
    }

    fn index(&self, pixel: UVec2) -> usize {
        (pixel.y * self.size.x + pixel.x) as usize
    }
}

/// Traces every pixel: ambient occlusion in x, the occlusion of the lights by channel in y, z, w. Noisy; see [`denoise`], and
/// [`occlusion`] for an example.
///
/// # Panics
/// If depth or normals do not hold one value per pixel.
pub fn trace(
    geometry: &GeometryBuffer,
    instances: &[(Placement, &VisibilityField)],
    lights: &[FrameLight],
    settings: &TraceSettings,
) -> Vec<Vec4> {
    let settings = settings.clamped();
    let (sphere, disc) = (settings.sphere_samples(), settings.disc_samples());
    let trace_pixel = |pixel: UVec2| {
        let receiver = geometry.receiver_at(pixel);
        if receiver.depth == 0.0 {
            return Vec4::ZERO;
        }
        let to_center = |placement: &Placement| placement.center - receiver.position;
        // What lies wholly below the horizon blocks no ray that counts.
        let above: Vec<FacingOccluder> = instances
            .iter()
            .filter(|(placement, _)| above_surface(to_center(placement), placement.radius, receiver.normal))
            .map(|placed| FacingOccluder::new(placed, receiver.position, receiver.normal))
            .collect();
        let mut occlusion = Vec4::ZERO;
        let within_reach = |occluder: &&FacingOccluder| {
            to_center(occluder.placement).length() - occluder.placement.radius < settings.max_distance
        };
        let share = |occluder: &FacingOccluder| {
            let source = OcclusionSource::of(occluder.field, settings.caps.is_some());
            share_of_rays(occluder, receiver.position, source)
        };
        let reached: Vec<_> = above.iter().filter(within_reach).map(|occluder| (occluder, share(occluder))).collect();
        let residue = interleave_index(pixel.x, pixel.y, AMBIENT_INTERLEAVE_BITS);
        let count = own_samples(&sphere, residue, AMBIENT_INTERLEAVE_BITS)
            .filter(|&(ray, &point)| {
                let direction = cosine_direction(receiver.normal, point);
                let blocks = |&(occluder, share): &(&FacingOccluder, f32)| {
                    is_sent(ray, residue, share) && occluder.blocks(direction, settings.max_distance, settings.bias)
                };
                reached.iter().any(blocks)
            })
            .count();
        occlusion.x = count as f32 / settings.ambient_rays.max(1) as f32;
        let residue = interleave_index(pixel.x, pixel.y, LIGHT_INTERLEAVE_BITS);
        for light in lights.iter().filter(|light| light.shines_on(receiver.normal)) {
            let in_cone = |occluder: &&FacingOccluder| {
                meets_cone(to_center(occluder.placement), occluder.placement.radius, light)
            };
            let share = |occluder: &FacingOccluder| {
                let large = light.is_large() && settings.caps.is_some();
                let source = OcclusionSource::of_large_lights(occluder.field, large);
                share_of_rays(occluder, receiver.position, source)
            };
            let in_cone: Vec<_> = above.iter().filter(in_cone).map(|occluder| (occluder, share(occluder))).collect();
            // Of the disc, only what is above the receiver's horizon counts.
            let rays: Vec<(u32, Vec3)> = own_samples(&disc, residue, LIGHT_INTERLEAVE_BITS)
                .map(|(ray, &point)| (ray, light.disc.direction(point)))
                .filter(|(_, direction)| receiver.normal.dot(*direction) > 0.0)
                .collect();
            let blocked = |&&(ray, direction): &&(u32, Vec3)| {
                let blocks = |&(occluder, share): &(&FacingOccluder, f32)| {
                    is_sent(ray, residue, share) && occluder.blocks(direction, f32::INFINITY, settings.bias)
                };
                in_cone.iter().any(blocks)
            };
            let count = rays.iter().filter(blocked).count();
            occlusion[light.channel + 1] = count as f32 / rays.len().max(1) as f32;
        }
        occlusion
    };
    geometry.pixels().map(trace_pixel).collect()
}

/// Which share of its rays a receiver sends to an occluder that is asked so.
fn share_of_rays(occluder: &FacingOccluder, position: Vec3, source: OcclusionSource) -> f32 {
    let cap = || CapOccluder::new(*occluder.placement, occluder.field);
    source.share_of_rays(|| cap().map_or(0.0, |cap| cap.inside_share(position)))
}

/// Whether a ray belongs to the share that is sent. The pixels that share a pattern differ in which rays do, so that all of them
/// together send just that share.
fn is_sent(ray: u32, residue: u32, share: f32) -> bool {
    // The radical inverse of both numbers, those of the ray first.
    let turn = ((residue << RAY_BITS) | ray).reverse_bits() >> 8;
    (turn as f32) * (1.0 / 16_777_216.0) < share
}

/// Bits of the number of a ray, below [`MAX_RAYS`].
const RAY_BITS: u32 = 5;

/// What cap grids give every pixel, without noise: ambient occlusion in x, the occlusion of large lights by channel in y, z, w;
/// of the instances that they answer for.
///
/// # Panics
/// If depth or normals do not hold one value per pixel.
pub fn caps(
    geometry: &GeometryBuffer,
    instances: &[(Placement, &VisibilityField)],
    lights: &[FrameLight],
    settings: &TraceSettings,
) -> Vec<Vec4> {
    let settings = settings.clamped();
    let wanted = settings.caps.is_some();
    let answered_for = |source: fn(&VisibilityField, bool) -> OcclusionSource| -> Vec<CapOccluder> {
        let asked = instances.iter().filter(|(_, field)| source(field, wanted).has_caps());
        asked.filter_map(|(placement, field)| CapOccluder::new(*placement, field)).collect()
    };
    let (of_ambient, of_lights) = (answered_for(OcclusionSource::of), answered_for(OcclusionSource::of_large_lights));
    let pixel = |pixel: UVec2| {
        let FrameReceiver { position, normal, depth } = geometry.receiver_at(pixel);
        if depth == 0.0 {
            return Vec4::ZERO;
        }
        let mut occlusion = Vec4::ZERO;
        occlusion.x = ambient(&of_ambient, position, normal, &settings.cap_settings()).occlusion;
        for light in lights.iter().filter(|light| light.is_large() && light.shines_on(normal)) {
            let in_cone = |occluder: &&CapOccluder| {
                let (to_center, radius) = (occluder.placement().center - position, occluder.placement().radius);
                above_surface(to_center, radius, normal) && meets_cone(to_center, radius, light)
            };
            let visible = |occluder: &CapOccluder| {
                1.0 - occluder.light_occlusion(position, light.disc.axis, light.angular_radius)
            };
            occlusion[light.channel + 1] = 1.0 - of_lights.iter().filter(in_cone).map(visible).product::<f32>();
        }
        occlusion
    };
    geometry.pixels().map(pixel).collect()
}

/// All of a frame's occlusion: what is traced and denoised, and what cap grids add.
///
/// ```
/// use glam::{Mat4, Vec3, Vec4, uvec2};
/// use visfield::estimate::frame::{GeometryBuffer, TraceSettings, occlusion};
/// let geometry = GeometryBuffer {
///     world_from_clip: Mat4::perspective_infinite_reverse_rh(1.0, 1.0, 0.1).inverse(),
///     size: uvec2(2, 1),
///     depth: vec![0.05, 0.0], // a wall two units away, and the sky
///     normals: vec![Vec3::Z; 2],
/// };
/// assert_eq!(occlusion(&geometry, &[], &[], &TraceSettings::default()), [Vec4::ZERO; 2]); // nothing there to occlude
/// ```
///
/// # Panics
/// If depth or normals do not hold one value per pixel.
pub fn occlusion(
    geometry: &GeometryBuffer,
    instances: &[(Placement, &VisibilityField)],
    lights: &[FrameLight],
    settings: &TraceSettings,
) -> Vec<Vec4> {
    let mut occlusion = denoise(geometry, &trace(geometry, instances, lights, settings));
    for (all, caps) in occlusion.iter_mut().zip(caps(geometry, instances, lights, settings)) {
        *all = 1.0 - (1.0 - *all) * (1.0 - caps);
    }
    occlusion
}

/// The samples of a shared pattern that the pixels of a residue take, numbered.
fn own_samples<T>(pattern: &[T], residue: u32, bits: u32) -> impl Iterator<Item = (u32, &T)> {
    (0..).zip(pattern.iter().skip(residue as usize).step_by(residues(bits) as usize))
}

/// Averages the interleaved patterns over the same surface, along rows and then along columns. (The shader's pass over
/// columns also encodes the result, see `gpu::OUTPUT_FORMAT`.)
///
/// # Panics
/// If `noisy`, depth or normals do not hold one value per pixel.
pub fn denoise(geometry: &GeometryBuffer, noisy: &[Vec4]) -> Vec<Vec4> {
    let rows: Vec<Vec4> = geometry.pixels().map(|pixel| denoise_line(geometry, noisy, pixel, IVec2::X)).collect();
    let column = |pixel| denoise_line(geometry, &rows, pixel, IVec2::Y).clamp(Vec4::ZERO, Vec4::ONE);
    geometry.pixels().map(column).collect()
}

/// Taps to either side.
const REACH: i32 = 4;

fn denoise_line(geometry: &GeometryBuffer, noisy: &[Vec4], pixel: UVec2, along: IVec2) -> Vec4 {
    let last = geometry.size.as_ivec2() - 1;
    let center = geometry.receiver_at(pixel);
    let mut sum = noisy[geometry.index(pixel)];
    let mut total = Vec4::ONE;
    if center.depth > 0.0 {
        let footprint = pixel_footprint(geometry, pixel, &center);
        for offset in -REACH..=REACH {
            let at = pixel.as_ivec2() + along * offset;
            if offset == 0 || at.cmplt(IVec2::ZERO).any() || at.cmpgt(last).any() {
                continue;
            }
            let at = at.as_uvec2();
            let weight = pattern_weight(offset) * bilateral_weight(&center, &geometry.receiver_at(at), footprint);
            sum += noisy[geometry.index(at)] * weight;
            total += weight;
        }
    }
    sum / total
}

/// How much a tap counts for ambient occlusion and for lights, whose patterns repeat every eight and four pixels: each
/// residue counts once, those at both ends half each.
fn pattern_weight(offset: i32) -> Vec4 {
    let ambient = if offset.abs() == 4 { 0.5 } else { 1.0 };
    let light = match offset.abs() {
        0 | 1 => 1.0,
        2 => 0.5,
        _ => 0.0,
    };
    Vec4::new(ambient, light, light, light)
}

/// How far a neighbour lies on the same surface, from 1 to 0 across depth edges and creases. `footprint` is the width of a
/// pixel at the centre, in world units.
fn bilateral_weight(center: &FrameReceiver, neighbor: &FrameReceiver, footprint: f32) -> f32 {
    if neighbor.depth == 0.0 {
        return 0.0;
    }
    let off_plane = center.normal.dot(neighbor.position - center.position).abs();
    let same_plane = (2.0 - off_plane / footprint).clamp(0.0, 1.0);
    let same_facing = (center.normal.dot(neighbor.normal) * 4.0 - 3.0).clamp(0.0, 1.0);
    same_plane * same_facing
}

/// Width of a pixel at a receiver, in world units.
fn pixel_footprint(geometry: &GeometryBuffer, pixel: UVec2, center: &FrameReceiver) -> f32 {
    geometry.position_at(pixel.as_vec2() + Vec2::X, center.depth).distance(center.position)
}

/// Whether a bounding sphere can block any ray of the receiver's hemisphere.
fn above_surface(to_center: Vec3, radius: f32, normal: Vec3) -> bool {
    to_center.dot(normal) > -radius
}

/// Whether a bounding sphere can block any ray towards the light's disc: whether it meets the cone of those rays.
fn meets_cone(to_center: Vec3, radius: f32, light: &FrameLight) -> bool {
    let along = to_center.dot(light.disc.axis);
    let across = (to_center - light.disc.axis * along).length();
    let (sine, cosine) = light.angular_radius.sin_cos();
    along > -radius && across * cosine - along * sine < radius
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::ball_field;
    use glam::{DAffine3, DVec3, dvec3, vec3};

    /// A ground plane seen from 3 above, looking straight down.
    pub(crate) fn ground_from_above(size: UVec2) -> GeometryBuffer {
        let view_from_clip = Mat4::perspective_infinite_reverse_rh(1.0, size.x as f32 / size.y as f32, 0.1).inverse();
        let world_from_view = Mat4::look_to_rh(Vec3::ZERO, -Vec3::Y, -Vec3::Z).inverse();
        let pixels = (size.x * size.y) as usize;
        GeometryBuffer {
            world_from_clip: world_from_view * view_from_clip,
            size,
            depth: vec![0.1 / 3.0; pixels],
            normals: vec![Vec3::Y; pixels],
        }
    }

    #[test]
    fn the_camera_sees_the_ground_where_it_is() {
        let geometry = ground_from_above(uvec2(8, 8));
        let corner = geometry.receiver_at(uvec2(0, 0)).position;
        assert!((corner.y + 3.0).abs() < 1e-5, "{corner}");
        assert!(corner.x < 0.0 && corner.z < 0.0, "image left is −x, image top is −z: {corner}");
    }

    #[test]
    fn denoising_hides_the_pattern_on_a_plane() {
        const SIDE: u32 = 96;
        let geometry = ground_from_above(UVec2::splat(SIDE));
        let field = ball_field(0.9, 65, 32);
        let world_from_mesh = DAffine3::from_translation(dvec3(0.0, -1.9, 0.0));
        let placement = Placement::new(&field.header().bounds, world_from_mesh, DVec3::ZERO).unwrap();
        let light = FrameLight::new(1, vec3(0.3, 1.0, 0.1).normalize(), 0.2);
        let noisy = trace(&geometry, &[(placement, &field)], &[light], &TraceSettings::default());
        let smooth = denoise(&geometry, &noisy);
        // Mean second difference along the middle rows: 0 for anything that changes evenly.
        let roughness = |image: &[Vec4], channel: usize| {
            let curvature = |x: u32, y: u32| {
                let at = |x: u32| image[(y * SIDE + x) as usize][channel];
                (at(x) - 2.0 * at(x + 1) + at(x + 2)).abs()
            };
            (32..64).flat_map(|y| (32..62).map(move |x| curvature(x, y))).sum::<f32>() / (32.0 * 30.0)
        };
        assert!(roughness(&noisy, 0) > 0.05, "the pattern is there: {}", roughness(&noisy, 0));
        assert!(roughness(&smooth, 0) < 0.006, "and gone: {}", roughness(&smooth, 0));
        assert!(smooth.iter().all(|p| p.y == 0.0 && p.w == 0.0), "channels of absent lights stay empty");
        let center = smooth[(SIDE / 2 * SIDE + SIDE / 2) as usize];
        assert!((center.x - 0.67).abs() < 0.03, "0.9²/1.1² of the sky: {}", center.x);
        assert!(center.z > 0.95, "in the umbra: {}", center.z);
    }

    #[test]
    fn culling_never_drops_what_can_block() {
        let light = FrameLight::new(0, Vec3::Y, 0.1);
        assert!(meets_cone(vec3(0.0, 5.0, 0.0), 1.0, &light));
        assert!(meets_cone(vec3(1.4, 5.0, 0.0), 1.0, &light), "the cone is 0.5 wide there");
        assert!(!meets_cone(vec3(1.6, 5.0, 0.0), 1.0, &light));
        assert!(!meets_cone(vec3(0.0, -1.1, 0.0), 1.0, &light), "behind");
        assert!(meets_cone(vec3(0.5, -0.5, 0.0), 1.0, &light), "around the receiver");
        assert!(above_surface(vec3(0.0, -0.9, 0.0), 1.0, Vec3::Y));
        assert!(!above_surface(vec3(0.0, -1.1, 0.0), 1.0, Vec3::Y));
    }

    #[test]
    fn settings_out_of_range_are_clamped() {
        let wild =
            TraceSettings { ambient_rays: 99, shadow_rays: 99, max_distance: f32::NAN, ..TraceSettings::default() };
        let tame = wild.clamped();
        assert_eq!((tame.ambient_rays, tame.shadow_rays, tame.max_distance), (32, 32, f32::INFINITY));
        assert_eq!(FrameLight::new(0, Vec3::Y, f32::NAN).angular_radius, 0.0);
    }
}
