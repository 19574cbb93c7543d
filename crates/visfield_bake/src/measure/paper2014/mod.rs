//! The claims of *Enhanced Sphere Tracing* (2014) again, on our own tracer, beside the paper's own numbers.
//!
//! Its city and its jewel are gone; scenes of the same kind take their place, a dodecahedron as in its Figure 11, and the distance grid
//! of any mesh. Each technique is compared with sphere tracing that has none of them but the end at half a pixel, on the rays of
//! the paper's 1280 × 720 pixels, of which only some are traced. What counts is distances asked for; times are beside them, of one
//! thread of the CPU, where no neighbours wait for the slowest ray.

mod convex;
mod escape;
mod facets;
mod findings;
mod pictures;
pub mod published;
mod relaxation;
mod scenes;
mod selection;
mod smoothing;
mod table;
mod together;

use serde::{Deserialize, Serialize};
use visfield::distance::DistanceGridFormat;

pub use self::convex::Convex;
pub use self::escape::Escape;
use self::facets::Facets;
pub use self::pictures::PaperPicture;
use self::relaxation::RaySet;
pub use self::relaxation::{RayKind, Relaxation};
use self::scenes::Subject;
pub use self::selection::Selection;
pub use self::smoothing::Smoothing;
pub use self::together::Technique;
use super::progress::Progress;
use crate::bake::BakeError;
use crate::mesh::Mesh;

/// Which rays are traced, and how.
///
/// ```
/// use visfield_bake::measure::paper2014::Paper2014Question;
/// assert_eq!(Paper2014Question::new(true).relaxations, [1.0, 1.2, 1.4, 1.6]);
/// ```
#[derive(Clone, Debug)]
pub struct Paper2014Question {
    /// How fine the mesh's distances are.
    pub format: DistanceGridFormat,
    /// Every so many of the paper's 1280 × 720 pixels is traced, both ways; at least 1.
    pub step: u32,
    /// About how many rays that graze something are looked for in each scene.
    pub grazing: usize,
    /// The mesh has up to three times the square of the first of receivers, with as many rays as the second says.
    pub ambient: (usize, u32),
    /// Values of ω, 1 to below 2; the first is 1.
    pub relaxations: Vec<f32>,
    /// Limits of steps for which the choice of a hit is measured.
    pub limits: Vec<u32>,
    /// Sizes of the jewel.
    pub scales: Vec<f32>,
    /// Numbers of steps of discontinuity reduction; the first is 0.
    pub smoothing: Vec<u32>,
}

impl Paper2014Question {
    /// Every tenth of ω, or, `quick`, few of everything.
    pub fn new(quick: bool) -> Self {
        let tenths: &[f32] = if quick { &[1.0, 1.2, 1.4, 1.6] } else { &[1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8] };
        Self {
            format: if quick {
                DistanceGridFormat { voxels: 32, ..DistanceGridFormat::DEFAULT }
            } else {
                DistanceGridFormat::DEFAULT
            },
            step: if quick { 32 } else { 12 },
            grazing: if quick { 200 } else { 2000 },
            ambient: if quick { (6, 16) } else { (12, 32) },
            relaxations: tenths.to_vec(),
            limits: vec![16, 24, 32, 64],
            scales: vec![1.0e-4, 1.0, 1.0e4],
            smoothing: vec![0, 1, 2, 3, 5],
        }
    }

    fn step(&self) -> u32 {
        self.step.max(1)
    }
}

/// What was found.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Paper2014 {
    /// Name of the mesh.
    pub mesh: String,
    /// Its triangles.
    pub triangles: u32,
    /// The grid of its distances, as 64 voxels u8.
    pub grid: String,
    /// Rays with every ω (§3.1).
    pub relaxation: Vec<Relaxation>,
    /// Which point counts as hit when steps run out (§3.2).
    pub selection: Vec<Selection>,
    /// How far from the surface the next ray starts (§3.3).
    pub escape: Vec<Escape>,
    /// How even the ends of rays are (§3.4).
    pub smoothing: Vec<Smoothing>,
    /// Out of convex solids (§3.5).
    pub convex: Vec<Convex>,
    /// Each technique by itself, and all of them.
    pub together: Vec<Technique>,
    /// As the paper's Figures 7 to 9.
    pub pictures: Vec<PaperPicture>,
}

