//! Nothing is lost, and nothing fails, when fields and entities go and come in any order, or do not fit the GPU.

use std::time::Instant;

use bevy::prelude::*;
use bevy::render::RenderApp;
use bevy_visfield::prelude::*;
use bevy_visfield::{FieldLevel, FieldResidency, NoShadow, VisibilityFieldSet, why_no_shadow};
use image::RgbaImage;
use visfield::field::ball;
use visfield::field::directions::DirectionMap;
use visfield::{Encoding, FieldParts, Representation};
use visfield_workspace::headless::HeadlessApp;

use crate::adapter;
use crate::stage::{BESIDE, SHADOW, SIZE, Shading, Stage, ball_field, ball_with_caps, brightness, largest_difference};

impl Stage {
    fn fields(&mut self) -> Mut<'_, Assets<VisibilityField>> {
        self.headless.app.world_mut().resource_mut()
    }

    fn field_of(&mut self, entity: Entity) -> Handle<VisibilityField> {
        self.entity(entity).get::<VisibilityField3d>().expect("it is an occluder").0.clone()
    }

    fn why(&mut self, entity: Entity) -> Option<NoShadow> {
        why_no_shadow(self.headless.app.world_mut(), entity)
    }

    /// How much darker the picture is beside the ball and in its shadow.
    fn darkening(&mut self, off: &RgbaImage, picture: &RgbaImage) -> [i32; 2] {
        [BESIDE, SHADOW].map(|point| {
            let at = self.pixel_of(point);
            brightness(off, at) - brightness(picture, at)
        })
    }

    fn residency(&self) -> &FieldResidency {
        self.headless.app.sub_app(RenderApp).world().resource()
    }

    /// Runs frames until another field is uploaded.
    fn wait_for_uploads(&mut self) {
        let (uploads, start) = (self.statistics().uploads, Instant::now());
        while self.statistics().uploads == uploads {
            assert!(start.elapsed().as_secs() < 20, "no field is uploaded");
            self.headless.update();
        }
    }

    fn set_budget(&mut self, bytes: u64) {
        self.headless.app.world_mut().resource_mut::<FieldMemoryBudget>().bytes = bytes;
    }

    /// The picture without fields, of a stage that has them.
    fn picture_without(&mut self) -> RgbaImage {
        let world = self.headless.app.world_mut();
        let occluders: Vec<Entity> = world.query_filtered::<Entity, With<VisibilityField3d>>().iter(world).collect();
        for &occluder in &occluders {
            self.entity(occluder).insert(NotFieldOccluder);
        }
        let off = self.picture();
        for occluder in occluders {
            self.entity(occluder).remove::<NotFieldOccluder>();
        }
        off
    }
}

/// The papers' table of the ball, which the GPU does not read, and its cap grid or nothing beside it.
fn ball_of_hemispheres(caps: bool) -> visfield::VisibilityField {
    let papers = Representation::Hemisphere { positions: 290, directions: 8, map: DirectionMap::Concentric };
    let mut parts = ball(0.98, papers, Encoding::U8).parts().clone();
    parts.cap_grid = ball_with_caps(false).cap_grid().filter(|_| caps).cloned();
    visfield::VisibilityField::new(ball_field().header().clone(), parts).expect("both parts are sound")
}

#[test]
fn a_field_that_is_unloaded_stops_occluding_and_comes_back() {
    if !adapter::available() {
        return;
    }
    let mut stage = Stage::new(Shading::Forward);
    let ball = stage.ball;
    let on = stage.picture();
    let off = stage.picture_without();
    assert_eq!(stage.why(ball), None);
    let handle = stage.field_of(ball);
    for _ in 0..2 {
        let field = stage.fields().remove(&handle).expect("it is there");
        stage.headless.update();
        // Ready is what it will not be.
        assert_eq!(largest_difference(&stage.headless.capture(), &off), 0);
        assert_eq!((stage.why(ball), stage.statistics().resident_bytes), (Some(NoShadow::NotLoading), 0));
        stage.fields().insert(&handle, field).expect("the handle is alive");
        assert_eq!(largest_difference(&stage.picture(), &on), 0);
        assert_eq!(stage.why(ball), None);
    }
    // Out and in again within a frame.
    let field = stage.fields().remove(&handle).expect("it is there");
    stage.fields().insert(&handle, field).expect("the handle is alive");
    assert_eq!(largest_difference(&stage.picture(), &on), 0);
}

