//! Cap grids of shapes that are hard on them, and scenes at their limits.

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3, dvec3};
use visfield::estimate::caps::{CapCombination, CapScene, CapSettings};
use visfield::estimate::sampling::sphere_samples;
use visfield::estimate::{AmbientOcclusion, Receiver};
use visfield::scene::{Instance, Scene};
use visfield::{CapGrid, CapGridFormat, VisibilityField};
use visfield_bake::{BakeSettings, ExactScene, Mesh, bake, exact, read_meshes};

use super::cap_shapes::{
    NORMALS, arch, ball, closed_crate, corner, fence, needle, one_sided_crate, open_crate, plate, room, sheet, terrain,
    triangle,
};
use super::support::{Random, shared_mesh};

/// The rules by which objects add up.
const RULES: [CapCombination; 3] =
    [CapCombination::Product, CapCombination::SoftCaps { directions: 8 }, CapCombination::SoftCaps { directions: 16 }];

fn shapes() -> Vec<Mesh> {
    vec![
        needle(),
        plate(),
        sheet(),
        triangle(),
        closed_crate(),
        open_crate(),
        one_sided_crate(),
        room(),
        arch(),
        fence(),
        terrain(),
        ball(),
    ]
}

fn bake_caps(mesh: &Mesh, points: u32) -> VisibilityField {
    let format = CapGridFormat { points, ..CapGridFormat::DEFAULT };
    bake(mesh, &BakeSettings::of_cap_grid(format), |_| ()).unwrap()
}

fn grid_of(field: &VisibilityField) -> &CapGrid {
    field.cap_grid().expect("a cap grid was baked")
}

fn bunny() -> Option<Mesh> {
    Some(read_meshes(&shared_mesh("stanford-bunny.obj")?).unwrap().swap_remove(0))
}

fn scene_of(field: VisibilityField, places: impl IntoIterator<Item = DAffine3>) -> Scene {
    let mut scene = Scene::default();
    let id = scene.add_field(field);
    scene.instances.extend(places.into_iter().map(|place| Instance::new(id, place)));
    scene
}

fn settings(combination: CapCombination) -> CapSettings {
    CapSettings { combination, ..CapSettings::default() }
}

/// Mean absolute error of occlusion, and how many receivers see anything.
fn mean_error(errors: impl IntoIterator<Item = (f32, f32)>) -> (f32, usize) {
    let seen: Vec<f32> =
        errors.into_iter().filter(|(_, exact)| *exact > 0.0).map(|(found, exact)| (found - exact).abs()).collect();
    (seen.iter().sum::<f32>() / seen.len().max(1) as f32, seen.len())
}

#[test]
fn answers_are_shares_everywhere() {
    for mesh in shapes() {
        for points in [4, 16] {
            let field = bake_caps(&mesh, points);
            let grid = grid_of(&field);
            let corners = mesh.solid_triangles().unwrap();
            let cap_from_mesh = grid.header().mesh_from_cap().inverse();
            let on = corners.as_flattened().iter().map(|p| cap_from_mesh.transform_point3(*p).as_vec3());
            let around = [0.0, 0.3, 1.0, 1.7, 5.0, 5.0001, 1000.0, 1.0e9]
                .into_iter()
                .flat_map(|distance| sphere_samples(60).into_iter().map(move |d| d * distance));
            for position in on.chain(around) {
                for normal in NORMALS {
                    let occlusion = grid.ambient_occlusion(position, normal);
                    assert!((0.0..=1.0).contains(&occlusion), "{} at {position}: {occlusion}", mesh.name);
                }
            }
            // Far away, what is seen falls with the square of the distance.
            for direction in sphere_samples(20) {
                let at = |distance: f32| grid.ambient_occlusion(direction * distance, -direction) * distance * distance;
                assert!((at(40.0) - at(20.0)).abs() <= 0.01 * at(20.0) + 1e-4, "{} along {direction}", mesh.name);
            }
        }
    }
}

