//! Ambient occlusion of many objects by their [cap grids](crate::field::cap_grid): no rays, and no noise.
//!
//! Twin of `shaders/caps.wgsl`, function by function.

#![expect(
    clippy::needless_range_loop,
    reason = "lane by lane through several arrays: that is what becomes vector instructions"
)]

use glam::{Affine3A, DVec3, Mat3, Vec3, Vec4};
use pulp::{Arch, NullaryFnOnce};

use super::cones::{ConeDisc, ConeOccluder, ConeReceiver};
use super::sampling::sphere_samples;
use super::source::{Answers, OcclusionSource, Wanted};
use super::{FacingOccluder, Falloff, Receiver, blocked_share, cosine_direction};
use crate::field::VisibilityField;
use crate::field::cap_grid::cap::{CUTOFF, Cap, above_cutoff, cap_occlusion};
use crate::field::cap_grid::{CapGrid, stretch};
use crate::field::lanes::Vectors;
use crate::field::query::Bias;
use crate::scene::{Placement, Scene, scaled_rows};

/// How the occlusion of several objects adds up.
///
/// ```
/// use visfield::estimate::caps::CapCombination;
/// assert_eq!(CapCombination::default(), CapCombination::SoftCaps { directions: 8 });
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CapCombination {
    /// The product of visibilities, as if objects hid each other by chance. Cheapest, and the largest error where several
    /// stand in the same direction.
    Product,
    /// Each object's cap over a few directions of the hemisphere, in which visibilities multiply.
    SoftCaps {
        /// Number of directions: 8, or 16 for a little more accuracy; others become the nearer of the two.
        directions: u32,
    },
}

impl Default for CapCombination {
    fn default() -> Self {
        Self::SoftCaps { directions: 8 }
    }
}

/// Most directions of [`CapCombination::SoftCaps`].
pub const MAX_DIRECTIONS: usize = 16;

impl CapCombination {
    /// How many directions are looked along; none of them matters to [`Product`](Self::Product).
    pub fn directions(self) -> usize {
        match self {
            Self::SoftCaps { directions: 12.. } => MAX_DIRECTIONS,
            _ => MAX_DIRECTIONS / 2,
        }
    }
}

/// How ambient occlusion is taken from cap grids.
///
/// ```
/// use visfield::estimate::caps::CapSettings;
/// let nearby = CapSettings { max_distance: 5.0, ..CapSettings::default() };
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CapSettings {
    /// How several objects add up.
    pub combination: CapCombination,
    /// Objects fade out as their bounding sphere leaves this distance, in world units. Infinity counts all. A grid holds one
    /// object as a whole: below the size of objects this is coarse, and a [falloff](crate::field::cap_grid::Falloff) that is
    /// baked in is better, which is good from about the bounding radius of the mesh up; below that, rays are.
    pub max_distance: f32,
    /// How objects count by their distance up to there, in the mean over their depth.
    pub falloff: Falloff,
    /// How near to the receiver surfaces do not count, of what is answered by cones.
    pub bias: Bias,
}

impl Default for CapSettings {
    fn default() -> Self {
        Self {
            combination: CapCombination::default(),
            max_distance: f32::INFINITY,
            falloff: Falloff::Binary,
            bias: Bias::default(),
        }
    }
}

/// What a receiver gets from all objects.
///
/// ```
/// let lit = visfield::estimate::caps::CapAmbient::UNOCCLUDED;
/// assert_eq!(lit.occlusion, 0.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CapAmbient {
    /// The cosine-weighted share of the hemisphere that is hidden, 0 to 1.
    pub occlusion: f32,
    /// The mean direction of what is not hidden, for specular occlusion: a unit vector of the world, the normal itself where
    /// nothing or all is hidden, and the zero vector for a receiver without a normal.
    pub bent_normal: Vec3,
}

impl CapAmbient {
    /// Nothing is hidden.
    pub const UNOCCLUDED: Self = Self { occlusion: 0.0, bent_normal: Vec3::ZERO };
}

