//! A frame's occlusion on the CPU: the twin of the GPU's passes, function by function.
//!
//! It exists to check the shaders against, and to compute frames without a GPU. All positions are relative to the camera. The
//! stages are files: [`tiles`] says what can matter where, [`trace`] sends rays, [`denoise`] filters what they found,
//! [`accumulate`] joins frames, and [`resolve`] adds what needs no rays.

pub mod accumulate;
pub mod denoise;
pub mod resolve;
pub mod tiles;
pub mod trace;

use glam::{Mat4, UVec2, Vec2, Vec3, Vec4, uvec2, vec2};

use super::caps::{CapCombination, CapSettings};
use super::cones::ConeReceiver;
use super::falloff::Falloff;
use super::light::Light;
use super::sampling::{
    AMBIENT_INTERLEAVE_BITS, LIGHT_INTERLEAVE_BITS, disc_samples, residues, rotated, shifted, sphere_samples,
    square_samples, uneven_levels,
};
use super::source::Wanted;
use crate::field::VisibilityField;
use crate::field::query::Bias;
use crate::scene::Placement;

/// Lights that one frame can mask: with ambient occlusion they fill three pages of four channels.
pub const MAX_LIGHTS: usize = 11;
/// Most rays per pixel and estimator: the bits of the shader's masks.
pub const MAX_RAYS: u32 = 32;
/// Most times that a frame is filtered.
pub const MAX_DENOISE_PASSES: u32 = 2;

/// A frame's occlusion at one pixel: ambient occlusion, then that of each light.
pub type Channels = [f32; 1 + MAX_LIGHTS];

/// Which pixels rays are sent from.
///
/// ```
/// use visfield::estimate::frame::TraceResolution;
/// assert_eq!(TraceResolution::Half.traced_size(glam::uvec2(641, 360)), glam::uvec2(321, 180));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum TraceResolution {
    /// All of them.
    #[default]
    Full,
    /// Every second one along both axes. The others take what those of their neighbours found that show the same surface.
    Half,
}

impl TraceResolution {
    /// Pixels from one that is traced to the next.
    pub const fn scale(self) -> u32 {
        match self {
            Self::Full => 1,
            Self::Half => 2,
        }
    }

    /// How many pixels of a viewport are traced.
    pub fn traced_size(self, viewport: UVec2) -> UVec2 {
        uvec2(viewport.x.div_ceil(self.scale()), viewport.y.div_ceil(self.scale()))
    }
}

/// How a frame is traced.
///
/// ```
/// use visfield::estimate::frame::TraceSettings;
/// let settings = TraceSettings { ambient_rays: 4, ..TraceSettings::default() };
/// assert_eq!(settings.sphere_samples().len(), 4 * 64); // shared by squares of 8×8 pixels
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceSettings {
    /// Whether ambient occlusion, and that of [large lights](Light::is_large), comes from the cap grids of fields that have
    /// one for it, and how they combine. Others get rays.
    pub caps: Option<CapCombination>,
    /// Whether lights that no cap grid hides are hidden by [cones](crate::estimate::cones) through the distances of fields that
    /// have them; and with `caps`, ambient occlusion where no cap grid answers, or is wrong. Others get rays.
    pub cones: bool,
    /// Ambient occlusion rays per pixel, 0 (none) to [`MAX_RAYS`]. The denoiser sees 64 times as many. Without rays, fields that
    /// no cap grid answers for do not occlude, and neither do others where their grid leaves receivers to rays.
    pub ambient_rays: u32,
    /// Rays per pixel and light, 0 (none) to [`MAX_RAYS`]. The denoiser sees 16 times as many.
    pub shadow_rays: u32,
    /// Which pixels send them.
    pub resolution: TraceResolution,
    /// How often what they find is filtered, 0 to [`MAX_DENOISE_PASSES`]. Once gathers the rays of a whole pattern; again makes it
    /// smoother, and edges of shadows softer.
    pub denoise_passes: u32,
    /// Ambient occlusion ignores hits beyond this distance, in world units. Infinity counts all.
    pub max_distance: f32,
    /// How hits up to there count.
    pub falloff: Falloff,
    /// Exponent of ambient visibility: 1 for what is true, 0 for none, above 1 for darker. 0 to 8.
    pub intensity: f32,
    /// How near to the receiver hits do not count.
    pub bias: Bias,
    /// Which rays are sent: others for each number. Frames that are accumulated count it up.
    pub turn: u32,
}

impl Default for TraceSettings {
    fn default() -> Self {
        Self {
            caps: None,
            cones: false,
            ambient_rays: 8,
            shadow_rays: 8,
            resolution: TraceResolution::Full,
            denoise_passes: 1,
            max_distance: f32::INFINITY,
            falloff: Falloff::Binary,
            intensity: 1.0,
            bias: Bias::default(),
            turn: 0,
        }
    }
}

