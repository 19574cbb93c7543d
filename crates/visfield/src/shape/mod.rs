//! Shapes: solids that a formula describes, by their signed distance, without anything being baked.
//!
//! A [`Shape`] is a tree of primitives and of what joins them. It is [checked](Shape::validate), bounded ([`Shape::extent`]) and
//! flattened into a [`ShapeProgram`], which alone evaluates it, on the CPU as on the GPU (`shaders/shape.wgsl`).
//!
//! Distances follow Hart, *Sphere Tracing* (1996), as *Distance Field Ray Marching* (2012) §3.3 has them. They are above 0
//! outside and below 0 inside, and no two of them differ by more than their points are apart (they are 1-Lipschitz). So none is
//! larger than the true distance: what the 2014 paper calls a signed distance bound (*Enhanced Sphere Tracing*, eq. 1), except
//! that inside, where eq. 1 wants the bound below −depth, these stay above it, and a step of |distance| is safe on both sides.

mod bounds;
mod pose;
mod primitive;
mod program;

use glam::{Quat, Vec3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use bounds::{ShapeBounds, ShapeExtent};
pub use program::{MAX_LENGTH, MAX_NESTING, MAX_NODES, MAX_STACK, ShapeNode, ShapeProgram};

/// A solid, as a tree of primitives and of what joins them. Every bounded primitive has its centre at the origin.
///
/// Lengths are in the shape's own units, finite and not below 0. What a length of 0 leaves without volume (a ball of radius 0,
/// a box without thickness) is allowed and has a distance, which is nowhere below 0; but it has no inside and counts as nothing
/// for [`Shape::extent`]. Give a plate a thickness if it is to be seen.
///
/// ```
/// use glam::{Quat, Vec3};
/// use visfield::shape::{Shape, ShapeProgram};
/// // A ball on the ground, with a slanted hole through it.
/// let hole = Shape::Cylinder { half_height: 2.0, radius: 0.25 }.turned(Quat::from_rotation_z(0.7));
/// let scene = Shape::Sphere { radius: 1.0 }.difference(hole).moved(Vec3::Y).union(Shape::HalfSpace);
/// let program = ShapeProgram::new(&scene, 1.0)?;
/// assert_eq!(program.distance(Vec3::new(4.0, 0.5, 0.0)), 0.5);
/// assert!(program.distance(Vec3::Y) > 0.0 && program.distance(Vec3::NEG_Y) < 0.0);
///
/// let json = serde_json::to_string(&Shape::Sphere { radius: 1.0 }).unwrap();
/// assert_eq!(json, r#"{"sphere":{"radius":1.0}}"#);
/// # Ok::<(), visfield::shape::ShapeError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Its radius.
        radius: f32,
    },
    /// A cuboid along the axes.
    Box {
        /// Half its edges along x, y and z.
        half_extents: [f32; 3],
    },
    /// Everything below y = 0: a ground without end.
    HalfSpace,
    /// All that is within `radius` of a line segment along y.
    Capsule {
        /// Half the length of the segment; the capsule is longer by a radius at either end.
        half_length: f32,
        /// How thick it is, from the segment outwards.
        radius: f32,
    },
    /// A solid cylinder along y, with flat ends.
    Cylinder {
        /// Half its height.
        half_height: f32,
        /// Its radius.
        radius: f32,
    },
    /// A ring around y: all that is within `minor_radius` of a circle.
    Torus {
        /// Radius of the circle, which lies in y = 0.
        major_radius: f32,
        /// How thick the ring is, from the circle outwards. More than `major_radius` closes the hole.
        minor_radius: f32,
    },
    /// A solid cone along y: from its base at −`height`/2 to its tip at `height`/2.
    Cone {
        /// From the base to the tip.
        height: f32,
        /// Radius of the base.
        radius: f32,
    },
    /// A shape turned about its origin, and then moved.
    Moved {
        /// What is moved.
        shape: Box<Shape>,
        /// A unit quaternion, as x, y, z, w.
        rotation: [f32; 4],
        /// Where its origin goes.
        translation: [f32; 3],
    },
    /// A shape grown or shrunk about its origin.
    Scaled {
        /// What is scaled.
        shape: Box<Shape>,
        /// How many times as large it becomes; above 0.
        factor: f32,
    },
    /// What is inside any of the shapes; nothing if there are none.
    Union(Vec<Shape>),
    /// What is inside all of the shapes, of which there is at least one.
    Intersection(Vec<Shape>),
    /// What is inside a shape and not inside another.
    Difference {
        /// What is left over in part.
        shape: Box<Shape>,
        /// What is taken away.
        removed: Box<Shape>,
    },
    /// A union with rounded seams, where the distances of the shapes are less than `width` apart. It contains the union.
    ///
    /// Its distance is below the union's by no more than a quarter of `width` for two shapes. Further shapes are joined one
    /// after the other, and where all of them meet may add to it: 0.4 widths for three, and never a whole width.
    SmoothUnion {
        /// What is joined, in this order.
        shapes: Vec<Shape>,
        /// How wide the seams are, as a difference of distances. A plain union at 0.
        width: f32,
    },
}

