//! Scenes of hostile transforms, receivers and settings.

use glam::{DAffine3, DMat3, DVec3, Vec3};
use visfield::estimate::{AmbientOcclusion, DirectionalShadow, Receiver, ambient_occlusion, directional_visibility};
use visfield::field::ball_field;
use visfield::field::query::Bias;
use visfield::scene::{FieldId, Instance, Scene};

use crate::HOSTILE_SCENES;
use crate::random::Random;
use crate::rays::HOSTILE;

/// Where a scene is: at the world's origin, or 10⁷ from it.
fn any_place(random: &mut Random) -> DVec3 {
    random.direction() * random.pick(&[0.0, 1.0e3, 1.0e7])
}

/// An invertible transform at a scale from 10⁻⁴ to 10⁴: turned, mirrored, stretched up to 1 : 1000 (along
/// one axis 1 : 10⁵) and sheared. `near` it is the
/// unit sphere's centre.
fn sound_transform(random: &mut Random, near: DVec3) -> DAffine3 {
    let size = random.power_of_ten(-4.0, 4.0);
    let stretch = match random.below(4) {
        0 => DVec3::ONE,
        1 => DVec3::new(1.0, 1.0e-5, 1.0),
        2 => DVec3::new(1.0, 1.0e-3, -1.0e-3),
        _ => DVec3::new(random.power_of_ten(-3.0, 0.0), -random.power_of_ten(-3.0, 0.0), 1.0),
    };
    // A turn on either side of a stretch is a shear.
    let linear = random.rotation_matrix() * DMat3::from_diagonal(stretch * size) * random.rotation_matrix();
    let translation = near + random.direction() * size * random.between(0.0, 3.0);
    DAffine3 { matrix3: linear, translation }
}

/// A transform that is flat or has a number that is none.
fn singular_transform(random: &mut Random, near: DVec3) -> DAffine3 {
    let mut transform = sound_transform(random, near);
    let flattened =
        DMat3::from_diagonal(random.pick(&[DVec3::ONE, DVec3::X]).with_y(0.0) * random.power_of_ten(-4.0, 4.0));
    match random.below(6) {
        0 => transform.matrix3 = DMat3::ZERO,
        1 => transform.matrix3 = random.rotation_matrix() * flattened * random.rotation_matrix(),
        // As it comes from an engine that works in single precision.
        5 => {
            let [left, right] = [0, 1].map(|_| random.rotation_matrix().as_mat3());
            transform.matrix3 = (left * flattened.as_mat3() * right).as_dmat3();
        }
        2 => transform.matrix3.y_axis = transform.matrix3.x_axis,
        3 => transform.matrix3.z_axis[random.below(3)] = random.pick(&[f64::NAN, f64::INFINITY, f64::NEG_INFINITY]),
        _ => transform.translation[random.below(3)] = random.pick(&[f64::NAN, f64::INFINITY, 1.0e300]),
    }
    transform
}

/// A receiver on, in, near or far from the last of the instances.
fn any_receiver(random: &mut Random, scene: &Scene, near: DVec3) -> Receiver {
    let transform = scene.instances.last().map_or(DAffine3::IDENTITY, |instance| instance.world_from_mesh);
    let mut position = match random.below(3) {
        0 => near + random.direction() * random.power_of_ten(-5.0, 5.0),
        _ => transform.transform_point3(random.direction() * random.pick(&[0.5, 1.0, 1.2, 3.0])),
    };
    let mut normal = random.direction().as_vec3();
    if random.chance(0.1) {
        position[random.below(3)] = f64::from(random.pick(&HOSTILE));
    }
    if random.chance(0.1) {
        normal[random.below(3)] = random.pick(&HOSTILE);
    }
    Receiver { position, normal }
}

fn any_bias(random: &mut Random) -> Bias {
    if random.chance(0.2) {
        Bias { height: random.pick(&HOSTILE), along: random.pick(&HOSTILE) }
    } else {
        Bias::default()
    }
}

