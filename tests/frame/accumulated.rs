//! Frames that are joined with those before them: nothing trails behind.

use bevy::prelude::*;
use bevy_visfield::prelude::*;
use visfield_workspace::headless::HeadlessApp;
use visfield_workspace::moving_objects::SceneClock;
use visfield_workspace::probe::{self, ProbedFrame};

use crate::{adapter, truth};

/// Frames after which what was accumulated has settled.
const SETTLED: usize = 10;

fn set_accumulate(headless: &mut HeadlessApp, accumulate: bool) {
    let world = headless.app.world_mut();
    let mut occlusion = world.query::<&mut FieldOcclusion>().single_mut(world).expect("there is one camera");
    *occlusion = FieldOcclusion { quality: FieldOcclusionQuality::High, accumulate, ..default() };
}

/// The scene after as many accumulated frames as change nothing more.
fn settled() -> HeadlessApp {
    let mut headless = truth::scene_app();
    set_accumulate(&mut headless, true);
    for _ in 0..SETTLED {
        headless.update();
    }
    headless
}

/// The same moment without any frames before it.
fn fresh(headless: &mut HeadlessApp) -> ProbedFrame {
    set_accumulate(headless, false);
    probe::read(headless)
}

/// The mean difference of two frames, of ambient visibility and of that of the sun, over the pixels that count.
fn mean_difference(a: &ProbedFrame, b: &ProbedFrame, counts: impl Fn(usize, usize) -> bool) -> [f32; 2] {
    [0, 1].map(|estimator| {
        let pixels = (0..a.visibility.len()).filter(|pixel| counts(*pixel, estimator));
        let differences = pixels.map(|pixel| (a.visibility[pixel][estimator] - b.visibility[pixel][estimator]).abs());
        let (sum, count) = differences.fold((0.0, 0), |(sum, count), difference| (sum + difference, count + 1));
        assert!(count > 50, "{count} pixels");
        sum / count as f32
    })
}

#[test]
fn a_moving_camera_leaves_no_trail() {
    if !adapter::available() {
        return;
    }
    let mut headless = settled();
    for _ in 0..6 {
        headless.update();
        let world = headless.app.world_mut();
        let mut camera =
            world.query_filtered::<&mut Transform, With<Camera3d>>().single_mut(world).expect("one camera");
        camera.translate_around(Vec3::ZERO, Quat::from_rotation_y(0.02));
        camera.rotate_y(0.02);
    }
    let moved = probe::read(&mut headless);
    let [ambient, sun] = mean_difference(&moved, &fresh(&mut headless), |_, _| true);
    println!("a moving camera: ambient {ambient:.4}, sun {sun:.4} from a frame of its own");
    assert!(ambient <= 0.02 && sun <= 0.02, "ambient {ambient}, sun {sun}");
    assert!(ambient > 0.0, "frames are accumulated at all");
}

#[test]
fn shadows_that_have_left_are_gone_after_four_frames() {
    if !adapter::available() {
        return;
    }
    let mut headless = settled();
    let before = probe::read(&mut headless);
    headless.app.world_mut().resource_mut::<SceneClock>().0 = 0.5;
    for _ in 0..3 {
        headless.update();
    }
    // The fourth.
    let after = probe::read(&mut headless);
    let fresh = fresh(&mut headless);
    // Where it was darker before, on surfaces that have stayed where they were.
    let stayed = |pixel: usize| (before.geometry.depth[pixel] - fresh.geometry.depth[pixel]).abs() < 1e-6;
    let left = |pixel: usize, estimator: usize| {
        stayed(pixel) && fresh.visibility[pixel][estimator] - before.visibility[pixel][estimator] > 0.1
    };
    let [ambient, sun] = mean_difference(&after, &fresh, left);
    println!("what has left: ambient {ambient:.4}, sun {sun:.4} from a frame of its own");
    assert!(ambient <= 0.02 && sun <= 0.02, "ambient {ambient}, sun {sun}");
}
