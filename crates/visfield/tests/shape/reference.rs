//! What shapes mean, written a second time: with the transforms at their place in the tree, in double precision, and with what
//! is inside as plain logic.

use glam::{DQuat, DVec2, DVec3, dvec2, dvec3};
use visfield::shape::Shape;

/// The distance, as 2012, §3.3 has it; infinite to nothing.
pub(crate) fn distance(shape: &Shape, p: DVec3) -> f64 {
    let from_axis = p.x.hypot(p.z);
    match shape {
        Shape::Sphere { radius } => p.length() - f64::from(*radius),
        Shape::Box { half_extents } => {
            let half = DVec3::from(half_extents.map(f64::from));
            let outside = p.distance(p.clamp(-half, half));
            if outside > 0.0 { outside } else { -(half - p.abs()).min_element() }
        }
        Shape::HalfSpace => p.y,
        Shape::Capsule { half_length, radius } => {
            let end = DVec3::Y * f64::from(*half_length);
            to_segment(p, -end, end) - f64::from(*radius)
        }
        Shape::Cylinder { half_height, radius } => {
            let (q, half) = (dvec2(from_axis, p.y), dvec2(f64::from(*radius), f64::from(*half_height)));
            let outside = q.distance(q.clamp(-half, half));
            if outside > 0.0 { outside } else { -(half - q.abs()).min_element() }
        }
        Shape::Torus { major_radius, minor_radius } => {
            let outward = DVec2::new(p.x, p.z).try_normalize().unwrap_or(DVec2::X) * f64::from(*major_radius);
            p.distance(dvec3(outward.x, 0.0, outward.y)) - f64::from(*minor_radius)
        }
        Shape::Cone { height, radius } => {
            let (half, radius) = (0.5 * f64::from(*height), f64::from(*radius));
            let [q, edge, tip] = [dvec2(from_axis, p.y), dvec2(radius, -half), dvec2(0.0, half)].map(|v| v.extend(0.0));
            let distance = to_segment(q, edge, tip).min(to_segment(q, edge, dvec3(0.0, -half, 0.0)));
            if contains(shape, p) { -distance } else { distance }
        }
        Shape::Moved { shape, rotation, translation } => distance(shape, moved_back(p, *rotation, *translation)),
        Shape::Scaled { shape, factor } => f64::from(*factor) * distance(shape, p / f64::from(*factor)),
        Shape::Union(shapes) => shapes.iter().map(|shape| distance(shape, p)).fold(f64::INFINITY, f64::min),
        Shape::Intersection(shapes) => shapes.iter().map(|shape| distance(shape, p)).fold(f64::NEG_INFINITY, f64::max),
        Shape::Difference { shape, removed } => distance(shape, p).max(-distance(removed, p)),
        Shape::SmoothUnion { shapes, width } => {
            let width = f64::from(*width);
            let join = |a: f64, b: f64| {
                // As Quilez first had it: a blend of both, bulged.
                let share = (0.5 + 0.5 * (b - a) / width).clamp(0.0, 1.0);
                let near = (b - a).abs() < width;
                if near { b + (a - b) * share - width * share * (1.0 - share) } else { a.min(b) }
            };
            shapes.iter().map(|shape| distance(shape, p)).fold(f64::INFINITY, join)
        }
    }
}

/// Whether a position is inside; of shapes without smooth unions.
pub(crate) fn contains(shape: &Shape, p: DVec3) -> bool {
    let from_axis = p.x.hypot(p.z);
    let [x, y, z] = p.to_array();
    match shape {
        Shape::Sphere { radius } => p.length() < f64::from(*radius),
        Shape::Box { half_extents } => p.abs().cmplt(DVec3::from(half_extents.map(f64::from))).all(),
        Shape::HalfSpace => y < 0.0,
        Shape::Capsule { half_length, radius } => {
            let beyond = (y.abs() - f64::from(*half_length)).max(0.0);
            dvec3(x, beyond, z).length() < f64::from(*radius)
        }
        Shape::Cylinder { half_height, radius } => from_axis < f64::from(*radius) && y.abs() < f64::from(*half_height),
        Shape::Torus { major_radius, minor_radius } => {
            (from_axis - f64::from(*major_radius)).hypot(y) < f64::from(*minor_radius)
        }
        Shape::Cone { height, radius } => {
            let below_tip = 0.5 - y / f64::from(*height);
            below_tip < 1.0 && from_axis < f64::from(*radius) * below_tip
        }
        Shape::Moved { shape, rotation, translation } => contains(shape, moved_back(p, *rotation, *translation)),
        Shape::Scaled { shape, factor } => contains(shape, p / f64::from(*factor)),
        Shape::Union(shapes) => shapes.iter().any(|shape| contains(shape, p)),
        Shape::Intersection(shapes) => shapes.iter().all(|shape| contains(shape, p)),
        Shape::Difference { shape, removed } => contains(shape, p) && !contains(removed, p),
        Shape::SmoothUnion { .. } => panic!("what is inside a smooth union is a matter of distances"),
    }
}

fn moved_back(p: DVec3, rotation: [f32; 4], translation: [f32; 3]) -> DVec3 {
    let [x, y, z, w] = rotation.map(f64::from);
    DQuat::from_xyzw(x, y, z, w).normalize().inverse() * (p - DVec3::from(translation.map(f64::from)))
}

fn to_segment(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let along = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
    p.distance(a.lerp(b, along))
}
