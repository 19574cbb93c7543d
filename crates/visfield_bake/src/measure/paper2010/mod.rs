//! The experiments of the 2010 paper, Figures 3 to 8, on any meshes and any adapter, beside the paper's own numbers.
//!
//! Its pixels are receivers here: those of the 2008 paper's corner, or triangles' centres where a model shades itself. One thread
//! takes one receiver and makes its rays. Tables are two-point, as large as the paper's maps; its own representation is measured
//! by [`paper2008`](super::paper2008).

mod findings;
mod kernels;
pub mod published;
mod scenes;
mod table;

use serde::{Deserialize, Serialize};

use self::scenes::Bench;
use super::gpu::{Gpu, GpuError};
use super::paper2008::{Maps, two_point};
use super::progress::Progress;
use crate::mesh::Mesh;

/// Which tables are baked, and how many receivers ask them.
///
/// ```
/// use visfield_bake::measure::paper2010::Paper2010Question;
/// assert_eq!(Paper2010Question::new(false).own_surface, (4226, 64));
/// ```
#[derive(Clone, Debug)]
pub struct Paper2010Question {
    /// The maps of Figures 3 and 4.
    pub ambient: Vec<Maps>,
    /// The maps of Figure 7.
    pub shadows: Vec<Maps>,
    /// The maps of Figure 5.
    pub own_surface: Maps,
    /// The maps of Figures 6 and 8.
    pub several: Maps,
    /// Rays per receiver of Figure 3 and of the reference, 1 to 4096.
    pub rays: u32,
    /// Rays per receiver of Figure 4, each 1 to 4096.
    pub rays_per_receiver: Vec<u32>,
    /// Receivers along each side of the corner's three squares, at least 2; `None` for 256, about the paper's pixels, or 64 on
    /// software adapters.
    pub side: Option<usize>,
}

impl Paper2010Question {
    /// The paper's tables; the three of 65 MB only if it is to be `full`.
    pub fn new(full: bool) -> Self {
        let small = [(4226, 32), (4226, 64), (16642, 32)];
        let mut shadows = small.to_vec();
        if full {
            shadows.extend([(4226, 128), (16642, 64)]);
        }
        Self {
            ambient: [[(1090, 32), (1090, 64), (1090, 128)], small].concat(),
            shadows,
            own_surface: if full { (16642, 64) } else { (4226, 64) },
            several: (4226, 64),
            rays: 256,
            rays_per_receiver: vec![16, 64, 121, 256],
            side: None,
        }
    }
}

/// Rays of Figure 5.
const OWN_RAYS: u32 = 121;
/// Rays of each light in Figures 7 and 8.
const SHADOW_RAYS: u32 = 20;

/// What was found. Errors are root mean squares over all receivers × 255, against exact rays.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Paper2010 {
    /// Name of the adapter.
    pub adapter: String,
    /// What tells the time: the adapter's own timestamps, or wall time.
    pub timer: String,
    /// Name of the mesh of Figures 3, 4 and 7.
    pub mesh: String,
    /// Its triangles.
    pub triangles: u32,
    /// Receivers in its corner.
    pub receivers: usize,
    /// Rays of each of them in Figure 3.
    pub rays: u32,
    /// Sizes of tables.
    pub figure3: Vec<TableTime>,
    /// Numbers of rays.
    pub figure4: Vec<RaysTime>,
    /// Models by themselves.
    pub figure5: Vec<OwnSurface>,
    /// Three models at once, if there are as many.
    pub figure6: Option<SeveralOccluders>,
    /// Soft shadows of three lights, by sizes of tables.
    pub figure7: Vec<TableTime>,
    /// Soft shadows of all models, by one light and by three.
    pub figure8: Vec<SoftShadow>,
}

/// A table and what it gave.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TableTime {
    /// Number of the paper's maps.
    pub positions: u32,
    /// Side of each map.
    pub directions: u32,
    /// The two-point table of about as many bytes, as 65² × 64².
    pub size: String,
    /// Its bytes.
    pub field_bytes: u64,
    /// Seconds for all receivers.
    pub seconds: f64,
    /// Error against exact rays.
    pub rms_255: f64,
}

