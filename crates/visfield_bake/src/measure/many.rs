//! Several objects at once, where what each hides has to be combined: the rules for cap grids, against exact rays of the whole
//! scene.

use glam::{DAffine3, DQuat, DVec3, dvec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use visfield::estimate::Receiver;
use visfield::estimate::caps::{CapAmbient, CapCombination, CapScene};
use visfield::field::cap_grid::Falloff;
use visfield::raycast::RayCaster;
use visfield::scene::{Instance, Scene};
use visfield::{CapGridFormat, QueryOptions, Ray};

use super::ambient::{Errors, TRUTH_RAYS, exact_occlusion_of};
use super::caps::{AskedCaps, TABLE_RAYS, occlusions};
use super::picture::{CornerView, Pictures};
use super::progress::Progress;
use super::scene::{Corner, hemisphere_directions};
use super::speed::{race, seconds};
use super::table::{Cells, bytes, count};
use crate::bake::{BakeError, BakeSettings};
use crate::bounds::bounding_sphere;
use crate::exact::ExactScene;
use crate::mesh::{Mesh, MeshError};

/// What is measured.
///
/// ```
/// let ask = visfield_bake::measure::many::ManyQuestion::default();
/// assert_eq!(ask.instances, 8);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ManyQuestion {
    /// Number of objects, at least 1: the meshes in turn.
    pub instances: usize,
    /// The cap grid of each mesh, without falloff: the truth has none.
    pub cap_grid: CapGridFormat,
    /// Receivers along each side of the floor, at least 8.
    pub side: usize,
}

impl Default for ManyQuestion {
    fn default() -> Self {
        Self { instances: 8, cap_grid: CapGridFormat::DEFAULT, side: 48 }
    }
}

/// What was found for objects that stand on a floor, or hang above it, close to each other and to two walls.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Many {
    /// Names of the meshes, with commas between them.
    pub mesh: String,
    /// Number of objects.
    pub instances: usize,
    /// Triangles of all of them.
    pub triangles: u64,
    /// The cap grids, as `16³ in rgba8`.
    pub cap_grid: String,
    /// Size of one of them in memory.
    pub field_bytes: u64,
    /// Number of receivers, on the floor and on the walls.
    pub receivers: usize,
    /// Share of their hemispheres that is occluded.
    pub occluded_fraction: f64,
    /// Ways to combine what single objects hide, and rays for comparison.
    pub rules: Vec<ManyRule>,
    /// How it looks by exact rays and by [`Many::SHOWN`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pictures: Option<Box<Pictures>>,
}

/// One way to the occlusion by all objects. Errors are against [`TRUTH_RAYS`] exact rays per receiver of the whole scene.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ManyRule {
    /// What it does, in words.
    pub rule: String,
    /// Root of the mean square error over all receivers, × 255.
    pub rms_255: f64,
    /// Mean absolute error over receivers whose exact or estimated occlusion exceeds 1/255.
    pub mean_abs: f64,
    /// Largest absolute error over the same receivers.
    pub max_abs: f64,
    /// Mean error over the same receivers: above 0, too dark.
    pub bias_signed: f64,
    /// Time of one thread.
    pub nanoseconds_per_receiver_and_object: f64,
}

/// Radius of the spiral's turns, in bounding radii: neighbours on it are at least 2.19 apart.
const SPIRAL: f64 = 1.42;
/// Of so many objects one hangs above the floor.
const HANGING: usize = 3;
/// Height of the walls as a share of the floor's side.
const WALL_HEIGHT: f64 = 0.25;
/// Every which receiver is asked when many exact rays are timed.
const TIMED_RECEIVERS: usize = 128;

/// Places object `index` of `meshes`, scaled to a bounding radius of 1: on a spiral of golden angles, each turned in its own
/// way, its lowest point on the floor y = 0 or above it.
fn place(mesh: &Mesh, index: usize) -> Result<DAffine3, MeshError> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let bounds = bounding_sphere(mesh)?;
    let center = DVec3::from(bounds.center.map(f64::from));
    let radius = bounds.mesh_from_field().matrix3.x_axis.x;
    let step = index as f64;
    let turned = DQuat::from_rotation_y(step * golden) * DQuat::from_rotation_x(0.7 * step);
    let around_center = DAffine3::from_scale_rotation_translation(DVec3::splat(1.0 / radius), turned, DVec3::ZERO)
        * DAffine3::from_translation(-center);
    let corners = mesh.solid_triangles()?;
    let heights = corners.as_flattened().iter().map(|p| around_center.transform_point3(*p).y);
    let lowest = heights.fold(f64::INFINITY, f64::min);
    let raised = if index % HANGING == HANGING - 1 { 0.3 + 0.5 * (step * golden).sin().abs() } else { 0.0 };
    let (sin, cos) = (step * golden).sin_cos();
    let from_middle = SPIRAL * (step + 0.5).sqrt();
    let shift = dvec3(cos * from_middle, raised - lowest, sin * from_middle);
    Ok(DAffine3::from_translation(shift) * around_center)
}