/// Where a cap grid lies.
///
/// ```
/// use glam::{DAffine3, DVec3, Vec3, dvec3};
/// use visfield::estimate::caps::CapPlacement;
/// use visfield::scene::Placement;
/// # let field = visfield::field::example_caps();
/// let mirrored = DAffine3::from_scale(dvec3(2.0, -2.0, 2.0));
/// let placement = Placement::new(&field.header().bounds, mirrored, DVec3::ZERO).unwrap();
/// let cap = CapPlacement::new(&field.cap_from_field().unwrap(), &placement);
/// assert!(cap.stretched < 1e-6);
/// assert_eq!(cap.cap_from_world.transform_point3(Vec3::Y * 4.0), Vec3::Y * -2.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CapPlacement {
    /// From the world, relative to the placement's chosen origin, to cap space.
    pub cap_from_world: Affine3A,
    /// 0 for instances that are turned, moved, mirrored and scaled evenly, which are answered as their mesh is; up to 1 for
    /// those whose scale is uneven, whose caps are [mapped](Cap::mapped). Scaled 1:2:3, a bunny in a corner
    /// has a mean error of 0.006, where 0.05 is hidden in the mean.
    pub stretched: f32,
}

/// Deviation from an even scale at which an instance counts as stretched altogether.
const FULLY_STRETCHED: f32 = 0.2;

/// Deviation that rotations come to in single precision.
const ROUNDING: f32 = 1.0e-4;

impl CapPlacement {
    /// Places the grid of a field that is placed.
    pub fn new(cap_from_field: &Affine3A, placement: &Placement) -> Self {
        let cap_from_world = *cap_from_field * placement.field_from_world;
        let stretched = (stretch(cap_from_world.matrix3.into()) - ROUNDING) / FULLY_STRETCHED;
        Self { cap_from_world, stretched: stretched.clamp(0.0, 1.0) }
    }

    /// The linear part of the way back, but for its scale.
    fn world_from_cap(&self) -> Mat3 {
        let [x, y, z] = scaled_rows(&self.cap_from_world);
        Mat3::from_cols(x, y, z).transpose().inverse()
    }
}

/// An instance of which something is answered without rays: by its cap grid, by cones through its distances, or by both.
#[derive(Clone, Copy, Debug)]
pub struct CapOccluder<'a> {
    placement: Placement,
    field: &'a VisibilityField,
    grid: Option<(CapPlacement, &'a CapGrid)>,
    cones: Option<ConeOccluder<'a>>,
    /// What answers ambient occlusion.
    source: OcclusionSource,
}

impl<'a> CapOccluder<'a> {
    /// An instance of a field; `None` if the field has neither a cap grid nor distances.
    pub fn new(placement: Placement, field: &'a VisibilityField, wanted: Wanted) -> Option<Self> {
        let grid = field.cap_grid().zip(field.cap_from_field());
        let grid = grid.map(|(grid, cap_from_field)| (CapPlacement::new(&cap_from_field, &placement), grid));
        let cones = ConeOccluder::new(&placement, field);
        let source = Answers::of(field).ambient(wanted);
        (grid.is_some() || cones.is_some()).then_some(Self { placement, field, grid, cones, source })
    }

    /// Its bounding sphere, and the map to field space.
    pub(super) fn placement(&self) -> &Placement {
        &self.placement
    }

    /// How much of a disc of the sky it hides, from 0 to 1, less what is left to rays: as [`CapGrid::light_occlusion`] has it, or
    /// [a cone](crate::distance::cone). Where the scale is uneven, the disc is taken for one of the same size in the mesh's space.
    pub(super) fn light_occlusion(
        &self,
        source: OcclusionSource,
        receiver: &ConeReceiver,
        disc: &ConeDisc,
        bias: Bias,
    ) -> f32 {
        let (mut occlusion, mut share_of_cones) = (0.0, source.share_of_cones(|| 0.0));
        if let Some((cap, grid)) = self.grid.filter(|_| source.has_caps()) {
            let map = cap.cap_from_world;
            let (local, axis) = (map.transform_point3(receiver.position), unit(map.transform_vector3(disc.direction)));
            share_of_cones = source.share_of_cones(|| grid.inside_share(local));
            let left = 1.0 - source.share_of_rays(|| grid.inside_share(local)) - share_of_cones;
            occlusion = above_cutoff(grid.light_occlusion(local, axis, disc.tangent.atan()) * left);
        }
        if let Some(cones) = self.cones.filter(|_| share_of_cones > 0.0) {
            occlusion += share_of_cones * cones.occlusion(receiver, disc, bias);
        }
        occlusion
    }

