//! Which part of a field answers: its cap grid, its distances by cones, or rays, or each at some receivers.
//!
//! Frames, their GPU twins and batches of receivers all ask here, so that they agree.

use crate::field::VisibilityField;
use crate::field::cap_grid::{CapGrid, HarmonicOrder};

/// Half-angle of a light, in radians, from which cap grids can hide it: 15°. Smaller ones have edges that harmonics do not.
pub const LARGE_LIGHT: f32 = 0.261_8;

/// Which part of a field answers: for ambient occlusion, or for a light.
///
/// ```
/// use visfield::estimate::source::{Answers, OcclusionSource, Wanted};
/// # let field = visfield::field::example_caps(); // neither a table nor distances
/// assert_eq!(Answers::of(&field).ambient(Wanted::CAPS), OcclusionSource::CapGrid);
/// assert_eq!(Answers::of(&field).ambient(Wanted::RAYS), OcclusionSource::None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OcclusionSource {
    /// No part can.
    None,
    /// Whatever answers rays.
    Rays,
    /// The cap grid.
    CapGrid,
    /// The cap grid outside the mesh's bounding box, and rays inside, where the grid [is known to be
    /// wrong](crate::field::cap_grid::CapGridError::serves_inside).
    CapGridWithRaysInside,
    /// The distances, by cones.
    Cones,
    /// The cap grid outside the mesh's bounding box, and cones inside, where the grid is known to be wrong.
    CapGridWithConesInside,
}

/// What a frame would have answered without rays.
///
/// ```
/// use visfield::estimate::source::Wanted;
/// assert_eq!(Wanted { cones: false, ..Wanted::NO_RAYS }, Wanted::CAPS);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// Ambient occlusion, and that of [large lights](LARGE_LIGHT), by cap grids.
    pub caps: bool,
    /// Lights by cones through the distances, where no cap grid answers; with `caps`, ambient occlusion too.
    pub cones: bool,
}

impl Wanted {
    /// Everything by rays.
    pub const RAYS: Self = Self { caps: false, cones: false };
    /// What cap grids can do, the rest by rays.
    pub const CAPS: Self = Self { caps: true, cones: false };
    /// All by caps and cones that can be.
    pub const NO_RAYS: Self = Self { caps: true, cones: true };
}

/// What a field can answer.
///
/// ```
/// use visfield::estimate::source::Answers;
/// # let field = visfield::field::example_field();
/// assert!(Answers::of(&field).rays);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answers {
    /// Whether it [answers rays](VisibilityField::answers_rays).
    pub rays: bool,
    /// Whether it has [distances](VisibilityField::distance_field).
    pub distances: bool,
    /// Whether it has a cap grid, and whether that [serves inside](CapGrid::serves_inside) its box.
    pub cap_grid: Option<bool>,
    /// The same of a grid of [`HarmonicOrder::Three`], which large lights need.
    pub light_grid: Option<bool>,
}

impl Answers {
    /// What this field can answer.
    pub fn of(field: &VisibilityField) -> Self {
        let for_lights = field.cap_grid().filter(|grid| grid.header().format.order == HarmonicOrder::Three);
        Self {
            rays: field.answers_rays(),
            distances: field.distance_field().is_some(),
            cap_grid: field.cap_grid().map(CapGrid::serves_inside),
            light_grid: for_lights.map(CapGrid::serves_inside),
        }
    }

    /// The part to ask for ambient occlusion.
    pub fn ambient(self, wanted: Wanted) -> OcclusionSource {
        self.choose(self.cap_grid.filter(|_| wanted.caps), wanted.caps && wanted.cones)
    }

    /// The part to ask for a light of [`LARGE_LIGHT`] or more.
    pub fn large_lights(self, wanted: Wanted) -> OcclusionSource {
        self.choose(self.light_grid.filter(|_| wanted.caps), wanted.cones)
    }

    /// The part to ask for a smaller light.
    pub fn small_lights(self, wanted: Wanted) -> OcclusionSource {
        self.choose(None, wanted.cones)
    }

    /// The part to ask, given a grid that serves inside its box or does not, and whether cones are wanted.
    fn choose(self, grid_serves_inside: Option<bool>, cones: bool) -> OcclusionSource {
        let cones = cones && self.distances;
        match grid_serves_inside {
            Some(false) if cones => OcclusionSource::CapGridWithConesInside,
            Some(false) if self.rays => OcclusionSource::CapGridWithRaysInside,
            Some(_) => OcclusionSource::CapGrid,
            None if cones => OcclusionSource::Cones,
            None if self.rays => OcclusionSource::Rays,
            None => OcclusionSource::None,
        }
    }
}

impl OcclusionSource {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::None, Self::Rays, Self::CapGrid, Self::CapGridWithRaysInside, Self::Cones, Self::CapGridWithConesInside];

    /// Whether the grid is asked anywhere.
    pub fn has_caps(self) -> bool {
        matches!(self, Self::CapGrid | Self::CapGridWithRaysInside | Self::CapGridWithConesInside)
    }

    /// Whether cones are marched anywhere.
    pub fn has_cones(self) -> bool {
        matches!(self, Self::Cones | Self::CapGridWithConesInside)
    }

    /// Whether rays are sent from anywhere.
    pub fn has_rays(self) -> bool {
        matches!(self, Self::Rays | Self::CapGridWithRaysInside)
    }

    /// Whether anything is answered without rays.
    pub fn needs_no_rays(self) -> bool {
        self.has_caps() || self.has_cones()
    }

    /// Which share of a receiver's rays is sent; `inside_share` is asked for the grid's [inside share](CapGrid::inside_share) if
    /// it matters. What is not sent, the grid answers, if it is asked at all.
    pub fn share_of_rays(self, inside_share: impl FnOnce() -> f32) -> f32 {
        match self {
            Self::None | Self::CapGrid | Self::Cones | Self::CapGridWithConesInside => 0.0,
            Self::Rays => 1.0,
            Self::CapGridWithRaysInside => inside_share(),
        }
    }

    /// Which share of what a receiver gets comes from cones, likewise.
    pub fn share_of_cones(self, inside_share: impl FnOnce() -> f32) -> f32 {
        match self {
            Self::None | Self::Rays | Self::CapGrid | Self::CapGridWithRaysInside => 0.0,
            Self::Cones => 1.0,
            Self::CapGridWithConesInside => inside_share(),
        }
    }
}
