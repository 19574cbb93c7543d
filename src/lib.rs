//! What the examples and the cross-crate tests share: the scene of `moving_objects`, crowds, and apps without a window.

pub mod crowd;
pub mod headless;
pub mod moving_objects;
pub mod recording;
