//! What the examples and the cross-crate tests share: the scene of `moving_objects`, and apps without a window.

pub mod headless;
pub mod moving_objects;
