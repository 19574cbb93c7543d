//! Ambient occlusion of a mesh on itself: where a field's resolution shows most, and where the bias decides.

use glam::{DAffine3, DVec3, Vec3};
use visfield::estimate::{AmbientOcclusion, Receiver, ambient_occlusion};
use visfield::field::query::Bias;
use visfield::scene::{Instance, Scene};
use visfield_bake::{BakeSettings, ExactScene, Mesh, bake, exact, read_meshes};

use crate::support::{asset, shared_mesh};

const RAYS: u32 = 256;

/// Receivers at the centres of up to 800 triangles, with the triangle's normal: smooth shading would be another surface.
fn receivers(mesh: &Mesh) -> Vec<Receiver> {
    let corner = |vertex: u32| DVec3::from(mesh.positions[vertex as usize].map(f64::from));
    let receiver = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(corner);
        let normal = (b - a).cross(c - a).try_normalize()?;
        Some(Receiver { position: (a + b + c) / 3.0, normal: normal.as_vec3() })
    };
    mesh.indices.iter().step_by(mesh.indices.len().div_ceil(800)).filter_map(receiver).collect()
}

/// Mean absolute error of ambient occlusion over a mesh's own surface, with a field of the default size.
fn own_surface_error(mesh: &Mesh, bias: Bias) -> f64 {
    let mut scene = Scene::default();
    let field = scene.add_field(bake(mesh, &BakeSettings::default(), |_| ()).unwrap());
    scene.instances.push(Instance::new(field, DAffine3::IDENTITY));
    let exact_scene = ExactScene::new(&[(mesh, DAffine3::IDENTITY)], DVec3::ZERO).unwrap();
    let settings = AmbientOcclusion { rays: RAYS, bias, ..AmbientOcclusion::default() };
    let receivers = receivers(mesh);
    let error = |receiver: &Receiver| {
        let found = ambient_occlusion(&scene, receiver, &settings);
        f64::from((found - exact::ambient_occlusion(&exact_scene, receiver, &settings)).abs())
    };
    receivers.iter().map(error).sum::<f64>() / receivers.len() as f64
}

#[test]
fn meshes_do_not_shadow_themselves_where_they_should_not() {
    for (name, bound) in [("torus_knot", 0.008), ("supershape", 0.012), ("chair", 0.028)] {
        let mesh = read_meshes(&asset(name, "glb")).unwrap().remove(0);
        let error = own_surface_error(&mesh, Bias::default());
        println!("{name}: mean absolute error on its own surface {error:.4}");
        assert!(error < bound, "{name}: {error}");
        assert!(own_surface_error(&mesh, Bias { height: -1.0, along: 0.0 }) > 2.0 * bound, "{name}: the bias decides");
    }
}

#[test]
fn real_meshes_do_not_shadow_themselves_where_they_should_not() {
    for (name, bound) in
        [("stanford-bunny.obj", 0.010), ("cow.obj", 0.016), ("spot.obj", 0.009), ("fandisk.obj", 0.006)]
    {
        let Some(path) = shared_mesh(name) else { return };
        let mesh = read_meshes(&path).unwrap().remove(0);
        let error = own_surface_error(&mesh, Bias::default());
        println!("{name}: mean absolute error on its own surface {error:.4}");
        assert!(error < bound, "{name}: {error}");
    }
}

#[test]
fn a_flat_face_stays_bright_up_to_its_corners() {
    // A box touches its bounding sphere with its corners: rounding puts receivers there on either side of it.
    let corner = |i: u32| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { 1.0 } else { -1.0 });
    let quad = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    let faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let mesh = Mesh {
        name: "box".to_owned(),
        positions: (0..8).map(corner).collect(),
        indices: faces.into_iter().flat_map(quad).collect(),
    };
    let mut scene = Scene::default();
    let field = scene.add_field(bake(&mesh, &BakeSettings::default(), |_| ()).unwrap());
    scene.instances.push(Instance::new(field, DAffine3::IDENTITY));
    for max_distance in [0.3, f32::INFINITY] {
        let settings = AmbientOcclusion { rays: RAYS, max_distance, ..AmbientOcclusion::default() };
        for scale in [1.0 - 1e-5, 1.0, 1.0 + 1e-5] {
            let at = |x: f64, z: f64| Receiver { position: DVec3::new(x, 1.0, z) * scale, normal: Vec3::Y };
            let steps = || (-10..=10).map(|i| f64::from(i) * 0.09999);
            let darkest = steps()
                .flat_map(|x| steps().map(move |z| at(x, z)))
                .map(|receiver| ambient_occlusion(&scene, &receiver, &settings))
                .fold(0.0, f32::max);
            assert!(darkest < 0.02, "reach {max_distance}, scale {scale}: {darkest}");
        }
    }
}

#[test]
fn a_ball_that_fills_its_bounds_stays_bright() {
    // Every receiver lies next to the bounding sphere, where stored chords are short and their angles coarse.
    let field = visfield::field::ball_field(0.98, 65, 32);
    let mut scene = Scene::default();
    let id = scene.add_field(field);
    scene.instances.push(Instance::new(id, DAffine3::IDENTITY));
    let points = visfield::estimate::sampling::sphere_samples(500);
    let occlusion = |point: &Vec3| {
        let receiver = Receiver { position: point.as_dvec3() * 0.98, normal: *point };
        ambient_occlusion(&scene, &receiver, &AmbientOcclusion::default())
    };
    let darkest = points.iter().map(occlusion).fold(0.0, f32::max);
    assert!(darkest < 0.05, "a convex surface that shadows itself: {darkest}");
}
