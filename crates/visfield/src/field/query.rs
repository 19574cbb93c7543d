//! Single rays against one table, in field space (the bounding ellipsoid is the unit sphere).

use glam::Vec3;

use super::chord::{Chord, chord};
use super::lookup::{Aim, ChordGrid, Lookup, forward_lookup, reversed_lookup};
use super::octahedral::cell_width;
use super::table::ChordTable;

/// A ray, or a segment of one: the points `origin + t·direction` with t in [0, `t_max`).
///
/// The direction needs no normalisation: t counts direction vectors. Any values are allowed; what is not a ray (a zero or
/// non-finite direction, a non-finite origin, a NaN for an end) hits nothing.
///
/// ```
/// use glam::{Vec3, vec3};
/// use visfield::Ray;
/// let ray = Ray::new(vec3(-3.0, 0.0, 0.0), Vec3::X);
/// assert_eq!(ray.t_max, f32::INFINITY);
/// let segment = Ray { t_max: 2.0, ..ray };
/// # _ = segment;
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts.
    pub origin: Vec3,
    /// Where it goes, of any length.
    pub direction: Vec3,
    /// Where it ends, in direction vectors; may be infinite.
    pub t_max: f32,
}

impl Ray {
    /// A ray without end.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, t_max: f32::INFINITY }
    }

    /// The same points with a direction whose square neither overflows nor vanishes, and how many of its vectors make one
    /// of the old ones. A power of two, so that nothing is rounded.
    #[inline]
    pub(crate) fn rescaled(&self) -> (Self, f32) {
        let largest = self.direction.abs().max_element();
        if is_ordinary(self.direction) || !(largest > 0.0 && largest.is_finite()) {
            return (*self, 1.0);
        }
        // The exponent's bits of a subnormal number are 0; then the smallest power of two whose inverse is finite will do.
        let exponent = (largest.to_bits() >> 23).clamp(1, 253);
        let power_of_two = |exponent: u32| f32::from_bits(exponent << 23);
        let (scale, inverse) = (power_of_two(exponent), power_of_two(254 - exponent));
        let direction = self.direction * inverse;
        (Self { direction, t_max: self.t_max * scale, ..*self }, scale)
    }
}

/// Whether a direction can be squared without trouble.
#[inline(always)]
pub(super) fn is_ordinary(direction: Vec3) -> bool {
    let Vec3 { x, y, z } = direction.abs();
    let largest = x.max(y).max(z);
    (1.0e-12..=1.0e12).contains(&largest)
}

/// How a field answers a ray.
///
/// ```
/// use visfield::field::{lookup::Aim, query::QueryOptions};
/// let fast = QueryOptions { aim: Aim::Plain, ..QueryOptions::default() };
/// assert_eq!(fast.normal, glam::Vec3::ZERO);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct QueryOptions {
    /// How rays are snapped to the chords of the table.
    pub aim: Aim,
    /// The unit normal, in field space, of the surface that the rays leave, or zero if they leave none.
    pub normal: Vec3,
    /// How near to the origin hits do not count, for origins inside the bounds.
    pub bias: Bias,
}

/// How near to the surface that a ray leaves hits do not count.
///
/// A reversed lookup recovers the surface under the origin only to within the table's own resolution, so without a bias
/// surfaces shadow themselves. But where the *stored* chord ends is known exactly, and so is its distance from the tangent
/// plane at the origin: a surface that is flat over the width of a cell never rises above its own plane, at whatever angle
/// the ray leaves it (for shadow maps: Isidoro, *Shadow Mapping: GPU-based Tips and Techniques*, 2006, receiver plane depth
/// bias). What is left for the bias to cover is curvature and quantisation. It is made of what the resolution is made of,
/// never of an absolute length.
///
/// ```
/// use visfield::{Encoding, field::query::{Bias, Resolution}};
/// let (bias, resolution) = (Bias::default(), Resolution { exits: 32, half_quantum: Encoding::U8.half_quantum() });
/// // Near the far end of a long chord the exit cell spreads wider than near its start.
/// assert!(bias.height(resolution, 1.8, 2.0) > bias.height(resolution, 0.2, 2.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bias {
    /// Height above the tangent plane in spreads of the exit cell: covers curvature below the grid.
    pub height: f32,
    /// Distance along the ray in spreads of the exit cell.
    pub along: f32,
}

impl Bias {
    /// No more than quantisation: for rays that do not start on the occluder.
    pub const NONE: Self = Self { height: 0.0, along: 0.0 };

    /// The least height above the tangent plane, in field-space length, for an origin that lies `before` along a stored
    /// chord of `length`.
    #[inline(always)]
    pub fn height(&self, resolution: Resolution, before: f32, length: f32) -> f32 {
        length * resolution.half_quantum + exit_spread(resolution, before, length) * self.height
    }

    /// The least distance along the ray, likewise.
    #[inline(always)]
    pub fn along(&self, resolution: Resolution, before: f32, length: f32) -> f32 {
        length * resolution.half_quantum + exit_spread(resolution, before, length) * self.along
    }
}

impl Default for Bias {
    /// Near the least error over meshes from smooth to thin-walled; the bake crate's test `own_surface` bounds it.
    fn default() -> Self {
        Self { height: 0.15, along: 0.25 }
    }
}

