//! What is measured for each figure: receivers, occluders, kernels, and the exact rays to compare with.

use glam::{DAffine3, DVec3, Quat, Vec3};
use rayon::prelude::*;
use visfield::estimate::Receiver;
use visfield::field::cap_grid::Falloff;
use visfield::{QueryOptions, VisibilityField};

use super::kernels::{Occluders, Receivers};
use super::{OWN_RAYS, OwnSurface, Paper2010Question, RaysTime, SHADOW_RAYS, SeveralOccluders, SoftShadow, TableTime};
use crate::bake::{BakeError, table_of};
use crate::bounds::bounding_sphere;
use crate::exact::ExactScene;
use crate::measure::ambient::{Errors, exact_occlusion};
use crate::measure::gpu::{Bvh, Gpu, GpuError, Kernel, MOST_RAYS, triangle_words};
use crate::measure::paper2008::several::placed;
use crate::measure::paper2008::{Maps, two_point};
use crate::measure::progress::Progress;
use crate::measure::scene::MeasureScene;
use crate::measure::shadow::{MeasuredLight, TO_LIGHT};
use crate::measure::speed::RaySet;
use crate::mesh::{Mesh, MeshError};

/// Half of the angle that a light covers, in radians. The paper's lights are spheres of radius 2 at distances that it does not say.
const ANGULAR_RADIUS: f32 = 0.1;
/// How far the second and the third light are turned around the vertical axis, in radians: to both sides of the first.
const APART: f32 = 0.5;
/// Rays per light of the reference.
const REFERENCE_RAYS: u32 = 256;

/// All that the figures share.
pub(super) struct Bench<'a> {
    pub(super) gpu: Gpu,
    progress: &'a Progress<'a>,
    question: &'a Paper2010Question,
    side: usize,
}

/// Receivers, and the triangles around them.
struct Scene {
    receivers: Vec<Receiver>,
    exact: ExactScene,
    on_adapter: Receivers,
}

/// One light or three.
fn lights(count: usize, rays: u32) -> Vec<MeasuredLight> {
    let light = |turn: f32| MeasuredLight::towards(Quat::from_rotation_y(turn) * TO_LIGHT, ANGULAR_RADIUS, rays);
    [0.0, APART, -APART].into_iter().take(count).map(light).collect()
}

impl Scene {
    /// Receivers of a scene of the first mesh, among all meshes.
    fn new(gpu: &Gpu, meshes: &[Mesh], scene: MeasureScene, side: usize) -> Result<Self, GpuError> {
        let mesh_error = |source: MeshError| BakeError::Mesh { name: meshes[0].name.clone(), source };
        let center = bounding_sphere(&meshes[0]).map_err(mesh_error)?.center;
        let origin = DVec3::from(center.map(f64::from));
        let receivers = scene.receivers_by(&meshes[0], side).map_err(mesh_error)?;
        let instances: Vec<_> = meshes.iter().map(|mesh| (mesh, DAffine3::IDENTITY)).collect();
        let exact = ExactScene::new(&instances, origin).map_err(mesh_error)?;
        let on_adapter = Receivers::new(gpu, &receivers, origin);
        Ok(Self { receivers, exact, on_adapter })
    }

    fn exact_ambient(&self, rays: u32) -> Vec<f32> {
        exact_occlusion(&self.exact, &self.receivers, rays, Falloff::None)
    }

    /// The mean of the lights' occlusion at each receiver, by many rays.
    fn exact_shadow(&self, count: usize) -> Vec<f32> {
        let lights = lights(count, REFERENCE_RAYS);
        let mean = |(index, receiver): (usize, &Receiver)| {
            let of = |light: &MeasuredLight| light.exact_occlusion(&self.exact, receiver, index);
            lights.iter().map(of).sum::<f32>() / lights.len() as f32
        };
        self.receivers.par_iter().enumerate().map(mean).collect()
    }
}

fn rms_255(found: &[f32], exact: &[f32]) -> f64 {
    Errors::of(found, exact).rms * 255.0
}

impl<'a> Bench<'a> {
    pub(super) fn new(gpu: Gpu, progress: &'a Progress<'a>, question: &'a Paper2010Question, side: usize) -> Self {
        Self { gpu, progress, question, side }
    }