#[test]
fn a_field_can_be_replaced_by_any_other_while_in_use() {
    if !adapter::available() {
        return;
    }
    let mut stage = Stage::with_field(Shading::Forward, SIZE, ball_with_caps(true));
    let entity = stage.ball;
    let on = stage.picture();
    let off = stage.picture_without();
    let handle = stage.field_of(entity);
    let bits = ball_field().table().unwrap().with_encoding(Encoding::Bit).unwrap();
    let small = ball_field().table().unwrap().coarser().unwrap();
    let of_table = |table| ball_field().with_table(table);
    for (name, field, ambient, shadow, reason) in [
        ("small", of_table(small), true, true, None),
        ("hemispheres", ball_of_hemispheres(false), false, false, Some(NoShadow::Hemisphere)),
        ("bits", of_table(bits), true, true, None),
        ("caps", ball_with_caps(false), true, false, Some(NoShadow::NoTable)),
        ("hemispheres and caps", ball_of_hemispheres(true), true, false, Some(NoShadow::Hemisphere)),
        ("both", ball_with_caps(true), true, true, None),
    ] {
        let parts: &FieldParts = field.parts();
        let most = parts.bytes() + 1024;
        stage.fields().insert(&handle, VisibilityField(field)).expect("the handle is alive");
        let picture = stage.picture();
        let [beside, shadowed] = stage.darkening(&off, &picture);
        println!("{name}: {beside} beside, {shadowed} in the shadow; {:?}", stage.statistics());
        assert_eq!(beside > 4, ambient, "{name}: {beside} darker beside the ball");
        assert_eq!(shadowed > 20, shadow, "{name}: {shadowed} darker in its shadow");
        assert_eq!(stage.why(entity), reason, "{name}");
        assert!(stage.statistics().resident_bytes <= most, "{name}: what was replaced is freed");
        if !ambient {
            assert_eq!(largest_difference(&picture, &off), 0, "{name}");
        }
    }
    assert_eq!(largest_difference(&stage.picture(), &on), 0, "nothing of the others is left");
}

#[test]
fn a_file_that_is_reloaded_replaces_its_field() {
    if !adapter::available() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.vfield");
    visfield::file::write(&path, &[ball_with_caps(true)]).unwrap();
    let root = folder.path().to_string_lossy().into_owned();
    let mut stage = Stage::with_app(Shading::Forward, SIZE, ball_field(), |size| {
        HeadlessApp::new(size, |plugins| plugins.set(AssetPlugin { file_path: root, ..default() }))
    });
    let server = stage.headless.app.world().resource::<AssetServer>().clone();
    let ball = stage.ball;
    // Files are reloaded while one of their own handles lives, or while they are watched.
    let _file: Handle<VisibilityFieldSet> = server.load("ball.vfield");
    stage.entity(ball).insert(VisibilityField3d(server.load("ball.vfield#ball")));
    let both = stage.picture();
    let off = stage.picture_without();

    visfield::file::write(&path, &[ball_with_caps(false)]).unwrap();
    server.reload("ball.vfield");
    stage.wait_for_uploads();
    let caps = stage.picture();
    let [beside, shadow] = stage.darkening(&off, &caps);
    assert!(beside > 4 && shadow <= stage.darkening(&off, &both)[1] - 20, "the table is gone: {beside}, {shadow}");

    // What is no field any more leaves the old one.
    std::fs::write(&path, b"not a field").unwrap();
    server.reload("ball.vfield");
    let start = Instant::now();
    stage.headless.update_until(|_| start.elapsed().as_millis() > 500);
    assert_eq!(largest_difference(&stage.headless.capture(), &caps), 0);
    visfield::file::write(&path, &[ball_with_caps(true)]).unwrap();
    server.reload("ball.vfield");
    stage.wait_for_uploads();
    assert_eq!(largest_difference(&stage.picture(), &both), 0);
}

