//! Occlusion of whole frames on the GPU: plain WGSL compute passes on raw `wgpu`.
//!
//! [`FieldPool`] keeps the parts of all fields in one storage buffer, [`layout`] is what the shaders read, and
//! [`OcclusionPasses::encode`] makes one camera's frame of cap grids, of rays and their filter, or of both. The application brings device, queue and encoder;
//! everything runs within [`wgpu::Limits::default`].
//!
//! The WGSL sources are plain, without preprocessor directives, and joined by concatenation: [`caps_source`], [`trace_source`]
//! and [`denoise_source`]. Each of their functions has a CPU twin of the same name in [`field`](crate::field),
//! [`estimate::frame`](crate::estimate::frame) or [`estimate::caps`](crate::estimate::caps).

pub mod layout;
mod passes;
mod pool;

pub use passes::{FrameInputs, MissingCapability, OUTPUT_FORMAT, OcclusionPasses, OcclusionView};
pub use pool::{CapGridSlot, FieldPool, FieldSlot, PoolError, PoolStatistics, TableSlot};

/// Functions over `pool`, the buffer of all fields, which the including shader declares.
pub const FIELD_SOURCE: &str = include_str!("../shaders/field.wgsl");
const FRAME_SOURCE: &str = include_str!("../shaders/frame.wgsl");
const INSTANCE_SOURCE: &str = include_str!("../shaders/instance.wgsl");

/// The trace pass, entry point `trace`.
pub fn trace_source() -> String {
    [FIELD_SOURCE, FRAME_SOURCE, INSTANCE_SOURCE, include_str!("../shaders/trace.wgsl")].concat()
}

/// The pass over cap grids, entry point `caps`.
pub fn caps_source() -> String {
    [FRAME_SOURCE, INSTANCE_SOURCE, include_str!("../shaders/caps.wgsl")].concat()
}

/// The denoise passes, entry points `denoise_rows` and `denoise_columns`.
pub fn denoise_source() -> String {
    [FRAME_SOURCE, include_str!("../shaders/denoise.wgsl")].concat()
}
