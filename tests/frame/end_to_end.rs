//! The picture: what must darken darkens, what must not change does not.

use bevy::camera::Viewport;
use bevy::camera::visibility::RenderLayers;
use bevy::core_pipeline::prepass::NormalPrepass;
use bevy::prelude::*;
use bevy_visfield::prelude::*;

use crate::adapter;
use crate::stage::{BESIDE, OPEN, SHADOW, SIZE, SKY, Shading, Stage, ball_with_caps, brightness, largest_difference};

fn what_must_darken_darkens(shading: Shading) {
    if !adapter::available() {
        return;
    }
    let mut stage = Stage::new(shading);
    let on = stage.picture();
    let (camera, sun) = (stage.camera, stage.sun);

    stage.entity(sun).remove::<FieldShadows>();
    let only_ambient = stage.picture();
    stage.entity(camera).remove::<FieldOcclusion>();
    let off = stage.picture();
    stage.entity(camera).insert(FieldOcclusion { ambient_occlusion: false, ..default() });
    stage.entity(sun).insert(FieldShadows { angular_radius: 0.05 });
    let only_shadow = stage.picture();

    let [beside, shadow, open] = [BESIDE, SHADOW, OPEN].map(|point| stage.pixel_of(point));
    let at = |pixel| [&off, &only_ambient, &only_shadow, &on].map(|picture| brightness(picture, pixel));
    println!(
        "{shading:?}: off, ambient, shadow, on: beside {:?}, shadow {:?}, open {:?}",
        at(beside),
        at(shadow),
        at(open)
    );
    let [off_at, ambient_at, shadow_at, on_at] = at(beside);
    assert!(ambient_at < off_at - 4, "ambient occlusion beside the ball");
    assert!((shadow_at - off_at).abs() <= 1, "no shadow there");
    assert!((on_at - ambient_at).abs() <= 1);
    let [off_at, ambient_at, shadow_at, on_at] = at(shadow);
    assert!(shadow_at < off_at - 20, "the sun's shadow");
    assert!(ambient_at < off_at - 4 && on_at < shadow_at, "and ambient occlusion in it");
    let open_at = at(open);
    assert!(open_at.iter().all(|&value| (value - open_at[0]).abs() <= 3), "hardly anything far away: {open_at:?}");
    for picture in [&only_ambient, &only_shadow, &on] {
        assert_eq!(picture.get_pixel(SKY.0, SKY.1), off.get_pixel(SKY.0, SKY.1), "the background stays");
    }
}

#[test]
fn what_must_darken_darkens_forward() {
    what_must_darken_darkens(Shading::Forward);
}

#[test]
fn what_must_darken_darkens_deferred() {
    what_must_darken_darkens(Shading::Deferred);
}

#[test]
fn the_shadow_follows_the_object() {
    if !adapter::available() {
        return;
    }
    let mut stage = Stage::new(Shading::Forward);
    let old_place = stage.pixel_of(SHADOW);
    let moved = Vec3::new(1.5, 0.0, 0.0);
    let new_place = stage.pixel_of(SHADOW + moved);
    let before = stage.picture();
    let uploaded = stage.statistics();
    let ball = stage.ball;
    stage.entity(ball).get_mut::<Transform>().unwrap().translation += moved;
    let after = stage.picture();
    assert!(brightness(&after, old_place) > brightness(&before, old_place) + 20, "light where it was");
    assert!(brightness(&after, new_place) < brightness(&before, new_place) - 20, "dark where it is");
    assert_eq!(stage.statistics(), uploaded, "moving uploads no field");
    assert_eq!(largest_difference(&after, &stage.picture()), 0, "a still scene gives the same frame");
}

