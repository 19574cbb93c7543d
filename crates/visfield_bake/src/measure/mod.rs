//! What a field costs and what it gets wrong, against exact rays: the same rays, in the same run.
//!
//! [`scene`] says where occlusion is measured, [`ambient`] measures it.

pub mod ambient;
pub mod scene;
mod speed;

pub use ambient::{AmbientMeasurement, AmbientQuestion, measure_ambient, measure_ambient_of};
pub use scene::MeasureScene;
