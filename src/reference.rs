//! Frames by exact rays: what a frame of visibility fields is compared with.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use bevy::math::{DAffine3, DVec3, UVec2, Vec3};
use rayon::prelude::*;
use visfield::estimate::light::{Light, LightKind};
use visfield::estimate::sampling::{disc_samples, square_samples};
use visfield::estimate::{AmbientOcclusion, Receiver};
use visfield_bake::{ExactScene, Mesh, exact};

use crate::headless::ASSETS;
use crate::moving_objects::MESHES;
use crate::probe::ProbedFrame;

/// The triangles of the default meshes.
///
/// ```
/// use bevy::math::{DVec3, Vec3};
/// use bevy::prelude::Transform;
/// use visfield_workspace::reference::ReferenceMeshes;
/// let meshes = ReferenceMeshes::read()?;
/// let scene = meshes.scene([(2, Transform::IDENTITY)], DVec3::ZERO)?;
/// assert!(scene.occluded(DVec3::Y * 3.0, Vec3::NEG_Y, f32::INFINITY), "a chair");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct ReferenceMeshes(Vec<Mesh>);

impl ReferenceMeshes {
    /// Reads the files that the default parts show.
    ///
    /// # Errors
    /// If a file is missing or is no mesh.
    pub fn read() -> Result<Self, visfield_bake::ReadError> {
        let read = |name| {
            Ok(visfield_bake::read_meshes(&Path::new(ASSETS.as_str()).join(format!("meshes/{name}.glb")))?.remove(0))
        };
        MESHES.into_iter().map(read).collect::<Result<_, _>>().map(Self)
    }

    /// Instances of these meshes, by their index among [`MESHES`], as seen from near `origin`.
    ///
    /// # Errors
    /// If a mesh cannot be traced.
    pub fn scene(
        &self,
        instances: impl IntoIterator<Item = (usize, bevy::prelude::Transform)>,
        origin: DVec3,
    ) -> Result<ExactScene, visfield_bake::MeshError> {
        let place = |(mesh, transform): (usize, bevy::prelude::Transform)| -> (&Mesh, DAffine3) {
            (&self.0[mesh], transform.compute_affine().as_daffine3())
        };
        ExactScene::new(&instances.into_iter().map(place).collect::<Vec<_>>(), origin)
    }
}

/// How far a reference has come, and whether it is still wanted.
///
/// ```
/// let progress = visfield_workspace::reference::Progress::default();
/// progress.cancel();
/// assert_eq!(progress.rows(), 0);
/// ```
#[derive(Debug, Default)]
pub struct Progress {
    rows: AtomicU32,
    cancelled: AtomicBool,
}

impl Progress {
    /// Rows of pixels that are done.
    pub fn rows(&self) -> u32 {
        self.rows.load(Ordering::Relaxed)
    }

    /// Nobody waits for the result any more.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }
}

/// Per pixel that shows a surface: ambient visibility, and that of a light.
pub type ExactFrame = Vec<Option<[f32; 2]>>;

/// What exact rays find for every pixel of a frame: `ambient_rays` rays of ambient light (none if 0), and `light_rays`
/// towards a light, whose place is relative to the frame's camera. All processors take part. `None` if it was cancelled.
pub fn trace_frame(
    scene: &ExactScene,
    frame: &ProbedFrame,
    ambient_rays: u32,
    (light, light_rays): (&Light, u32),
    progress: &Progress,
) -> Option<ExactFrame> {
    let ambient = AmbientOcclusion { rays: ambient_rays, ..AmbientOcclusion::default() };
    let samples = LightSamples::new(light, light_rays);
    let size = frame.geometry.size;
    let pixel = |x, y| {
        let seen = frame.geometry.receiver_at(UVec2::new(x, y));
        // The sky.
        if seen.depth <= 0.0 {
            return None;
        }
        let position = frame.camera.as_dvec3() + seen.position.as_dvec3();
        let receiver = Receiver { position, normal: seen.normal };
        let occlusion = if ambient_rays > 0 { exact::ambient_occlusion(scene, &receiver, &ambient) } else { 0.0 };
        Some([1.0 - occlusion, samples.visibility(scene, &receiver, seen.position)])
    };
    let rows: Vec<Vec<_>> = (0..size.y)
        .into_par_iter()
        .map(|y| {
            if progress.cancelled.load(Ordering::Relaxed) {
                return Vec::new();
            }
            let row = (0..size.x).map(|x| pixel(x, y)).collect();
            progress.rows.fetch_add(1, Ordering::Relaxed);
            row
        })
        .collect();
    (!progress.cancelled.load(Ordering::Relaxed)).then(|| rows.concat())
}

/// Points of a light's surface.
struct LightSamples<'a> {
    light: &'a Light,
    points: Vec<bevy::math::Vec2>,
}

impl<'a> LightSamples<'a> {
    fn new(light: &'a Light, count: u32) -> Self {
        let rectangle = light.kind == LightKind::Rectangle;
        let points = if rectangle { square_samples(count) } else { disc_samples(count) };
        Self { light, points }
    }

    /// The share of the light above the receiver's horizon that it sees; 1 where the light does not shine.
    fn visibility(&self, scene: &ExactScene, receiver: &Receiver, relative: Vec3) -> f32 {
        let view = self.light.seen_from(relative);
        if !self.light.shines_on(&view, receiver.normal) {
            return 1.0;
        }
        let t_max = if self.light.kind == LightKind::Directional { f32::INFINITY } else { view.t_max };
        // As far above the surface as the rays of ambient occlusion start, in scenes of about ten units.
        let offset = ExactScene::SURFACE_OFFSET * 10.0_f32.max(relative.abs().max_element());
        let start = receiver.position + (receiver.normal * offset).as_dvec3();
        let directions = self.points.iter().map(|point| view.direction(*point));
        let above: Vec<_> = directions.filter(|direction| receiver.normal.dot(*direction) > 0.0).collect();
        let hidden = above.iter().filter(|direction| scene.occluded(start, **direction, t_max)).count();
        1.0 - hidden as f32 / above.len().max(1) as f32
    }
}

/// Differences between what was found and what is exact.
///
/// ```
/// use visfield_workspace::reference::Errors;
/// let mut errors = Errors::default();
/// errors.add(0.5, 0.25);
/// errors.add(1.0, 1.0);
/// assert_eq!((errors.mean(), errors.largest), (0.125, 0.25));
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct Errors {
    absolute: f64,
    squared: f64,
    signed: f64,
    /// The largest, by its absolute value.
    pub largest: f32,
    /// How many were added.
    pub count: usize,
}

impl Errors {
    /// Adds one.
    pub fn add(&mut self, found: f32, exact: f32) {
        let error = found - exact;
        self.absolute += f64::from(error.abs());
        self.squared += f64::from(error * error);
        self.signed += f64::from(error);
        self.largest = self.largest.max(error.abs());
        self.count += 1;
    }

    /// The mean absolute one.
    pub fn mean(&self) -> f64 {
        self.absolute / self.count.max(1) as f64
    }
}

impl std::fmt::Display for Errors {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let n = self.count.max(1) as f64;
        write!(
            f,
            "mean absolute error {:.4}, RMS {:.4}, maximum {:.3}, bias {:+.4} over {} pixels",
            self.mean(),
            (self.squared / n).sqrt(),
            self.largest,
            self.signed / n,
            self.count
        )
    }
}
