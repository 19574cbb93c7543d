//! Exact answers for the receivers of a scene, with which many fields are compared.

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use visfield::estimate::Receiver;
use visfield::field::cap_grid::Falloff;
use visfield::{QueryOptions, VisibilityField};

use super::ambient::{Errors, TRUTH_RAYS, exact_occlusion, shares};
use super::scene::{MeasureScene, hemisphere_directions};
use super::speed::{RaySet, median_seconds};
use crate::exact::ExactScene;
use crate::mesh::{Mesh, MeshError};
use crate::triangles::TriangleBvh;

/// What is wrong with the ambient occlusion that a field gives: a table against the same rays through triangles, a cap grid
/// against very many.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OcclusionError {
    /// Root of the mean square error over all receivers, × 255.
    pub rms_255: f64,
    /// Mean absolute error over receivers whose exact or estimated occlusion exceeds 1/255.
    pub mean_abs: f64,
    /// Mean error over the same receivers: above 0, the field is too dark.
    pub bias_signed: f64,
}

impl OcclusionError {
    pub(super) fn of(found: &[f32], exact: &[f32]) -> Self {
        let errors = Errors::of(found, exact);
        Self { rms_255: errors.rms * 255.0, mean_abs: errors.mean_abs, bias_signed: errors.bias }
    }
}

/// Receivers of a scene, and what exact rays find for them.
pub(super) struct Reference {
    receivers: Vec<Receiver>,
    scene: ExactScene,
    rays: u32,
    pub(super) exact: Vec<f32>,
}

impl Reference {
    pub(super) fn new(mesh: &Mesh, scene: MeasureScene, rays: u32) -> Result<Self, MeshError> {
        let receivers = scene.receivers(mesh)?;
        let scene = ExactScene::of_mesh(mesh)?;
        let mut reference = Self { receivers, scene, rays, exact: Vec::new() };
        reference.exact = reference.trace();
        Ok(reference)
    }

    fn trace(&self) -> Vec<f32> {
        exact_occlusion(&self.scene, &self.receivers, self.rays, Falloff::None)
    }

    /// What very many rays find: the integral, all but.
    pub(super) fn truth(&self) -> Vec<f32> {
        exact_occlusion(&self.scene, &self.receivers, TRUTH_RAYS, Falloff::None)
    }

    /// The same occlusion by as many rays that are uniform over the hemisphere, weighted by their cosine.
    pub(super) fn trace_uniform(&self) -> Vec<f32> {
        let share = |(index, receiver): (usize, &Receiver)| {
            let start = self.scene.start(receiver);
            let weight = |&direction: &Vec3| {
                // Of cosine-distributed directions the square of the cosine is uniform.
                let cosine = direction.dot(receiver.normal);
                let tangent = (direction - receiver.normal * cosine).normalize_or_zero();
                let height = cosine * cosine;
                let direction = receiver.normal * height + tangent * (1.0 - height * height).sqrt();
                let hit = self.triangles().occluded(start, direction, 0.0, f32::INFINITY);
                if hit { 2.0 * height } else { 0.0 }
            };
            hemisphere_directions(receiver, index, self.rays).iter().map(weight).sum::<f32>() / self.rays as f32
        };
        self.receivers.par_iter().enumerate().map(share).collect()
    }

    pub(super) fn receivers(&self) -> &[Receiver] {
        &self.receivers
    }

    pub(super) fn triangles(&self) -> &TriangleBvh {
        self.scene.triangles()
    }

    /// The rays of all receivers.
    pub(super) fn rays(&self) -> u64 {
        self.receivers.len() as u64 * u64::from(self.rays)
    }

    /// The rays as a field is asked for them. Fields with the same bounds share a set.
    pub(super) fn ray_set(&self, field: &VisibilityField, options: QueryOptions) -> RaySet {
        let directions = |receiver: &Receiver, index: usize| hemisphere_directions(receiver, index, self.rays);
        let start = |receiver: &Receiver| self.scene.start(receiver);
        RaySet::new(self.triangles(), field, options, &self.receivers, directions, start)
    }

    /// Occlusion of each receiver by the field.
    pub(super) fn found(set: &RaySet, field: &VisibilityField) -> Vec<f32> {
        shares(&set.field_answers(field), &set.receivers)
    }

    pub(super) fn error(&self, found: &[f32]) -> OcclusionError {
        OcclusionError::of(found, &self.exact)
    }

    /// Median seconds of one thread for all rays through the field.
    pub(super) fn field_seconds(set: &RaySet, field: &VisibilityField) -> f64 {
        median_seconds(|| set.field_answers(field))
    }

    /// Median seconds of one thread for all rays through the triangles.
    pub(super) fn exact_seconds(&self, set: &RaySet) -> f64 {
        median_seconds(|| set.exact_answers(self.triangles()))
    }
}
