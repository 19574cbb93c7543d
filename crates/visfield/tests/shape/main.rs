//! Shapes: what holds for any tree of them. Closed forms of primitives are tested beside their code.

mod random;
mod reference;

use std::cell::Cell;

use glam::{Quat, Vec3};
use proptest::prelude::*;
use visfield::shape::{Shape, ShapeBounds, ShapeExtent, ShapeProgram};

use random::{check, placed, position, primitive, rotation, tree};

/// What single precision may get wrong in the space that [`position`] fills.
const ROUNDING: f32 = 2.0e-5;

fn program(shape: &Shape) -> ShapeProgram {
    ShapeProgram::new(shape, 1.0).unwrap_or_else(|error| panic!("{error}: {shape:#?}"))
}

fn positions(count: usize) -> impl Strategy<Value = Vec<Vec3>> {
    prop::collection::vec(position(), count)
}

#[test]
fn programs_say_what_the_formulas_say() {
    check(2000, &(tree(true), positions(20)), |(shape, positions)| {
        let program = program(&shape);
        for p in positions {
            let (found, expected) = (program.distance(p), reference::distance(&shape, p.as_dvec3()).min(1.0e12) as f32);
            assert!((found - expected).abs() <= ROUNDING.max(1.0e-6 * expected), "{p}: {found}, should be {expected}");
        }
    });
}

#[test]
fn distances_are_below_zero_inside_and_only_there() {
    let inside = Cell::new(0);
    check(2000, &(tree(false), positions(20)), |(shape, positions)| {
        let program = program(&shape);
        for p in positions {
            let (distance, contained) = (program.distance(p), reference::contains(&shape, p.as_dvec3()));
            assert!(distance.abs() < ROUNDING || (distance < 0.0) == contained, "{p}: {distance}");
            inside.set(inside.get() + u32::from(contained));
        }
    });
    assert!(inside.get() > 2000, "{} of 40000 are inside", inside.get());
}

#[test]
fn distances_are_never_larger_than_the_way_to_the_other_side() {
    let pairs = Cell::new(0);
    check(1000, &(tree(false), positions(30)), |(shape, positions)| {
        let program = program(&shape);
        let (inside, outside): (Vec<_>, Vec<_>) =
            positions.into_iter().partition(|p| reference::contains(&shape, p.as_dvec3()));
        for (a, b) in inside.iter().flat_map(|a| outside.iter().map(move |b| (*a, *b))) {
            let way = a.distance(b) + ROUNDING;
            assert!(program.distance(b) <= way && -program.distance(a) <= way, "from {a} to {b}");
            pairs.set(pairs.get() + 1);
        }
    });
    assert!(pairs.get() > 10_000, "{}", pairs.get());
}

#[test]
fn distances_change_no_faster_than_positions() {
    check(2000, &(tree(true), positions(10), position()), |(shape, positions, step)| {
        let program = program(&shape);
        for (p, length) in positions.into_iter().zip([1.0e-3, 0.01, 0.1, 1.0].into_iter().cycle()) {
            let to = p + step * length;
            let change = (program.distance(to) - program.distance(p)).abs();
            assert!(change <= p.distance(to) + ROUNDING, "from {p} to {to} by {change}");
        }
    });
}

#[test]
fn moves_and_scales_keep_distances() {
    let motion = (rotation(), position(), -4.0_f32..4.0);
    check(2000, &(tree(true), motion, positions(10)), |(shape, (rotation, translation, exponent), positions)| {
        let factor = 10.0_f32.powf(exponent);
        let still = program(&shape);
        let moved = program(&shape.clone().turned(rotation).moved(translation).scaled(factor));
        // The same space again, measured in another unit.
        let other_unit = ShapeProgram::new(&shape.turned(rotation).moved(translation), 1.0 / factor).unwrap();
        assert_eq!(moved.nodes().len(), still.nodes().len());
        for p in positions {
            let to = (rotation * p + translation) * factor;
            let expected = if still.nodes().is_empty() { still.distance(p) } else { factor * still.distance(p) };
            for found in [moved.distance(to), other_unit.distance(to)] {
                assert!((found - expected).abs() <= 2.0 * ROUNDING * factor, "{p}: {found}, should be {expected}");
            }
        }
    });
}