/// The floor and walls around objects whose centres are within `reach` of the middle.
fn corner_around(reach: f64) -> Corner {
    // The walls all but touch the outermost; in front there is as much room again.
    let (behind, before) = (reach + 1.1, reach + 1.6);
    Corner { origin: dvec3(-behind, 0.0, -behind), side: behind + before, height: WALL_HEIGHT }
}

/// Bakes the meshes, places objects, and measures every rule. `progress` gets the share of the work that is done, from 0 to 1,
/// and what is being done, from any thread.
///
/// # Errors
/// [`BakeError`] if a mesh or the cap grid's format cannot be baked.
///
/// # Panics
/// If there are no meshes.
pub fn measure_many(
    meshes: &[Mesh],
    question: &ManyQuestion,
    progress: impl Fn(f64, &str) + Sync,
) -> Result<Many, BakeError> {
    let objects = Objects::new(meshes, question)?;
    let (receivers, middle) = (&objects.receivers, objects.middle);
    let instances = objects.placed.len();
    let different = &meshes[..meshes.len().min(instances)];
    let settings = BakeSettings {
        cap_grid: Some(CapGridFormat { falloff: Falloff::None, ..question.cap_grid }),
        distance: None,
        ..BakeSettings::default()
    };
    let exact_rays = receivers.len() as u64 * u64::from(TRUTH_RAYS);
    let work = different.len() as u64 * settings.rays() + (1 + instances as u64) * exact_rays;
    let progress = Progress::new(work, &progress);
    let mut scene = Scene::default();
    let mut fields = Vec::new();
    for mesh in different {
        fields.push(scene.add_field(progress.bake(mesh, &settings)?));
    }
    let placed = fields.iter().cycle().zip(&objects.placed);
    scene.instances.extend(placed.map(|(&field, &(_, place))| Instance::new(field, place)));

    let exact = objects.exact(&objects.placed)?;
    let truth = objects.trace(&exact, &progress, "exact rays of the whole scene");
    let (product_of_exact, product_of_exact_time) = objects.product_of_exact(&progress)?;
    let rule = |rule: &str, found: &[f32], nanoseconds_per_receiver_and_object: f64| {
        let errors = Errors::of(found, &truth);
        ManyRule {
            rule: rule.to_owned(),
            rms_255: errors.rms * 255.0,
            mean_abs: errors.mean_abs,
            max_abs: errors.max_abs,
            bias_signed: errors.bias,
            nanoseconds_per_receiver_and_object,
        }
    };
    let [mut product, mut soft, mut softer] = [CapCombination::Product, soft_caps(8), soft_caps(16)]
        .map(|combination| Answered::new(AskedCaps { caps: CapScene::new(&scene, middle), combination }, receivers));
    let table = TableRays::new(&scene, &exact, middle, receivers);
    let mut hits = vec![false; table.rays.len()];
    let times = race([&mut || product.ask(), &mut || soft.ask(), &mut || softer.ask(), &mut || table.ask(&mut hits)]);
    let times = times.map(|seconds| objects.nanoseconds(seconds));
    let [product, soft, softer] = [product, soft, softer].map(|rule| occlusions(&rule.answers));
    let rules = vec![
        rule("cap grids, product", &product, times[0]),
        rule(Many::SHOWN, &soft, times[1]),
        rule("cap grids, soft caps in 16 directions", &softer, times[2]),
        rule("product of exact occlusions", &product_of_exact, product_of_exact_time),
        rule(&format!("{TABLE_RAYS} rays through tables"), &TableRays::shares(&hits), times[3]),
    ];
    let names: Vec<&str> = different.iter().map(|mesh| mesh.name.as_str()).collect();
    let view = CornerView::of(objects.corner, &exact, middle);
    Ok(Many {
        mesh: names.join(", "),
        instances,
        triangles: objects.placed.iter().map(|(mesh, _)| mesh.indices.len() as u64).sum(),
        cap_grid: question.cap_grid.to_string(),
        field_bytes: question.cap_grid.bytes(),
        receivers: receivers.len(),
        occluded_fraction: truth.iter().map(|&x| f64::from(x)).sum::<f64>() / truth.len() as f64,
        rules,
        pictures: Some(Box::new(view.pictures(&truth, &soft))),
    })
}

