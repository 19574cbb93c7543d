//! Rays through fields and through triangles on a GPU: the same rays, in the same run, beside what limits look-ups.
//!
//! One thread takes one ray of a list. Nothing here is part of a frame; the kernels are joined from the field's own functions
//! ([`FIELD_SOURCE`](visfield::gpu::FIELD_SOURCE)) and the WGSL files beside this one.

mod bvh;
mod device;
mod field;
mod rays;
mod table;

use serde::{Deserialize, Serialize};
use visfield::VisibilityField;
use visfield::estimate::Receiver;

pub(in crate::measure) use self::bvh::Bvh;
pub use self::device::GpuError;
pub(in crate::measure) use self::device::{Gpu, Kernel, TIMINGS};
use self::field::FieldKernels;
use self::rays::MeetingRays;
pub(in crate::measure) use self::rays::triangle_words;
use super::progress::Progress;
use super::scene::MeasureScene;
use crate::bake::{BakeError, BakeSettings};
use crate::exact::ExactScene;
use crate::mesh::Mesh;

/// What is measured.
///
/// ```
/// let ask = visfield_bake::measure::gpu::GpuQuestion::default();
/// assert_eq!(ask.small, (33, 32));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct GpuQuestion {
    /// Sides of the two-point table's grids of entries and exits, 1 to 512 cells: a table that fits into caches.
    pub small: (u32, u32),
    /// The same of a table that does not.
    pub large: (u32, u32),
    /// About how many rays that meet the bounds are asked, up to [`MOST_RAYS`]; `None` for as many as the adapter answers
    /// in a while.
    pub rays: Option<u32>,
}

impl Default for GpuQuestion {
    /// Tables of 1.1 MB and 17 MB.
    fn default() -> Self {
        Self { small: (33, 32), large: (65, 64), rays: None }
    }
}

/// The most rays that are asked: 32 bytes of each have to fit into a binding of 128 MiB.
pub const MOST_RAYS: u32 = 4_000_000;
/// The fewest that are chosen by time: enough for every core of an adapter.
const FEWEST_RAYS: u32 = 1 << 17;
/// How long the triangles may take for all rays, in seconds.
const LONGEST: f64 = 0.15;

/// What was found for a mesh in the 2008 paper's corner ([`MeasureScene::Corner`]).
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct GpuMeasurement {
    /// Name of the adapter.
    pub adapter: String,
    /// How it is driven: `vulkan`, `metal` or `dx12`.
    pub backend: String,
    /// Its driver.
    pub driver: String,
    /// What tells the time: the adapter's own timestamps, or wall time.
    pub timer: String,
    /// Name of the mesh.
    pub mesh: String,
    /// Its triangles.
    pub triangles: u32,
    /// Number of receivers.
    pub receivers: usize,
    /// Rays of each of them, of which only those are asked that meet the bounds.
    pub rays_per_receiver: u32,
    /// Rays that are asked: all meet the field's bounds.
    pub rays: u64,
    /// Bytes of nodes and triangles.
    pub bvh_bytes: u64,
    /// Rays per second through the triangles: any hit, by a compressed wide BVH.
    pub bvh_rays_per_second: f64,
    /// The share of rays that this finds occluded or not as the processor does.
    pub bvh_parity: f64,
    /// The field that fits into caches.
    #[serde(flatten)]
    pub small: GpuField,
    /// The one that does not.
    pub large: GpuField,
}

/// One field on the adapter.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct GpuField {
    /// The sides of its grids, as 33² × 32².
    pub size: String,
    /// Bytes of its table.
    pub field_bytes: u64,
    /// Aimed look-ups per second, one for each ray.
    pub lookups_per_second: f64,
    /// Random bytes of the same table per second, by a shader that does nothing else.
    pub gather_limit_lookups_per_second: f64,
    /// Look-ups per second by a shader that does everything but read the byte.
    pub arithmetic_limit_lookups_per_second: f64,
    /// Rays per second, asked as frames ask: from inside and outside of the bounds, with normal and bias.
    pub field_rays_per_second: f64,
    /// Those over [`GpuMeasurement::bvh_rays_per_second`].
    pub speedup_bvh: f64,
    /// The share of rays for which the shader reads the byte that its twin on the processor reads.
    pub index_parity: f64,
    /// The share of rays that both find occluded, or both do not.
    pub answer_parity: f64,
    /// Mean absolute error of ambient occlusion against the same rays through triangles, over receivers whose exact or estimated
    /// occlusion exceeds 1/255.
    pub mean_abs: f64,
    /// Root of the mean square error over all receivers, × 255.
    pub rms_255: f64,
}