#[test]
fn caps_darken_as_rays_do() {
    if !adapter::available() {
        return;
    }
    let mut stage = Stage::with_field(Shading::Forward, SIZE, ball_with_caps(true));
    let (camera, sun) = (stage.camera, stage.sun);
    // Beside caps, the sun's rays still go through the filter.
    let with_sun = stage.picture();
    stage.entity(sun).remove::<FieldShadows>();
    let mut by = |estimator| {
        stage.entity(camera).insert(FieldOcclusion { estimator, ..default() });
        stage.picture()
    };
    let [caps, rays] = [OcclusionEstimator::CapGrid, OcclusionEstimator::Rays].map(&mut by);
    stage.entity(camera).remove::<FieldOcclusion>();
    let off = stage.picture();
    for point in [BESIDE, SHADOW, OPEN] {
        let at = stage.pixel_of(point);
        let [off, caps, rays] = [&off, &caps, &rays].map(|picture| brightness(picture, at));
        println!("at {point}: off {off}, caps {caps}, rays {rays}");
        assert!((caps - rays).abs() <= 3, "{point}: {caps} by caps, {rays} by rays, {off} without");
        assert!(caps < off - 4 || point == OPEN, "{point}: {caps} by caps, {off} without");
    }
    let [beside, shadow] = [BESIDE, SHADOW].map(|point| stage.pixel_of(point));
    assert!((brightness(&with_sun, beside) - brightness(&caps, beside)).abs() <= 1, "caps do not depend on the sun");
    assert!(brightness(&with_sun, shadow) < brightness(&caps, shadow) - 20, "the sun's shadow is there too");
}

#[test]
fn caps_alone_occlude_and_make_the_same_frame_again() {
    if !adapter::available() {
        return;
    }
    let mut stage = Stage::with_field(Shading::Forward, SIZE, ball_with_caps(false));
    let (camera, ball) = (stage.camera, stage.ball);
    let first = stage.picture();
    assert_eq!(largest_difference(&first, &stage.picture()), 0, "a still scene gives the same frame");
    stage.entity(ball).get_mut::<Transform>().unwrap().translation.x += 0.5;
    assert!(largest_difference(&first, &stage.picture()) > 4, "what moves takes its occlusion along");
    stage.entity(ball).get_mut::<Transform>().unwrap().translation.x -= 0.5;
    assert_eq!(largest_difference(&first, &stage.picture()), 0, "and leaves nothing behind");
    stage.entity(camera).insert(FieldOcclusion { ambient_occlusion: false, ..default() });
    let off = stage.picture();
    let beside = stage.pixel_of(BESIDE);
    assert!(brightness(&first, beside) < brightness(&off, beside) - 4);
}

#[test]
fn without_occluders_the_image_is_bevys_own() {
    if !adapter::available() {
        return;
    }
    for shading in [Shading::Forward, Shading::Deferred] {
        let mut stage = Stage::new(shading);
        let (ball, camera) = (stage.ball, stage.camera);
        let with_occluder = stage.picture();
        stage.entity(ball).insert(NotFieldOccluder);
        let with_plugin = stage.picture();
        stage.entity(camera).remove::<FieldOcclusion>();
        let bevys_own = stage.picture();
        assert!(largest_difference(&with_occluder, &bevys_own) > 30, "the plugin does something");
        let difference = largest_difference(&with_plugin, &bevys_own);
        assert!(difference <= 1, "{shading:?}: {difference}/255 apart without occluders");

        // Back and forth at run time: nothing of the camera's state sticks.
        stage.entity(camera).insert(FieldOcclusion::default());
        stage.entity(ball).remove::<NotFieldOccluder>();
        assert_eq!(largest_difference(&stage.picture(), &with_occluder), 0);
    }
}

#[test]
fn one_field_is_uploaded_once_for_all_its_instances() {
    if !adapter::available() {
        return;
    }
    let mut stage = Stage::new(Shading::Forward);
    let ball = stage.ball;
    let field = stage.entity(ball).get::<VisibilityField3d>().cloned().unwrap();
    for i in 0..30 {
        let place = Transform::from_xyz(i as f32 * 0.3 - 4.0, 0.3, -2.0).with_scale(Vec3::splat(0.2));
        stage.headless.app.world_mut().spawn((field.clone(), place));
    }
    let with_many = stage.picture();
    let table = 65 * 65 * 32 * 32;
    let found = stage.statistics();
    assert_eq!((found.uploads, found.uploaded_bytes, found.resident_bytes), (1, table, table));

    // When the last user goes, so does the table.
    let world = stage.headless.app.world_mut();
    let users: Vec<Entity> = world.query_filtered::<Entity, With<VisibilityField3d>>().iter(world).collect();
    for user in users {
        world.despawn(user);
    }
    drop(field);
    let empty = stage.picture();
    assert_eq!(stage.statistics().resident_bytes, 0, "the table is freed");
    assert!(largest_difference(&with_many, &empty) > 30);
}