impl Shape {
    /// The shape, moved by a vector.
    ///
    /// ```
    /// use glam::Vec3;
    /// use visfield::shape::Shape;
    /// let bounds = Shape::Sphere { radius: 1.0 }.moved(Vec3::Y).bounds().unwrap();
    /// assert_eq!((bounds.low.y, bounds.high.y), (0.0, 2.0));
    /// ```
    #[must_use]
    pub fn moved(self, translation: impl Into<Vec3>) -> Self {
        let translation = translation.into().to_array();
        Self::Moved { shape: Box::new(self), rotation: Quat::IDENTITY.to_array(), translation }
    }

    /// The shape, turned about the origin by a unit quaternion.
    ///
    /// ```
    /// use glam::Quat;
    /// use visfield::shape::Shape;
    /// let lying = Shape::Cylinder { half_height: 3.0, radius: 1.0 }.turned(Quat::from_rotation_z(1.570_796_4));
    /// assert_eq!(lying.bounds().unwrap().high.x, 3.0);
    /// ```
    #[must_use]
    pub fn turned(self, rotation: Quat) -> Self {
        Self::Moved { shape: Box::new(self), rotation: rotation.to_array(), translation: [0.0; 3] }
    }

    /// The shape, `factor` times as large, about the origin; above 0.
    ///
    /// ```
    /// use visfield::shape::Shape;
    /// assert_eq!(Shape::Sphere { radius: 1.0 }.scaled(3.0).bounds().unwrap().high.x, 3.0);
    /// ```
    #[must_use]
    pub fn scaled(self, factor: f32) -> Self {
        Self::Scaled { shape: Box::new(self), factor }
    }

