//! Receivers on the adapter, and the kernels in which each of them makes its own rays.

use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DVec3};
use visfield::VisibilityField;
use visfield::estimate::Receiver;
use visfield::estimate::sampling::{DiscBasis, disc_samples, sphere_samples};
use visfield::field::query::Bias;
use visfield::gpu::layout::encoding_number;
use visfield::gpu::{FIELD_SOURCE, FieldPool};
use visfield::scene::Placement;

use crate::bake::BakeError;
use crate::measure::gpu::{Gpu, GpuError, Kernel};
use crate::measure::scene::pattern_turn;
use crate::measure::shadow::MeasuredLight;

/// A receiver, `Receiver` in `receivers.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct ReceiverWords {
    position: [f32; 3],
    turn_x: f32,
    normal: [f32; 3],
    turn_y: f32,
}

/// An occluder, `Occluder` in `receivers.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct OccluderWords {
    field_from_world: [[f32; 4]; 3],
    first_byte: u32,
    entries: u32,
    exits: u32,
    encoding: u32,
    center: [f32; 3],
    radius: f32,
}

/// A light, `Light` in `receivers.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct LightWords {
    axis: [f32; 3],
    cosine: f32,
    tangent: [f32; 3],
    sine: f32,
    bitangent: [f32; 3],
    /// Fills 16 bytes.
    padding: u32,
}

impl From<&MeasuredLight> for LightWords {
    fn from(light: &MeasuredLight) -> Self {
        let DiscBasis { axis, tangent, bitangent } = *light.disc();
        let (sine, cosine) = tangent.length().atan().sin_cos();
        Self {
            axis: axis.to_array(),
            cosine,
            tangent: tangent.to_array(),
            sine,
            bitangent: bitangent.to_array(),
            padding: 0,
        }
    }
}

/// How rays are asked, `Asked` in `receivers.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct AskedWords {
    bias_height: f32,
    bias_along: f32,
    rays: u32,
    padding: u32,
}

/// Receivers, on the adapter.
pub(super) struct Receivers {
    buffer: wgpu::Buffer,
    count: usize,
    origin: DVec3,
    module: wgpu::ShaderModule,
}

/// Fields in their own meshes' places.
pub(super) struct Occluders {
    pool: FieldPool,
    buffer: wgpu::Buffer,
}

/// A kernel and what it writes.
pub(super) struct Asking {
    pub(super) kernel: Kernel,
    answers: wgpu::Buffer,
}

impl Receivers {
    /// Positions are kept relative to `origin`: choose a point near them.
    pub(super) fn new(gpu: &Gpu, receivers: &[Receiver], origin: DVec3) -> Self {
        let words = |(index, receiver): (usize, &Receiver)| {
            let turn = pattern_turn(index);
            ReceiverWords {
                position: (receiver.position - origin).as_vec3().to_array(),
                turn_x: turn.x,
                normal: receiver.normal.to_array(),
                turn_y: turn.y,
            }
        };
        let words: Vec<_> = receivers.iter().enumerate().map(words).collect();
        let module = gpu.module("receivers", &[FIELD_SOURCE, include_str!("receivers.wgsl")]);
        Self { buffer: gpu.buffer("receivers", &words), count: receivers.len(), origin, module }
    }

    /// Places fields where their meshes are.
    pub(super) fn occluders(&self, gpu: &Gpu, fields: &[&VisibilityField]) -> Result<Occluders, GpuError> {
        let mut pool = FieldPool::new(&gpu.device);
        let mut words = Vec::new();
        for field in fields {
            let slot = pool.insert(&gpu.device, &gpu.queue, field)?;
            let table = slot.table().ok_or_else(|| BakeError::NoTable { name: field.header().name.clone() })?;
            let placement = Placement::new(&field.header().bounds, DAffine3::IDENTITY, self.origin);
            let placement = placement.expect("the bounds of a field have a volume");
            let map = placement.field_from_world;
            words.push(OccluderWords {
                field_from_world: [0, 1, 2].map(|i| map.matrix3.row(i).extend(map.translation[i]).to_array()),
                first_byte: table.first_byte,
                entries: table.grid.entries,
                exits: table.grid.exits,
                encoding: encoding_number(table.encoding),
                center: placement.center.to_array(),
                radius: placement.radius,
            });
        }
        Ok(Occluders { pool, buffer: gpu.buffer("occluders", &words) })
    }

    /// Ambient occlusion by so many rays of each receiver.
    pub(super) fn ambient(&self, gpu: &Gpu, occluders: &Occluders, rays: u32) -> Asking {
        let samples: Vec<_> = sphere_samples(rays).into_iter().map(|p| p.extend(0.0).to_array()).collect();
        self.asking(gpu, ("ambient", rays), occluders, &samples, None)
    }

