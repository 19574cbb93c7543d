//! What a distance grid adds to a cap grid: the contact term (DESIGN §4).

use glam::{DAffine3, DVec3};
use visfield::distance::{DistanceGridFormat, DistancePrecision};
use visfield::estimate::caps::{CapAmbient, CapScene, CapSettings};
use visfield::estimate::{AmbientOcclusion, Receiver};
use visfield::scene::{Instance, Scene};
use visfield::{FieldParts, VisibilityField};
use visfield_bake::measure::MeasureScene;
use visfield_bake::{BakeSettings, ExactScene, bake, exact, read_meshes};

use crate::support::shared_mesh;

/// Occlusion by a field's caps, and by its contact term if it has distances.
fn by_caps(field: VisibilityField, receivers: &[Receiver]) -> Vec<f32> {
    let mut scene = Scene::default();
    let id = scene.add_field(field);
    scene.instances.push(Instance::new(id, DAffine3::IDENTITY));
    let mut answers = vec![CapAmbient::UNOCCLUDED; receivers.len()];
    CapScene::new(&scene, DVec3::ZERO).ambient_batch(receivers, &CapSettings::default(), &mut answers);
    answers.into_iter().map(|answer| answer.occlusion).collect()
}

#[test]
fn contact_lowers_the_largest_errors_of_cap_grids() {
    for (name, most) in [("stanford-bunny.obj", 0.9), ("cow.obj", 0.65), ("spot.obj", 0.6)] {
        let Some(path) = shared_mesh(name) else { return };
        let mesh = read_meshes(&path).unwrap().remove(0);
        let distance = DistanceGridFormat { voxels: 32, precision: DistancePrecision::U8 };
        let settings = BakeSettings { table: None, distance: Some(distance), ..BakeSettings::default() };
        let both = bake(&mesh, &settings, |_| ()).unwrap();
        let parts = FieldParts { distance: None, ..both.parts().clone() };
        let caps = VisibilityField::new(both.header().clone(), parts).unwrap();
        let receivers = MeasureScene::Corner.receivers_by(&mesh, 97).unwrap();
        let scene = ExactScene::new(&[(&mesh, DAffine3::IDENTITY)], DVec3::ZERO).unwrap();
        let rays = AmbientOcclusion { rays: 256, ..AmbientOcclusion::default() };
        // The floor, where contacts are.
        let floor = &receivers[..97 * 97];
        let [with, without] = [both, caps].map(|field| by_caps(field, floor));
        let mut largest = [0.0_f32; 2];
        let mut sums = [0.0; 3];
        for (receiver, found) in floor.iter().zip(with.iter().zip(&without)) {
            let near = *found.0 > 1.0 / 255.0 || *found.1 > 1.0 / 255.0;
            if near {
                let truth = exact::ambient_occlusion(&scene, receiver, &rays);
                let errors = [(found.0 - truth).abs(), (found.1 - truth).abs()];
                largest = [largest[0].max(errors[0]), largest[1].max(errors[1])];
                sums = [sums[0] + f64::from(errors[0]), sums[1] + f64::from(errors[1]), sums[2] + 1.0];
            }
        }
        println!(
            "{name}: largest error {:.3} with the contact term, {:.3} without; mean {:.4} and {:.4}",
            largest[0],
            largest[1],
            sums[0] / sums[2],
            sums[1] / sums[2]
        );
        assert!(largest[0] <= most * largest[1] && sums[0] <= 1.02 * sums[1], "{name}: {largest:?} {sums:?}");
    }
}