#[test]
fn entities_can_go_in_any_order() {
    if !adapter::available() {
        return;
    }
    for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
        let mut stage = Stage::new(Shading::Forward);
        let entities = [stage.ball, stage.sun, stage.camera];
        for index in order {
            stage.entity(entities[index]).despawn();
            for _ in 0..3 {
                stage.headless.update();
            }
        }
        assert_eq!(stage.statistics().resident_bytes, 0, "the last handle of the field went with the ball");
        assert_eq!(stage.why(entities[0]), Some(NoShadow::NoEntity));
    }
    // All within one frame.
    let mut stage = Stage::new(Shading::Forward);
    for entity in [stage.camera, stage.ball, stage.sun] {
        stage.entity(entity).despawn();
    }
    for _ in 0..3 {
        stage.headless.update();
    }
    assert_eq!(stage.residency().fields().count(), 0);
}

#[test]
fn a_field_that_never_arrives_leaves_the_others_alone() {
    if !adapter::available() {
        return;
    }
    let mut stage = Stage::new(Shading::Forward);
    let on = stage.picture();
    let world = stage.headless.app.world_mut();
    let nowhere = world.resource::<AssetServer>().load("nowhere.vfield#ball");
    let near = Transform::from_xyz(1.0, 1.0, 1.0);
    let [missing, forgotten] = [VisibilityField3d(nowhere), VisibilityField3d::default()]
        .map(|field| stage.headless.app.world_mut().spawn((field, near)).id());
    let mut why = None;
    stage.headless.update_until(|app| {
        why = why_no_shadow(app.world_mut(), missing);
        why != Some(NoShadow::Loading)
    });
    assert_eq!(why, Some(NoShadow::LoadFailed));
    assert_eq!(stage.why(forgotten), Some(NoShadow::NotLoading));
    assert_eq!(largest_difference(&stage.headless.capture(), &on), 0);
    assert_eq!(stage.residency().fields().count(), 1);
}

/// A stage with fields of their own for the ball and for four more, ever farther away.
fn crowded_stage() -> (Stage, Vec<Entity>) {
    let mut stage = Stage::with_field(Shading::Forward, SIZE, ball_with_caps(true));
    let mut balls = vec![stage.ball];
    for i in 1..5 {
        let field = stage.fields().add(VisibilityField(ball_with_caps(true)));
        let place = Transform::from_xyz(2.0, 0.5, -6.0 * i as f32).with_scale(Vec3::splat(0.5));
        balls.push(stage.headless.app.world_mut().spawn((VisibilityField3d(field), place)).id());
    }
    (stage, balls)
}

impl Stage {
    /// Runs frames until nothing more happens to the fields on the GPU; tables are made coarser in the background.
    fn settle(&mut self) {
        let (mut calm, mut before) = (0, None);
        self.headless.update_until(|app| {
            let residency = app.sub_app(RenderApp).world().resource::<FieldResidency>();
            let now = Some((residency.statistics(), residency.budget()));
            calm = if now == before { calm + 1 } else { 0 };
            before = now;
            calm > 60
        });
    }

    /// The levels of these objects' fields.
    fn levels(&mut self, objects: &[Entity]) -> Vec<FieldLevel> {
        let ids: Vec<_> = objects.iter().map(|object| self.field_of(*object).id()).collect();
        ids.into_iter().map(|id| self.residency().level(id)).collect()
    }
}