    /// This shape and another. A chain of these makes one [`Shape::Union`].
    ///
    /// ```
    /// use visfield::shape::Shape;
    /// let [a, b, c] = [1.0, 2.0, 3.0].map(|radius| Shape::Sphere { radius });
    /// assert_eq!(a.clone().union(b.clone()).union(c.clone()), Shape::Union(vec![a, b, c]));
    /// ```
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        match self {
            Self::Union(mut shapes) => {
                shapes.push(other);
                Self::Union(shapes)
            }
            shape => Self::Union(vec![shape, other]),
        }
    }

    /// What this shape and another have in common. A chain of these makes one [`Shape::Intersection`].
    ///
    /// ```
    /// use visfield::shape::Shape;
    /// let half_ball = Shape::Sphere { radius: 1.0 }.intersection(Shape::HalfSpace);
    /// assert_eq!(half_ball.bounds().unwrap().high.y, 0.0);
    /// ```
    #[must_use]
    pub fn intersection(self, other: Self) -> Self {
        match self {
            Self::Intersection(mut shapes) => {
                shapes.push(other);
                Self::Intersection(shapes)
            }
            shape => Self::Intersection(vec![shape, other]),
        }
    }

    /// This shape without what is inside another.
    ///
    /// ```
    /// use glam::Vec3;
    /// use visfield::shape::{Shape, ShapeProgram};
    /// let hollow = Shape::Sphere { radius: 1.0 }.difference(Shape::Sphere { radius: 0.5 });
    /// assert_eq!(ShapeProgram::new(&hollow, 1.0)?.distance(Vec3::ZERO), 0.5);
    /// # Ok::<(), visfield::shape::ShapeError>(())
    /// ```
    #[must_use]
    pub fn difference(self, removed: Self) -> Self {
        Self::Difference { shape: Box::new(self), removed: Box::new(removed) }
    }

    /// This shape and another, with a rounded seam. A chain of these with the same `width` makes one [`Shape::SmoothUnion`].
    ///
    /// ```
    /// use glam::Vec3;
    /// use visfield::shape::{Shape, ShapeProgram};
    /// let ball = Shape::Sphere { radius: 1.0 };
    /// let pair = ball.clone().moved(Vec3::X).smooth_union(ball.moved(Vec3::NEG_X), 0.4);
    /// // Where both are equally near, by a quarter of the width.
    /// assert_eq!(ShapeProgram::new(&pair, 1.0)?.distance(Vec3::ZERO), -0.1);
    /// # Ok::<(), visfield::shape::ShapeError>(())
    /// ```
    #[must_use]
    pub fn smooth_union(self, other: Self, width: f32) -> Self {
        match self {
            Self::SmoothUnion { mut shapes, width: own } if own == width => {
                shapes.push(other);
                Self::SmoothUnion { shapes, width }
            }
            shape => Self::SmoothUnion { shapes: vec![shape, other], width },
        }
    }

    /// Checks every number against its documented range, and that the shape is small enough to be evaluated.
    ///
    /// ```
    /// use visfield::shape::{Shape, ShapeError};
    /// assert_eq!(Shape::Sphere { radius: 1.0 }.validate(), Ok(()));
    /// let bad = Shape::Sphere { radius: -1.0 };
    /// assert_eq!(bad.validate(), Err(ShapeError::Length { name: "radius", value: -1.0 }));
    /// ```
    ///
    /// # Errors
    /// [`ShapeError`] names the first thing that is wrong.
    pub fn validate(&self) -> Result<(), ShapeError> {
        ShapeProgram::new(self, 1.0).map(drop)
    }

    /// Where it is: nowhere, in a box, or without end. Of a [valid](Self::validate) shape.
    ///
    /// ```
    /// use visfield::shape::{Shape, ShapeExtent};
    /// assert_eq!(Shape::Union(vec![]).extent(), ShapeExtent::Empty);
    /// assert_eq!(Shape::HalfSpace.extent(), ShapeExtent::Unbounded);
    /// ```
    pub fn extent(&self) -> ShapeExtent {
        bounds::extent(self)
    }

    /// The box around it, if there is something in it and it ends. Of a [valid](Self::validate) shape.
    ///
    /// ```
    /// use visfield::shape::Shape;
    /// let capsule = Shape::Capsule { half_length: 1.0, radius: 0.5 };
    /// assert_eq!(capsule.bounds().unwrap().high.to_array(), [0.5, 1.5, 0.5]);
    /// assert_eq!(Shape::HalfSpace.bounds(), None);
    /// ```
    pub fn bounds(&self) -> Option<ShapeBounds> {
        match self.extent() {
            ShapeExtent::Bounded(bounds) => Some(bounds),
            ShapeExtent::Empty | ShapeExtent::Unbounded => None,
        }
    }

    /// Whether it is known to be convex: true for primitives other than a torus, for what is moved or scaled of them, and for
    /// their intersections. Other shapes may be convex and are not found to be.
    ///
    /// ```
    /// use visfield::shape::Shape;
    /// assert!(Shape::Sphere { radius: 1.0 }.intersection(Shape::HalfSpace).is_convex());
    /// assert!(!Shape::Torus { major_radius: 2.0, minor_radius: 1.0 }.is_convex());
    /// ```
    pub fn is_convex(&self) -> bool {
        match self {
            Self::Sphere { .. }
            | Self::Box { .. }
            | Self::HalfSpace
            | Self::Capsule { .. }
            | Self::Cylinder { .. }
            | Self::Cone { .. } => true,
            Self::Torus { .. } | Self::Difference { .. } => false,
            Self::Moved { shape, .. } | Self::Scaled { shape, .. } => shape.is_convex(),
            // One shape alone, or none.
            Self::Union(shapes) | Self::SmoothUnion { shapes, .. } => {
                shapes.len() <= 1 && shapes.iter().all(Self::is_convex)
            }
            Self::Intersection(shapes) => shapes.iter().all(Self::is_convex),
        }
    }
}