    fn has_rays_inside(&self) -> bool {
        self.source == OcclusionSource::CapGridWithRaysInside
    }

    /// The [inside share](CapGrid::inside_share) of a receiver.
    pub(super) fn inside_share(&self, position: Vec3) -> f32 {
        let share =
            |(cap, grid): (CapPlacement, &CapGrid)| grid.inside_share(cap.cap_from_world.transform_point3(position));
        self.grid.map_or(0.0, share)
    }
}

/// A scene's cap grids, placed: ask it for the ambient occlusion of as many receivers as you like.
///
/// ```
/// use glam::{DAffine3, DVec3, Vec3, dvec3};
/// use visfield::estimate::{Receiver, caps::{CapAmbient, CapScene, CapSettings}};
/// use visfield::scene::{Instance, Scene};
/// # let field = visfield::field::example_caps();
/// let mut scene = Scene::default();
/// let id = scene.add_field(field); // of a ball of radius 1
/// scene.instances.push(Instance::new(id, DAffine3::from_translation(dvec3(0.0, 2.0, 0.0))));
/// let caps = CapScene::new(&scene, DVec3::ZERO);
/// let receivers = [0.0, 100.0].map(|x| Receiver { position: dvec3(x, 0.0, 0.0), normal: Vec3::Y });
/// let mut ambient = [CapAmbient::UNOCCLUDED; 2];
/// caps.ambient_batch(&receivers, &CapSettings::default(), &mut ambient);
/// assert!((ambient[0].occlusion - 0.25).abs() < 0.02 && ambient[1].occlusion == 0.0);
/// ```
#[derive(Debug)]
pub struct CapScene<'a> {
    origin: DVec3,
    occluders: Vec<CapOccluder<'a>>,
    /// Rays of receivers that grids leave to them.
    inside_samples: Vec<Vec3>,
}

/// Receivers of a block.
const LANES: usize = 64;

impl<'a> CapScene<'a> {
    /// Places the instances whose field has a cap grid relative to `origin`, leaving out those whose transform is not
    /// invertible. Choose a point near the receivers: they are seen in single precision.
    pub fn new(scene: &'a Scene, origin: DVec3) -> Self {
        let placed = scene.place(origin).into_iter();
        let occluders =
            placed.filter_map(|(placement, field)| CapOccluder::new(placement, field, Wanted::CAPS)).collect();
        Self { origin, occluders, inside_samples: sphere_samples(INSIDE_RAYS) }
    }

    /// What one receiver gets. Where a grid is known to be wrong inside its box, receivers in there get rays, if the field
    /// answers them.
    pub fn ambient(&self, receiver: &Receiver, settings: &CapSettings) -> CapAmbient {
        let position = (receiver.position - self.origin).as_vec3();
        let found = ambient(&self.occluders, position, receiver.normal, settings);
        self.with_rays_inside(found, position, receiver.normal, settings)
    }

    /// What many receivers get, the same bit for bit and several times faster.
    ///
    /// # Panics
    /// If there are not as many answers as receivers.
    pub fn ambient_batch(&self, receivers: &[Receiver], settings: &CapSettings, answers: &mut [CapAmbient]) {
        assert_eq!(receivers.len(), answers.len(), "one answer per receiver");
        self.ask_grids(receivers, settings, answers);
        if self.occluders.iter().any(CapOccluder::has_rays_inside) {
            for (receiver, answer) in receivers.iter().zip(answers) {
                let position = (receiver.position - self.origin).as_vec3();
                *answer = self.with_rays_inside(*answer, position, receiver.normal, settings);
            }
        }
    }

    fn ask_grids(&self, receivers: &[Receiver], settings: &CapSettings, answers: &mut [CapAmbient]) {
        let work = Work { scene: self, receivers, settings, answers };
        match (settings.combination, settings.combination.directions()) {
            (CapCombination::Product, _) => Arch::new().dispatch(Combined::<_, 8, false>(work)),
            (CapCombination::SoftCaps { .. }, 8) => Arch::new().dispatch(Combined::<_, 8, true>(work)),
            (CapCombination::SoftCaps { .. }, _) => Arch::new().dispatch(Combined::<_, 16, true>(work)),
        }
    }
}

