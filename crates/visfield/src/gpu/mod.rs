//! Occlusion of whole frames on the GPU: plain WGSL compute passes on raw `wgpu`.
//!
//! [`FieldPool`] keeps the parts of all fields in one storage buffer, [`layout`] is what the shaders read, and
//! [`OcclusionPasses::encode`] makes one camera's frame of cap grids, of rays and their filter, or of both: ambient visibility, and
//! that of up to [`MAX_LIGHTS`](crate::estimate::frame::MAX_LIGHTS) lights. [`OcclusionView`] is what a camera keeps from frame to
//! frame. The application brings device, queue and encoder; everything runs within [`wgpu::Limits::default`].
//!
//! A frame has five groups of passes, of which only those run that it needs:
//!
//! 1. *tiles* lists for each tile of 16×16 pixels the instances that can matter there. Lists drop nothing: a tile whose list finds
//!    no room looks at all instances, until the buffer has grown,
//! 2. *trace* sends rays, from every pixel or from every second one of every second row,
//! 3. *denoise* filters what they found,
//! 4. *accumulate* joins it with the frames before, by motion vectors,
//! 5. *resolve* asks cap grids, joins screen-space ambient occlusion of another kind, and writes [`OUTPUT_FORMAT`].
//!
//! [`PassTimer`] hears of each group.
//!
//! The WGSL sources are plain, without preprocessor directives, and joined by concatenation, a source for each stage:
//! [`tiles_source`], [`trace_source`], [`denoise_source`], [`accumulate_source`], [`resolve_source`]. Each of their functions has
//! a CPU twin of the same name in [`field`](crate::field), [`estimate::frame`](crate::estimate::frame),
//! [`estimate::light`](crate::estimate::light) or [`estimate::caps`](crate::estimate::caps).

pub mod layout;
mod lists;
mod passes;
mod pool;
mod view;

pub use passes::{
    FrameInputs, MissingCapability, OUTPUT_FORMAT, OcclusionPasses, PassTimer, ScreenSpace, ScreenSpaceCombination,
    TILE_LOAD_SHOWN,
};
pub use pool::{CapGridSlot, DistanceSlot, FieldPool, FieldSlot, PoolError, PoolStatistics, TableSlot};
pub use view::OcclusionView;

/// Functions over `pool`, the buffer of all fields, which the including shader declares.
pub const FIELD_SOURCE: &str = concat!(include_str!("../shaders/bias.wgsl"), include_str!("../shaders/field.wgsl"));
/// `shape_distance` over `pool`, as [`FIELD_SOURCE`] has it: the distance to a [shape](crate::shape) whose nodes are in it.
pub const SHAPE_SOURCE: &str = include_str!("../shaders/shape.wgsl");
const BIAS_SOURCE: &str = include_str!("../shaders/bias.wgsl");
const DISTANCE_SOURCE: &str = include_str!("../shaders/distance.wgsl");
const SPHERE_TRACE_SOURCE: &str = include_str!("../shaders/sphere_trace.wgsl");
const CONE_SOURCE: &str = include_str!("../shaders/cone.wgsl");
const FRAME_SOURCE: &str = include_str!("../shaders/frame.wgsl");
const LIGHT_SOURCE: &str = include_str!("../shaders/light.wgsl");
const INSTANCE_SOURCE: &str = include_str!("../shaders/instance.wgsl");
const LISTS_SOURCE: &str = include_str!("../shaders/lists.wgsl");
const LISTED_SOURCE: &str = include_str!("../shaders/listed.wgsl");
const SURFACE_SOURCE: &str = include_str!("../shaders/surface.wgsl");
const CAPS_SOURCE: &str = include_str!("../shaders/caps.wgsl");

/// The passes that list what matters to each tile, entry points `tile_bounds`, `list_blocks` and `list_tiles`.
pub fn tiles_source() -> String {
    [FRAME_SOURCE, LIGHT_SOURCE, INSTANCE_SOURCE, LISTS_SOURCE, include_str!("../shaders/tiles.wgsl")].concat()
}

/// The trace pass, entry point `trace`.
pub fn trace_source() -> String {
    let occluders = [FRAME_SOURCE, LIGHT_SOURCE, INSTANCE_SOURCE, LISTS_SOURCE, LISTED_SOURCE];
    let fields = [FIELD_SOURCE, SHAPE_SOURCE, DISTANCE_SOURCE, SPHERE_TRACE_SOURCE];
    [&fields[..], &occluders, &[include_str!("../shaders/trace.wgsl")]].concat().concat()
}

/// The denoise passes, entry points `denoise_rows` and `denoise_columns`.
pub fn denoise_source() -> String {
    [FRAME_SOURCE, SURFACE_SOURCE, include_str!("../shaders/denoise.wgsl")].concat()
}

/// The accumulate pass, entry point `accumulate`.
pub fn accumulate_source() -> String {
    [FRAME_SOURCE, include_str!("../shaders/accumulate.wgsl")].concat()
}

/// Functions over signed distances in `pool`, which the including shader declares: `distance_source(word)` reads what a
/// [`DistanceSlot`] names, `field_distance` and `gradient` ask it, and `sphere_trace` follows rays.
pub fn distance_source() -> String {
    [BIAS_SOURCE, SHAPE_SOURCE, DISTANCE_SOURCE, SPHERE_TRACE_SOURCE].concat()
}

/// The functions of cap grids and of cones, for the resolve pass.
pub fn caps_source() -> String {
    let occluders =
        [FRAME_SOURCE, LIGHT_SOURCE, INSTANCE_SOURCE, LISTS_SOURCE, LISTED_SOURCE, CONE_SOURCE, CAPS_SOURCE];
    distance_source() + &occluders.concat()
}

/// The resolve pass, entry point `resolve`.
pub fn resolve_source() -> String {
    caps_source() + SURFACE_SOURCE + include_str!("../shaders/resolve.wgsl")
}
