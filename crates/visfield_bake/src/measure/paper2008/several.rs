//! Figure 8's last column: three objects in a corner. The first one only casts, the other two cast and receive.

use std::time::Instant;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use visfield::estimate::Receiver;
use visfield::field::directions::DirectionMap;
use visfield::field::lookup::Aim;
use visfield::{Encoding, QueryOptions, VisibilityField};

use super::{Paper2008Question, hemisphere, two_point};
use crate::bake::{BakeError, BakeSettings};
use crate::bounds::bounding_sphere;
use crate::exact::ExactScene;
use crate::measure::ambient::{Errors, shares};
use crate::measure::progress::Progress;
use crate::measure::scene::{Corner, MeasureScene, hemisphere_directions};
use crate::measure::speed::RaySet;
use crate::mesh::{Mesh, MeshError};

/// Receivers whose rays are held in memory at once.
const RECEIVERS_AT_ONCE: usize = 2048;

/// Radius of the second and third object, in radii of the first one, and their places on the floor, in the same unit.
const SMALLER: f64 = 0.6;
const PLACES: [(f64, f64); 2] = [(2.8, 0.85), (0.85, 2.8)];

/// What was found for three objects. Several fields answer each ray.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SeveralObjects {
    /// Names of the meshes; the first one casts and does not receive.
    pub meshes: Vec<String>,
    /// Triangles of all of them.
    pub triangles: u32,
    /// Receivers, in the corner and on two objects.
    pub receivers: usize,
    /// Rays that were sent.
    pub rays: u64,
    /// Seconds for them through the triangles of all objects.
    pub exact_seconds: f64,
    /// Seconds of all bakes, the paper's representation.
    pub hemisphere_bake_seconds: f64,
    /// Seconds for all rays by the paper's representation.
    pub hemisphere_seconds: f64,
    /// RMS × 255 of the paper's representation.
    pub hemisphere_rms_255: f64,
    /// Seconds of all bakes of two-point tables.
    pub two_point_bake_seconds: f64,
    /// Seconds for all rays by two-point tables, aimed.
    pub two_point_seconds: f64,
    /// RMS × 255 of two-point tables, aimed.
    pub two_point_rms_255: f64,
}

/// Fields of all objects, and how they are asked.
struct Method {
    fields: Vec<VisibilityField>,
    aim: Aim,
    bake_seconds: f64,
    seconds: f64,
    found: Vec<f32>,
}

pub(super) fn several_objects(
    meshes: [&Mesh; 3],
    question: &Paper2008Question,
    progress: &Progress,
) -> Result<SeveralObjects, BakeError> {
    let placed = placed(meshes)?;
    let name = || meshes.map(|mesh| mesh.name.as_str()).join(", ");
    let mesh_error = |source| BakeError::Mesh { name: name(), source };
    let receivers = receivers(&placed, question.own_side).map_err(mesh_error)?;
    let instances: Vec<_> = placed.iter().map(|mesh| (mesh, glam::DAffine3::IDENTITY)).collect();
    let scene = ExactScene::new(&instances, DVec3::ZERO).map_err(mesh_error)?;
    let papers = hemisphere(question.models, DirectionMap::Concentric, Encoding::U8);
    let mut methods = [
        Method::bake(&placed, &papers, Aim::Plain, progress)?,
        Method::bake(&placed, &two_point(question.models), Aim::Point, progress)?,
    ];
    let (mut exact, mut exact_seconds) = (Vec::new(), 0.0);
    for (chunk, some) in receivers.chunks(RECEIVERS_AT_ONCE).enumerate() {
        progress.add(0, &format!("{} receivers around {}", receivers.len(), name()));
        let directions = |receiver: &Receiver, index: usize| {
            hemisphere_directions(receiver, chunk * RECEIVERS_AT_ONCE + index, question.rays)
        };
        let set = |field: &VisibilityField, aim| {
            let options = QueryOptions { aim, ..QueryOptions::default() };
            RaySet::new(scene.triangles(), field, options, some, directions, |receiver| scene.start(receiver))
        };
        for method in &mut methods {
            method.ask(&set);
        }
        let set = set(&methods[0].fields[0], Aim::Plain);
        let (answers, seconds) = timed(|| set.exact_answers(scene.triangles()));
        exact.extend(shares(&answers, &set.receivers));
        exact_seconds += seconds;
    }
    let [papers, ours] = methods;
    Ok(SeveralObjects {
        meshes: meshes.map(|mesh| mesh.name.clone()).to_vec(),
        triangles: papers.fields.iter().map(|field| field.header().triangles).sum(),
        receivers: receivers.len(),
        rays: receivers.len() as u64 * u64::from(question.rays),
        exact_seconds,
        hemisphere_rms_255: Errors::of(&papers.found, &exact).rms * 255.0,
        hemisphere_bake_seconds: papers.bake_seconds,
        hemisphere_seconds: papers.seconds,
        two_point_rms_255: Errors::of(&ours.found, &exact).rms * 255.0,
        two_point_bake_seconds: ours.bake_seconds,
        two_point_seconds: ours.seconds,
    })
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64())
}