/// How finely a table knows where a chord ends and where it is hit.
///
/// ```
/// # let field = visfield::field::example_field();
/// assert_eq!(field.table().unwrap().resolution().half_quantum, 0.5 / 254.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resolution {
    /// Side of the grid of chord ends.
    pub exits: u32,
    /// Half a step of the chord fraction.
    pub half_quantum: f32,
}

/// How wide the chords of one exit cell spread, where they have come `before` of their `length`.
#[inline(always)]
fn exit_spread(resolution: Resolution, before: f32, length: f32) -> f32 {
    cell_width(resolution.exits) * before / length.max(f32::MIN_POSITIVE)
}

impl ChordTable {
    /// [`VisibilityField::hit`](super::VisibilityField::hit)
    #[inline]
    pub(super) fn hit(&self, ray: &Ray, options: &QueryOptions) -> Option<f32> {
        let (rescaled, scale) = ray.rescaled();
        let t = self.known_hit(&rescaled, options, true)? / scale;
        // Scaling back may leave the range of f32, or round up to the end.
        Some(t.min(ray.t_max.next_down()))
    }

    /// [`VisibilityField::distance`](super::VisibilityField::distance)
    #[inline]
    pub(super) fn distance(&self, ray: &Ray, options: &QueryOptions) -> f32 {
        let (ray, _) = ray.rescaled();
        self.known_hit(&ray, options, true).map_or(f32::INFINITY, |t| finite(t * ray.direction.length()))
    }

    /// [`VisibilityField::occluded`](super::VisibilityField::occluded)
    #[inline]
    pub(super) fn occluded(&self, ray: &Ray, options: &QueryOptions) -> bool {
        let (ray, _) = ray.rescaled();
        self.known_hit(&ray, options, false).is_some()
    }

    /// [`VisibilityField::last_hit`](super::VisibilityField::last_hit)
    #[inline]
    pub(super) fn last_hit(&self, ray: &Ray, aim: Aim) -> Option<f32> {
        let (ray, scale) = ray.rescaled();
        let c = chord(ray.origin, ray.direction)?;
        let lookup = reversed_lookup(&self.grid(), ray.origin, ray.direction, &c, aim);
        let fraction = self.codes().fraction(lookup.index)?;
        Some(finite((lookup.before - fraction * lookup.length) / ray.direction.length() / scale))
    }

    /// A hit along the ray, if there is one: the first that is known if `nearest`, else any.
    #[inline(always)]
    fn known_hit(&self, ray: &Ray, options: &QueryOptions, nearest: bool) -> Option<f32> {
        let Ray { origin, direction, t_max } = *ray;
        let c = chord(origin, direction)?;
        if c.t_exit() <= 0.0 || c.t_entry() >= t_max {
            return None;
        }
        let first_hit = || self.first_hit_on_chord(direction, &c, options.aim);
        if c.t_entry() >= 0.0 {
            return first_hit().filter(|t| *t < t_max).map(not_behind);
        }
        let lookup = reversed_lookup(&self.grid(), origin, direction, &c, options.aim);
        let fraction = self.codes().fraction(lookup.index)?;
        let length = direction.length();
        let t_last = (lookup.before - fraction * lookup.length) / length;
        let t_bias = not_behind(options.bias.along(self.resolution(), lookup.before, lookup.length) / length);
        if t_last <= t_bias || !rises_above(self.resolution(), &lookup, fraction, origin, options) {
            return None;
        }
        if t_last < t_max && !nearest {
            return Some(t_last);
        }
        first_hit().filter(|t| *t > t_bias && *t < t_max).or((t_last < t_max).then_some(t_last))
    }

    #[inline(always)]
    fn first_hit_on_chord(&self, direction: Vec3, chord: &Chord, aim: Aim) -> Option<f32> {
        let lookup = forward_lookup(&self.grid(), direction, chord, aim);
        let past_middle = self.codes().fraction(lookup.index)? * lookup.length - lookup.before;
        Some(chord.t_middle + past_middle / direction.length())
    }

    /// How finely the table knows where chords end and are hit.
    #[inline]
    pub fn resolution(&self) -> Resolution {
        Resolution { exits: self.grid().exit_side(), half_quantum: self.encoding().half_quantum() }
    }
}

/// A ray parameter, or the origin's for what is behind it: the snapped chord of a ray that starts at the bounds may start, and
/// be hit, a little before the ray does. No bias reaches behind the origin either; one that is NaN is none.
#[inline(always)]
pub(super) fn not_behind(t: f32) -> f32 {
    // Unlike `max` it decides between zeros of either sign, as a batch must too.
    if t > 0.0 { t } else { 0.0 }
}

/// The nearest number to one that left the range of f32: infinity would stand for no hit.
#[inline(always)]
pub(crate) fn finite(x: f32) -> f32 {
    x.clamp(f32::MIN, f32::MAX)
}

/// Whether a hit rises above the surface that the ray leaves, by more than the bias.
#[inline(always)]
#[expect(clippy::needless_bitwise_bool, reason = "without a branch, for loops over many rays")]
pub(super) fn rises_above(
    resolution: Resolution,
    lookup: &Lookup,
    fraction: f32,
    origin: Vec3,
    options: &QueryOptions,
) -> bool {
    let height = (lookup.point_on_chord(fraction) - origin).dot(options.normal);
    let least = options.bias.height(resolution, lookup.before, lookup.length);
    (options.normal == Vec3::ZERO) | (height > least)
}