/// Bytes of a whole field of the crowd, and less than those of a coarser one with its cap grid.
const WHOLE: u64 = 4_500_000;
const COARSE: u64 = 310_000;

#[test]
fn more_fields_than_the_budget_degrade_step_by_step_and_recover() {
    use FieldLevel::{Absent, Coarse, Full, WithoutTable};
    if !adapter::available() {
        return;
    }
    let (mut stage, balls) = crowded_stage();
    let on = stage.picture();
    let off = stage.picture_without();
    let everything = stage.residency().asked_bytes();
    assert_eq!(stage.levels(&balls), [Full; 5]);
    let caps = ball_with_caps(false).bytes() + 512;
    for (budget, expected) in [
        (everything, [Full; 5]),
        (everything - 1, [Full, Full, Full, Full, Coarse]),
        (2 * WHOLE + 3 * COARSE, [Full, Full, Coarse, Coarse, Coarse]),
        (5 * COARSE, [Coarse; 5]),
        (2 * COARSE + 3 * caps, [Coarse, Coarse, WithoutTable, WithoutTable, WithoutTable]),
        (5 * caps, [WithoutTable; 5]),
        (2 * caps, [WithoutTable, WithoutTable, Absent, Absent, Absent]),
        (100, [Absent; 5]),
        // Back, over another way.
        (3 * caps, [WithoutTable, WithoutTable, WithoutTable, Absent, Absent]),
        (4 * WHOLE + COARSE, [Full, Full, Full, Full, Coarse]),
        (COARSE + 4 * caps, [Coarse, WithoutTable, WithoutTable, WithoutTable, WithoutTable]),
        (u64::MAX, [Full; 5]),
    ] {
        stage.set_budget(budget);
        stage.settle();
        let picture = stage.picture();
        let [beside, shadow] = stage.darkening(&off, &picture);
        let found = stage.statistics();
        let levels = stage.levels(&balls);
        println!("{budget}: {levels:?}, {beside} beside, {shadow} in the shadow; {found:?}");
        assert_eq!(levels, expected, "{budget}");
        assert!(found.resident_bytes <= budget && found.buffer_bytes <= budget.max(4096), "{budget}: {found:?}");
        let told: u64 = stage.residency().fields().map(|(_, _, bytes)| bytes).sum();
        assert_eq!(told, found.resident_bytes, "{budget}");
        // The ball, which is nearest, does what its level can.
        assert_eq!(beside > 4, expected[0] >= WithoutTable, "{budget}: {beside}");
        assert_eq!(shadow > 20, expected[0] >= Coarse, "{budget}: {shadow}");
        let reasons: Vec<_> = balls.iter().map(|ball| stage.why(*ball)).collect();
        let reason = |level: &FieldLevel| match level {
            Absent => Some(NoShadow::OverBudget),
            WithoutTable => Some(NoShadow::TableOverBudget),
            Coarse | Full => None,
        };
        assert_eq!(reasons, expected.iter().map(reason).collect::<Vec<_>>(), "{budget}");
        match expected[0] {
            Full => assert!(largest_difference(&picture, &on) <= 2, "{budget}"),
            // The edge of the shadow moves.
            Coarse => {
                let pixels = picture.pixels().zip(on.pixels());
                let moved = pixels.filter(|(a, b)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 20)).count();
                assert!(moved <= 200, "{budget}: {moved} pixels");
            }
            WithoutTable => {}
            Absent => assert_eq!(largest_difference(&picture, &off), 0, "{budget}"),
        }
    }
    assert_eq!(largest_difference(&stage.picture(), &on), 0, "all is as it was");
}