#[test]
fn smooth_unions_contain_unions_and_not_much_more() {
    let shapes = prop::collection::vec(placed(primitive()), 1..6);
    let smooth = Cell::new(0);
    check(1000, &(shapes, 0.0_f32..2.0, positions(20)), |(shapes, width, positions)| {
        // Of 1, 2, 3, … shapes, in widths.
        let excess = [0.0, 0.25, 0.3907, 0.4836, 0.5503][shapes.len() - 1];
        let union = program(&Shape::Union(shapes.clone()));
        let rounded = program(&Shape::SmoothUnion { shapes, width });
        for p in positions {
            let lower_by = union.distance(p) - rounded.distance(p);
            assert!((-ROUNDING..=excess * width + ROUNDING).contains(&lower_by), "{p}: lower by {lower_by}");
            smooth.set(smooth.get() + u32::from(lower_by > 0.01));
        }
    });
    assert!(smooth.get() > 1000, "{} of 20000 are in a seam", smooth.get());
    // A shape meets itself everywhere, which is as much as there can be.
    let ball = Shape::Sphere { radius: 1.0 };
    let many = |count| program(&Shape::SmoothUnion { shapes: vec![ball.clone(); count], width: 0.5 }).distance(Vec3::X);
    assert_eq!(many(2), -0.125);
    assert!((many(3) + 0.5 * 0.390_625).abs() < 1e-6 && many(30) > -0.5);
}

#[test]
fn bounds_contain_what_is_inside() {
    let (bounded, unbounded, empty) = (Cell::new(0), Cell::new(0), Cell::new(0));
    check(3000, &(tree(true), prop::collection::vec(prop::array::uniform3(-0.1_f32..1.1), 40)), |(shape, places)| {
        let program = program(&shape);
        let count = |cell: &Cell<u32>| cell.set(cell.get() + 1);
        let (box_around, to) = match shape.extent() {
            ShapeExtent::Unbounded => return count(&unbounded),
            ShapeExtent::Empty => {
                count(&empty);
                (None, ShapeBounds { low: Vec3::splat(-8.0), high: Vec3::splat(8.0) })
            }
            ShapeExtent::Bounded(bounds) => {
                count(&bounded);
                (Some(bounds), bounds)
            }
        };
        assert_eq!(shape.bounds(), box_around);
        for place in places {
            let p = to.low + Vec3::from(place) * (to.high - to.low);
            let inside = program.distance(p) < -ROUNDING;
            let within =
                box_around.is_some_and(|b| p.cmpge(b.low - ROUNDING).all() && p.cmple(b.high + ROUNDING).all());
            assert!(!inside || within, "{p} is inside, but not within {box_around:?}");
        }
    });
    let counts = [bounded.get(), unbounded.get(), empty.get()];
    assert!(counts.iter().all(|count| *count > 100), "bounded, unbounded, empty: {counts:?}");
}

#[test]
fn boxes_touch_placed_primitives_on_all_six_sides() {
    check(300, &placed(primitive()), |shape| {
        let Some(ShapeBounds { low, high }) = shape.bounds() else { return };
        let program = program(&shape);
        for axis in 0..3 {
            for end in [low[axis], high[axis]] {
                let on_side = |i: i32| {
                    let mut p = Vec3::splat(end);
                    let share = [(i % 100) as f32 / 99.0, (i / 100) as f32 / 99.0];
                    let others = [(axis + 1) % 3, (axis + 2) % 3];
                    for (other, share) in others.into_iter().zip(share) {
                        p[other] = low[other] + (high[other] - low[other]) * share;
                    }
                    program.distance(p)
                };
                let nearest = (0..10_000).map(on_side).fold(f32::INFINITY, f32::min);
                let spacing = (high - low).length() / 99.0;
                assert!(nearest > -ROUNDING && nearest < spacing, "axis {axis} at {end}: {nearest} away");
            }
        }
    });
}