impl GpuField {
    /// Look-ups per second over the lower of the two limits.
    pub fn share_of_limit(&self) -> f64 {
        self.lookups_per_second / self.gather_limit_lookups_per_second.min(self.arithmetic_limit_lookups_per_second)
    }
}

/// Bakes two fields of a mesh, and measures them on the fastest adapter that there is. `progress` gets the share of the work that
/// is done, from 0 to 1, and what is being done, from any thread.
///
/// # Errors
/// [`GpuError`] if there is no adapter, or if the mesh or a table cannot be baked.
pub fn measure_gpu(
    mesh: &Mesh,
    question: &GpuQuestion,
    progress: impl Fn(f64, &str) + Sync,
) -> Result<GpuMeasurement, GpuError> {
    let gpu = Gpu::new()?;
    let settings = [question.small, question.large].map(|(entries, exits)| BakeSettings::two_point(entries, exits));
    let bakes: u64 = settings.iter().map(BakeSettings::rays).sum();
    // Timings take about as long as bakes.
    let progress = Progress::new(2 * bakes, &progress);
    let fields = [progress.bake(mesh, &settings[0])?, progress.bake(mesh, &settings[1])?];
    let mesh_error = |source| BakeError::Mesh { name: mesh.name.clone(), source };
    let receivers = MeasureScene::Corner.receivers(mesh).map_err(mesh_error)?;
    let scene = ExactScene::of_mesh(mesh).map_err(mesh_error)?;
    let bvh = Bvh::new(&gpu, &scene);
    let rays = choose_rays(&gpu, &bvh, &scene, &fields[0], &receivers, question.rays);
    let trace = bvh.trace(&gpu, &triangle_words(&rays.set));
    let field_kernels = FieldKernels::of_all(&gpu, &fields, &rays)?;

    let exact = rays.set.exact_answers(scene.triangles());
    let bvh_parity = share_of_equal(&as_bools(&gpu.run(&trace.kernel, &trace.answers)), &exact);
    let exact_shares = rays.shares(&exact);
    let kernels: Vec<&Kernel> = field_kernels.iter().flat_map(FieldKernels::timed).chain([&trace.kernel]).collect();
    let doing = format!("{} rays on {}", rays.count(), gpu.info.name);
    let step = bakes / (TIMINGS * kernels.len() as u64);
    let rates: Vec<f64> =
        gpu.race(&kernels, || progress.add(step, &doing)).iter().map(|seconds| rays.count() as f64 / seconds).collect();
    progress.add(bakes, &doing);
    let bvh_rays_per_second = rates[rates.len() - 1];
    let measured = |i: usize| {
        let rates = &rates[i * FieldKernels::TIMED..][..FieldKernels::TIMED];
        field_kernels[i].measured(&gpu, &fields[i], &rays, &exact_shares, rates, bvh_rays_per_second)
    };
    Ok(GpuMeasurement {
        adapter: gpu.info.name.clone(),
        backend: gpu.info.backend.to_string(),
        driver: format!("{} {}", gpu.info.driver, gpu.info.driver_info).trim().to_owned(),
        timer: gpu.timer().to_owned(),
        mesh: mesh.name.clone(),
        triangles: fields[0].header().triangles,
        receivers: receivers.len(),
        rays_per_receiver: rays.rays_per_receiver,
        rays: rays.count() as u64,
        bvh_bytes: bvh.bytes(),
        bvh_rays_per_second,
        bvh_parity,
        small: measured(0)?,
        large: measured(1)?,
    })
}

/// About as many rays as are wanted, or as the triangles answer in a while.
fn choose_rays(
    gpu: &Gpu,
    bvh: &Bvh,
    scene: &ExactScene,
    field: &VisibilityField,
    receivers: &[Receiver],
    wanted: Option<u32>,
) -> MeetingRays {
    const FEW: u32 = 32;
    let few = MeetingRays::new(scene, field, receivers, FEW);
    let wanted = wanted.unwrap_or_else(|| {
        let trace = bvh.trace(gpu, &triangle_words(&few.set));
        let rate = few.count() as f64 / gpu.race(&[&trace.kernel], || ())[0];
        // Saturates.
        ((rate * LONGEST) as u32).clamp(FEWEST_RAYS, MOST_RAYS)
    });
    let per_receiver = f64::from(wanted.min(MOST_RAYS)) / few.count().max(1) as f64 * f64::from(FEW);
    MeetingRays::new(scene, field, receivers, (per_receiver.round() as u32).max(1))
}

fn as_bools(answers: &[u32]) -> Vec<bool> {
    answers.iter().map(|&answer| answer != 0).collect()
}

fn share_of_equal<T: PartialEq>(a: &[T], b: &[T]) -> f64 {
    a.iter().zip(b).filter(|(a, b)| a == b).count() as f64 / a.len().max(1) as f64
}