/// Ambient occlusion and visibility of a light from anywhere, both checked to be numbers of [0, 1].
fn estimates(random: &mut Random, scene: &Scene, receiver: &Receiver) -> [f32; 2] {
    let max_distance = random.pick(&[f32::INFINITY, f32::INFINITY, 10.0, 0.0, -1.0, 1.0e-40, f32::NAN]);
    let bias = any_bias(random);
    let ambient = AmbientOcclusion { rays: random.pick(&[0, 1, 16, 65]), max_distance, bias };
    let mut light = DirectionalShadow {
        to_light: random.direction().as_vec3(),
        angular_radius: random.pick(&[0.005, 0.5, 0.0, 2.0, -1.0, f32::NAN, f32::INFINITY]),
        rays: ambient.rays,
        bias,
    };
    if random.chance(0.1) {
        light.to_light = random.pick(&[Vec3::ZERO, Vec3::NAN, Vec3::INFINITY, receiver.normal]);
    }
    let found = [ambient_occlusion(scene, receiver, &ambient), directional_visibility(scene, receiver, &light)];
    assert!(
        found.iter().all(|share| (0.0..=1.0).contains(share)),
        "{found:?} of {receiver:?}, {ambient:?}, {light:?}, {:?}",
        scene.instances
    );
    found
}

fn scene_of(random: &mut Random, transform: fn(&mut Random, DVec3) -> DAffine3, near: DVec3, fields: &Scene) -> Scene {
    let mut scene = fields.clone();
    let ids: Vec<FieldId> = scene.instances.drain(..).map(|instance| instance.field).collect();
    for _ in 0..=random.below(3) {
        scene.instances.push(Instance::new(random.pick(&ids), transform(random, near)));
    }
    scene
}

/// Two fields, with an instance of each.
fn fields() -> Scene {
    let mut scene = Scene::default();
    for radius in [0.5, 0.999] {
        let id = scene.add_field(ball_field(radius, 33, 17));
        scene.instances.push(Instance::new(id, DAffine3::IDENTITY));
    }
    scene
}

/// Whatever the transforms, the receiver and the settings, estimates are numbers of [0, 1]; and an instance whose transform is
/// not invertible changes none of them.
#[test]
fn any_scene_has_a_sane_answer() {
    let (mut random, fields) = (Random::new(6), fields());
    let mut partly = 0;
    for case in 0..HOSTILE_SCENES {
        let near = any_place(&mut random);
        let sound = scene_of(&mut random, sound_transform, near, &fields);
        let mut mixed = scene_of(&mut random, singular_transform, near, &fields);
        mixed.instances.extend(&sound.instances);
        let receiver = any_receiver(&mut random, &sound, near);
        let seed = case as u64;
        let found = estimates(&mut Random::new(seed), &sound, &receiver);
        assert_eq!(found, estimates(&mut Random::new(seed), &mixed, &receiver), "{:?}", mixed.instances);
        partly += usize::from(found[0] > 0.0 && found[0] < 1.0);
    }
    println!("{partly} of {HOSTILE_SCENES} receivers are partly occluded");
    assert!(partly > HOSTILE_SCENES / 20, "both outcomes are tested");
}

/// Transforms that are invertible in any sense that matters are kept, at any place and any scale; all others vanish.
#[test]
fn singular_instances_vanish_and_no_others() {
    let (mut random, fields) = (Random::new(7), fields());
    for _ in 0..HOSTILE_SCENES {
        let near = any_place(&mut random);
        let sound = scene_of(&mut random, sound_transform, near, &fields);
        assert_eq!(sound.place(near).len(), sound.instances.len(), "{:?}", sound.instances);
        let singular = scene_of(&mut random, singular_transform, near, &fields);
        assert_eq!(singular.place(near).len(), 0, "{:?}", singular.instances);
    }
}
