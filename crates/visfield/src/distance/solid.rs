//! Shapes as distance fields: in a unit of their own size, so that what counts as near means the same for all.

use glam::{DAffine3, DMat3, DVec3, Vec3};

use crate::field::BoundingEllipsoid;
use crate::shape::{Shape, ShapeError, ShapeExtent, ShapeProgram};

/// Units of a shape's distances to its bounding radius.
const UNITS: f32 = 32.0;
/// Half the side of the box around a shape without end, in the shape's own lengths.
const ENDLESS: f32 = 1.0e6;
/// The unit of a shape without end, or without size.
const DEFAULT_UNIT: f32 = 1.0 / UNITS;

/// A [`Shape`] that is ready to be asked. Its distances are in units of a 32nd of its bounding radius.
///
/// ```
/// use visfield::distance::Solid;
/// use visfield::shape::Shape;
/// let ball = Solid::new(Shape::Sphere { radius: 1.0 })?;
/// assert!((ball.distance_from_mesh().matrix3.x_axis.x * 3.0_f64.sqrt() - 32.0).abs() < 1e-4);
/// # Ok::<(), visfield::shape::ShapeError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    shape: Shape,
    program: ShapeProgram,
    unit: f32,
    center: Vec3,
    /// Half the diagonal of its box, in the shape's own lengths.
    radius: f32,
    /// In units.
    bounds: (Vec3, Vec3),
}

impl Solid {
    /// Flattens a shape.
    ///
    /// # Errors
    /// What [`Shape::validate`] finds.
    pub fn new(shape: Shape) -> Result<Self, ShapeError> {
        shape.validate()?;
        let extent = shape.extent();
        let (low, high) = match extent {
            ShapeExtent::Empty => (Vec3::ZERO, Vec3::ZERO),
            ShapeExtent::Bounded(bounds) => (bounds.low, bounds.high),
            ShapeExtent::Unbounded => (Vec3::splat(-ENDLESS), Vec3::splat(ENDLESS)),
        };
        let (center, half) = ((low + high) * 0.5, (high - low) * 0.5);
        let radius = half.length().max(f32::MIN_POSITIVE);
        let sized = extent != ShapeExtent::Unbounded && radius / UNITS >= f32::MIN_POSITIVE;
        let unit = if sized { radius / UNITS } else { DEFAULT_UNIT };
        // A unit more, for surfaces that lie in the faces of the box.
        let bounds = ((low - center) / unit - 1.0, (high - center) / unit + 1.0);
        let program = ShapeProgram::new(&shape.clone().moved(-center), unit)?;
        Ok(Self { shape, program, unit, center, radius, bounds })
    }

    /// The shape.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// What is evaluated of it.
    pub fn program(&self) -> &ShapeProgram {
        &self.program
    }

    /// The lowest and the highest corner of the box around it, and a little more, in its units.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        self.bounds
    }

    /// The sphere around it, in the shape's own space.
    pub fn sphere(&self) -> BoundingEllipsoid {
        BoundingEllipsoid::sphere(self.center.to_array(), self.radius.max(self.unit * 1.0e-3))
    }

    /// The map from the shape's own space to that of its distances.
    pub fn distance_from_mesh(&self) -> DAffine3 {
        let inverse = 1.0 / f64::from(self.unit);
        let matrix3 = DMat3::from_diagonal(DVec3::splat(inverse));
        DAffine3 { matrix3, translation: -self.center.as_dvec3() * inverse }
    }
}