/// Meshes in their places, and the receivers around them.
struct Objects<'a> {
    placed: Vec<(&'a Mesh, DAffine3)>,
    corner: Corner,
    receivers: Vec<Receiver>,
    middle: DVec3,
}

impl<'a> Objects<'a> {
    fn new(meshes: &'a [Mesh], question: &ManyQuestion) -> Result<Self, BakeError> {
        assert!(!meshes.is_empty(), "objects need a mesh");
        let instances = question.instances.max(1);
        let in_place = |(index, mesh): (usize, &'a Mesh)| match place(mesh, index) {
            Ok(place) => Ok((mesh, place)),
            Err(source) => Err(BakeError::Mesh { name: mesh.name.clone(), source }),
        };
        let placed = meshes.iter().cycle().take(instances).enumerate().map(in_place).collect::<Result<_, _>>()?;
        let corner = corner_around(SPIRAL * (instances as f64 - 0.5).sqrt());
        let receivers = corner.receivers(question.side.max(8));
        Ok(Self { placed, corner, receivers, middle: corner.origin + DVec3::splat(corner.side * 0.5) })
    }

    fn exact(&self, some: &[(&Mesh, DAffine3)]) -> Result<ExactScene, BakeError> {
        let name = || some.first().map_or(String::new(), |(mesh, _)| mesh.name.clone());
        ExactScene::new(some, self.middle).map_err(|source| BakeError::Mesh { name: name(), source })
    }

    /// Occlusion of every receiver by very many rays.
    fn trace(&self, scene: &ExactScene, progress: &Progress, doing: &str) -> Vec<f32> {
        let of = |(index, receiver)| {
            progress.add(TRUTH_RAYS.into(), doing);
            exact_occlusion_of(scene, receiver, index, TRUTH_RAYS, Falloff::None)
        };
        self.receivers.par_iter().enumerate().map(of).collect()
    }

    /// The product rule for what very many rays find of each object alone, and nanoseconds for a receiver and object.
    fn product_of_exact(&self, progress: &Progress) -> Result<(Vec<f32>, f64), BakeError> {
        let mut visible = vec![1.0; self.receivers.len()];
        // One thread would take minutes for all of them.
        let step = self.receivers.len().div_ceil(TIMED_RECEIVERS);
        let timed: Vec<_> = self.receivers.iter().enumerate().step_by(step).collect();
        let mut time = 0.0;
        for (number, object) in (1..).zip(&self.placed) {
            let alone = self.exact(std::slice::from_ref(object))?;
            let doing = format!("exact rays of object {number} of {}", self.placed.len());
            let occlusion = self.trace(&alone, progress, &doing);
            visible.iter_mut().zip(&occlusion).for_each(|(visible, occlusion)| *visible *= 1.0 - occlusion);
            time += seconds(|| {
                let of = |&(index, receiver)| exact_occlusion_of(&alone, receiver, index, TRUTH_RAYS, Falloff::None);
                timed.iter().map(of).sum::<f32>()
            });
        }
        let asked = timed.len() * self.placed.len();
        Ok((visible.iter().map(|visible| 1.0 - visible).collect(), time / asked as f64 * 1e9))
    }

    /// Of a time for all receivers and objects, the share of one of each.
    fn nanoseconds(&self, seconds: f64) -> f64 {
        seconds / (self.receivers.len() * self.placed.len()) as f64 * 1e9
    }
}

/// A rule for cap grids, with room for its answers.
struct Answered<'a> {
    asked: AskedCaps<'a>,
    receivers: &'a [Receiver],
    answers: Vec<CapAmbient>,
}

impl<'a> Answered<'a> {
    fn new(asked: AskedCaps<'a>, receivers: &'a [Receiver]) -> Self {
        Self { asked, receivers, answers: vec![CapAmbient::UNOCCLUDED; receivers.len()] }
    }

    fn ask(&mut self) {
        self.asked.ask(self.receivers, &mut self.answers);
    }
}

fn soft_caps(directions: u32) -> CapCombination {
    CapCombination::SoftCaps { directions }
}

/// A few rays of every receiver, as a table is asked for them.
struct TableRays<'a> {
    caster: RayCaster<'a>,
    rays: Vec<Ray>,
    /// How many rays of receivers alike follow each other, and how they are asked.
    batches: Vec<(usize, QueryOptions)>,
}