impl TraceSettings {
    /// The same with every number inside its range; a NaN distance becomes infinite.
    #[must_use]
    pub fn clamped(self) -> Self {
        let falloff = match self.falloff {
            Falloff::Obscurance { tau } if !(tau > 0.0 && tau.is_finite()) => Falloff::Binary,
            // Evenly over an endless distance is not at all.
            Falloff::Linear if !self.max_distance.is_finite() => Falloff::Binary,
            other => other,
        };
        Self {
            ambient_rays: self.ambient_rays.min(MAX_RAYS),
            shadow_rays: self.shadow_rays.min(MAX_RAYS),
            denoise_passes: self.denoise_passes.min(MAX_DENOISE_PASSES),
            max_distance: if self.max_distance.is_nan() { f32::INFINITY } else { self.max_distance.max(0.0) },
            falloff,
            intensity: if self.intensity.is_nan() { 1.0 } else { self.intensity.clamp(0.0, 8.0) },
            ..self
        }
    }

    /// What is to be answered without rays.
    pub fn wanted(&self) -> Wanted {
        Wanted { caps: self.caps.is_some(), cones: self.cones }
    }

    /// How cap grids are asked.
    pub fn cap_settings(&self) -> CapSettings {
        CapSettings {
            combination: self.caps.unwrap_or_default(),
            max_distance: self.max_distance,
            falloff: self.falloff,
        }
    }

    /// The points of the sphere that 8×8 pixels share for ambient occlusion.
    pub fn sphere_samples(&self) -> Vec<Vec3> {
        rotated(sphere_samples(self.ambient_rays * residues(AMBIENT_INTERLEAVE_BITS)), self.turn)
    }

    /// How far the rays to those points reach, in world units.
    pub fn reaches(&self) -> Vec<f32> {
        let levels = uneven_levels(self.ambient_rays * residues(AMBIENT_INTERLEAVE_BITS), self.turn).into_iter();
        levels.map(|level| self.falloff.reach(level, self.max_distance)).collect()
    }

    /// The points of the disc that 4×4 pixels share for each light.
    pub fn disc_samples(&self) -> Vec<Vec2> {
        let points = disc_samples(self.shadow_rays * residues(LIGHT_INTERLEAVE_BITS)).into_iter();
        let flat = rotated(points.map(|point| point.extend(0.0)).collect(), self.turn).into_iter();
        flat.map(Vec3::truncate).collect()
    }

    /// The points of the square that they share for each rectangle.
    pub fn square_samples(&self) -> Vec<Vec2> {
        shifted(square_samples(self.shadow_rays * residues(LIGHT_INTERLEAVE_BITS)), self.turn)
    }
}

/// What an instance does to others and to itself.
///
/// ```
/// use visfield::estimate::frame::Casting;
/// let beacon = Casting { shadows: false, ..Casting::default() };
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Casting {
    /// Whether it occludes ambient light.
    pub ambient: bool,
    /// Whether it hides lights.
    pub shadows: bool,
    /// Whether it does so to its own surface, on [receivers that ask for that](ReceiverFlags::own_surface_off).
    pub own_surface: bool,
}

impl Default for Casting {
    fn default() -> Self {
        Self { ambient: true, shadows: true, own_surface: true }
    }
}

/// An instance in a frame. See [`visibility`](resolve::visibility) for an example.
#[derive(Clone, Copy, Debug)]
pub struct FrameOccluder<'a> {
    /// Where it is, relative to the camera.
    pub placement: Placement,
    /// What it is.
    pub field: &'a VisibilityField,
    /// What it occludes.
    pub casting: Casting,
}

impl<'a> FrameOccluder<'a> {
    /// An instance that casts all it can.
    pub fn new(placement: Placement, field: &'a VisibilityField) -> Self {
        Self { placement, field, casting: Casting::default() }
    }
}

/// What a receiver is spared.
///
/// ```
/// use visfield::estimate::frame::ReceiverFlags;
/// assert_eq!(ReceiverFlags::from_normal_alpha(1.0), ReceiverFlags::default());
/// assert!(ReceiverFlags::from_normal_alpha(1.0 / 3.0).no_ambient);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReceiverFlags {
    /// Its own instance does not occlude it, if [that says so too](Casting::own_surface).
    pub own_surface_off: bool,
    /// It gets no ambient occlusion.
    pub no_ambient: bool,
}