#[test]
fn outside_the_box_it_agrees_with_exact_rays() {
    // Measured: 0.0013, 0.018, 0.018, 0.0048, 0.011, 0.010, 0.0075, 0.026, 0.012, 0.0077, 0.014, 0.0032.
    let bounds = [0.002, 0.022, 0.022, 0.006, 0.014, 0.013, 0.010, 0.031, 0.014, 0.010, 0.018, 0.004];
    for (mesh, bound) in shapes().iter().zip(bounds) {
        let field = bake_caps(mesh, 16);
        let grid = grid_of(&field);
        let header = grid.header();
        let cap_from_mesh = header.mesh_from_cap().inverse();
        let truth = ExactScene::new(&[(mesh, cap_from_mesh)], DVec3::ZERO).unwrap();
        let half_extents = header.half_extents_in_cap_space();
        let mut random = Random(5);
        let receivers = (0..400)
            .map(|index| {
                let p = dvec3(random.signed(), random.signed(), random.signed()) * (half_extents.as_dvec3() + 1.0);
                Receiver { position: p, normal: NORMALS[index % 6] }
            })
            .filter(|receiver| receiver.position.as_vec3().abs().cmpgt(half_extents).any());
        let rays = AmbientOcclusion { rays: 1024, ..AmbientOcclusion::default() };
        let (error, count) = mean_error(receivers.map(|receiver| {
            let found = grid.ambient_occlusion(receiver.position.as_vec3(), receiver.normal);
            (found, exact::ambient_occlusion(&truth, &receiver, &rays))
        }));
        println!("{}: {error:.4} over {count}, measured by the bake {:?}", mesh.name, header.error.unwrap());
        assert!(error < bound, "{}: {error} over {count}", mesh.name);
        assert!(count > 60, "{}: {count}", mesh.name);
        let outside = header.error.unwrap().outside;
        assert!((0.0..bound).contains(&outside), "{}: the bake says {outside}", mesh.name);
    }
}

#[test]
fn what_cannot_be_asked_inside_is_marked() {
    for (mesh, serves) in [
        (closed_crate(), false),
        (open_crate(), false),
        (room(), false),
        (arch(), true),
        (fence(), false),
        (one_sided_crate(), true),
        (ball(), true),
    ] {
        let field = bake_caps(&mesh, 16);
        let error = grid_of(&field).header().error.unwrap();
        println!("{}: {error:?}", mesh.name);
        assert_eq!(error.serves_inside(), serves, "{}: {error:?}", mesh.name);
        assert_eq!(grid_of(&field).serves_inside(), serves);
        assert!(
            grid_of(&field).inside_share(Vec3::splat(0.03)) == 1.0
                && grid_of(&field).inside_share(Vec3::Y * 1.11) == 0.0
        );
    }
    for name in ["stanford-bunny.obj", "cow.obj", "spot.obj", "teapot.obj", "suzanne.obj", "fandisk.obj", "igea.glb"] {
        let Some(path) = shared_mesh(name) else { continue };
        let field = bake_caps(&read_meshes(&path).unwrap()[0], 16);
        let error = grid_of(&field).header().error.unwrap();
        println!("{name}: {error:?}");
        assert!(error.serves_inside() && error.inside > 0.0, "{name}: {error:?}");
    }
}

#[test]
fn in_the_middle_of_a_crate_all_is_dark() {
    for mesh in [closed_crate(), one_sided_crate(), room()] {
        for points in [8, 16] {
            let field = bake_caps(&mesh, points);
            for normal in NORMALS {
                let occlusion = grid_of(&field).ambient_occlusion(Vec3::new(0.1, -0.2, 0.05), normal);
                assert!(occlusion > 0.85, "{} {points}: {occlusion}", mesh.name);
            }
        }
    }
}

/// The largest change of occlusion from one step to the next.
fn largest_jump(answers: impl IntoIterator<Item = f32>) -> f32 {
    let answers: Vec<f32> = answers.into_iter().collect();
    assert!(answers.iter().all(|x| (0.0..=1.0).contains(x)));
    answers.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f32::max)
}

#[test]
fn nothing_jumps_along_a_path() {
    for mesh in shapes() {
        let field = bake_caps(&mesh, 16);
        let mesh_from_cap = grid_of(&field).header().mesh_from_cap();
        // Two of them, since the rules differ where several are seen.
        let beside = DAffine3::from_translation(mesh_from_cap.matrix3 * dvec3(1.2, 0.3, 0.9));
        let scene = scene_of(field, [DAffine3::IDENTITY, beside]);
        let caps = CapScene::new(&scene, mesh_from_cap.translation);
        // Past both, and through the outer boundary of the grids at five.
        for (from, to) in [
            (dvec3(-1.3, 1.2, 1.6), dvec3(3.0, 1.5, 1.2)),
            (dvec3(-2.0, -1.4, -1.5), dvec3(2.0, -1.2, 1.5)),
            (dvec3(3.0, 4.0, 0.2), dvec3(6.5, 6.0, 1.0)),
        ] {
            for rule in RULES {
                for normal in [Vec3::Y, Vec3::NEG_Y, Vec3::new(0.6, 0.0, -0.8)] {
                    let path = (0..=1000).map(|step| {
                        let position = mesh_from_cap.transform_point3(from.lerp(to, f64::from(step) / 1000.0));
                        caps.ambient(&Receiver { position, normal }, &settings(rule)).occlusion
                    });
                    let jump = largest_jump(path);
                    assert!(jump <= 0.02, "{}, {rule:?}, {from} to {to}: {jump}", mesh.name);
                }
            }
        }
    }
}

