//! Which part of a field answers: its table by rays, its cap grid, or each at some receivers.
//!
//! Frames, their GPU twins and batches of receivers all ask here, so that they agree.

use crate::field::VisibilityField;
use crate::field::cap_grid::{CapGrid, HarmonicOrder};

/// Half-angle of a light, in radians, from which cap grids can hide it: 15°. Smaller ones have edges that harmonics do not.
pub const LARGE_LIGHT: f32 = 0.261_8;

/// Which part of a field answers: for ambient occlusion, or for a large light.
///
/// ```
/// use visfield::estimate::source::OcclusionSource;
/// # let field = visfield::field::example_caps(); // no table
/// assert_eq!(OcclusionSource::of(&field, true), OcclusionSource::CapGrid);
/// assert_eq!(OcclusionSource::of(&field, false), OcclusionSource::None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OcclusionSource {
    /// No part can.
    None,
    /// The table, by rays.
    Rays,
    /// The cap grid.
    CapGrid,
    /// The cap grid outside the mesh's bounding box, and rays inside, where the grid [is known to be
    /// wrong](crate::field::cap_grid::CapGridError::serves_inside).
    CapGridWithRaysInside,
}

impl OcclusionSource {
    /// The part of a field to ask for ambient occlusion, where cap grids are wanted or are not.
    pub fn of(field: &VisibilityField, caps: bool) -> Self {
        Self::choose(field.answers_rays(), field.cap_grid().map(CapGrid::serves_inside), caps)
    }

    /// The part of a field to ask for a light of [`LARGE_LIGHT`] or more: for that, a grid needs
    /// [`HarmonicOrder::Three`].
    pub fn of_large_lights(field: &VisibilityField, caps: bool) -> Self {
        let grid = field.cap_grid().filter(|grid| grid.header().format.order == HarmonicOrder::Three);
        Self::choose(field.answers_rays(), grid.map(CapGrid::serves_inside), caps)
    }

    /// The same, of a field that answers rays or does not, and has a grid that serves inside its box or does not.
    pub fn choose(answers_rays: bool, grid_serves_inside: Option<bool>, caps: bool) -> Self {
        match (grid_serves_inside.filter(|_| caps), answers_rays) {
            (Some(false), true) => Self::CapGridWithRaysInside,
            (Some(_), _) => Self::CapGrid,
            (None, true) => Self::Rays,
            (None, false) => Self::None,
        }
    }

    /// Whether the grid is asked anywhere.
    pub fn has_caps(self) -> bool {
        matches!(self, Self::CapGrid | Self::CapGridWithRaysInside)
    }

    /// Whether rays are sent from anywhere.
    pub fn has_rays(self) -> bool {
        matches!(self, Self::Rays | Self::CapGridWithRaysInside)
    }

    /// Which share of a receiver's rays is sent; `inside_share` is asked for the grid's [inside share](CapGrid::inside_share) if
    /// it matters. What is not sent, the grid answers, if it is asked at all.
    pub fn share_of_rays(self, inside_share: impl FnOnce() -> f32) -> f32 {
        match self {
            Self::None | Self::CapGrid => 0.0,
            Self::Rays => 1.0,
            Self::CapGridWithRaysInside => inside_share(),
        }
    }
}
