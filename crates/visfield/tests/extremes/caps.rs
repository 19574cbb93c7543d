//! Cap grids at their limits: answers stay between 0 and 1 and continuous, and batches are their receivers one by one.

use glam::{DAffine3, DQuat, DVec3, Vec3, dvec3};
use visfield::estimate::caps::{CapAmbient, CapCombination, CapScene, CapSettings};
use visfield::estimate::sampling::sphere_samples;
use visfield::estimate::{AmbientOcclusion, Receiver, ambient_occlusion};
use visfield::field::cap_grid::{self, CapGridError, CapGridHeader};
use visfield::field::{FieldParts, ball_field, example_caps};
use visfield::scene::{Instance, Scene};
use visfield::{BoundingEllipsoid, FieldHeader, VisibilityField};

const RULES: [CapCombination; 3] =
    [CapCombination::Product, CapCombination::SoftCaps { directions: 8 }, CapCombination::SoftCaps { directions: 16 }];

fn settings(combination: CapCombination) -> CapSettings {
    CapSettings { combination, ..CapSettings::default() }
}

/// Balls of several sizes, turned, mirrored, stretched and far from the origin, some of them overlapping, some vanishing.
fn crowd(origin: DVec3) -> Scene {
    let mut scene = Scene::default();
    let ball = scene.add_field(example_caps());
    for i in 0..40 {
        let i = f64::from(i);
        let scale =
            [dvec3(1.0, 1.0, 1.0), dvec3(0.3, -0.3, 0.3), dvec3(1.0, 2.0, 0.5), dvec3(1.0, 0.0, 1.0)][i as usize % 4];
        let at = dvec3((i * 1.7).sin() * 6.0, (i * 2.3).cos() * 6.0, (i * 0.9).sin() * 6.0);
        let place = DAffine3::from_scale_rotation_translation(scale, DQuat::from_rotation_y(i), origin + at);
        scene.instances.push(Instance::new(ball, place));
    }
    scene
}

fn receivers(origin: DVec3) -> Vec<Receiver> {
    let place = |(i, direction): (usize, Vec3)| Receiver {
        position: origin + direction.as_dvec3() * (1.02_f64.powi(i as i32) * 0.1),
        normal: sphere_samples(700)[(i * 37) % 700],
    };
    sphere_samples(700).into_iter().enumerate().map(place).collect()
}

#[test]
fn batches_are_their_receivers_one_by_one() {
    for origin in [DVec3::ZERO, dvec3(1e7, -3e6, 2e6)] {
        let scene = crowd(origin);
        let caps = CapScene::new(&scene, origin);
        let mut receivers = receivers(origin);
        for strange in [Vec3::ZERO, Vec3::NAN, Vec3::splat(f32::MAX), Vec3::INFINITY] {
            receivers.push(Receiver { position: origin, normal: strange });
            receivers.push(Receiver { position: origin + strange.as_dvec3(), normal: Vec3::Y });
        }
        for rule in RULES {
            let mut answers = vec![CapAmbient::UNOCCLUDED; receivers.len()];
            caps.ambient_batch(&receivers, &settings(rule), &mut answers);
            for (receiver, batched) in receivers.iter().zip(&answers) {
                let single = caps.ambient(receiver, &settings(rule));
                assert_eq!(single.occlusion.to_bits(), batched.occlusion.to_bits(), "{rule:?}: {receiver:?}");
                assert_eq!(
                    single.bent_normal.to_array().map(f32::to_bits),
                    batched.bent_normal.to_array().map(f32::to_bits)
                );
                assert!((0.0..=1.0).contains(&single.occlusion), "{rule:?}, {receiver:?}: {single:?}");
                let has_direction = receiver.normal.is_finite();
                assert!(!single.bent_normal.is_nan() || !has_direction, "{rule:?}, {receiver:?}: {single:?}");
            }
            let occluded = answers.iter().filter(|answer| answer.occlusion > 0.1).count();
            assert!(occluded > 100, "{occluded} receivers are occluded");
        }
    }
}

#[test]
fn the_origin_does_not_matter() {
    let [near, far] = [DVec3::ZERO, dvec3(1e7, -3e6, 2e6)].map(|origin| {
        let scene = crowd(origin);
        let caps = CapScene::new(&scene, origin);
        receivers(origin).iter().map(|r| caps.ambient(r, &CapSettings::default()).occlusion).collect::<Vec<f32>>()
    });
    for (near, far) in near.iter().zip(far) {
        assert!((near - far).abs() < 1e-3, "{near} and {far}");
    }
}

