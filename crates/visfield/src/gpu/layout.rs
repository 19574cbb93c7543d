//! What the shaders read, byte for byte. A test compares every offset with the layout that naga reflects from the WGSL.

use bytemuck::{Pod, Zeroable};
use glam::{UVec2, Vec3};

use super::FieldSlot;
use crate::estimate::frame::{FrameLight, MAX_LIGHTS, TraceSettings};
use crate::field::Encoding;
use crate::scene::Placement;

/// One occluder, `Instance` in `shaders/trace.wgsl`.
///
/// ```
/// assert_eq!(size_of::<visfield::gpu::layout::InstanceData>(), 80);
/// ```
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct InstanceData {
    /// Rows of the affine map from the camera-relative world to field space.
    pub field_from_world: [[f32; 4]; 3],
    /// Centre of the bounding sphere, relative to the camera.
    pub center: [f32; 3],
    /// Radius of the bounding sphere, in world units.
    pub radius: f32,
    /// Where the field's table starts in the pool, in bytes.
    pub first_byte: u32,
    /// Side of the table's grid of chord entries.
    pub entries: u32,
    /// Side of the table's grid of chord exits.
    pub exits: u32,
    /// How the table is encoded: 0 for [`Encoding::U8`], 1 for [`Encoding::Bit`], 2 for [`Encoding::U16`], 3 for
    /// [`Encoding::F32`].
    pub encoding: u32,
}

impl InstanceData {
    /// An instance of the field in `slot`, placed relative to the camera.
    pub fn new(slot: &FieldSlot, placement: &Placement) -> Self {
        let map = placement.field_from_world;
        let row = |i: usize| {
            let linear = map.matrix3.row(i);
            [linear.x, linear.y, linear.z, map.translation[i]]
        };
        Self {
            field_from_world: [row(0), row(1), row(2)],
            center: placement.center.to_array(),
            radius: placement.radius,
            first_byte: slot.first_byte(),
            entries: slot.grid().entries,
            exits: slot.grid().exits,
            encoding: encoding_number(slot.encoding()),
        }
    }
}

/// An encoding as shaders know it.
pub fn encoding_number(encoding: Encoding) -> u32 {
    match encoding {
        Encoding::U8 => 0,
        Encoding::Bit => 1,
        Encoding::U16 => 2,
        Encoding::F32 => 3,
    }
}

/// A directional light, `Light` in `shaders/frame.wgsl`.
///
/// ```
/// assert_eq!(size_of::<visfield::gpu::layout::LightData>(), 48);
/// ```
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LightData {
    /// Unit vector towards the light.
    pub axis: [f32; 3],
    /// Cosine of the disc's angular radius.
    pub cosine: f32,
    /// Tangent of the disc, as long as its radius at distance 1.
    pub tangent: [f32; 3],
    /// Sine of the disc's angular radius.
    pub sine: f32,
    /// The other tangent.
    pub bitangent: [f32; 3],
    /// The mask that the light fills.
    pub channel: u32,
}

impl From<&FrameLight> for LightData {
    fn from(light: &FrameLight) -> Self {
        let (sine, cosine) = light.angular_radius.sin_cos();
        Self {
            axis: light.disc.axis.to_array(),
            cosine,
            tangent: light.disc.tangent.to_array(),
            sine,
            bitangent: light.disc.bitangent.to_array(),
            channel: light.channel as u32,
        }
    }
}

/// A frame's parameters, `Frame` in `shaders/frame.wgsl`.
///
/// ```
/// assert_eq!(size_of::<visfield::gpu::layout::FrameUniform>(), 256);
/// ```
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct FrameUniform {
    /// From clip space to the world relative to the camera, by columns.
    pub world_from_clip: [[f32; 4]; 4],
    /// First pixel of the camera's viewport.
    pub viewport_origin: [u32; 2],
    /// Width and height of the viewport in pixels.
    pub viewport_size: [u32; 2],
    /// Number of instances.
    pub instance_count: u32,
    /// Ambient occlusion rays per pixel.
    pub ambient_rays: u32,
    /// Rays per pixel and light.
    pub shadow_rays: u32,
    /// Number of `lights` in use.
    pub light_count: u32,
    /// Ambient occlusion ignores hits beyond this distance, in world units; finite.
    pub max_distance: f32,
    /// [`Bias::height`](crate::field::query::Bias::height)
    pub bias_height: f32,
    /// [`Bias::along`](crate::field::query::Bias::along)
    pub bias_along: f32,
    /// Aligns the lights.
    pub padding: u32,
    /// The lights, the first `light_count` of them in use.
    pub lights: [LightData; MAX_LIGHTS],
}

impl FrameUniform {
    pub(super) fn new(
        world_from_clip: glam::Mat4,
        viewport: (UVec2, UVec2),
        instance_count: u32,
        lights: &[FrameLight],
        settings: &TraceSettings,
    ) -> Self {
        let mut data = [LightData::default(); MAX_LIGHTS];
        let usable = lights.iter().filter(|light| light.channel < MAX_LIGHTS);
        let mut light_count = 0;
        for (slot, light) in data.iter_mut().zip(usable) {
            *slot = light.into();
            light_count += 1;
        }
        Self {
            world_from_clip: world_from_clip.to_cols_array_2d(),
            viewport_origin: viewport.0.to_array(),
            viewport_size: viewport.1.to_array(),
            instance_count,
            ambient_rays: settings.ambient_rays,
            shadow_rays: settings.shadow_rays,
            light_count,
            // WGSL has no portable infinity; this is its NO_HIT.
            max_distance: settings.max_distance.min(3.0e38),
            bias_height: settings.bias.height,
            bias_along: settings.bias.along,
            padding: 0,
            lights: data,
        }
    }
}

/// The sample patterns as the shader reads them: points of the sphere, then points of the disc.
pub(super) fn sample_data(settings: &TraceSettings) -> Vec<[f32; 4]> {
    let sphere = settings.sphere_samples().into_iter().map(|p| p.extend(0.0).to_array());
    let disc = settings.disc_samples().into_iter().map(|p| Vec3::new(p.x, p.y, 0.0).extend(0.0).to_array());
    sphere.chain(disc).collect()
}
