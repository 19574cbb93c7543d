//! What the shaders read, byte for byte. A test compares every offset with the layout that naga reflects from the WGSL.

use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, Vec2};

use super::FieldSlot;
use crate::distance::DistanceField;
use crate::estimate::Falloff;
use crate::estimate::caps::{CapCombination, CapPlacement};
use crate::estimate::frame::{Casting, MAX_LIGHTS, TraceSettings};
use crate::estimate::light::Light;
use crate::estimate::sampling::sphere_samples;
use crate::estimate::source::{OcclusionSource, Wanted};
use crate::field::cap_grid::CapPrecision;
use crate::field::cap_grid::warp::AxisWarp;
use crate::field::{CapGrid, Encoding};
use crate::scene::Placement;

/// One occluder, `Instance` in `shaders/instance.wgsl`.
///
/// ```
/// assert_eq!(size_of::<visfield::gpu::layout::InstanceData>(), 208);
/// ```
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct InstanceData {
    /// Rows of the affine map from the camera-relative world to field space.
    pub field_from_world: [[f32; 4]; 3],
    /// Rows of the affine map from the camera-relative world to the space of the cap grid.
    pub cap_from_world: [[f32; 4]; 3],
    /// Rows of the affine map from the camera-relative world to the space of the distances.
    pub distance_from_world: [[f32; 4]; 3],
    /// Centre of the bounding sphere, relative to the camera.
    pub center: [f32; 3],
    /// Radius of the bounding sphere, in world units.
    pub radius: f32,
    /// Where the field's table starts in the pool, in bytes.
    pub first_byte: u32,
    /// Side of the table's grid of chord entries; 0 if there is no table.
    pub entries: u32,
    /// Side of the table's grid of chord exits.
    pub exits: u32,
    /// How the table is encoded: 0 for [`Encoding::U8`], 1 for [`Encoding::Bit`], 2 for [`Encoding::U16`], 3 for
    /// [`Encoding::F32`].
    pub encoding: u32,
    /// The number of the field's cap grid: where it starts in the pool, in headers.
    pub cap_grid: u32,
    /// Which part answers ambient occlusion, by its [number](source_number).
    pub ambient_source: u32,
    /// [`CapPlacement::stretched`]
    pub stretched: f32,
    /// The same as `ambient_source`, for lights of [`LARGE_LIGHT`](crate::estimate::source::LARGE_LIGHT) and more.
    pub light_source: u32,
    /// 1 if it casts no shadows, plus 2 if it does not occlude its own surface.
    pub flags: u32,
    /// The same for smaller lights.
    pub small_light_source: u32,
    /// Word of the pool at which the field's [`DistanceData`] starts; [`NO_DISTANCE`] if there is none.
    pub distance: u32,
    /// Fills 16 bytes.
    pub padding: u32,
}

/// In the place of [`InstanceData::distance`].
pub const NO_DISTANCE: u32 = u32::MAX;

impl InstanceData {
    /// An instance of the field in `slot`, placed relative to the camera, whose parts are asked as wanted.
    pub fn new(slot: &FieldSlot, placement: &Placement, casting: Casting, wanted: Wanted) -> Self {
        let answers = slot.answers();
        let ambient_source = if casting.ambient { answers.ambient(wanted) } else { OcclusionSource::None };
        let mut data = Self {
            field_from_world: rows(&placement.field_from_world),
            center: placement.center.to_array(),
            radius: placement.radius,
            ambient_source: source_number(ambient_source),
            light_source: source_number(answers.large_lights(wanted)),
            small_light_source: source_number(answers.small_lights(wanted)),
            flags: u32::from(!casting.shadows) | u32::from(!casting.own_surface) << 1,
            distance: NO_DISTANCE,
            ..Self::zeroed()
        };
        if let Some(table) = slot.table() {
            data.first_byte = table.first_byte;
            (data.entries, data.exits) = (table.grid.entries, table.grid.exits);
            data.encoding = encoding_number(table.encoding);
        }
        if let Some(grid) = slot.cap_grid() {
            let cap = CapPlacement::new(&grid.cap_from_field, placement);
            data.cap_from_world = rows(&cap.cap_from_world);
            data.stretched = cap.stretched;
            data.cap_grid = grid.number;
        }
        if let Some(distance) = slot.distance() {
            data.distance_from_world = rows(&(distance.distance_from_field * placement.field_from_world));
            data.distance = distance.first_word;
        }
        data
    }
}

