//! Where in the whole a part of a shape is: what all the moves and scales around it come to.

use glam::{DMat3, DQuat, DVec3};

/// A similarity `x = scale · rotation · p + translation`, from the space of a part to that of the whole. In double precision, so
/// that chains of them round once.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pose {
    rotation: DMat3,
    /// Of the part's origin, in the whole's units.
    pub(super) translation: DVec3,
    /// Length of the part's unit in the whole's.
    pub(super) scale: f64,
}

/// Components of rotated axes below this are 0. They are what single precision leaves of quarter turns, whose boxes and
/// half-spaces would miss the axes by that little.
const SMALLEST_COMPONENT: f64 = 1.0 / 4_194_304.0;

impl Pose {
    /// The whole itself, measured in `unit`s.
    pub(super) fn in_units_of(unit: f32) -> Self {
        Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO, scale: 1.0 / f64::from(unit) }
    }

    /// The pose of what is turned and moved within this one (2012, §3.3, eq. 3.6 and 3.7).
    pub(super) fn moved(&self, rotation: [f32; 4], translation: [f32; 3]) -> Self {
        let [x, y, z, w] = rotation.map(f64::from);
        let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let translation = self.rotation * DVec3::from(translation.map(f64::from));
        Self {
            rotation: self.rotation * rotation,
            translation: self.translation + self.scale * translation,
            scale: self.scale,
        }
    }

    /// The pose of what is scaled within this one (2012, §3.3, eq. 3.8).
    pub(super) fn scaled(&self, factor: f32) -> Self {
        Self { scale: self.scale * f64::from(factor), ..*self }
    }

    /// The part's axes in the whole, as columns of unit length.
    pub(super) fn axes(&self) -> DMat3 {
        let exact = |x: f64| if x.abs() < SMALLEST_COMPONENT { 0.0 } else { x };
        // With one component left, that is ±1 then.
        let axis = |i: usize| self.rotation.col(i).map(exact).normalize();
        DMat3::from_cols(axis(0), axis(1), axis(2))
    }
}
