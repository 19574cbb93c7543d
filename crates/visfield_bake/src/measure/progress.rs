//! How far a long measurement has come.

use std::sync::atomic::{AtomicU64, Ordering};

use visfield::VisibilityField;

use crate::bake::{BakeError, BakeSettings, bake};
use crate::mesh::Mesh;

/// Counts work in rays, and tells a caller its share of the whole.
pub(super) struct Progress<'a> {
    total: u64,
    done: AtomicU64,
    report: &'a (dyn Fn(f64, &str) + Sync),
}

impl<'a> Progress<'a> {
    /// `report` gets the share of the work that is done, from 0 to 1, and what is being done.
    pub(super) fn new(total: u64, report: &'a (dyn Fn(f64, &str) + Sync)) -> Self {
        Self { total, done: AtomicU64::new(0), report }
    }

    pub(super) fn add(&self, rays: u64, doing: &str) {
        let done = self.done.fetch_add(rays, Ordering::Relaxed) + rays;
        (self.report)((done as f64 / self.total.max(1) as f64).min(1.0), doing);
    }

    /// Bakes, and counts the rays that were expected of it; a cap grid may take fewer.
    pub(super) fn bake(&self, mesh: &Mesh, settings: &BakeSettings) -> Result<VisibilityField, BakeError> {
        let doing = format!("baking {}: {settings}", mesh.name);
        let traced = AtomicU64::new(0);
        let field = bake(mesh, settings, |rays| {
            traced.fetch_add(rays, Ordering::Relaxed);
            self.add(rays, &doing);
        })?;
        self.add(settings.rays().saturating_sub(traced.into_inner()), &doing);
        Ok(field)
    }
}
