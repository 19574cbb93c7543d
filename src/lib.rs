//! What the examples and the cross-crate tests share: their scenes, and apps without a window.

pub mod crowd;
pub mod headless;
pub mod light_bays;
pub mod moving_objects;
pub mod panes;
pub mod probe;
pub mod recording;
pub mod reference;
pub mod reference_view;
pub mod window;
