//! What is required of a field, with exact answers to compare it with.

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use visfield::estimate::Receiver;
use visfield::field::measured::{Measured, MeasuredScene, Purpose};
use visfield::{QueryOptions, Ray, VisibilityField};

use super::{AMBIENT_RAYS, ANGULAR_RADIUS, SHADOW_RAYS, TuneQuestion, TuneReceivers};
use crate::bake::BakeError;
use crate::bounds::{BoundsKind, bounds_of};
use crate::exact::ExactScene;
use crate::measure::MeasureScene;
use crate::measure::ambient::Errors;
use crate::measure::scene::{CORNER_SIDE, hemisphere_directions};
use crate::measure::shadow::{MeasuredLight, SHADOW_SIDE, ShadowErrors};
use crate::measure::speed::AskedField;
use crate::mesh::{Mesh, MeshError};

/// Receivers that ask for one thing, and what exact rays answer.
pub(super) struct Probe {
    purpose: Purpose,
    scene: MeasuredScene,
    receivers: Vec<Receiver>,
    rays: u32,
    /// For shadows.
    light: Option<MeasuredLight>,
    t_max: f32,
    exact: Vec<f32>,
}

/// Everything that a question requires.
pub(super) fn probes(mesh: &Mesh, question: &TuneQuestion) -> Result<Vec<Probe>, BakeError> {
    let make = || -> Result<Vec<Probe>, MeshError> {
        let exact_scene = ExactScene::of_mesh(mesh)?;
        let scenes: &[MeasuredScene] = match question.receivers {
            TuneReceivers::All => &[MeasuredScene::Corner, MeasuredScene::OwnSurface],
            TuneReceivers::Others => &[MeasuredScene::Corner],
            TuneReceivers::Far => &[MeasuredScene::CornerFar],
        };
        let mut probes = Vec::new();
        for &scene in scenes {
            if question.ambient {
                probes.push(Probe::ambient(mesh, scene, question.max_distance)?);
            }
            if question.shadows {
                probes.push(Probe::shadow(mesh, scene)?);
            }
        }
        for probe in &mut probes {
            probe.exact = probe.exact_occlusion(&exact_scene);
        }
        Ok(probes)
    };
    make().map_err(|source| BakeError::Mesh { name: mesh.name.clone(), source })
}

impl Probe {
    fn ambient(mesh: &Mesh, scene: MeasuredScene, max_distance: f32) -> Result<Self, MeshError> {
        Ok(Self {
            purpose: Purpose::Ao { max_distance: max_distance.is_finite().then_some(max_distance) },
            scene,
            receivers: receivers(mesh, scene, CORNER_SIDE)?,
            rays: AMBIENT_RAYS,
            light: None,
            t_max: max_distance,
            exact: Vec::new(),
        })
    }

    fn shadow(mesh: &Mesh, scene: MeasuredScene) -> Result<Self, MeshError> {
        Ok(Self {
            purpose: Purpose::Shadows { angular_radius: ANGULAR_RADIUS },
            scene,
            receivers: receivers(mesh, scene, SHADOW_SIDE)?,
            rays: SHADOW_RAYS,
            light: Some(MeasuredLight::new(ANGULAR_RADIUS, SHADOW_RAYS)),
            t_max: f32::INFINITY,
            exact: Vec::new(),
        })
    }

    /// What is wrong with the occlusion that was found for each receiver.
    pub(super) fn judge(&self, found: &[f32]) -> Measured {
        let (rms, mean_abs) = if self.light.is_some() {
            let errors = ShadowErrors::of(found, &self.exact);
            // Without a penumbra there is nothing that the RMS could be of.
            (if errors.partly_lit == 0 { errors.mean_abs } else { errors.rms }, errors.mean_abs)
        } else {
            let errors = Errors::of(found, &self.exact);
            (errors.rms, errors.mean_abs)
        };
        Measured {
            purpose: self.purpose,
            scene: self.scene,
            rays: self.rays,
            rms_255: (rms * 255.0) as f32,
            mean_abs: mean_abs as f32,
        }
    }

    fn exact_occlusion(&self, scene: &ExactScene) -> Vec<f32> {
        self.shares(|receiver, directions| {
            let start = scene.start(receiver);
            let occluded = |direction: &&Vec3| scene.triangles().occluded(start, **direction, 0.0, self.t_max);
            directions.iter().filter(occluded).count()
        })
    }

    /// What exact rays find for each receiver.
    pub(super) fn exact(&self) -> &[f32] {
        &self.exact
    }

    /// Whether each receiver lies inside a field's bounds: all of its rays start there.
    pub(super) fn inside(&self, field: &VisibilityField) -> Vec<bool> {
        let asked = AskedField::new(field);
        self.receivers.iter().map(|receiver| asked.origin(receiver).length_squared() < 1.0).collect()
    }

    /// The occlusion of each receiver by a field.
    pub(super) fn found(&self, field: &VisibilityField) -> Vec<f32> {
        let asked = AskedField::new(field);
        self.shares(|receiver, directions| {
            let origin = asked.origin(receiver);
            // A linear map keeps the ray parameter, so that the reach stays in the mesh's units.
            let ray = |direction: &Vec3| Ray { origin, direction: asked.direction(*direction), t_max: self.t_max };
            let rays: Vec<Ray> = directions.iter().map(ray).collect();
            let normal = asked.normal(receiver);
            let mut occluded = vec![false; rays.len()];
            field.occluded_batch(&rays, &QueryOptions { normal, ..QueryOptions::default() }, &mut occluded);
            occluded.into_iter().filter(|&hit| hit).count()
        })
    }

    /// For each receiver the share of its rays that are occluded, of which `count` tells the number.
    fn shares(&self, count: impl Fn(&Receiver, &[Vec3]) -> usize + Sync) -> Vec<f32> {
        let share = |(index, receiver): (usize, &Receiver)| {
            let directions = match &self.light {
                Some(light) => light.directions(receiver, index),
                None => hemisphere_directions(receiver, index, self.rays),
            };
            count(receiver, &directions) as f32 / directions.len().max(1) as f32
        };
        self.receivers.par_iter().enumerate().map(share).collect()
    }
}

fn receivers(mesh: &Mesh, scene: MeasuredScene, side: usize) -> Result<Vec<Receiver>, MeshError> {
    if scene == MeasuredScene::OwnSurface {
        return MeasureScene::OwnSurface.receivers_by(mesh, side);
    }
    let mut receivers = MeasureScene::Corner.receivers_by(mesh, side)?;
    if scene == MeasuredScene::CornerFar {
        // Outside every bounds that a table may have, so that all tables are asked the same.
        let triangles = mesh.solid_triangles()?;
        for kind in [BoundsKind::Sphere, BoundsKind::Ellipsoid] {
            let field_from_mesh = bounds_of(&triangles, kind)?.field_from_mesh();
            let is_outside = |position: DVec3| field_from_mesh.transform_point3(position).length() > 1.0;
            receivers.retain(|receiver| is_outside(receiver.position));
        }
    }
    Ok(receivers)
}