/// Rays per receiver and object that grids leave to them.
const INSIDE_RAYS: u32 = 64;

impl CapScene<'_> {
    /// Adds the occlusion of objects that leave this receiver to rays, or the share of it that they leave.
    fn with_rays_inside(&self, found: CapAmbient, position: Vec3, normal: Vec3, settings: &CapSettings) -> CapAmbient {
        let mut visibility = 1.0 - found.occlusion;
        for occluder in self.occluders.iter().filter(|occluder| occluder.has_rays_inside()) {
            let share = occluder.inside_share(position);
            if share > 0.0 {
                let facing = FacingOccluder::new(&occluder.placement, occluder.field, position, normal);
                let samples = self.inside_samples.iter();
                let directions = samples.map(|&sample| cosine_direction(normal, sample)).collect();
                visibility *=
                    1.0 - share * blocked_share(&[facing], directions, settings.max_distance, Bias::default());
            }
        }
        CapAmbient { occlusion: 1.0 - visibility, ..found }
    }
}

/// What one receiver gets of grids alone, relative to the origin that the occluders were placed by.
pub fn ambient(occluders: &[CapOccluder], position: Vec3, normal: Vec3, settings: &CapSettings) -> CapAmbient {
    let one = |v: Vec3| {
        let mut one = Vectors::<1>::ZERO;
        one.set(0, v);
        one
    };
    let (positions, normals) = (one(position), one(normal));
    let points = sphere_samples(settings.combination.directions() as u32);
    let [answer] = match (settings.combination, settings.combination.directions()) {
        (CapCombination::Product, _) => block::<1, 8, false>(occluders, &positions, &normals, settings, &points),
        (CapCombination::SoftCaps { .. }, 8) => block::<1, 8, true>(occluders, &positions, &normals, settings, &points),
        (CapCombination::SoftCaps { .. }, _) => {
            block::<1, 16, true>(occluders, &positions, &normals, settings, &points)
        }
    };
    answer
}

struct Work<'a> {
    scene: &'a CapScene<'a>,
    receivers: &'a [Receiver],
    settings: &'a CapSettings,
    answers: &'a mut [CapAmbient],
}

/// Work that is to be compiled for each kind of processor: over K directions, and whether objects are combined in each.
struct Combined<W, const K: usize, const SOFT: bool>(W);

impl<const K: usize, const SOFT: bool> NullaryFnOnce for Combined<Work<'_>, K, SOFT> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Work { scene, receivers, settings, answers } = self.0;
        let points = sphere_samples(K as u32);
        for (receivers, answers) in receivers.chunks(LANES).zip(answers.chunks_mut(LANES)) {
            let (mut positions, mut normals) = (Vectors::<LANES>::ZERO, Vectors::<LANES>::ZERO);
            for (lane, receiver) in receivers.iter().enumerate() {
                positions.set(lane, (receiver.position - scene.origin).as_vec3());
                normals.set(lane, receiver.normal);
            }
            let found = block::<LANES, K, SOFT>(&scene.occluders, &positions, &normals, settings, &points);
            answers.copy_from_slice(&found[..answers.len()]);
        }
    }
}