/// Why a shape cannot be evaluated.
///
/// ```
/// use visfield::shape::{Shape, ShapeError};
/// let error = Shape::Intersection(vec![]).validate().unwrap_err();
/// assert_eq!(error, ShapeError::EmptyIntersection);
/// assert_eq!(error.to_string(), "an intersection of no shapes is everything; give it at least one");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum ShapeError {
    /// A length is not finite, or below 0.
    #[error("{name} is {value}; lengths are finite and not below 0")]
    Length {
        /// The field that holds it.
        name: &'static str,
        /// The length.
        value: f32,
    },
    /// A factor of [`Shape::Scaled`] is not finite, or not above 0.
    #[error("a shape is scaled by {0}; factors are finite and above 0")]
    Factor(f32),
    /// A rotation is no unit quaternion.
    #[error("rotation {0:?} is not a unit quaternion; normalize it")]
    Rotation([f32; 4]),
    /// A translation is not finite.
    #[error("translation {0:?} is not finite")]
    Translation([f32; 3]),
    /// A unit of length is not finite, or not above 0.
    #[error("the unit of length is {0}; it is finite and above 0")]
    Unit(f32),
    /// All in all, something is larger or farther away than can be calculated with.
    #[error("with all factors, {name} is {value} units, which is more than {MAX_LENGTH}; make the shape smaller")]
    TooLarge {
        /// What is.
        name: &'static str,
        /// The size or distance.
        value: f64,
    },
    /// An intersection of no shapes.
    #[error("an intersection of no shapes is everything; give it at least one")]
    EmptyIntersection,
    /// More than [`MAX_NODES`] nodes.
    #[error("the shape has over {MAX_NODES} nodes, one for each primitive and each joint of two; make it simpler")]
    TooManyNodes,
    /// Evaluation needs a stack of more than [`MAX_STACK`], or more than [`MAX_NESTING`] shapes are within each other.
    #[error(
        "shapes are nested too deeply: over {MAX_STACK} distances are kept at once, or over {MAX_NESTING} shapes are within \
         each other; flatten unions and intersections, and put what is nested first"
    )]
    TooDeep,
}

#[cfg(test)]
mod tests {
    use super::*;

    const BALL: Shape = Shape::Sphere { radius: 1.0 };

