//! What games set: opt-outs, other ambient occlusion, projections, several cameras, worlds of any size.

use bevy::camera::{ScalingMode, Viewport};
use bevy::pbr::ScreenSpaceAmbientOcclusion;
use bevy::prelude::*;
use bevy_visfield::prelude::*;
use image::RgbaImage;

use crate::adapter;
use crate::stage::{BESIDE, OPEN, SHADOW, SIZE, Shading, Stage, ball_with_caps, brightness, largest_difference};

/// How bright ambient visibility and that of the sun are at a point, of 255.
fn visibility_at(stage: &mut Stage, point: Vec3) -> [i32; 2] {
    let (camera, pixel) = (stage.camera, stage.pixel_of(point));
    let views = [FieldDebugView::AmbientVisibility, FieldDebugView::Light(0)];
    let found = views.map(|view| {
        stage.entity(camera).insert(view);
        brightness(&stage.picture(), pixel)
    });
    stage.entity(camera).remove::<FieldDebugView>();
    found
}

#[test]
fn casters_can_keep_either_to_themselves() {
    if !adapter::available() {
        return;
    }
    let mut stage = Stage::with_field(Shading::Forward, SIZE, ball_with_caps(true));
    let ball = stage.ball;
    let [ambient, _] = visibility_at(&mut stage, BESIDE);
    let [_, sun] = visibility_at(&mut stage, SHADOW);
    assert!(ambient < 240 && sun < 10, "{ambient}, {sun}");

    stage.entity(ball).insert(NotFieldShadowCaster);
    assert_eq!((visibility_at(&mut stage, BESIDE)[0], visibility_at(&mut stage, SHADOW)[1]), (ambient, 255));
    stage.entity(ball).remove::<NotFieldShadowCaster>().insert(NotFieldAmbientOccluder);
    assert_eq!((visibility_at(&mut stage, BESIDE)[0], visibility_at(&mut stage, SHADOW)[1]), (255, sun));
    stage.entity(ball).insert(NotFieldOccluder);
    assert_eq!((visibility_at(&mut stage, BESIDE)[0], visibility_at(&mut stage, SHADOW)[1]), (255, 255));
}

#[test]
fn receivers_can_keep_ambient_light() {
    if !adapter::available() {
        return;
    }
    for estimator in [OcclusionEstimator::CapGrid, OcclusionEstimator::Rays] {
        let mut stage = Stage::with_field(Shading::Deferred, SIZE, ball_with_caps(true));
        let (camera, ball) = (stage.camera, stage.ball);
        stage.entity(camera).insert(FieldOcclusion { estimator, ..default() });
        let world = stage.headless.app.world_mut();
        let floor = world.query_filtered::<Entity, (With<Mesh3d>, Without<VisibilityField3d>)>().single(world).unwrap();
        let before = visibility_at(&mut stage, SHADOW);
        stage.entity(floor).insert(NotFieldReceiver);
        let after = visibility_at(&mut stage, SHADOW);
        assert!(before[0] < 235 && after == [255, before[1]], "{estimator:?}: {before:?}, {after:?}");
        stage.entity(floor).remove::<NotFieldReceiver>();
        stage.entity(ball).insert(OwnSurfaceOcclusion::Off);
        assert_eq!(visibility_at(&mut stage, SHADOW), before, "the floor is not the ball's own surface");
    }
}

/// The ambient visibility that a camera shows.
fn ambient_picture(stage: &mut Stage) -> RgbaImage {
    let camera = stage.camera;
    stage.entity(camera).insert(FieldDebugView::AmbientVisibility);
    // Bevy's own effect is black until its pipelines are compiled, and settles over a few frames.
    (0..3).for_each(|_| drop(stage.picture()));
    stage.picture()
}