impl Method {
    fn bake(placed: &[Mesh], settings: &BakeSettings, aim: Aim, progress: &Progress) -> Result<Self, BakeError> {
        let bake = || placed.iter().map(|mesh| progress.bake(mesh, settings)).collect::<Result<Vec<_>, _>>();
        let (fields, bake_seconds) = timed(bake);
        Ok(Self { fields: fields?, aim, bake_seconds, seconds: 0.0, found: Vec::new() })
    }

    /// A ray is occluded if any field occludes it.
    fn ask(&mut self, set: &impl Fn(&VisibilityField, Aim) -> RaySet) {
        let mut occluded: Option<Vec<bool>> = None;
        let mut receivers = Vec::new();
        for field in &self.fields {
            let set = set(field, self.aim);
            let (answers, seconds) = timed(|| set.field_answers(field));
            self.seconds += seconds;
            occluded = Some(match occluded {
                None => answers,
                Some(others) => others.iter().zip(&answers).map(|(a, b)| *a || *b).collect(),
            });
            receivers = set.receivers;
        }
        self.found.extend(shares(&occluded.unwrap_or_default(), &receivers));
    }
}

/// The first mesh as it is, the others smaller, beside it on the same floor.
pub(in crate::measure) fn placed(meshes: [&Mesh; 3]) -> Result<Vec<Mesh>, BakeError> {
    let of = |mesh: &Mesh| {
        let mesh_error = |source| BakeError::Mesh { name: mesh.name.clone(), source };
        let bounds = bounding_sphere(mesh).map_err(mesh_error)?;
        let corner = Corner::around(mesh).map_err(mesh_error)?;
        let center = DVec3::from(bounds.center.map(f64::from));
        Ok::<_, BakeError>((center, bounds.mesh_from_field().matrix3.x_axis.x, corner))
    };
    let (_, first_radius, corner) = of(meshes[0])?;
    let mut placed = vec![meshes[0].clone()];
    for (mesh, (x, z)) in meshes[1..].iter().zip(PLACES) {
        let (center, radius, own_corner) = of(mesh)?;
        let scale = first_radius * SMALLER / radius;
        let stands = DVec3::new(center.x, own_corner.origin.y, center.z);
        let target = corner.origin + DVec3::new(x, 0.0, z) * first_radius;
        let place = |p: &[f32; 3]| (target + (DVec3::from(p.map(f64::from)) - stands) * scale).as_vec3().to_array();
        let positions = mesh.positions.iter().map(place).collect();
        placed.push(Mesh { positions, ..(*mesh).clone() });
    }
    Ok(placed)
}

/// Those of the corner around the first mesh, and those on the other ones.
fn receivers(placed: &[Mesh], side: usize) -> Result<Vec<Receiver>, MeshError> {
    let mut receivers = MeasureScene::Corner.receivers(&placed[0])?;
    for mesh in &placed[1..] {
        receivers.extend(MeasureScene::OwnSurface.receivers_by(mesh, side)?);
    }
    Ok(receivers)
}
