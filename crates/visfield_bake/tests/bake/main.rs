//! Tests of the bake as its users see it: closed forms, real meshes, bad input, the command, and the example assets.

mod bad_input;
mod cap_extremes;
mod cap_lights;
mod cap_shapes;
mod closed_forms;
mod command;
mod contact;
mod example_assets;
mod gpu;
mod measure_report;
mod own_surface;
mod paper2012;
mod paper2014;
mod real_meshes;
mod support;
mod tune;
