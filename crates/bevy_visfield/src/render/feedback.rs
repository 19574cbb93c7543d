//! What the render world tells the main world: whether the plugin works on this GPU, and which fields are there.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bevy::prelude::*;

use super::budget::FieldLevel;
use crate::asset::VisibilityField;

/// A resource of both worlds; both have the same one. A frame behind where rendering is pipelined.
#[derive(Resource, Clone, Debug, Default)]
pub(crate) struct RenderFeedback(Arc<Mutex<Told>>);

#[derive(Debug, Default)]
struct Told {
    active: bool,
    fields: HashMap<AssetId<VisibilityField>, FieldOnGpu>,
}

/// How much of a field is on the GPU, and how much shall be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FieldOnGpu {
    pub(crate) level: FieldLevel,
    /// What the budget has room for.
    pub(crate) target: FieldLevel,
}

impl RenderFeedback {
    fn told(&self) -> MutexGuard<'_, Told> {
        // Whoever panicked with it in hand left it sound: nothing is written in two steps.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The GPU has all that the plugin needs.
    pub(crate) fn activate(&self) {
        self.told().active = true;
    }

    /// Whether the plugin does anything.
    pub(crate) fn is_active(&self) -> bool {
        self.told().active
    }

    pub(crate) fn tell(&self, fields: HashMap<AssetId<VisibilityField>, FieldOnGpu>) {
        self.told().fields = fields;
    }

    /// What is known of a field, if it arrived.
    pub(crate) fn field(&self, id: AssetId<VisibilityField>) -> Option<FieldOnGpu> {
        self.told().fields.get(&id).copied()
    }
}