/// Whether a source, by its number, is one of those.
pub(super) fn is_source(number: u32, of: fn(OcclusionSource) -> bool) -> bool {
    OcclusionSource::ALL.into_iter().any(|source| of(source) && source_number(source) == number)
}

fn rows(map: &Affine3A) -> [[f32; 4]; 3] {
    [0, 1, 2].map(|i| map.matrix3.row(i).extend(map.translation[i]).to_array())
}

/// What a cap grid starts with in the pool, `CapGrid` in `shaders/instance.wgsl`. Its points follow.
///
/// ```
/// assert_eq!(size_of::<visfield::gpu::layout::CapGridData>(), 128);
/// ```
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct CapGridData {
    /// Of each axis, [`AxisWarp::knee`](crate::field::cap_grid::warp::AxisWarp::knee).
    pub knee: [f32; 3],
    /// Grid points along each axis.
    pub points: u32,
    /// Of each axis, how wide its linear part is.
    pub slope: [f32; 3],
    /// 0 for bytes, 1 for halves.
    pub encoding: u32,
    /// 1 / `slope`.
    pub inverse_slope: [f32; 3],
    /// First word of the points in the pool.
    pub first_texel: u32,
    /// Of each axis, how fast its rational part widens.
    pub curvature: [f32; 3],
    /// Words from the points of four coefficients to those of the next four.
    pub plane_words: u32,
    /// Of each axis, 1 over where the grid ends.
    pub inverse_extent: [f32; 3],
    /// Fills 16 bytes.
    pub padding: u32,
    /// Half the sides of the mesh's box in cap space.
    pub half_extents: [f32; 3],
    /// Fills 16 bytes.
    pub padding_2: u32,
    /// What a stored 0 stands for, of the first four coefficients.
    pub low: [f32; 4],
    /// What a step stands for.
    pub step: [f32; 4],
}

impl CapGridData {
    /// A grid whose points start at a word of the pool.
    pub fn new(grid: &CapGrid, first_texel: u32) -> Self {
        let header = grid.header();
        let axes = |number: fn(&AxisWarp) -> f32| grid.warps().each_ref().map(number);
        let [low, step] = grid.low_and_step(0);
        Self {
            knee: axes(|warp| warp.knee),
            points: header.format.points,
            slope: axes(|warp| warp.slope),
            encoding: u32::from(header.format.precision != CapPrecision::U8),
            inverse_slope: axes(|warp| warp.inverse_slope),
            first_texel,
            curvature: axes(|warp| warp.curvature),
            plane_words: (grid.words().len() / planes(grid)) as u32 + COEFFICIENT_WORDS,
            inverse_extent: axes(|warp| warp.inverse_extent),
            padding: 0,
            half_extents: header.half_extents_in_cap_space().to_array(),
            padding_2: 0,
            low,
            step,
        }
    }
}

/// Words that go before the points of all but the first four coefficients: what 0 and a step of them stand for.
const COEFFICIENT_WORDS: u32 = 8;

/// How many times four coefficients a grid has.
fn planes(grid: &CapGrid) -> usize {
    grid.header().format.order.coefficients() / 4
}

/// What follows a grid's [`CapGridData`]: the points of the first four coefficients, then for each four more what 0 and a step of
/// them stand for, and their points.
pub fn cap_grid_words(grid: &CapGrid) -> Vec<u32> {
    let mut words = Vec::new();
    for (plane, points) in grid.words().chunks(grid.words().len() / planes(grid)).enumerate() {
        if plane > 0 {
            words.extend(grid.low_and_step(plane).as_flattened().iter().map(|x| x.to_bits()));
        }
        words.extend(points);
    }
    words
}

