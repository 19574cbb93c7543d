//! The same rays through a field and through triangles, timed in turn.

use std::hint::black_box;
use std::ops::Range;
use std::time::{Duration, Instant};

use glam::{DAffine3, DVec3, Vec3};
use visfield::estimate::Receiver;
use visfield::field::chord::chord;
use visfield::scene::Placement;
use visfield::{QueryOptions, Ray, VisibilityField};

use crate::triangles::{PreparedRay, TriangleBvh};

/// How often everything is timed; the median counts.
const REPEATS: usize = 5;

/// How long a timing lasts at least.
const SHORTEST: Duration = Duration::from_millis(50);

/// Rays of one receiver after another, ready for both opponents.
pub(super) struct RaySet {
    /// In field space.
    pub(super) field: Vec<Ray>,
    /// In mesh space.
    pub(super) exact: Vec<PreparedRay>,
    /// For each receiver its rays, and how the field is asked.
    pub(super) receivers: Vec<(Range<usize>, QueryOptions)>,
}

impl RaySet {
    /// `start` lifts a receiver off its surface for exact rays; `directions` are a receiver's rays in mesh space.
    pub(super) fn new(
        triangles: &TriangleBvh,
        field: &VisibilityField,
        options: QueryOptions,
        receivers: &[Receiver],
        directions: impl Fn(&Receiver, usize) -> Vec<Vec3>,
        start: impl Fn(&Receiver) -> Vec3,
    ) -> Self {
        let asked = AskedField::new(field);
        let mut set = Self { field: Vec::new(), exact: Vec::new(), receivers: Vec::new() };
        for (index, receiver) in receivers.iter().enumerate() {
            let first = set.field.len();
            let origin = asked.origin(receiver);
            for direction in directions(receiver, index) {
                let exact = triangles.prepare(start(receiver), direction, 0.0, f32::INFINITY);
                set.exact.push(exact.expect("directions are unit vectors"));
                set.field.push(Ray::new(origin, asked.direction(direction)));
            }
            let normal = asked.normal(receiver);
            set.receivers.push((first..set.field.len(), QueryOptions { normal, ..options }));
        }
        set
    }

    /// Only the rays that meet the field's bounds, ahead of their origins.
    pub(super) fn meeting_bounds(&self) -> Self {
        let mut set = Self { field: Vec::new(), exact: Vec::new(), receivers: Vec::new() };
        for (range, options) in &self.receivers {
            let first = set.field.len();
            for i in range.clone().filter(|&i| meets_bounds(&self.field[i])) {
                set.field.push(self.field[i]);
                set.exact.push(self.exact[i]);
            }
            set.receivers.push((first..set.field.len(), *options));
        }
        set
    }

    /// Answers of the field.
    pub(super) fn field_answers(&self, field: &VisibilityField) -> Vec<bool> {
        let mut occluded = self.unanswered();
        self.ask_field(field, &mut occluded);
        occluded
    }

    /// Answers of the triangles.
    pub(super) fn exact_answers(&self, triangles: &TriangleBvh) -> Vec<bool> {
        let mut occluded = self.unanswered();
        self.ask_triangles(triangles, &mut occluded);
        occluded
    }

    /// Room for the answers to all rays.
    pub(super) fn unanswered(&self) -> Vec<bool> {
        vec![false; self.field.len()]
    }

    pub(super) fn ask_field(&self, field: &VisibilityField, occluded: &mut [bool]) {
        // Receivers with one normal make one batch.
        for alike in self.receivers.chunk_by(|(_, a), (_, b)| a == b) {
            let range = alike[0].0.start..alike[alike.len() - 1].0.end;
            field.occluded_batch(&self.field[range.clone()], &alike[0].1, &mut occluded[range]);
        }
    }

    pub(super) fn ask_triangles(&self, triangles: &TriangleBvh, occluded: &mut [bool]) {
        for (occluded, ray) in occluded.iter_mut().zip(&self.exact) {
            *occluded = triangles.occluded_prepared(ray);
        }
    }