    /// Soft shadows of lights by so many rays of each receiver and light, 32 at most.
    pub(super) fn shadows(&self, gpu: &Gpu, occluders: &Occluders, lights: &[MeasuredLight], rays: u32) -> Asking {
        let samples: Vec<_> = disc_samples(rays).into_iter().map(|p| [p.x, p.y, 0.0, 0.0]).collect();
        let lights: Vec<_> = lights.iter().map(LightWords::from).collect();
        self.asking(gpu, ("shadows", rays), occluders, &samples, Some(&lights))
    }

    fn asking(
        &self,
        gpu: &Gpu,
        (entry_point, rays): (&'static str, u32),
        occluders: &Occluders,
        samples: &[[f32; 4]],
        lights: Option<&[LightWords]>,
    ) -> Asking {
        let bias = Bias::default();
        let asked = AskedWords { bias_height: bias.height, bias_along: bias.along, rays, padding: 0 };
        let asked = gpu.buffer("asked", &[asked]);
        let samples = gpu.buffer("samples", samples);
        let answers = gpu.answers(self.count * lights.map_or(1, <[_]>::len));
        let lights = lights.map(|lights| gpu.buffer("lights", lights));
        let mut buffers = vec![
            (0, &self.buffer),
            (1, &answers),
            (2, occluders.pool.buffer()),
            (3, &occluders.buffer),
            (4, &asked),
            (5, &samples),
        ];
        buffers.extend(lights.as_ref().map(|lights| (6, lights)));
        let kernel = gpu.kernel(entry_point, &self.module, &[], &buffers, self.count);
        Asking { kernel, answers }
    }
}

impl Asking {
    /// The mean occluded share of each of so many receivers, over its lights if there are any.
    pub(super) fn occlusion(&self, gpu: &Gpu, receivers: usize) -> Vec<f32> {
        let shares: Vec<f32> = gpu.run(&self.kernel, &self.answers);
        let each = (shares.len() / receivers.max(1)).max(1);
        shares.chunks(each).map(|shares| shares.iter().sum::<f32>() / each as f32).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::{BakeSettings, bake};
    use crate::bounds::bounding_sphere;
    use crate::exact::ExactScene;
    use crate::measure::ambient::shares;
    use crate::measure::scene::{MeasureScene, hemisphere_directions};
    use crate::measure::speed::RaySet;
    use crate::mesh::Mesh;
    use glam::{Vec3, vec3};
    use visfield::QueryOptions;

    /// The share of occluded rays of each receiver, on the processor.
    fn twin(
        scene: &ExactScene,
        field: &VisibilityField,
        receivers: &[Receiver],
        directions: impl Fn(&Receiver, usize) -> Vec<Vec3>,
    ) -> Vec<f32> {
        let start = |receiver: &Receiver| scene.start(receiver);
        let set = RaySet::new(scene.triangles(), field, QueryOptions::default(), receivers, directions, start);
        shares(&set.field_answers(field), &set.receivers)
    }

    #[test]
    fn receivers_make_the_rays_that_their_twins_make() {
        let gpu = match Gpu::new() {
            Ok(gpu) => gpu,
            Err(error) => {
                assert!(std::env::var_os("CI").is_none(), "{error}");
                eprintln!("skipped: {error}");
                return;
            }
        };
        let mesh = Mesh {
            name: "tetrahedron".to_owned(),
            positions: vec![[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0]],
            indices: vec![[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]],
        };
        let field = bake(&mesh, &BakeSettings::two_point(17, 16), |_| ()).unwrap();
        let receivers = MeasureScene::Corner.receivers_by(&mesh, 16).unwrap();
        let origin = DVec3::from(bounding_sphere(&mesh).unwrap().center.map(f64::from));
        let scene = ExactScene::of_mesh(&mesh).unwrap();
        let on_adapter = Receivers::new(&gpu, &receivers, origin);
        let occluders = on_adapter.occluders(&gpu, &[&field]).unwrap();
        let close = |found: &[f32], expected: &[f32], least: f32| {
            let differences: f32 = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).sum();
            let sum: f32 = expected.iter().sum();
            assert!(sum > least, "something is occluded: {sum}");
            assert!(differences < 0.002 * sum, "{differences} of {sum}");
        };
        // More rays than a word has bits, and not a whole number of words.
        let found = on_adapter.ambient(&gpu, &occluders, 75).occlusion(&gpu, receivers.len());
        close(&found, &twin(&scene, &field, &receivers, |r, index| hemisphere_directions(r, index, 75)), 20.0);

        // Two of them: one slanted, one that grazes the floor, below whose horizon some rays are.
        let lights = [vec3(0.5, 0.7, 0.6), vec3(1.0, 0.1, 0.4)].map(|axis| MeasuredLight::towards(axis, 0.3, 20));
        let found = on_adapter.shadows(&gpu, &occluders, &lights, 20).occlusion(&gpu, receivers.len());
        let [a, b] =
            lights.each_ref().map(|light| twin(&scene, &field, &receivers, |r, index| light.directions(r, index)));
        let mean: Vec<f32> = a.iter().zip(&b).map(|(a, b)| (a + b) / 2.0).collect();
        close(&found, &mean, 20.0);
    }
}