/// What distances start with in the pool, `DistanceSource` in `shaders/distance.wgsl`. Their codes or nodes follow.
///
/// ```
/// assert_eq!(size_of::<visfield::gpu::layout::DistanceData>(), 64);
/// ```
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct DistanceData {
    /// The lowest corner of a box that holds the surface, in the space of the distances.
    pub low: [f32; 3],
    /// How many nodes a shape has; `u32::MAX` for a grid.
    pub nodes: u32,
    /// The highest corner.
    pub high: [f32; 3],
    /// Word of the pool at which the codes or nodes start.
    pub first_word: u32,
    /// Codes of a row of the grid.
    pub row: u32,
    /// Codes of a layer of the grid.
    pub layer: u32,
    /// Bits of a code.
    pub bits: u32,
    /// Distance below which a ray has met the surface.
    pub threshold: f32,
    /// What code 0 stands for.
    pub code_low: f32,
    /// What a step of the codes stands for.
    pub code_step: f32,
    /// Fills 16 bytes.
    pub padding: [u32; 2],
}

impl DistanceData {
    /// Distances whose codes or nodes start at a word of the pool.
    pub fn new(distance: &DistanceField, first_word: u32) -> Self {
        let (low, high) = distance.bounds();
        let data = Self {
            low: low.to_array(),
            nodes: u32::MAX,
            high: high.to_array(),
            first_word,
            threshold: distance.threshold(),
            ..Self::zeroed()
        };
        match distance {
            DistanceField::Grid(grid) => {
                let header = grid.header();
                let [row, columns, _] = header.points;
                Self {
                    row,
                    layer: row * columns,
                    bits: 8 * header.format.precision.bytes() as u32,
                    code_low: header.low,
                    code_step: header.step(),
                    ..data
                }
            }
            DistanceField::Shape(solid) => Self { nodes: solid.program().nodes().len() as u32, ..data },
        }
    }
}

/// What follows the [`DistanceData`]: codes, and one word more than they fill, for the shader reads two at a time; or nodes.
pub fn distance_words(distance: &DistanceField) -> Vec<u32> {
    match distance {
        DistanceField::Grid(grid) => {
            let mut bytes = grid.bytes();
            bytes.resize(bytes.len().next_multiple_of(4) + 4, 0);
            bytes.as_chunks().0.iter().map(|&word| u32::from_le_bytes(word)).collect()
        }
        DistanceField::Shape(solid) => bytemuck::cast_slice(solid.program().nodes()).to_vec(),
    }
}