#[test]
fn the_debug_view_shows_the_occlusion() {
    if !adapter::available() {
        return;
    }
    let mut stage = Stage::new(Shading::Forward);
    let [beside, shadow] = [BESIDE, SHADOW].map(|point| stage.pixel_of(point));
    let camera = stage.camera;
    stage.entity(camera).insert(FieldDebugView::Light(0));
    let sun = stage.picture();
    assert!(brightness(&sun, shadow) < 10 && brightness(&sun, SKY) > 250 && brightness(&sun, beside) > 250);
    stage.entity(camera).insert(FieldDebugView::AmbientVisibility);
    let ambient = stage.picture();
    assert!((60..245).contains(&brightness(&ambient, beside)) && brightness(&ambient, SKY) > 250);
    stage.entity(camera).remove::<FieldDebugView>();
    assert_ne!(stage.picture().get_pixel(SKY.0, SKY.1), ambient.get_pixel(SKY.0, SKY.1));
}

#[test]
fn a_viewport_shows_what_a_picture_of_its_own_would() {
    if !adapter::available() {
        return;
    }
    // The right half of the target, and a target as large as that half.
    let half = UVec2::new(SIZE.x / 2, SIZE.y);
    let mut whole = Stage::with_size(Shading::Forward, half);
    let own_picture = whole.picture();
    let mut part = Stage::new(Shading::Forward);
    let camera = part.camera;
    part.entity(camera).get_mut::<Camera>().unwrap().viewport =
        Some(Viewport { physical_position: UVec2::new(half.x, 0), physical_size: half, ..default() });
    let picture = part.picture();
    let in_viewport = image::imageops::crop_imm(&picture, half.x, 0, half.x, half.y).to_image();
    let difference = largest_difference(&in_viewport, &own_picture);
    assert!(difference <= 1, "{difference}/255 apart");
}

#[test]
fn cameras_see_occluders_of_their_own_layers_only() {
    if !adapter::available() {
        return;
    }
    let mut stage = Stage::new(Shading::Forward);
    let (ball, camera) = (stage.ball, stage.camera);
    let beside = stage.pixel_of(BESIDE);
    let same_layer = stage.picture();
    stage.entity(ball).insert(RenderLayers::layer(1));
    let other_layer = stage.picture();
    assert!(brightness(&other_layer, beside) > brightness(&same_layer, beside) + 4);
    stage.entity(camera).insert(RenderLayers::from_layers(&[0, 1]));
    assert_eq!(largest_difference(&stage.picture(), &same_layer), 0);
}

#[test]
fn a_camera_that_loses_its_prepass_shows_bevys_own_picture() {
    if !adapter::available() {
        return;
    }
    let mut stage = Stage::new(Shading::Forward);
    let camera = stage.camera;
    let with_occlusion = stage.picture();
    stage.entity(camera).remove::<NormalPrepass>();
    let without_prepass = stage.picture();
    stage.entity(camera).insert(NormalPrepass);
    assert_eq!(largest_difference(&stage.picture(), &with_occlusion), 0);
    stage.entity(camera).remove::<FieldOcclusion>();
    assert!(largest_difference(&stage.picture(), &without_prepass) <= 1);
}

#[test]
fn a_tiny_picture_shows_bevys_own() {
    if !adapter::available() {
        return;
    }
    // As a window that is dragged small: Bevy's ambient occlusion would fail there and take the app with it.
    for size in [UVec2::new(12, 8), UVec2::ONE, UVec2::new(16, 1)] {
        assert_eq!(Stage::with_size(Shading::Forward, size).picture().dimensions(), (size.x, size.y));
    }
}
