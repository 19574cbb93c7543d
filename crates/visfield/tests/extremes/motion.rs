//! Scenes that are moved together with their receivers.

use glam::{DAffine3, DQuat, DVec3};
use visfield::estimate::{AmbientOcclusion, Receiver, ambient_occlusion};
use visfield::field::ball;
use visfield::scene::{Instance, Scene};
use visfield::{Encoding, Representation, VisibilityField};

use crate::fields::scattered;
use crate::random::Random;
use crate::{
    MOTION_RAYS, MOTIONS, MOVED_MAXIMUM, MOVED_MAXIMUM_OF_NOISE, MOVED_MEAN, MOVED_MEAN_OF_NOISE, TURNED_MAXIMUM,
    TURNED_MEAN,
};

/// A scene near the world's origin at a scale of 1, a receiver in it, and how far it looks.
struct Case {
    scene: Scene,
    receiver: Receiver,
    max_distance: f32,
}

fn any_case(random: &mut Random, one: &Scene) -> Case {
    let mut scene = one.clone();
    let id = scene.instances.remove(0).field;
    for _ in 0..=random.below(3) {
        let size = random.power_of_ten(-0.5, 0.5);
        let stretch = DVec3::new(size, size * random.between(0.3, 1.0), size);
        let translation = random.direction() * random.between(0.5, 4.0);
        scene.instances.push(Instance::new(
            id,
            DAffine3::from_scale_rotation_translation(stretch, random.rotation(), translation),
        ));
    }
    let receiver = Receiver { position: random.in_ball() * 4.0, normal: random.direction().as_vec3() };
    Case { scene, receiver, max_distance: random.pick(&[f32::INFINITY, 2.0]) }
}

impl Case {
    fn moved(&self, scale: f64, rotation: DQuat, translation: DVec3) -> Self {
        let motion = DAffine3::from_scale_rotation_translation(DVec3::splat(scale), rotation, translation);
        let mut scene = self.scene.clone();
        for instance in &mut scene.instances {
            instance.world_from_mesh = motion * instance.world_from_mesh;
        }
        let normal = (rotation * self.receiver.normal.as_dvec3()).as_vec3();
        let receiver = Receiver { position: motion.transform_point3(self.receiver.position), normal };
        Self { scene, receiver, max_distance: (f64::from(self.max_distance) * scale) as f32 }
    }

    fn occlusion(&self) -> f32 {
        let settings =
            AmbientOcclusion { rays: MOTION_RAYS, max_distance: self.max_distance, ..AmbientOcclusion::default() };
        ambient_occlusion(&self.scene, &self.receiver, &settings)
    }
}

/// The largest and the mean change of ambient occlusion by instances of `field`, under motions with a rotation that `turn`
/// chooses.
fn changes(seed: u64, field: VisibilityField, turn: fn(&mut Random) -> DQuat) -> (f32, f64) {
    let mut random = Random::new(seed);
    let mut one = Scene::default();
    let id = one.add_field(field);
    one.instances.push(Instance::new(id, DAffine3::IDENTITY));
    let (mut largest, mut sum, mut partly) = (0.0_f32, 0.0, 0);
    for _ in 0..MOTIONS {
        let case = any_case(&mut random, &one);
        let scale = random.power_of_ten(-4.0, 4.0);
        let translation = random.direction() * random.power_of_ten(0.0, 7.0);
        let still = case.occlusion();
        let change = (case.moved(scale, turn(&mut random), translation).occlusion() - still).abs();
        largest = largest.max(change);
        sum += f64::from(change);
        partly += usize::from(still > 0.0 && still < 1.0);
    }
    assert!(partly > MOTIONS / 4, "only {partly} receivers are partly occluded");
    (largest, sum / MOTIONS as f64)
}

const SHAPE: Representation = Representation::TwoPoint { entries: 65, exits: 32 };

/// Ambient occlusion does not depend on where a scene is, nor on its units.
#[test]
fn places_and_units_do_not_matter() {
    let noise = scattered(SHAPE, Encoding::U8);
    for (name, field, maximum, most_mean) in [
        ("ball", ball(0.9, SHAPE, Encoding::U8), MOVED_MAXIMUM, MOVED_MEAN),
        ("noise", noise, MOVED_MAXIMUM_OF_NOISE, MOVED_MEAN_OF_NOISE),
    ] {
        let (largest, mean) = changes(8, field, |_| DQuat::IDENTITY);
        println!("{name}, moved and scaled: ambient occlusion changes by {largest} at most, {mean:.2e} in the mean");
        assert!(largest < maximum && mean < most_mean, "{name}: {largest} at most, {mean} in the mean");
    }
}

/// Nor does it depend on how the scene is turned, but for the pattern of the rays, which the world's axes hold.
#[test]
fn turning_everything_changes_no_more_than_the_pattern_of_rays() {
    let (largest, mean) = changes(9, ball(0.9, SHAPE, Encoding::U8), Random::rotation);
    println!("turned too: ambient occlusion changes by {largest} at most, {mean:.2e} in the mean");
    assert!(largest < TURNED_MAXIMUM && mean < TURNED_MEAN, "{largest} at most, {mean} in the mean");
}