impl<'a> TableRays<'a> {
    fn new(scene: &'a Scene, exact: &ExactScene, origin: DVec3, receivers: &[Receiver]) -> Self {
        let (mut rays, mut batches) = (Vec::new(), Vec::new());
        let mut index = 0;
        for alike in receivers.chunk_by(|a, b| a.normal == b.normal) {
            let before = rays.len();
            for receiver in alike {
                let start = exact.start(receiver);
                let directions = hemisphere_directions(receiver, index, TABLE_RAYS);
                rays.extend(directions.into_iter().map(|direction| Ray::new(start, direction)));
                index += 1;
            }
            let options = QueryOptions { normal: alike[0].normal, ..QueryOptions::default() };
            batches.push((rays.len() - before, options));
        }
        Self { caster: RayCaster::new(scene, origin), rays, batches }
    }

    fn ask(&self, occluded: &mut [bool]) {
        let mut first = 0;
        for (length, options) in &self.batches {
            let range = first..first + length;
            self.caster.occluded_batch(&self.rays[range.clone()], options, &mut occluded[range]);
            first += length;
        }
    }

    /// The share of rays of each receiver that hit.
    fn shares(hits: &[bool]) -> Vec<f32> {
        hits.chunks(TABLE_RAYS as usize)
            .map(|hits| hits.iter().filter(|&&hit| hit).count() as f32 / TABLE_RAYS as f32)
            .collect()
    }
}

impl Many {
    /// The rule that [`pictures`](Self::pictures) show: the default of `visfield::estimate::caps`.
    pub const SHOWN: &str = "cap grids, soft caps in 8 directions";

    /// Every rule with its errors and its time.
    pub fn table(&self) -> String {
        format!("{}\n{}\n", self.summary(), self.cells())
    }

    /// What was measured, in a sentence.
    pub(crate) fn summary(&self) -> String {
        format!(
            "{} objects of {}, {} triangles, on a floor and by two walls: {} receivers, {:.1} % occluded. A cap grid of {} takes {}. \
             Errors are against {TRUTH_RAYS} exact rays of the whole scene, times of one thread.",
            self.instances,
            self.mesh,
            count(self.triangles),
            count(self.receivers as u64),
            100.0 * self.occluded_fraction,
            self.cap_grid,
            bytes(self.field_bytes),
        )
    }

    pub(crate) fn cells(&self) -> Cells {
        let mut cells =
            Cells::new(&["rule", "mean error", "RMS \u{d7} 255", "largest", "bias", "ns per receiver and object"]);
        for rule in &self.rules {
            cells.row([
                rule.rule.clone(),
                format!("{:.4}", rule.mean_abs),
                format!("{:.2}", rule.rms_255),
                format!("{:.3}", rule.max_abs),
                format!("{:+.4}", rule.bias_signed),
                format!("{:.1}", rule.nanoseconds_per_receiver_and_object),
            ]);
        }
        cells
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron() -> Mesh {
        Mesh {
            name: "tetrahedron".to_owned(),
            positions: vec![[5.0, 9.0, 3.0], [1.0, 5.0, 3.0], [1.0, 9.0, -1.0], [5.0, 5.0, -1.0]],
            indices: vec![[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]],
        }
    }

    #[test]
    fn objects_stand_apart_on_the_floor_or_above_it() {
        let mesh = tetrahedron();
        let center = dvec3(3.0, 7.0, 1.0);
        let places: Vec<DAffine3> = (0..64).map(|index| place(&mesh, index).unwrap()).collect();
        let centers: Vec<DVec3> = places.iter().map(|place| place.transform_point3(center)).collect();
        let corner = corner_around(SPIRAL * 63.5_f64.sqrt());
        for (i, a) in centers.iter().enumerate() {
            // Seen from above, so that it does not matter how high they hang.
            let apart = centers[..i].iter().map(|b| (*b - *a).with_y(0.0).length());
            assert!(apart.fold(f64::INFINITY, f64::min) > 2.15, "object {i}");
            let room = [a.x - corner.origin.x, a.z - corner.origin.z];
            assert!(room.iter().all(|room| (1.05..corner.side - 1.5).contains(room)), "object {i} in {room:?}");
            let vertices: Vec<DVec3> =
                mesh.positions.iter().map(|p| places[i].transform_point3(DVec3::from(p.map(f64::from)))).collect();
            assert!(vertices.iter().all(|v| (v.distance(*a) - 1.0).abs() < 1e-3), "object {i} has radius 1");
            let lowest = vertices.iter().map(|v| v.y).fold(f64::INFINITY, f64::min);
            let hangs = i % HANGING == HANGING - 1;
            assert!(if hangs { lowest > 0.29 } else { lowest.abs() < 1e-9 }, "object {i} at {lowest}");
        }
        let turns = places.windows(2).map(|pair| (pair[0].matrix3.x_axis - pair[1].matrix3.x_axis).length());
        assert!(turns.fold(f64::INFINITY, f64::min) > 0.1, "each is turned in its own way");
    }
}