/// A source as shaders know it.
pub fn source_number(source: OcclusionSource) -> u32 {
    match source {
        OcclusionSource::None => 0,
        OcclusionSource::Rays => 1,
        OcclusionSource::CapGrid => 2,
        OcclusionSource::CapGridWithRaysInside => 3,
        OcclusionSource::Cones => 4,
        OcclusionSource::CapGridWithConesInside => 5,
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

/// A light, `Light` in `shaders/frame.wgsl`; see [`Light`].
///
/// ```
/// assert_eq!(size_of::<visfield::gpu::layout::LightData>(), 64);
/// ```
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LightData {
    /// [`Light::origin`]
    pub origin: [f32; 3],
    /// [`Light::kind`]
    pub kind: u32,
    /// [`Light::tangent`]
    pub tangent: [f32; 3],
    /// [`Light::range`]
    pub range: f32,
    /// [`Light::bitangent`]
    pub bitangent: [f32; 3],
    /// [`Light::radius`]
    pub radius: f32,
    /// [`Light::emission`]
    pub emission: [f32; 3],
    /// [`Light::cosine`]
    pub cosine: f32,
}

impl From<&Light> for LightData {
    fn from(light: &Light) -> Self {
        Self {
            origin: light.origin.to_array(),
            kind: light.kind as u32,
            tangent: light.tangent.to_array(),
            range: light.range,
            bitangent: light.bitangent.to_array(),
            radius: light.radius,
            emission: light.emission.to_array(),
            cosine: light.cosine,
        }
    }
}

/// A frame's parameters, `Frame` in `shaders/frame.wgsl`.
///
/// ```
/// assert_eq!(size_of::<visfield::gpu::layout::FrameUniform>(), 880);
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
    /// Width and height of what is traced.
    pub trace_size: [u32; 2],
    /// Pixels of the viewport from one that is traced to the next.
    pub trace_scale: u32,
    /// Number of instances.
    pub instance_count: u32,
    /// Ambient occlusion rays per pixel.
    pub ambient_rays: u32,
    /// Rays per pixel and light.
    pub shadow_rays: u32,
    /// Number of `lights` in use.
    pub light_count: u32,
    /// A bit for each of `lights` that is [large](Light::is_large).
    pub large_lights: u32,
    /// Ambient occlusion ignores hits beyond this distance, in world units; finite.
    pub max_distance: f32,
    /// [`Bias::height`](crate::field::query::Bias::height)
    pub bias_height: f32,
    /// [`Bias::along`](crate::field::query::Bias::along)
    pub bias_along: f32,
    /// 0 for [`Falloff::Binary`], 1 for [`Falloff::Linear`], 2 for [`Falloff::Obscurance`].
    pub falloff: u32,
    /// Of [`Falloff::Obscurance`], per world unit.
    pub falloff_tau: f32,
    /// [`TraceSettings::intensity`]
    pub intensity: f32,
    /// Whether rays are traced, and what they find is part of the frame's.
    pub traced: u32,
    /// How screen-space ambient occlusion is part of the frame: 0 not at all, 1 the darker of both, 2 their product.
    pub screen_space: u32,
    /// Tiles of the viewport along both axes.
    pub tiles: [u32; 2],
    /// Entries that there is room for in all lists of tiles.
    pub list_capacity: u32,
    /// Rows from a page of the output to the next.
    pub page_rows: u32,
    /// How much the frame counts against those that were accumulated before it.
    pub blend: f32,
    /// Entries of a tile's list that are shown as a full one; 0 shows ambient visibility.
    pub show_tile_load: u32,
    /// Aligns the lights.
    pub padding: [u32; 2],
    /// The lights, the first `light_count` of them in use.
    pub lights: [LightData; MAX_LIGHTS],
}

impl FrameUniform {
    /// What is said by settings and lights alone; the rest is 0.
    pub(super) fn new(lights: &[Light], settings: &TraceSettings) -> Self {
        let mut data = [LightData::default(); MAX_LIGHTS];
        let (mut light_count, mut large_lights) = (0, 0);
        for (slot, light) in data.iter_mut().zip(lights) {
            *slot = light.into();
            large_lights |= u32::from(light.is_large()) << light_count;
            light_count += 1;
        }
        let (falloff, falloff_tau) = match settings.falloff {
            Falloff::Binary => (0, 0.0),
            Falloff::Linear => (1, 0.0),
            Falloff::Obscurance { tau } => (2, tau),
        };
        Self {
            ambient_rays: settings.ambient_rays,
            shadow_rays: settings.shadow_rays,
            light_count,
            large_lights,
            max_distance: settings.max_distance.min(LARGEST),
            bias_height: settings.bias.height,
            bias_along: settings.bias.along,
            falloff,
            falloff_tau,
            intensity: settings.intensity,
            lights: data,
            ..Self::zeroed()
        }
    }
}

/// WGSL has no portable infinity; this is its `NO_HIT`.
const LARGEST: f32 = 3.0e38;

/// The sample patterns as the shaders read them: points of the sphere and how far their rays reach, points of the disc and of the
/// square, and the points of the sphere that caps are combined at.
pub(super) fn sample_data(settings: &TraceSettings) -> Vec<[f32; 4]> {
    let sphere = settings.sphere_samples().into_iter().zip(settings.reaches());
    let sphere = sphere.map(|(point, reach)| point.extend(reach.min(LARGEST)).to_array());
    let flat = |points: Vec<Vec2>| points.into_iter().map(|point| [point.x, point.y, 0.0, 0.0]);
    let directions = settings.caps.map_or(0, CapCombination::directions);
    let caps = sphere_samples(directions as u32).into_iter().map(|point| point.extend(0.0).to_array());
    sphere.chain(flat(settings.disc_samples())).chain(flat(settings.square_samples())).chain(caps).collect()
}