    #[test]
    fn what_cannot_be_evaluated_is_named() {
        let length = |shape: Shape| match shape.validate() {
            Err(ShapeError::Length { name, .. }) => name,
            other => panic!("{shape:?}: {other:?}"),
        };
        for bad in [-1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(length(Shape::Sphere { radius: bad }), "radius");
            assert_eq!(length(Shape::Box { half_extents: [1.0, 1.0, bad] }), "half_extents");
            assert_eq!(length(Shape::Capsule { half_length: bad, radius: 1.0 }), "half_length");
            assert_eq!(length(Shape::Capsule { half_length: 1.0, radius: bad }), "radius");
            assert_eq!(length(Shape::Cylinder { half_height: bad, radius: 1.0 }), "half_height");
            assert_eq!(length(Shape::Cylinder { half_height: 1.0, radius: bad }), "radius");
            assert_eq!(length(Shape::Torus { major_radius: bad, minor_radius: 1.0 }), "major_radius");
            assert_eq!(length(Shape::Torus { major_radius: 1.0, minor_radius: bad }), "minor_radius");
            assert_eq!(length(Shape::Cone { height: bad, radius: 1.0 }), "height");
            assert_eq!(length(Shape::Cone { height: 1.0, radius: bad }), "radius");
            assert_eq!(length(BALL.smooth_union(BALL, bad)), "width");
            // However deep it lies, and beside however much of nothing.
            let inner = Shape::Union(vec![]).intersection(Shape::Sphere { radius: bad }).moved(Vec3::X);
            assert_eq!(length(BALL.difference(inner.scaled(2.0))), "radius");
            assert!(matches!(BALL.scaled(bad).validate(), Err(ShapeError::Factor(_))));
            assert!(matches!(ShapeProgram::new(&BALL, bad), Err(ShapeError::Unit(_))));
        }
        assert_eq!(BALL.scaled(0.0).validate(), Err(ShapeError::Factor(0.0)));
        assert_eq!(ShapeProgram::new(&BALL, 0.0), Err(ShapeError::Unit(0.0)));
        for bad in [f32::NAN, f32::INFINITY] {
            assert!(matches!(BALL.moved([0.0, bad, 0.0]).validate(), Err(ShapeError::Translation(_))));
        }
        for bad in
            [Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), Quat::IDENTITY * 1.01, Quat::from_xyzw(0.0, f32::NAN, 0.0, 1.0)]
        {
            assert!(matches!(BALL.turned(bad).validate(), Err(ShapeError::Rotation(_))), "{bad}");
        }
        // As written by hand, with four digits.
        assert_eq!(BALL.turned(Quat::from_xyzw(0.3827, 0.0, 0.0, 0.9239)).validate(), Ok(()));
        assert_eq!(Shape::Intersection(vec![]).validate(), Err(ShapeError::EmptyIntersection));
        assert_eq!(BALL.union(Shape::Intersection(vec![])).validate(), Err(ShapeError::EmptyIntersection));
    }

    #[test]
    fn sizes_that_only_factors_make_too_large_are_refused() {
        let name = |shape: Shape| match shape.validate() {
            Err(ShapeError::TooLarge { name, .. }) => name,
            other => panic!("{shape:?}: {other:?}"),
        };
        assert_eq!(name(BALL.scaled(1.0e10).scaled(1.0e10)), "radius");
        assert_eq!(name(BALL.moved([0.0, -1.0e10, 0.0]).scaled(1.0e10)), "translation");
        assert_eq!(name(BALL.smooth_union(Shape::HalfSpace, 1.0e13)), "width");
        assert_eq!(name((0..40).fold(BALL, |shape, _| shape.scaled(f32::MAX))), "radius");
        assert!(matches!(ShapeProgram::new(&BALL, 1.0e-13), Err(ShapeError::TooLarge { .. })));
        assert_eq!((0..40).fold(BALL, |shape, _| shape.scaled(f32::MIN_POSITIVE)).validate(), Ok(()));
    }

    #[test]
    fn nodes_stack_and_nesting_are_limited() {
        // n primitives have n − 1 joints.
        let balls = |count: usize| Shape::Union(vec![BALL; count]);
        assert_eq!(balls(MAX_NODES / 2).validate(), Ok(()));
        assert_eq!(balls(MAX_NODES / 2 + 1).validate(), Err(ShapeError::TooManyNodes));
        assert_eq!(balls(100_000).validate(), Err(ShapeError::TooManyNodes));
        // Nested last, every level keeps a distance; nested first, none does.
        let last = |levels: usize| (0..levels).fold(BALL, |shape, _| Shape::Union(vec![BALL, shape]));
        assert_eq!(last(MAX_STACK - 1).validate(), Ok(()));
        assert_eq!(last(MAX_STACK).validate(), Err(ShapeError::TooDeep));
        let first = (0..3 * MAX_STACK).fold(BALL, |shape, _| Shape::Union(vec![shape, BALL]));
        assert_eq!(first.validate(), Ok(()));
        let removed = |levels: usize| (0..levels).fold(BALL, |shape, _| BALL.difference(shape));
        assert_eq!(removed(MAX_STACK - 1).validate(), Ok(()));
        assert_eq!(removed(MAX_STACK).validate(), Err(ShapeError::TooDeep));
        let moved = |levels: usize| (0..levels).fold(BALL, |shape, _| shape.moved(Vec3::X));
        assert_eq!(moved(MAX_NESTING).validate(), Ok(()));
        assert_eq!(moved(MAX_NESTING + 1).validate(), Err(ShapeError::TooDeep));
    }

    #[test]
    fn only_what_is_known_to_be_convex_is_called_so() {
        let ring = Shape::Torus { major_radius: 1.0, minor_radius: 0.5 };
        let lens = BALL.intersection(BALL.moved(Vec3::X)).intersection(Shape::HalfSpace);
        for convex in [BALL, Shape::HalfSpace, lens.clone(), lens.clone().moved(Vec3::X).scaled(2.0)] {
            assert!(convex.is_convex(), "{convex:?}");
            assert!(Shape::Union(vec![convex]).is_convex());
        }
        let moved_ring = ring.clone().moved(Vec3::X).scaled(2.0);
        for other in [ring, moved_ring.clone(), lens.intersection(moved_ring), BALL.union(BALL), BALL.difference(BALL)]
        {
            assert!(!other.is_convex(), "{other:?}");
        }
        assert!(!BALL.smooth_union(BALL, 0.1).is_convex());
    }

    #[test]
    fn files_hold_what_they_were_given() {
        let all = Shape::Box { half_extents: [0.1, 0.2, 0.3] }
            .union(Shape::Capsule { half_length: 1.0, radius: 0.3 })
            .union(Shape::Cylinder { half_height: 0.7, radius: 1.0e-4 })
            .smooth_union(Shape::Torus { major_radius: 1.0, minor_radius: 0.1 }, 0.05)
            .intersection(Shape::HalfSpace)
            .difference(Shape::Cone { height: 1.0, radius: 0.5 })
            .turned(Quat::from_rotation_x(0.3))
            .moved([1.0e6, -0.1, 1.0 / 3.0])
            .scaled(1.1)
            .union(Shape::Union(vec![]));
        let json = serde_json::to_string(&all).unwrap();
        assert_eq!(serde_json::from_str::<Shape>(&json).unwrap(), all);
        for name in ["smooth-union", "half-space", "half_extents", "difference", "moved", "scaled"] {
            assert!(json.contains(&format!("\"{name}\"")), "{name} in {json}");
        }
        assert!(serde_json::from_str::<Shape>(r#"{"sphere":{"radius":null}}"#).is_err());
    }
}