impl ReceiverFlags {
    /// The flags that the fourth channel of a normal holds: 1 for none, less for each.
    pub fn from_normal_alpha(alpha: f32) -> Self {
        let bits = ((1.0 - alpha) * 3.0).round() as u32;
        Self { own_surface_off: bits & 1 != 0, no_ambient: bits & 2 != 0 }
    }
}

/// A surface point of the frame, relative to the camera; depth 0 (infinity, reversed z) means there is none. See
/// [`visibility`](resolve::visibility) for an example.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameReceiver {
    /// Where it is, relative to the camera.
    pub position: Vec3,
    /// Its unit normal.
    pub normal: Vec3,
    /// Depth buffer value, 1 at the near plane.
    pub depth: f32,
    /// What it is spared.
    pub flags: ReceiverFlags,
}

impl FrameReceiver {
    /// What cones ask of it.
    pub(super) fn cone_receiver(&self) -> ConeReceiver {
        ConeReceiver { position: self.position, normal: self.normal }
    }
}

/// A frame's depth and normals, and where they lie. See [`visibility`](resolve::visibility) for an example.
#[derive(Clone, Debug)]
pub struct GeometryBuffer {
    /// From clip space to the world relative to the camera.
    pub world_from_clip: Mat4,
    /// Width and height in pixels.
    pub size: UVec2,
    /// Depth per pixel, rows from the top; reversed z.
    pub depth: Vec<f32>,
    /// Normal per pixel, and in its fourth component the [flags](ReceiverFlags::from_normal_alpha) of the receiver: 1 for none.
    pub normals: Vec<Vec4>,
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
        let index = index(pixel, self.size);
        let (depth, normal) = (self.depth[index], self.normals[index]);
        FrameReceiver {
            position: self.position_at(pixel.as_vec2(), depth),
            normal: normal.truncate().normalize(),
            depth,
            flags: ReceiverFlags::from_normal_alpha(normal.w),
        }
    }

    /// All pixels, row by row.
    pub fn pixels(&self) -> impl Iterator<Item = UVec2> + use<> {
        pixels(self.size)
    }
}

/// All pixels of a picture, row by row.
fn pixels(size: UVec2) -> impl Iterator<Item = UVec2> + use<> {
    (0..size.y).flat_map(move |y| (0..size.x).map(move |x| uvec2(x, y)))
}

fn index(pixel: UVec2, size: UVec2) -> usize {
    (pixel.y * size.x + pixel.x) as usize
}

/// The lights that a frame has masks for.
fn masked(lights: &[Light]) -> &[Light] {
    &lights[..lights.len().min(MAX_LIGHTS)]
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use glam::vec4;

    /// A ground plane seen from 3 above, looking straight down.
    pub(crate) fn ground_from_above(size: UVec2) -> GeometryBuffer {
        let view_from_clip = Mat4::perspective_infinite_reverse_rh(1.0, size.x as f32 / size.y as f32, 0.1).inverse();
        let world_from_view = Mat4::look_to_rh(Vec3::ZERO, -Vec3::Y, -Vec3::Z).inverse();
        let pixels = (size.x * size.y) as usize;
        GeometryBuffer {
            world_from_clip: world_from_view * view_from_clip,
            size,
            depth: vec![0.1 / 3.0; pixels],
            normals: vec![vec4(0.0, 1.0, 0.0, 1.0); pixels],
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
    fn settings_out_of_range_are_clamped() {
        let wild = TraceSettings {
            ambient_rays: 99,
            shadow_rays: 99,
            max_distance: f32::NAN,
            falloff: Falloff::Obscurance { tau: -1.0 },
            intensity: f32::INFINITY,
            ..TraceSettings::default()
        };
        let tame = wild.clamped();
        assert_eq!((tame.ambient_rays, tame.shadow_rays, tame.max_distance), (32, 32, f32::INFINITY));
        assert_eq!((tame.falloff, tame.intensity), (Falloff::Binary, 8.0));
        let endless = TraceSettings { falloff: Falloff::Linear, ..TraceSettings::default() };
        assert_eq!(endless.clamped().falloff, Falloff::Binary);
    }

    #[test]
    fn every_turn_sends_other_rays() {
        let at = |turn| TraceSettings { turn, falloff: Falloff::Linear, max_distance: 1.0, ..TraceSettings::default() };
        assert_ne!(at(0).sphere_samples(), at(1).sphere_samples());
        assert_ne!(at(0).disc_samples(), at(1).disc_samples());
        assert_ne!(at(0).square_samples(), at(1).square_samples());
        assert_ne!(at(0).reaches(), at(1).reaches());
        assert!(at(7).disc_samples().iter().all(|point| point.length() < 1.0));
        assert!(at(7).square_samples().iter().all(|point| point.abs().max_element() <= 1.0));
    }
}