#[test]
fn what_is_needed_most_follows_the_camera_and_does_not_flicker() {
    use FieldLevel::{Coarse, Full};
    if !adapter::available() {
        return;
    }
    let (mut stage, balls) = crowded_stage();
    stage.set_budget(WHOLE + 4 * COARSE);
    stage.settle();
    assert_eq!(stage.levels(&balls), [Full, Coarse, Coarse, Coarse, Coarse]);

    // Near the farthest; the nearest ones lose.
    let camera = stage.camera;
    stage.entity(camera).get_mut::<Transform>().unwrap().translation = Vec3::new(2.0, 1.0, -26.0);
    stage.settle();
    assert_eq!(stage.levels(&balls), [Coarse, Coarse, Coarse, Coarse, Full]);

    // Back and forth between two of them, a little: nothing is uploaded.
    stage.entity(camera).get_mut::<Transform>().unwrap().translation = Vec3::new(2.0, 0.5, -14.9);
    stage.settle();
    let (levels, uploads) = (stage.levels(&balls), stage.statistics().uploads);
    assert_eq!(levels, [Coarse, Coarse, Full, Coarse, Coarse]);
    for i in 0..20 {
        let z = if i % 2 == 0 { -15.1 } else { -14.9 };
        stage.entity(camera).get_mut::<Transform>().unwrap().translation.z = z;
        stage.headless.update();
    }
    assert_eq!((stage.levels(&balls), stage.statistics().uploads), (levels, uploads));
}

#[test]
fn uploads_are_spread_over_frames() {
    if !adapter::available() {
        return;
    }
    let (mut stage, balls) = crowded_stage();
    stage.set_budget(100);
    stage.settle();
    stage.headless.app.world_mut().resource_mut::<FieldMemoryBudget>().upload_bytes_per_frame = 2 * WHOLE;
    stage.set_budget(u64::MAX);
    let mut before = stage.statistics().uploads;
    let mut frames = 0;
    while stage.levels(&balls) != [FieldLevel::Full; 5] {
        stage.headless.update();
        let now = stage.statistics().uploads;
        assert!(now - before <= 2, "{} fields in a frame", now - before);
        (before, frames) = (now, frames + 1);
        assert!(frames < 100);
    }
    assert!(frames >= 3);
}

#[test]
fn fields_may_come_and_go_while_the_budget_is_short() {
    if !adapter::available() {
        return;
    }
    let (mut stage, balls) = crowded_stage();
    let on = stage.picture();
    let (everything, mut most) = (stage.residency().asked_bytes(), 0);
    stage.set_budget(WHOLE + COARSE);
    let mut handles: Vec<_> = balls.iter().map(|ball| stage.field_of(*ball)).collect();
    for round in 0..40_usize {
        let index = round * 7 % handles.len();
        let handle = handles[index].clone();
        match round % 4 {
            // While its coarser table is being made, perhaps.
            0 => _ = stage.fields().remove(&handle),
            1 => _ = stage.fields().insert(&handle, VisibilityField(ball_field())),
            2 => _ = stage.fields().insert(&handle, VisibilityField(ball_of_hemispheres(round % 8 == 2))),
            _ => {
                let field = stage.fields().add(VisibilityField(ball_with_caps(round % 8 == 3)));
                stage.entity(balls[index]).insert(VisibilityField3d(field.clone()));
                handles[index] = field;
            }
        }
        stage.set_budget([WHOLE + COARSE, 2 * COARSE, 50_000, 3 * WHOLE][round / 3 % 4]);
        stage.headless.update();
        let found = stage.statistics();
        most = most.max(found.resident_bytes);
    }
    assert!(most <= everything, "{most} bytes, and {everything} without a budget");
    // All of them as in the beginning.
    for handle in &handles {
        stage.fields().insert(handle, VisibilityField(ball_with_caps(true))).expect("the handle is alive");
    }
    stage.set_budget(FieldMemoryBudget::default().bytes);
    stage.settle();
    assert_eq!(stage.levels(&balls), [FieldLevel::Full; 5]);
    assert_eq!(largest_difference(&stage.picture(), &on), 0);
}