/// Repeats the paper's measurements. `progress` gets the share of the work that is done, from 0 to 1, and what is being done, from
/// any thread.
///
/// # Errors
/// [`BakeError`] if the mesh or its distances cannot be baked.
pub fn paper2014(
    mesh: &Mesh,
    question: &Paper2014Question,
    progress: impl Fn(f64, &str) + Sync,
) -> Result<Paper2014, BakeError> {
    let progress = Progress::new(STAGES, &progress);
    let step = question.step();
    let (grid, grid_from_mesh) = scenes::grid(mesh, question.format)?;
    progress.add(1, "distances of the mesh");
    let (ambient, ambient_settings) = scenes::ambient(mesh, &grid, grid_from_mesh, question.ambient)?;
    let [jewel_facets, dodecahedron_facets] = [Facets::jewel(1.0), Facets::dodecahedron()];
    let city = scenes::city();
    let jewel = scenes::glass("jewel", &jewel_facets, 1.0);
    let dodecahedron = scenes::glass("dodecahedron", &dodecahedron_facets, 1.0);

    let mut sets: Vec<RaySet> = [&city, &jewel, &grid]
        .into_iter()
        .flat_map(|subject| {
            let set = |kind, rays| RaySet { subject, kind, rays, settings: subject.plain };
            let grazing = subject.grazing((step / 6).max(1), question.grazing);
            [set(RayKind::Camera, subject.camera(step)), set(RayKind::Grazing, grazing)]
        })
        .collect();
    let refracted = convex::refraction_rays(&jewel, &jewel_facets, 2 * step);
    let settings = escape::inside(&jewel);
    sets.push(RaySet { subject: &jewel, kind: RayKind::Refraction, rays: refracted.clone(), settings });
    sets.push(RaySet { subject: &grid, kind: RayKind::Ambient, rays: ambient, settings: ambient_settings });
    let relaxation = sets.iter().flat_map(|set| set.measure(&question.relaxations, &progress)).collect();

    let each = |doing: &str, subject: &Subject| progress.add(1, &format!("{}: {doing}", subject.name));
    let scenes = [&city, &jewel, &grid];
    let mut selection = Vec::new();
    let mut smoothing = Vec::new();
    for subject in scenes {
        selection.extend(selection::select(subject, step, &question.limits));
        each("which point counts as hit", subject);
        smoothing.extend(smoothing::smooth(subject, 3 * step, &question.smoothing));
        each("how even ends of rays are", subject);
    }
    let of_scale = |&scale: &f32| escape::escapes(scale, step);
    let escape = question.scales.iter().flat_map(of_scale).collect();
    each("where the next ray starts", &jewel);
    let mut convex = convex::compare(&jewel, &refracted, &CONVEX_RELAXATIONS);
    let rays = convex::refraction_rays(&dodecahedron, &dodecahedron_facets, 2 * step);
    convex.extend(convex::compare(&dodecahedron, &rays, &CONVEX_RELAXATIONS));
    each("from the bounds back", &dodecahedron);
    let mut together = Vec::new();
    for (subject, facets) in
        [(&city, None), (&jewel, Some(&jewel_facets)), (&dodecahedron, Some(&dodecahedron_facets)), (&grid, None)]
    {
        together.extend(together::combine(subject, facets, 2 * step));
        each("all techniques", subject);
    }
    let pictures = pictures::pictures(&city, &jewel);
    each("pictures", &city);
    Ok(Paper2014 {
        mesh: mesh.name.clone(),
        triangles: mesh.solid_triangles().map_or(0, |solid| solid.len() as u32),
        grid: question.format.to_string(),
        relaxation,
        selection,
        escape,
        smoothing,
        convex,
        together,
        pictures,
    })
}

/// Steps of the whole work that are reported: the bake, eight sets of rays, two times three scenes, ε, convex solids, four scenes for
/// all techniques, and pictures.
const STAGES: u64 = 1 + 8 + 6 + 1 + 1 + 4 + 1;

/// Values of ω with which ways out of convex solids are compared.
const CONVEX_RELAXATIONS: [f32; 2] = [1.0, published::RELAXATION];