#[test]
fn nothing_jumps_on_the_way_through_an_object() {
    // From free to hidden lies one cell.
    let all = [closed_crate(), one_sided_crate(), arch(), ball()];
    for mesh in all.into_iter().chain(bunny()) {
        let scene = scene_of(bake_caps(&mesh, 16), [DAffine3::IDENTITY]);
        let field = scene.place(DVec3::ZERO)[0].1;
        let mesh_from_cap = grid_of(field).header().mesh_from_cap();
        let caps = CapScene::new(&scene, mesh_from_cap.translation);
        let mut largest = 0.0_f32;
        for rule in RULES {
            for normal in NORMALS {
                let path = (0..=1000).map(|step| {
                    let along = f64::from(step) / 1000.0;
                    let position =
                        mesh_from_cap.transform_point3(dvec3(-1.9, -0.9, -1.7).lerp(dvec3(1.8, 0.8, 1.9), along));
                    caps.ambient(&Receiver { position, normal }, &settings(rule)).occlusion
                });
                largest = largest.max(largest_jump(path));
            }
        }
        println!("through {}: {largest}", mesh.name);
        assert!(largest <= 0.035, "{}: {largest}", mesh.name);
    }
}

#[test]
fn a_bunny_slides_past_smoothly_and_stands_still() {
    let Some(mesh) = bunny() else { return };
    let bounds = visfield_bake::bounding_sphere(&mesh).unwrap();
    let (center, radius) = (DVec3::from(bounds.center.map(f64::from)), f64::from(bounds.sphere_radius().unwrap()));
    let field = bake_caps(&mesh, 16);
    for rule in RULES {
        for aside in [0.2, 0.7, 1.3] {
            let receiver = Receiver { position: center + dvec3(0.0, -0.8, aside) * radius, normal: Vec3::Y };
            let slide = || {
                (0..=1000).map(|step| {
                    let along = (f64::from(step) / 500.0 - 1.0) * 2.0 * radius;
                    let scene = scene_of(field.clone(), [DAffine3::from_translation(DVec3::X * along)]);
                    CapScene::new(&scene, center).ambient(&receiver, &settings(rule)).occlusion
                })
            };
            let jump = largest_jump(slide());
            println!("{rule:?} {aside}: {jump}");
            assert!(jump <= 0.02, "{rule:?} {aside}: {jump}");
            let darkest = slide().fold(0.0, f32::max);
            assert!(darkest > 0.02, "the bunny passes over: {darkest}");
            assert!(slide().map(f32::to_bits).eq(slide().map(f32::to_bits)), "the same every time");
        }
    }
}

#[test]
fn hundreds_of_objects_and_broken_places() {
    let mut random = Random(9);
    let mut anywhere = |spread: f64| {
        let turn =
            DQuat::from_euler(glam::EulerRot::XYZ, random.signed() * 3.0, random.signed(), random.signed() * 3.0);
        let scale = dvec3(1.0, 1.0 + 0.5 * random.signed(), 1.0) * 2.0_f64.powf(random.signed());
        DAffine3::from_scale_rotation_translation(scale, turn, random.in_ball() * spread)
    };
    let mut scene = scene_of(bake_caps(&fence(), 8), (0..200).map(|_| anywhere(3.0)));
    let ball = scene.add_field(bake_caps(&ball(), 8));
    scene.instances.extend((0..200).map(|_| Instance::new(ball, anywhere(3.0))));
    let whole = scene.clone();
    for scale in [DVec3::ZERO, dvec3(1.0, 0.0, 1.0), DVec3::NAN, DVec3::INFINITY] {
        scene.instances.push(Instance::new(ball, DAffine3::from_scale(scale)));
    }
    scene.instances.push(Instance::new(ball, DAffine3::from_translation(DVec3::NAN)));
    for rule in RULES {
        let (broken, sound) = (CapScene::new(&scene, DVec3::ZERO), CapScene::new(&whole, DVec3::ZERO));
        let receivers: Vec<Receiver> = (0..300)
            .map(|i| Receiver { position: random.in_ball() * 6.0, normal: NORMALS[i % 6] })
            .chain([Receiver { position: DVec3::NAN, normal: Vec3::Y }])
            .chain([Receiver { position: DVec3::ZERO, normal: Vec3::NAN }])
            .collect();
        for receiver in &receivers {
            let occlusion = broken.ambient(receiver, &settings(rule)).occlusion;
            assert!((0.0..=1.0).contains(&occlusion), "{rule:?} {receiver:?}: {occlusion}");
            let again = sound.ambient(receiver, &settings(rule)).occlusion;
            assert_eq!(occlusion.to_bits(), again.to_bits(), "what has no place counts for nothing");
        }
        let buried = Receiver { position: DVec3::ZERO, normal: Vec3::Y };
        assert!(broken.ambient(&buried, &settings(rule)).occlusion > 0.95, "{rule:?}");
    }
}