    /// Median seconds of one thread for all rays: through the field, and through the triangles.
    pub(super) fn race(&self, field: &VisibilityField, triangles: &TriangleBvh) -> (f64, f64) {
        let [mut by_field, mut by_triangles] = [self.unanswered(), self.unanswered()];
        let mut ask_field = || self.ask_field(field, black_box(&mut by_field));
        let mut ask_triangles = || self.ask_triangles(triangles, black_box(&mut by_triangles));
        race([&mut ask_field, &mut ask_triangles]).into()
    }
}

/// Whether a ray in field space meets the field's bounds ahead of its origin.
pub(super) fn meets_bounds(ray: &Ray) -> bool {
    chord(ray.origin, ray.direction).is_some_and(|chord| chord.t_exit() > 0.0)
}

/// A field in the space of its mesh, asked near the mesh's own centre: neither where the mesh lies nor its units cost digits.
pub(crate) struct AskedField {
    placement: Placement,
    center: DVec3,
}

impl AskedField {
    pub(crate) fn new(field: &VisibilityField) -> Self {
        let bounds = &field.header().bounds;
        let center = DVec3::from(bounds.center.map(f64::from));
        let placement = Placement::new(bounds, DAffine3::IDENTITY, center);
        Self { placement: placement.expect("the bounds of a field have a volume"), center }
    }

    pub(crate) fn origin(&self, receiver: &Receiver) -> Vec3 {
        self.placement.field_from_world.transform_point3((receiver.position - self.center).as_vec3())
    }

    /// A linear map keeps the ray parameter.
    pub(crate) fn direction(&self, direction: Vec3) -> Vec3 {
        self.placement.field_from_world.transform_vector3(direction)
    }

    pub(crate) fn normal(&self, receiver: &Receiver) -> Vec3 {
        self.placement.field_normal(receiver.normal)
    }
}

/// Random ones of a field's bytes per second: what lookups with nothing to compute and no coherence would do.
pub(super) fn gather_limit(bytes: &[u8]) -> f64 {
    // A multiplicative generator over all of them; which one does not matter as long as nobody can predict it.
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let positions: Vec<u32> = (0..1 << 20)
        .map(|_| {
            state = state.wrapping_mul(0xD129_0D3F_8F2B_7A55).wrapping_add(1);
            ((u128::from(state) * bytes.len() as u128) >> 64) as u32
        })
        .collect();
    let gather = || positions.iter().fold(0_u32, |sum, &at| sum.wrapping_add(bytes[at as usize].into()));
    positions.len() as f64 / median_seconds(gather)
}

/// Median [`seconds`] of each work, in turn: what slows the machine down for a while slows all of them down.
pub(super) fn race<const N: usize>(mut works: [&mut dyn FnMut(); N]) -> [f64; N] {
    race_all(&mut works).try_into().expect("a time for each work")
}

/// [`race`] of any number of works.
pub(super) fn race_all(works: &mut [&mut dyn FnMut()]) -> Vec<f64> {
    let mut times = vec![Vec::new(); works.len()];
    for _ in 0..REPEATS {
        for (work, times) in works.iter_mut().zip(&mut times) {
            times.push(seconds(work));
        }
    }
    times.into_iter().map(median).collect()
}

/// Median [`seconds`] of some work by itself.
pub(super) fn median_seconds<T>(mut work: impl FnMut() -> T) -> f64 {
    median((0..REPEATS).map(|_| seconds(&mut work)).collect())
}

/// Seconds that some work takes, on average of as many runs as fill a while: what runs for a millisecond would otherwise
/// mostly measure what ran before it.
pub(super) fn seconds<T>(mut work: impl FnMut() -> T) -> f64 {
    let start = Instant::now();
    for runs in 1.. {
        black_box(work());
        let elapsed = start.elapsed();
        if elapsed >= SHORTEST {
            return elapsed.as_secs_f64() / f64::from(runs);
        }
    }
    unreachable!("time passes")
}

/// The middle one.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