    fn bake(&self, mesh: &Mesh, maps: Maps) -> Result<VisibilityField, GpuError> {
        Ok(self.progress.bake(mesh, &two_point(maps))?)
    }

    fn race(&self, kernels: &[&Kernel]) -> Vec<f64> {
        self.gpu.race(kernels, || ())
    }

    /// Figures 3, 4 and 7: each table once.
    pub(super) fn tables(&self, mesh: &Mesh) -> Result<(Vec<TableTime>, Vec<RaysTime>, Vec<TableTime>), GpuError> {
        const LIGHTS: usize = 3;
        let (gpu, question) = (&self.gpu, self.question);
        let scene = Scene::new(gpu, std::slice::from_ref(mesh), MeasureScene::Corner, self.side)?;
        let exact_ambient = scene.exact_ambient(question.rays);
        let exact_shadow = scene.exact_shadow(LIGHTS);
        let (mut figure3, mut figure4, mut figure7) = (Vec::new(), Vec::new(), Vec::new());
        for maps in question.tables() {
            let field = self.bake(mesh, maps)?;
            let table = table_of(&field)?;
            let (size, field_bytes) = (table.representation().to_string(), table.format().bytes());
            let occluders = scene.on_adapter.occluders(gpu, &[&field])?;
            let row = |found: &[f32], exact: &[f32], seconds| TableTime {
                positions: maps.0,
                directions: maps.1,
                size: size.clone(),
                field_bytes,
                seconds,
                rms_255: rms_255(found, exact),
            };
            if question.ambient.contains(&maps) {
                let all = scene.on_adapter.ambient(gpu, &occluders, question.rays);
                let found = all.occlusion(gpu, scene.receivers.len());
                let by_rays: Vec<_> = question
                    .rays_per_receiver
                    .iter()
                    .map(|&rays| scene.on_adapter.ambient(gpu, &occluders, rays))
                    .collect();
                let kernels: Vec<_> = by_rays.iter().chain([&all]).map(|asking| &asking.kernel).collect();
                let seconds = self.race(&kernels);
                figure3.push(row(&found, &exact_ambient, seconds[seconds.len() - 1]));
                figure4.extend(question.rays_per_receiver.iter().zip(&seconds).map(|(&rays, &seconds)| RaysTime {
                    size: size.clone(),
                    field_bytes,
                    rays,
                    seconds,
                }));
            }
            if question.shadows.contains(&maps) {
                let asking = scene.on_adapter.shadows(gpu, &occluders, &lights(LIGHTS, SHADOW_RAYS), SHADOW_RAYS);
                let found = asking.occlusion(gpu, scene.receivers.len());
                figure7.push(row(&found, &exact_shadow, self.race(&[&asking.kernel])[0]));
            }
        }
        Ok((figure3, figure4, figure7))
    }

    /// Figure 5: a model by itself.
    pub(super) fn own_surface(&self, mesh: &Mesh) -> Result<OwnSurface, GpuError> {
        let gpu = &self.gpu;
        let field = self.bake(mesh, self.question.own_surface)?;
        let scenes = [MeasureScene::OwnSurface, MeasureScene::Corner]
            .map(|scene| Scene::new(gpu, std::slice::from_ref(mesh), scene, self.side));
        let [own, corner] = scenes;
        let (own, corner) = (own?, corner?);
        let ask = |scene: &Scene| {
            let occluders = scene.on_adapter.occluders(gpu, &[&field])?;
            Ok::<_, GpuError>(scene.on_adapter.ambient(gpu, &occluders, OWN_RAYS))
        };
        let (own_asking, corner_asking) = (ask(&own)?, ask(&corner)?);
        let found = own_asking.occlusion(gpu, own.receivers.len());
        let seconds = self.race(&[&own_asking.kernel, &corner_asking.kernel]);
        let share = own.receivers.len() as f64 / corner.receivers.len() as f64;
        Ok(OwnSurface {
            mesh: mesh.name.clone(),
            triangles: field.header().triangles,
            size: table_of(&field)?.representation().to_string(),
            receivers: own.receivers.len(),
            seconds: seconds[0],
            rays_per_second: own.receivers.len() as f64 * f64::from(OWN_RAYS) / seconds[0],
            rms_255: rms_255(&found, &own.exact_ambient(OWN_RAYS)),
            corner_seconds: seconds[1] * share,
        })
    }