/// N receivers at once, over K directions, which are those from the normals to as many points of the sphere.
#[inline(always)]
fn block<const N: usize, const K: usize, const SOFT: bool>(
    occluders: &[CapOccluder],
    positions: &Vectors<N>,
    normals: &Vectors<N>,
    settings: &CapSettings,
    points: &[Vec3],
) -> [CapAmbient; N] {
    let mut unit_normals = Vectors::<N>::ZERO;
    for lane in 0..N {
        unit_normals.set(lane, unit(normals.get(lane)));
    }
    let normals = &unit_normals;
    let mut directions = [Vectors::<N>::ZERO; K];
    if SOFT || occluders.iter().any(|occluder| occluder.source.has_cones()) {
        for k in 0..K {
            for lane in 0..N {
                directions[k].set(lane, cosine_direction(normals.get(lane), points[k]));
            }
        }
    }
    // In each direction; objects that are not told apart by direction all in the first.
    let mut visible = [[1.0_f32; N]; K];
    let mut open = Vectors::<N>::ZERO;
    for lane in 0..N {
        open.set(lane, normals.get(lane) * MEAN_COSINE);
    }
    for occluder in occluders {
        let reach = reaches(&occluder.placement, positions, normals, settings);
        if reach.iter().all(|reach| *reach <= 0.0) {
            continue;
        }
        let mut soft = [[0.0; N]; K];
        let mut occlusion = [0.0; N];
        // What is left to cones.
        let mut left = [occluder.source.share_of_cones(|| 1.0); N];
        if let Some((cap, grid)) = occluder.grid.filter(|_| occluder.source.has_caps()) {
            let map = Map::new(&cap);
            let seen = Seen::new(grid, &map, positions);
            occlusion = occluder.grid_occlusion(&cap, &seen, &map, positions, normals);
            if occluder.source != OcclusionSource::CapGrid {
                for lane in 0..N {
                    left[lane] = grid.inside_share(seen.positions.get(lane));
                    occlusion[lane] *= 1.0 - left[lane];
                }
            }
            for lane in 0..N {
                occlusion[lane] = above_cutoff(occlusion[lane] * reach[lane]);
            }
            if SOFT {
                seen.soften(&map, &directions, &mut soft);
                distribute(&mut soft, &occlusion);
            } else {
                for lane in 0..N {
                    let towards = map.turned_back(seen.axes.get(lane));
                    open.set(lane, open.get(lane) - towards * occlusion[lane]);
                }
            }
        }
        if let Some(cones) = occluder.cones.filter(|_| occluder.source.has_cones()) {
            for lane in 0..N {
                left[lane] *= cone_reach(&occluder.placement, positions.get(lane), settings, reach[lane]);
                let receiver = ConeReceiver { position: positions.get(lane), normal: normals.get(lane) };
                if left[lane] > 0.0 {
                    let hidden = directions.each_ref().map(|direction| {
                        left[lane]
                            * cones.edge_occlusion(
                                &receiver,
                                &sky_disc::<K>(direction.get(lane), settings.max_distance),
                                settings.bias,
                            )
                    });
                    soft.iter_mut().zip(hidden).for_each(|(soft, hidden)| soft[lane] = (soft[lane] + hidden).min(1.0));
                    occlusion[lane] = (occlusion[lane] + hidden.iter().sum::<f32>() / K as f32).min(1.0);
                }
            }
        }
        if occlusion.iter().all(|occlusion| *occlusion <= 0.0) {
            continue;
        }
        if SOFT {
            for k in 0..K {
                for lane in 0..N {
                    visible[k][lane] *= 1.0 - soft[k][lane];
                }
            }
        } else {
            for lane in 0..N {
                visible[0][lane] *= 1.0 - occlusion[lane];
            }
        }
    }
    let visibility = if SOFT { mean(&visible) } else { visible[0] };
    if SOFT {
        // Few directions are not even around the normal: as much as is seen of what they lack is added.
        for lane in 0..N {
            open.set(lane, normals.get(lane) * (MEAN_COSINE * K as f32 * visibility[lane]));
        }
        for k in 0..K {
            for lane in 0..N {
                open.set(lane, open.get(lane) + directions[k].get(lane) * (visible[k][lane] - visibility[lane]));
            }
        }
    }
    let mut answers = [CapAmbient::UNOCCLUDED; N];
    for lane in 0..N {
        let bent_normal = bent_normal(open.get(lane), normals.get(lane));
        answers[lane] = CapAmbient { occlusion: 1.0 - visibility[lane], bent_normal };
    }
    answers
}

/// How far an object counts of which cones see all up to the maximum distance, and nothing beyond: in the mean over that part of its
/// depth, where `reach` is the mean over all of it.
fn cone_reach(placement: &Placement, position: Vec3, settings: &CapSettings, reach: f32) -> f32 {
    let nearest = ((placement.center - position).length() - placement.radius).max(0.0);
    let depth = (2.0 * placement.radius).min(settings.max_distance - nearest);
    if reach > 0.0 { settings.falloff.mean_weight(nearest, depth, settings.max_distance) } else { 0.0 }
}

/// One of `K` discs that fill a hemisphere.
fn sky_disc<const K: usize>(direction: Vec3, distance: f32) -> ConeDisc {
    let cosine = 1.0 - 1.0 / K as f32;
    ConeDisc { direction, tangent: (1.0 - cosine * cosine).sqrt() / cosine, distance }
}

