//! Random shapes and positions, the same ones each time.

use glam::{Quat, Vec3, Vec4};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestError, TestRng, TestRunner};
use visfield::shape::Shape;

/// Runs a test on so many values; it panics with the simplest one that fails.
pub(crate) fn check<S: Strategy>(cases: u32, strategy: &S, test: impl Fn(S::Value)) {
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let tested = runner.run(&strategy, |value| {
        test(value);
        Ok(())
    });
    match tested {
        Ok(()) => {}
        Err(TestError::Fail(reason, value)) => panic!("{reason}: {value:#?}"),
        Err(abort) => panic!("{abort}"),
    }
}

/// Where most shapes are, and around them.
pub(crate) fn position() -> impl Strategy<Value = Vec3> + Clone {
    let within = |reach: f32| prop::array::uniform3(-reach..reach).prop_map(Vec3::from);
    prop_oneof![within(2.0), within(8.0)]
}

/// Any rotation, quarter turns among them.
pub(crate) fn rotation() -> impl Strategy<Value = Quat> + Clone {
    let any = prop::array::uniform4(-1.0_f32..1.0)
        .prop_map(|q| Quat::from_vec4(Vec4::from(q).try_normalize().unwrap_or(Vec4::W)));
    let quarter = (0..3_usize, 0..4_i32)
        .prop_map(|(axis, turns)| Quat::from_axis_angle(Vec3::AXES[axis], turns as f32 * std::f32::consts::FRAC_PI_2));
    prop_oneof![3 => any, 1 => quarter]
}

/// One primitive, its sizes between 0.1 and 2.
pub(crate) fn primitive() -> impl Strategy<Value = Shape> + Clone {
    let size = || 0.1_f32..2.0;
    prop_oneof![
        3 => size().prop_map(|radius| Shape::Sphere { radius }),
        3 => prop::array::uniform3(size()).prop_map(|half_extents| Shape::Box { half_extents }),
        1 => Just(Shape::HalfSpace),
        2 => (size(), size()).prop_map(|(half_length, radius)| Shape::Capsule { half_length, radius }),
        2 => (size(), size()).prop_map(|(half_height, radius)| Shape::Cylinder { half_height, radius }),
        2 => (size(), size()).prop_map(|(major_radius, minor_radius)| Shape::Torus { major_radius, minor_radius }),
        2 => (size(), size()).prop_map(|(height, radius)| Shape::Cone { height, radius }),
    ]
}

/// A shape with a motion and a scale around it.
pub(crate) fn placed(shape: impl Strategy<Value = Shape> + Clone) -> impl Strategy<Value = Shape> + Clone {
    let translation = prop::array::uniform3(-2.0_f32..2.0);
    (shape, rotation(), translation, 0.3_f32..2.0)
        .prop_map(|(shape, rotation, translation, factor)| shape.turned(rotation).moved(translation).scaled(factor))
}

/// Trees, three levels deep at most, of some 12 primitives at most; with smooth unions or without.
pub(crate) fn tree(smooth: bool) -> impl Strategy<Value = Shape> + Clone {
    placed(primitive()).prop_recursive(3, 12, 3, move |inner| {
        let several = || prop::collection::vec(inner.clone(), 0..=3);
        let some = || prop::collection::vec(inner.clone(), 1..=3);
        let joined = prop_oneof![
            several().prop_map(Shape::Union),
            some().prop_map(Shape::Intersection),
            (inner.clone(), inner.clone()).prop_map(|(shape, removed)| shape.difference(removed)),
        ];
        let smooth_union = (several(), 0.0_f32..1.0).prop_map(|(shapes, width)| Shape::SmoothUnion { shapes, width });
        let weight = u32::from(smooth);
        placed(prop_oneof![3 => joined, weight => smooth_union])
    })
}