#[test]
fn one_object_hides_as_much_by_every_rule() {
    let mut scene = Scene::default();
    let ball = scene.add_field(example_caps());
    scene.instances.push(Instance::new(ball, DAffine3::IDENTITY));
    let caps = CapScene::new(&scene, DVec3::ZERO);
    for receiver in receivers(DVec3::ZERO).iter().filter(|receiver| receiver.position.length() > 1.2) {
        let [product, soft_8, soft_16] = RULES.map(|rule| caps.ambient(receiver, &settings(rule)).occlusion);
        assert!((product - soft_8).abs() < 1e-3 && (product - soft_16).abs() < 1e-3, "{product}, {soft_8}, {soft_16}");
    }
}

#[test]
fn a_reach_fades_objects_out() {
    let mut scene = Scene::default();
    let ball = scene.add_field(example_caps());
    scene.instances.push(Instance::new(ball, DAffine3::IDENTITY));
    let caps = CapScene::new(&scene, DVec3::ZERO);
    let receiver = Receiver { position: DVec3::Y * -3.0, normal: Vec3::Y };
    let at = |max_distance| caps.ambient(&receiver, &CapSettings { max_distance, ..CapSettings::default() }).occlusion;
    let whole = at(f32::INFINITY);
    // The ball reaches from 2 to 4.
    assert!((at(4.0) - whole).abs() < 1e-6 && at(2.0) == 0.0 && at(0.0) == 0.0 && whole > 0.08);
    assert!((at(3.0) / whole - 0.5).abs() < 0.05);
    let inside = Receiver { position: DVec3::Y * -0.5, normal: Vec3::Y };
    let nothing = CapSettings { max_distance: 0.0, ..CapSettings::default() };
    assert_eq!(caps.ambient(&inside, &nothing).occlusion, 0.0, "no reach, from inside");
    let mut previous = 0.0;
    for step in 0..100 {
        let here = at(1.5 + 0.03 * step as f32);
        assert!(here >= previous && here - previous < 0.01, "{here} after {previous}");
        previous = here;
    }
}

#[test]
fn where_a_grid_is_wrong_there_are_rays() {
    let bounds = BoundingEllipsoid::sphere([0.0; 3], 1.0);
    let header = FieldHeader { name: String::new(), bounds, triangles: 0, measured: Vec::new() };
    // A grid that is right outside, wrong inside, and beside it the table of another, smaller ball.
    let error = Some(CapGridError { outside: 0.0, inside: 0.5 });
    let cap_grid = Some(cap_grid::ball(CapGridHeader { error, ..CapGridHeader::default() }));
    let table = ball_field(0.5, 65, 32).table().cloned();
    let field = VisibilityField::new(header, FieldParts { cap_grid, table, distance: None }).unwrap();
    let mut scene = Scene::default();
    let ball = scene.add_field(field);
    scene.instances.push(Instance::new(ball, DAffine3::IDENTITY));
    let caps = CapScene::new(&scene, DVec3::ZERO);
    let below = |y: f64| {
        let receiver = Receiver { position: dvec3(0.0, -y, 0.0), normal: Vec3::Y };
        let rays = ambient_occlusion(&scene, &receiver, &AmbientOcclusion::default());
        let mut batched = [CapAmbient::UNOCCLUDED];
        caps.ambient_batch(&[receiver], &CapSettings::default(), &mut batched);
        (batched[0].occlusion, rays)
    };
    let (inside, rays) = below(0.9);
    assert!((inside - rays).abs() < 1e-6 && (rays - 0.309).abs() < 0.05, "{inside}, {rays}");
    let (outside, rays) = below(1.1);
    assert!((outside - 0.826).abs() < 0.05 && rays < 0.3, "{outside}, {rays}");
    // From the one to the other without a jump, however much they differ.
    let mut previous = below(0.95).0;
    for step in 0..200 {
        let (here, _) = below(0.95 + 0.001 * f64::from(step));
        assert!((here - previous).abs() < 0.02, "{here} after {previous}");
        previous = here;
    }
}

#[test]
fn bent_normals_stay_above_the_surface() {
    let mut scene = Scene::default();
    let ball = scene.add_field(example_caps());
    scene.instances.push(Instance::new(ball, DAffine3::IDENTITY));
    let caps = CapScene::new(&scene, DVec3::ZERO);
    for rule in RULES {
        let bent = |position: DVec3| caps.ambient(&Receiver { position, normal: Vec3::Y }, &settings(rule)).bent_normal;
        for height in [1.02, 1.1, 1.5, 3.0] {
            let above = bent(DVec3::Y * -height);
            assert!(above.y > 0.75, "{rule:?}: the ball overhead at {height} leaves {above}");
            // Beside it, what is open lies on the other side.
            let beside = bent(dvec3(height, -0.3, 0.0));
            assert!(beside.y >= 0.0 && beside.x > 0.0 && (beside.length() - 1.0).abs() < 1e-3, "{rule:?}: {beside}");
        }
        assert!(bent(DVec3::Y * -100.0).abs_diff_eq(Vec3::Y, 2e-2));
        assert_eq!(bent(DVec3::ZERO).length().round(), 1.0, "inside");
    }
}
