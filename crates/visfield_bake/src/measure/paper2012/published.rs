//! What the thesis says of its estimators. It has pictures and no errors; what it prints in numbers is how long its references took.

/// Minutes for a reference image by ray tracing: of spheres and boxes, of the bunny, of the bunny with a box.
pub const REFERENCE_MINUTES: [u32; 3] = [20, 45, 40];

/// Frames a second that the sphere-traced scenes of chapter 3 "greatly exceeded", at 512 × 512 pixels on a `GeForce` GTX 560 Ti.
pub const FRAMES_PER_SECOND: u32 = 60;

/// Mean error of what this crate casts shadows with that is aimed at on the ground, for a light of 5° to each side and a grid of
/// 64³ of a bunny; and 0.04 for a cow. Not of the thesis.
pub const SHADOW_TARGET: f64 = 0.025;
