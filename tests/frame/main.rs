//! Whole frames of Bevy apps, without a window.

mod accumulated;
mod adapter;
mod diagnostics;
mod end_to_end;
mod implicit;
mod lights;
mod lights_exact;
mod loss;
mod real_meshes;
mod receivers;
mod settings;
mod stage;
mod truth;