    /// Figures 6 and 8: the first three meshes at once, or the first one alone; then there is no Figure 6.
    pub(super) fn several(&self, meshes: &[Mesh]) -> Result<(Option<SeveralOccluders>, Vec<SoftShadow>), GpuError> {
        let gpu = &self.gpu;
        let meshes = match meshes {
            [first, second, third, ..] => placed([first, second, third])?,
            _ => meshes[..1].to_vec(),
        };
        let fields = meshes.iter().map(|mesh| self.bake(mesh, self.question.several)).collect::<Result<Vec<_>, _>>()?;
        let scene = Scene::new(gpu, &meshes, MeasureScene::Corner, self.side)?;
        let all = scene.on_adapter.occluders(gpu, &fields.iter().collect::<Vec<_>>())?;
        let figure8 = [1, 3].map(|count| self.soft_shadow(&scene, &all, count, &fields[0])).into_iter().collect();
        let figure6 = (meshes.len() > 1).then(|| self.several_occluders(&meshes, &fields, &scene, &all)).transpose()?;
        Ok((figure6, figure8))
    }

    fn several_occluders(
        &self,
        meshes: &[Mesh],
        fields: &[VisibilityField],
        scene: &Scene,
        all: &Occluders,
    ) -> Result<SeveralOccluders, GpuError> {
        let (gpu, rays) = (&self.gpu, self.question.rays);
        let mut askings = vec![scene.on_adapter.ambient(gpu, all, rays)];
        for field in fields {
            let one = scene.on_adapter.occluders(gpu, &[field])?;
            askings.push(scene.on_adapter.ambient(gpu, &one, rays));
        }
        let found = askings[0].occlusion(gpu, scene.receivers.len());
        let seconds = self.race(&askings.iter().map(|asking| &asking.kernel).collect::<Vec<_>>());
        Ok(SeveralOccluders {
            meshes: meshes.iter().map(|mesh| mesh.name.clone()).collect(),
            triangles: fields.iter().map(|field| field.header().triangles).sum(),
            receivers: scene.receivers.len(),
            rays,
            seconds: seconds[0],
            single_seconds: seconds[1..].to_vec(),
            rms_255: rms_255(&found, &scene.exact_ambient(rays)),
        })
    }

    /// A row of Figure 8. Any of the fields will do to list rays.
    fn soft_shadow(&self, scene: &Scene, occluders: &Occluders, count: usize, field: &VisibilityField) -> SoftShadow {
        let gpu = &self.gpu;
        let sampled = lights(count, SHADOW_RAYS);
        let asking = scene.on_adapter.shadows(gpu, occluders, &sampled, SHADOW_RAYS);
        let directions = |receiver: &Receiver, index: usize| -> Vec<Vec3> {
            sampled.iter().flat_map(|light| light.directions(receiver, index)).collect()
        };
        let count_rays = |(index, receiver): (usize, &Receiver)| directions(receiver, index).len() as u64;
        let shadow_rays: u64 = scene.receivers.par_iter().enumerate().map(count_rays).sum();
        // A list of all of them may not fit into a binding.
        let step = shadow_rays.div_ceil(u64::from(MOST_RAYS / 2)).max(1) as usize;
        let some: Vec<Receiver> = scene.receivers.iter().step_by(step).copied().collect();
        let start = |receiver: &Receiver| scene.exact.start(receiver);
        let triangles = scene.exact.triangles();
        let set = RaySet::new(triangles, field, QueryOptions::default(), &some, directions, start);
        let trace = Bvh::new(gpu, &scene.exact).trace(gpu, &triangle_words(&set));
        let found = asking.occlusion(gpu, scene.receivers.len());
        let seconds = self.race(&[&asking.kernel, &trace.kernel]);
        SoftShadow {
            lights: count,
            shadow_rays,
            seconds: seconds[0],
            rays_per_second: shadow_rays as f64 / seconds[0],
            bvh_rays_per_second: set.exact.len() as f64 / seconds[1],
            rms_255: rms_255(&found, &scene.exact_shadow(count)),
        }
    }
}