#[test]
fn extents_tell_nothing_something_and_everything_apart() {
    let ball = |radius| Shape::Sphere { radius };
    let nothing = [
        Shape::Union(vec![]),
        ball(0.0),
        Shape::Box { half_extents: [1.0, 0.0, 1.0] },
        Shape::Capsule { half_length: 1.0, radius: 0.0 },
        Shape::Cylinder { half_height: 0.0, radius: 1.0 },
        Shape::Torus { major_radius: 1.0, minor_radius: 0.0 },
        Shape::Cone { height: 0.0, radius: 1.0 },
        Shape::Cone { height: 1.0, radius: 0.0 },
        ball(0.0).moved(Vec3::X).union(ball(0.0)),
        ball(1.0).intersection(ball(1.0).moved(Vec3::X * 3.0)),
        Shape::HalfSpace.intersection(ball(1.0).moved(Vec3::Y)),
        ball(1.0).intersection(Shape::Union(vec![])),
        ball(0.0).difference(ball(1.0)),
        ball(0.0).smooth_union(ball(0.0), 0.0),
    ];
    for shape in nothing {
        assert_eq!((shape.validate(), shape.extent()), (Ok(()), ShapeExtent::Empty), "{shape:?}");
        for p in [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE * 0.5] {
            assert!(program(&shape).distance(p) >= 0.0, "{shape:?} at {p}");
        }
    }
    // Two points close together make something, where their distances melt.
    let melted = ball(0.0).smooth_union(ball(0.0).moved(Vec3::X * 0.1), 1.0);
    assert!(program(&melted).distance(Vec3::X * 0.05) < 0.0 && melted.bounds().is_some());
    // A ring whose circle is a point is a ball.
    assert!(Shape::Torus { major_radius: 0.0, minor_radius: 1.0 }.bounds().is_some());

    let ground = Shape::HalfSpace;
    let slanted = ground.clone().turned(Quat::from_rotation_x(0.1));
    for shape in [
        ground.clone(),
        slanted.clone(),
        ground.clone().union(ball(1.0)),
        ground.clone().intersection(slanted.clone()),
        ground.clone().difference(ball(1.0)),
        ground.clone().smooth_union(ball(0.0), 0.1),
    ] {
        assert_eq!((shape.extent(), shape.bounds()), (ShapeExtent::Unbounded, None), "{shape:?}");
    }
    let cut = ball(1.0).intersection(slanted).bounds();
    assert_eq!(cut, ball(1.0).bounds());
    assert_eq!(ball(1.0).difference(ground.clone()).bounds(), ball(1.0).bounds());
    // Six of them, turned by quarters, make a box.
    let turns = [Vec3::X, Vec3::Z].map(|axis| [1.0, -1.0].map(|sign| (axis, sign * std::f32::consts::FRAC_PI_2)));
    let sides = turns.as_flattened().iter().chain(&[(Vec3::X, 0.0), (Vec3::X, std::f32::consts::PI)]);
    let cube = sides.map(|(axis, angle)| {
        let turn = Quat::from_axis_angle(*axis, *angle);
        ground.clone().turned(turn).moved(turn * Vec3::Y)
    });
    let bounds = Shape::Intersection(cube.collect()).bounds().expect("a box");
    assert!((bounds.low + 1.0).length() < 1e-6 && (bounds.high - 1.0).length() < 1e-6, "{bounds:?}");
}

#[test]
fn extremes_stay_finite() {
    let size = (-4.0_f32..4.0).prop_map(|exponent| 10.0_f32.powf(exponent));
    let far = prop::array::uniform3(-1.0e6_f32..1.0e6).prop_map(Vec3::from);
    check(3000, &(tree(true), size, far), |(shape, factor, far)| {
        let program = program(&shape.clone().scaled(factor));
        for p in [far, far * 1.0e6, far * 1.0e-12, Vec3::ZERO, Vec3::splat(f32::MIN_POSITIVE)] {
            assert!(program.distance(p).abs() <= 1.0e12, "{p}");
        }
        for p in [Vec3::NAN, Vec3::INFINITY, Vec3::new(0.0, f32::NAN, 0.0), Vec3::MAX] {
            program.distance(p);
        }
        if let Some(bounds) = shape.scaled(factor).moved(far).bounds() {
            assert!(bounds.low.is_finite() && bounds.high.is_finite() && bounds.low.cmplt(bounds.high).all());
        }
    });
    let nothing = ShapeProgram::default();
    assert_eq!(nothing.distance(Vec3::ZERO), 1.0e12);
    assert_eq!(nothing, program(&Shape::Union(vec![])));
}

#[test]
fn any_tree_survives_a_file() {
    check(500, &tree(true), |shape| {
        let json = serde_json::to_string(&shape).unwrap();
        assert_eq!(serde_json::from_str::<Shape>(&json).unwrap(), shape);
    });
}
