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
    let field = scene.add_field(bake(mesh, &BakeSettings::two_point(65, 32), |_| ()).unwrap());
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

/// Boxes from corner to corner, as one mesh.
fn boxes(corners: &[[[f32; 3]; 2]]) -> Mesh {
    let mut mesh = Mesh { name: "boxes".to_owned(), ..Mesh::default() };
    for ends in corners {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend((0..8).map(|i| [0, 1, 2].map(|axis| ends[i >> axis & 1][axis])));
        for [a, b, c, d] in [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]] {
            mesh.indices.extend([[a, b, c], [a, c, d]].map(|triangle| triangle.map(|corner: u32| first + corner)));
        }
    }
    mesh
}

/// The darkest of 21² receivers on the face y = 1 of a mesh, between −1 and 1 and scaled a little.
fn darkest_on_top(mesh: &Mesh, max_distance: f32, scale: f64) -> f32 {
    let mut scene = Scene::default();
    let field = scene.add_field(bake(mesh, &BakeSettings::two_point(65, 32), |_| ()).unwrap());
    scene.instances.push(Instance::new(field, DAffine3::IDENTITY));
    let settings = AmbientOcclusion { rays: RAYS, max_distance, ..AmbientOcclusion::default() };
    let at = |x: i32, z: i32| DVec3::new(f64::from(x) * 0.1, 1.0, f64::from(z) * 0.1) * scale;
    let receivers = (-10..=10).flat_map(|x| (-10..=10).map(move |z| at(x, z)));
    let occlusion = |position| ambient_occlusion(&scene, &Receiver { position, normal: Vec3::Y }, &settings);
    receivers.map(occlusion).fold(0.0, f32::max)
}

#[test]
fn a_flat_face_stays_bright_up_to_its_corners() {
    // A box touches its bounding sphere with its corners: rounding puts receivers there on either side of it.
    let mesh = boxes(&[[[-1.0; 3], [1.0; 3]]]);
    for scale in [1.0 - 1e-4, 1.0, 1.0 + 1e-4] {
        let darkest = darkest_on_top(&mesh, f32::INFINITY, scale);
        assert!(darkest < 0.02, "scale {scale}: {darkest}");
    }
}

#[test]
fn a_flat_face_stays_bright_below_what_is_out_of_reach() {
    // The roof is met first from the far side, so that nearer hits are looked up forwards, past the face itself.
    let mesh = boxes(&[[[-1.0; 3], [1.0; 3]], [[-1.0, 1.8, -1.0], [1.0, 2.0, 1.0]]]);
    let out_of_reach = darkest_on_top(&mesh, 0.5, 1.0);
    assert!(out_of_reach < 0.03, "{out_of_reach}");
    assert!(darkest_on_top(&mesh, f32::INFINITY, 1.0) > 0.3, "the roof is there");
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
