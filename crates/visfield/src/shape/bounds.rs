//! Where a shape is: the box around it.

use glam::{DVec3, Vec3};

use super::Shape;
use super::pose::Pose;

/// An axis-aligned box around a solid, in the shape's own units, to the rounding of single precision. It contains the solid,
/// and fits primitives and what is moved and scaled of them closely.
///
/// ```
/// use glam::Vec3;
/// use visfield::shape::{Shape, ShapeBounds};
/// let bounds = Shape::Sphere { radius: 2.0 }.bounds();
/// assert_eq!(bounds, Some(ShapeBounds { low: Vec3::splat(-2.0), high: Vec3::splat(2.0) }));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeBounds {
    /// The corner of the least coordinates.
    pub low: Vec3,
    /// The corner of the largest coordinates.
    pub high: Vec3,
}

/// Where a shape is.
///
/// ```
/// use visfield::shape::{Shape, ShapeExtent};
/// let ball = Shape::Sphere { radius: 1.0 };
/// assert!(matches!(ball.clone().union(Shape::HalfSpace).extent(), ShapeExtent::Unbounded));
/// assert!(matches!(ball.intersection(Shape::HalfSpace).extent(), ShapeExtent::Bounded(_)));
/// assert!(matches!(Shape::Sphere { radius: 0.0 }.extent(), ShapeExtent::Empty));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShapeExtent {
    /// It has no inside: there is nothing to see. (That an intersection or a difference leaves nothing is only found where
    /// boxes tell.)
    Empty,
    /// It is within a box.
    Bounded(ShapeBounds),
    /// It has, or is not known not to have, a half-space that nothing cuts down.
    Unbounded,
}

/// A box with finite sides and such without end.
#[derive(Clone, Copy)]
struct Around {
    low: DVec3,
    high: DVec3,
}

impl Around {
    const EVERYTHING: Self = Self { low: DVec3::NEG_INFINITY, high: DVec3::INFINITY };

    fn new(center: DVec3, half: DVec3) -> Self {
        Self { low: center - half, high: center + half }
    }

    fn with(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// What two boxes share, if that has a volume.
    fn within(self, other: Self) -> Option<Self> {
        let shared = Self { low: self.low.max(other.low), high: self.high.min(other.high) };
        shared.low.cmplt(shared.high).all().then_some(shared)
    }
}

pub(super) fn extent(shape: &Shape) -> ShapeExtent {
    match around(shape, &Pose::in_units_of(1.0), 0.0) {
        None => ShapeExtent::Empty,
        Some(found) if found.low.is_finite() && found.high.is_finite() => {
            let low = found.low.to_array().map(|x| rounded(x, -1.0));
            let high = found.high.to_array().map(|x| rounded(x, 1.0));
            ShapeExtent::Bounded(ShapeBounds { low: low.into(), high: high.into() })
        }
        Some(_) => ShapeExtent::Unbounded,
    }
}

/// In single precision, and not nearer to the middle.
fn rounded(x: f64, outwards: f64) -> f32 {
    let nearest = x as f32;
    if f64::from(nearest) * outwards >= x * outwards {
        nearest
    } else if outwards > 0.0 {
        nearest.next_up()
    } else {
        nearest.next_down()
    }
}

/// The box around all whose distance is below `margin`, in the whole's units; `None` if there is nothing.
///
/// Smooth unions need the margin: they fill what is near several shapes, and how far something of small distance is from a
/// shape follows from its parts alone. (Two balls that share a thin lens are both near far beyond its edge.)
fn around(shape: &Shape, pose: &Pose, margin: f64) -> Option<Around> {
    let axes = pose.axes();
    // How far a disc of radius 1 across the part's y reaches along the axes.
    let across = (DVec3::ONE - axes.y_axis * axes.y_axis).max(DVec3::ZERO).map(f64::sqrt);
    let along = axes.y_axis.abs();
    let size = |length: f32| f64::from(length) * pose.scale;
    let primitive = |lengths: &[f32], half: DVec3| {
        // Without volume it matters only for what is near it.
        let solid = margin > 0.0 || lengths.iter().all(|length| *length > 0.0);
        solid.then(|| Around::new(pose.translation, half + margin))
    };
    match shape {
        Shape::Sphere { radius } => primitive(&[*radius], DVec3::splat(size(*radius))),
        Shape::Box { half_extents } => {
            let [x, y, z] = half_extents.map(size);
            primitive(half_extents, axes.x_axis.abs() * x + axes.y_axis.abs() * y + axes.z_axis.abs() * z)
        }
        Shape::HalfSpace => Some(half_space(axes.y_axis, pose.translation, margin)),
        Shape::Capsule { half_length, radius } => primitive(&[*radius], along * size(*half_length) + size(*radius)),
        Shape::Cylinder { half_height, radius } => {
            primitive(&[*half_height, *radius], along * size(*half_height) + across * size(*radius))
        }
        Shape::Torus { major_radius, minor_radius } => {
            primitive(&[*minor_radius], across * size(*major_radius) + size(*minor_radius))
        }
        Shape::Cone { height, radius } => {
            let to_tip = axes.y_axis * (0.5 * size(*height));
            let base = Around::new(pose.translation - to_tip, across * size(*radius) + margin);
            let tip = Around::new(pose.translation + to_tip, DVec3::splat(margin));
            primitive(&[*height, *radius], DVec3::ZERO).map(|_| base.with(tip))
        }
        Shape::Moved { shape, rotation, translation } => around(shape, &pose.moved(*rotation, *translation), margin),
        Shape::Scaled { shape, factor } => around(shape, &pose.scaled(*factor), margin),
        Shape::Union(shapes) => union(shapes, pose, margin),
        Shape::SmoothUnion { shapes, width } => union(shapes, pose, margin + size(*width) * excess(shapes.len())),
        Shape::Intersection(shapes) => {
            let mut boxes = shapes.iter().map(|shape| around(shape, pose, margin));
            boxes.try_fold(Around::EVERYTHING, |all, one| all.within(one?))
        }
        Shape::Difference { shape, .. } => around(shape, pose, margin),
    }
}

fn union(shapes: &[Shape], pose: &Pose, margin: f64) -> Option<Around> {
    shapes.iter().filter_map(|shape| around(shape, pose, margin)).reduce(Around::with)
}

/// Only one that ends across an axis has an end.
fn half_space(normal: DVec3, through: DVec3, margin: f64) -> Around {
    let Around { mut low, mut high } = Around::EVERYTHING;
    for axis in 0..3 {
        let only = (0..3).all(|other| other == axis || normal[other] == 0.0);
        if only && normal[axis] > 0.0 {
            high[axis] = through[axis] + margin;
        } else if only {
            low[axis] = through[axis] - margin;
        }
    }
    Around { low, high }
}

/// By how many widths the smooth union of `count` shapes is below their union, at most. Where n of them are e widths below,
/// another is e widths away from them and lets them sink by (1 − e)²/4 more.
fn excess(count: usize) -> f64 {
    // After so many, what is left to a whole width is no more than what the width itself is rounded by.
    let joints = count.saturating_sub(1).min(super::MAX_NODES);
    (0..joints).fold(0.0, |excess, _| excess + 0.25 * (1.0 - excess) * (1.0 - excess))
}