/// A point of Figure 4.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RaysTime {
    /// The table, as 65² × 64².
    pub size: String,
    /// Its bytes.
    pub field_bytes: u64,
    /// Rays of each receiver.
    pub rays: u32,
    /// Seconds for all receivers.
    pub seconds: f64,
}

/// A model of Figure 5.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct OwnSurface {
    /// Name of the mesh.
    pub mesh: String,
    /// Its triangles.
    pub triangles: u32,
    /// The table, as 65² × 64².
    pub size: String,
    /// Receivers on it.
    pub receivers: usize,
    /// Seconds for 121 rays of each.
    pub seconds: f64,
    /// Rays per second.
    pub rays_per_second: f64,
    /// Error against the same rays through triangles.
    pub rms_255: f64,
    /// Seconds for 121 rays of each receiver in the model's corner, over as many receivers.
    pub corner_seconds: f64,
}

/// Figure 6.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SeveralOccluders {
    /// Names of the meshes.
    pub meshes: Vec<String>,
    /// Triangles of all of them.
    pub triangles: u32,
    /// Receivers in the corner of the first one.
    pub receivers: usize,
    /// Rays of each of them.
    pub rays: u32,
    /// Seconds for one pass over all occluders.
    pub seconds: f64,
    /// Seconds for a pass over each of them.
    pub single_seconds: Vec<f64>,
    /// Error of the one pass against the same rays through the triangles of all.
    pub rms_255: f64,
}

/// A row of Figure 8.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SoftShadow {
    /// Number of lights.
    pub lights: usize,
    /// Shadow rays of all receivers: those above the horizon.
    pub shadow_rays: u64,
    /// Seconds for them.
    pub seconds: f64,
    /// Shadow rays per second.
    pub rays_per_second: f64,
    /// The same through triangles, by a compressed wide BVH on the adapter: any hit, of up to 2 million of the rays from a list.
    pub bvh_rays_per_second: f64,
    /// Error against 256 exact rays per light.
    pub rms_255: f64,
}

/// Repeats the paper's experiments: Figures 3, 4 and 7 with the first mesh, Figure 5 with each, Figures 6 and 8 with the first
/// three, or the first alone if they are fewer. `progress` gets the share of the work that is done, from 0 to 1, and what is
/// being done, from any thread.
///
/// # Errors
/// [`GpuError`] if there is no adapter, or if a mesh or a table cannot be baked.
///
/// # Panics
/// If there is no mesh.
pub fn paper2010(
    meshes: &[Mesh],
    question: &Paper2010Question,
    progress: impl Fn(f64, &str) + Sync,
) -> Result<Paper2010, GpuError> {
    let mesh = &meshes[0];
    let gpu = Gpu::new()?;
    let progress = Progress::new(question.work(meshes.len()), &progress);
    let side = question.side.unwrap_or(if gpu.is_software() { 64 } else { 256 }).max(2);
    let bench = Bench::new(gpu, &progress, question, side);
    let (figure3, figure4, figure7) = bench.tables(mesh)?;
    let figure5 = meshes.iter().map(|mesh| bench.own_surface(mesh)).collect::<Result<_, _>>()?;
    let (figure6, figure8) = bench.several(meshes)?;
    let triangles = mesh.solid_triangles().map_or(0, |solid| solid.len() as u32);
    Ok(Paper2010 {
        adapter: bench.gpu.info.name.clone(),
        timer: bench.gpu.timer().to_owned(),
        mesh: mesh.name.clone(),
        triangles,
        receivers: 3 * side * side,
        rays: question.rays,
        figure3,
        figure4,
        figure5,
        figure6,
        figure7,
        figure8,
    })
}

impl Paper2010Question {
    /// All tables of Figures 3, 4 and 7, each once.
    fn tables(&self) -> Vec<Maps> {
        let mut all = self.ambient.clone();
        all.extend(self.shadows.iter().filter(|maps| !self.ambient.contains(maps)));
        all
    }

    /// In rays of bakes, with which all other work is in proportion.
    fn work(&self, meshes: usize) -> u64 {
        let rays = |maps: Maps| two_point(maps).rays();
        let several = meshes.min(3) as u64;
        self.tables().into_iter().map(rays).sum::<u64>()
            + meshes as u64 * rays(self.own_surface)
            + several * rays(self.several)
    }
}