#[test]
fn turned_mirrored_and_scaled_objects_answer_alike() {
    let Some(mesh) = bunny() else { return };
    let bounds = visfield_bake::bounding_sphere(&mesh).unwrap();
    let (center, radius) = (DVec3::from(bounds.center.map(f64::from)), f64::from(bounds.sphere_radius().unwrap()));
    let field = bake_caps(&mesh, 16);
    let still = scene_of(field.clone(), [DAffine3::IDENTITY]);
    let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.4, 2.0, -1.1));
    let mirror = DMat3::from_diagonal(dvec3(-1.0, 1.0, 1.0));
    for (scale, linear) in
        [(1.0, turn), (1.0, turn * mirror), (1e-6, turn), (1e6, mirror * turn), (7.0, DMat3::IDENTITY)]
    {
        let place = DAffine3::from_mat3_translation(linear * scale, dvec3(30.0, -4.0, 8.0) * scale);
        let moved = scene_of(field.clone(), [place]);
        let (at_rest, in_place) =
            (CapScene::new(&still, center), CapScene::new(&moved, place.transform_point3(center)));
        for receiver in corner(center, radius, 0.8) {
            let carried = Receiver {
                position: place.transform_point3(receiver.position),
                normal: (linear * receiver.normal.as_dvec3()).as_vec3(),
            };
            // One object: its own occlusion, by whichever rule.
            let settings = settings(CapCombination::Product);
            let (expected, found) = (at_rest.ambient(&receiver, &settings), in_place.ambient(&carried, &settings));
            assert!((expected.occlusion - found.occlusion).abs() < 1e-3, "{expected:?} became {found:?}");
        }
    }
}

#[test]
fn stretched_objects_agree_roughly_with_exact_rays() {
    let stretch = DAffine3::from_scale(dvec3(1.0, 2.0, 3.0));
    let Some(bunny) = bunny() else { return };
    // Measured, by all rules alike since there is one object: 0.0062 and 0.0065.
    for mesh in [bunny, ball()] {
        let world = bounds_in_place(&mesh, stretch);
        let field = bake_caps(&mesh, 16);
        let scene = scene_of(field, [stretch]);
        let truth = ExactScene::new(&[(&mesh, stretch)], world.0).unwrap();
        let caps = CapScene::new(&scene, world.0);
        let receivers = corner(world.0, world.1, 1.0);
        let rays = AmbientOcclusion { rays: 2048, ..AmbientOcclusion::default() };
        let exact: Vec<f32> = receivers.iter().map(|r| exact::ambient_occlusion(&truth, r, &rays)).collect();
        for rule in RULES {
            let found = receivers.iter().map(|r| caps.ambient(r, &settings(rule)).occlusion);
            let (error, count) = mean_error(found.zip(exact.iter().copied()));
            println!("{} stretched 1:2:3, {rule:?}: {error:.4} over {count}", mesh.name);
            assert!(error < 0.009 && count > 200, "{} {rule:?}: {error} over {count}", mesh.name);
        }
    }
}

/// Centre and radius of a mesh as it is placed.
fn bounds_in_place(mesh: &Mesh, place: DAffine3) -> (DVec3, f64) {
    let corners = mesh.solid_triangles().unwrap();
    let placed = corners.as_flattened().iter().map(|p| place.transform_point3(*p));
    let (low, high) = placed.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    ((low + high) * 0.5, (high - low).length() * 0.5)
}