impl CapOccluder<'_> {
    /// What N receivers get of its cap grid, and of its contact.
    #[inline(always)]
    fn grid_occlusion<const N: usize>(
        &self,
        cap: &CapPlacement,
        seen: &Seen<N>,
        map: &Map,
        positions: &Vectors<N>,
        normals: &Vectors<N>,
    ) -> [f32; N] {
        let mut occlusion = [0.0; N];
        for lane in 0..N {
            let normal = map.turned(normals.get(lane));
            occlusion[lane] = cap_occlusion(seen.harmonics(lane), &seen.cap(lane), normal);
        }
        if cap.stretched > 0.0 {
            let world_from_cap = cap.world_from_cap();
            for lane in 0..N {
                let in_world = seen.cap(lane).mapped(&world_from_cap);
                let mapped = cap_occlusion(in_world.harmonics(), &in_world, normals.get(lane));
                occlusion[lane] += (mapped - occlusion[lane]) * cap.stretched;
            }
        }
        if let Some(cones) = &self.cones {
            for lane in 0..N {
                occlusion[lane] = occlusion[lane].max(cones.contact(positions.get(lane), normals.get(lane)));
            }
        }
        occlusion
    }
}

/// The unit vector along what is open, above the surface; the normal itself if nothing is.
#[inline(always)]
fn bent_normal(open: Vec3, normal: Vec3) -> Vec3 {
    let above = open - normal * open.dot(normal).min(0.0);
    if above.dot(above) > SMALLEST_OPEN { unit(above) } else { unit(normal) }
}

/// Squared length below which what is open has no direction.
const SMALLEST_OPEN: f32 = 1.0e-6;

/// Mean cosine of the directions of a hemisphere, weighted by their cosine.
const MEAN_COSINE: f32 = 2.0 / 3.0;

/// A grid's place in plain numbers: `Affine3A` is made of short vectors, which do not become long ones.
struct Map {
    linear: Mat3,
    translation: Vec3,
    /// The linear part without its scale.
    turn: Mat3,
    /// Its transpose, which turns back.
    turn_back: Mat3,
    /// Whether turned unit vectors are unit vectors.
    even: bool,
}

impl Map {
    fn new(cap: &CapPlacement) -> Self {
        let linear = Mat3::from(cap.cap_from_world.matrix3);
        let squared = [linear.x_axis, linear.y_axis, linear.z_axis].map(Vec3::length_squared).iter().sum::<f32>() / 3.0;
        let turn = linear * (1.0 / squared.sqrt().max(f32::MIN_POSITIVE));
        let translation = cap.cap_from_world.translation.into();
        Self { linear, translation, turn, turn_back: turn.transpose(), even: cap.stretched <= 0.0 }
    }

    /// A unit vector of the world, in cap space.
    #[inline(always)]
    fn turned(&self, direction: Vec3) -> Vec3 {
        self.made_unit(self.turn * direction)
    }

    /// A unit vector of cap space, in the world.
    #[inline(always)]
    fn turned_back(&self, direction: Vec3) -> Vec3 {
        self.made_unit(self.turn_back * direction)
    }

    #[inline(always)]
    fn made_unit(&self, turned: Vec3) -> Vec3 {
        if self.even { turned } else { unit(turned) }
    }
}

/// What N receivers see of one object, in cap space.
struct Seen<const N: usize> {
    positions: Vectors<N>,
    harmonics: [[f32; N]; 4],
    axes: Vectors<N>,
    cosines: [f32; N],
    opacities: [f32; N],
}

impl<const N: usize> Seen<N> {
    #[inline(always)]
    fn new(grid: &CapGrid, map: &Map, positions: &Vectors<N>) -> Self {
        let mut local = Vectors::<N>::ZERO;
        for lane in 0..N {
            local.set(lane, map.linear * positions.get(lane) + map.translation);
        }
        let harmonics = grid.plane_of(&local, 0);
        let mut seen =
            Self { positions: local, harmonics, axes: Vectors::ZERO, cosines: [0.0; N], opacities: [0.0; N] };
        for lane in 0..N {
            let cap = Cap::new(seen.harmonics(lane));
            seen.axes.set(lane, cap.axis);
            (seen.cosines[lane], seen.opacities[lane]) = (cap.cosine, cap.opacity);
        }
        seen
    }

