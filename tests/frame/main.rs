//! Whole frames of Bevy apps, without a window.

mod adapter;
mod diagnostics;
mod end_to_end;
mod lights;
mod loss;
mod probe;
mod real_meshes;
mod receivers;
mod stage;
mod truth;
