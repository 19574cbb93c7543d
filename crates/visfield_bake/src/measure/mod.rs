//! What a field costs and what it gets wrong, against exact rays: the same rays, in the same run.
//!
//! [`scene`] says where occlusion is measured, [`ambient`] measures it, [`caps`] has what is different without
//! rays, [`shadow`] measures soft shadows.
//! With the feature `command`, [`distance`] compares distances themselves with exact ones, [`many`] combines several objects,
//! [`tradeoff`] compares many fields, [`paper2008`] repeats a paper's experiments, [`gpu`] measures on a GPU, [`paper2010`] repeats
//! those of another paper there, [`paper2012`] compares estimators over distances, [`paper2014`] the ways of sphere tracing,
//! [`picture`] draws what was measured, and [`document`] keeps it in files.

pub mod ambient;
pub mod caps;
#[cfg(feature = "command")]
pub mod distance;
#[cfg(feature = "command")]
pub mod document;
#[cfg(feature = "command")]
pub mod gpu;
#[cfg(feature = "command")]
pub mod many;
mod names;
#[cfg(feature = "command")]
pub mod paper2008;
#[cfg(feature = "command")]
pub mod paper2010;
#[cfg(feature = "command")]
pub mod paper2012;
pub mod paper2014;
#[cfg(feature = "command")]
pub mod picture;
#[cfg(feature = "command")]
mod progress;
#[cfg(feature = "command")]
mod reference;
pub mod scene;
pub mod shadow;
pub(crate) mod speed;
#[cfg(feature = "command")]
pub(crate) mod table;
#[cfg(feature = "command")]
pub mod tradeoff;

pub use ambient::{AmbientMeasurement, AmbientQuestion, measure_ambient, measure_ambient_of};
#[cfg(feature = "command")]
pub use document::MeasurementDocument;
#[cfg(feature = "command")]
pub use reference::OcclusionError;
pub use scene::MeasureScene;
pub use shadow::{ShadowMeasurement, ShadowQuestion, measure_shadow, measure_shadow_of};