    #[inline(always)]
    fn harmonics(&self, lane: usize) -> Vec4 {
        let [o0, x, y, z] = &self.harmonics;
        Vec4::new(o0[lane], x[lane], y[lane], z[lane])
    }

    #[inline(always)]
    fn cap(&self, lane: usize) -> Cap {
        Cap { axis: self.axes.get(lane), cosine: self.cosines[lane], opacity: self.opacities[lane] }
    }

    /// How far each direction of the world is occluded.
    #[inline(always)]
    fn soften<const K: usize>(&self, map: &Map, directions: &[Vectors<N>; K], soft: &mut [[f32; N]; K]) {
        let softness = 1.0 - 0.7 / K as f32;
        for k in 0..K {
            for lane in 0..N {
                let direction = map.turned(directions[k].get(lane));
                soft[k][lane] = self.cap(lane).soft_occlusion(direction, softness);
            }
        }
    }
}

/// The unit vector in a direction; the zero vector has none.
#[inline(always)]
fn unit(v: Vec3) -> Vec3 {
    v * (1.0 / v.dot(v).sqrt().max(f32::MIN_POSITIVE))
}

/// [`reach_of`] for N receivers.
#[inline(always)]
fn reaches<const N: usize>(
    placement: &Placement,
    positions: &Vectors<N>,
    normals: &Vectors<N>,
    settings: &CapSettings,
) -> [f32; N] {
    let mut reach = [0.0; N];
    let mut reach_by = |falloff| {
        for lane in 0..N {
            let receiver = (positions.get(lane), normals.get(lane));
            reach[lane] = reach_of(placement, receiver, falloff, settings.max_distance);
        }
    };
    // The most common one by itself: exponentials keep a loop from becoming vector instructions.
    match settings.falloff {
        Falloff::Binary => reach_by(Falloff::Binary),
        other => reach_by(other),
    }
    reach
}

/// How far an object counts at a receiver: fading out as it leaves the maximum distance, and not at all where it is so far that
/// even its bounding sphere would hide less than the cutoff.
#[inline(always)]
fn reach_of(placement: &Placement, (position, normal): (Vec3, Vec3), falloff: Falloff, max_distance: f32) -> f32 {
    let to_center = placement.center - position;
    let (squared, radius) = (to_center.dot(to_center), placement.radius);
    let nearest = (squared.sqrt() - radius).max(0.0);
    let weight = falloff.mean_weight(nearest, 2.0 * radius, max_distance);
    // What lies wholly below the horizon hides nothing that counts, whatever a grid's few harmonics say.
    let counts = (radius * radius > CUTOFF * squared) & (to_center.dot(normal) > -radius);
    if counts { weight } else { 0.0 }
}

/// Scales the occlusion of each direction so that their mean is the object's, without exceeding 1.
#[inline(always)]
fn distribute<const N: usize, const K: usize>(soft: &mut [[f32; N]; K], occlusion: &[f32; N]) {
    for _ in 0..2 {
        let mut scale = mean(soft);
        for lane in 0..N {
            scale[lane] = occlusion[lane] / scale[lane].max(SMALLEST_MEAN);
        }
        for k in 0..K {
            for lane in 0..N {
                soft[k][lane] = (soft[k][lane] * scale[lane]).min(1.0);
            }
        }
    }
    // What is still missing goes evenly to what is left open.
    let mut share = mean(soft);
    for lane in 0..N {
        share[lane] = ((occlusion[lane] - share[lane]) / (1.0 - share[lane]).max(SMALLEST_MEAN)).clamp(0.0, 1.0);
    }
    for k in 0..K {
        for lane in 0..N {
            soft[k][lane] += (1.0 - soft[k][lane]) * share[lane];
        }
    }
}

/// Below this, a mean is no longer divided by.
const SMALLEST_MEAN: f32 = 1.0e-4;

/// Over all directions.
#[inline(always)]
fn mean<const N: usize, const K: usize>(values: &[[f32; N]; K]) -> [f32; N] {
    let mut sum = [0.0; N];
    for k in 0..K {
        for lane in 0..N {
            sum[lane] += values[k][lane];
        }
    }
    sum.map(|sum| sum / K as f32)
}
