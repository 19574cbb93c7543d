//! Distance grids, shapes and composites: whole frames by rays and by cones against their CPU twins.

use glam::{Quat, Vec3};
use visfield::VisibilityField;
use visfield::distance::{DistanceGridFormat, DistancePrecision, ball_grid};
use visfield::estimate::caps::CapCombination;
use visfield::estimate::frame::TraceSettings;
use visfield::field::cap_grid::{self, CapGridError, CapGridFormat, CapGridHeader, HarmonicOrder};
use visfield::field::{FieldParts, ball_field};
use visfield::shape::Shape;

use super::device::device;
use super::frame::{Occluders, all_lights, compare, frames, moved, squeezed};

/// A ball of radius 0.7 in grids of bytes and of two, alone and beside a table; a shape; and grids beside cap grids: one that is
/// asked everywhere, and one of large lights that must not be asked inside its box.
fn fields() -> Vec<VisibilityField> {
    let table = ball_field(0.7, 33, 16);
    let distances = |voxels, precision| ball_grid(0.7, DistanceGridFormat { voxels, precision }).into();
    let caps = |order: HarmonicOrder, inside| {
        let numbers = vec![0.0; order.coefficients()];
        cap_grid::ball(CapGridHeader {
            format: CapGridFormat { order, points: 12, ..CapGridFormat::DEFAULT },
            half_extents: [0.7; 3],
            error: Some(CapGridError { outside: 0.0, inside }),
            low: numbers.clone(),
            range: numbers,
            ..CapGridHeader::default()
        })
    };
    let with_table = table.table().cloned();
    let parts = [
        FieldParts { distance: Some(distances(24, DistancePrecision::U8)), ..FieldParts::default() },
        FieldParts { distance: Some(distances(17, DistancePrecision::U16)), table: with_table, cap_grid: None },
        FieldParts {
            distance: Some(distances(20, DistancePrecision::U8)),
            cap_grid: Some(caps(HarmonicOrder::One, 0.0)),
            table: None,
        },
        FieldParts {
            distance: Some(distances(20, DistancePrecision::U16)),
            cap_grid: Some(caps(HarmonicOrder::Three, 1.0)),
            table: None,
        },
    ];
    let ring = Shape::Torus { major_radius: 0.5, minor_radius: 0.15 }.turned(Quat::from_rotation_x(0.6));
    let carved = Shape::Box { half_extents: [0.5, 0.3, 0.4] }.difference(Shape::Sphere { radius: 0.45 });
    let shape = ring.smooth_union(carved.moved(Vec3::new(0.2, 0.3, 0.0)), 0.1);
    let shape = VisibilityField::of_shape(shape).expect("the shape is sound");
    let baked = parts.map(|parts| VisibilityField::new(table.header().clone(), parts).unwrap());
    baked.into_iter().chain([shape]).collect()
}

fn occluders() -> Occluders {
    let instances = [
        (0, moved(-0.5, -1.4, -3.0)),
        (1, squeezed()),
        (2, moved(0.2, -1.5, -2.0)),
        (3, moved(1.9, -1.3, -2.8)),
        (4, moved(-1.6, -1.5, -2.4)),
    ];
    Occluders::new(fields(), instances)
}

fn assert_alike(settings: TraceSettings, share: usize) {
    let Some((device, queue)) = device() else { return };
    let frames = frames(&device, &queue, &occluders(), &all_lights(), settings);
    let (touched, differing) = compare(&frames);
    assert!(touched.iter().all(|touched| *touched > 40.0), "everything is hidden somewhere: {touched:?}");
    assert!(differing <= frames[0].len() / share, "{differing} pixels differ");
}

#[test]
fn rays_through_distances_are_their_twins() {
    // A rounding difference lets a ray pass a surface that it grazes: seldom.
    assert_alike(TraceSettings { ambient_rays: 3, shadow_rays: 4, ..TraceSettings::default() }, 40);
}

#[test]
fn cones_through_distances_are_their_twins() {
    // No rays decide: what differs is rounding alone.
    assert_alike(TraceSettings { cones: true, ambient_rays: 3, shadow_rays: 4, ..TraceSettings::default() }, 60);
}

#[test]
fn without_rays_all_is_answered_and_alike() {
    let rayless = TraceSettings { cones: true, ambient_rays: 0, shadow_rays: 0, ..TraceSettings::default() };
    for caps in [CapCombination::Product, CapCombination::default(), CapCombination::SoftCaps { directions: 16 }] {
        assert_alike(TraceSettings { caps: Some(caps), ..rayless }, 200);
    }
}