#[test]
fn screen_space_ambient_occlusion_can_be_joined() {
    if !adapter::available() {
        return;
    }
    let mut stage = Stage::with_field(Shading::Forward, SIZE, ball_with_caps(true));
    let camera = stage.camera;
    let of_fields = ambient_picture(&mut stage);
    let mut with = |screen_space| {
        let joined = FieldOcclusion { screen_space, ..default() };
        stage.entity(camera).insert((joined, ScreenSpaceAmbientOcclusion::default()));
        ambient_picture(&mut stage)
    };
    let ignored = with(ScreenSpaceOcclusion::Ignored);
    let [darker, product] = [ScreenSpaceOcclusion::Darker, ScreenSpaceOcclusion::Product].map(&mut with);
    assert_eq!(largest_difference(&ignored, &of_fields), 0);
    let pixels =
        || of_fields.pixels().zip(darker.pixels()).zip(product.pixels()).map(|((f, d), p)| [f.0[0], d.0[0], p.0[0]]);
    assert!(pixels().all(|[fields, darker, product]| darker <= fields && product <= darker.saturating_add(1)));
    let darkened = pixels().filter(|[fields, darker, _]| *darker + 8 < *fields).count();
    let twice = pixels().filter(|[_, darker, product]| *product + 8 < *darker).count();
    assert!(darkened > 20 && twice > 20, "{darkened} pixels darker, {twice} darker still");
    assert!(pixels().filter(|[_, darker, _]| *darker > 250).count() > 2000, "the sky, and the open floor");
}

#[test]
fn orthographic_cameras_see_the_same() {
    if !adapter::available() {
        return;
    }
    let mut stage = Stage::new(Shading::Forward);
    let camera = stage.camera;
    let scaling_mode = ScalingMode::FixedVertical { viewport_height: 8.0 };
    let orthographic = OrthographicProjection { scaling_mode, ..OrthographicProjection::default_3d() };
    stage.entity(camera).insert(Projection::Orthographic(orthographic));
    stage.picture();
    let [ambient, sun] = visibility_at(&mut stage, SHADOW);
    assert!(ambient < 235 && sun < 10, "{ambient}, {sun}");
    assert_eq!(visibility_at(&mut stage, OPEN)[1], 255);
}

#[test]
fn cameras_side_by_side_show_their_own() {
    if !adapter::available() {
        return;
    }
    let half = UVec2::new(SIZE.x / 2, SIZE.y);
    let mut stage = Stage::new(Shading::Forward);
    let camera = stage.camera;
    let part = |x| Some(Viewport { physical_position: UVec2::new(x, 0), physical_size: half, ..default() });
    stage.entity(camera).get_mut::<Camera>().unwrap().viewport = part(0);
    let second = stage.headless.app.world_mut().entity_mut(camera).clone_and_spawn();
    let mut second = stage.headless.app.world_mut().entity_mut(second);
    let mut settings = second.get_mut::<Camera>().unwrap();
    (settings.viewport, settings.order) = (part(half.x), 1);
    second.insert(FieldOcclusion { quality: FieldOcclusionQuality::High, ..default() });
    let picture = stage.picture();
    let [left, right] = [0, half.x].map(|x| image::imageops::crop_imm(&picture, x, 0, half.x, half.y).to_image());
    // The same by other estimators: alike, and not the same.
    let apart = left.as_raw().iter().zip(right.as_raw()).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>();
    let mean = apart / left.as_raw().len() as f64;
    assert!(mean > 0.0 && mean < 1.0, "{mean} of 255 apart in the mean");
}

/// As large as to be seen a million units away at all: positions there come in sixteenths.
const SCALE: f32 = 64.0;

#[test]
fn a_million_units_away_looks_as_at_the_origin() {
    if !adapter::available() {
        return;
    }
    let pictures = [Vec3::ZERO, Vec3::new(1.0e6, 0.0, -1.0e6)].map(|place| {
        let mut stage = Stage::with_field(Shading::Forward, SIZE, ball_with_caps(true));
        let world = stage.headless.app.world_mut();
        let mut placed = world.query_filtered::<&mut Transform, Or<(With<Mesh3d>, With<Camera3d>)>>();
        for mut transform in placed.iter_mut(world) {
            transform.translation = transform.translation * SCALE + place;
            transform.scale *= SCALE;
        }
        let camera = stage.camera;
        let mut camera = stage.entity(camera);
        camera.get_mut::<Transform>().unwrap().scale = Vec3::ONE;
        camera.insert(Projection::Perspective(PerspectiveProjection { near: 1.0, far: 1.0e5, ..default() }));
        stage.picture();
        stage.picture()
    });
    let differing = pictures[0].pixels().zip(pictures[1].pixels()).filter(|(a, b)| {
        let apart = a.0.iter().zip(b.0).map(|(a, b)| a.abs_diff(b)).max();
        apart > Some(3)
    });
    // Edges move by hundredths of a pixel.
    let differing = differing.count();
    assert!(differing < (SIZE.x * SIZE.y / 200) as usize, "{differing} pixels differ");
}
