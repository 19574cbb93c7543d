//! Rays against one field, in field space (the bounding sphere is the unit sphere).

use glam::Vec3;

use super::chord::{Chord, chord};
use super::lookup::{Lookup, forward_lookup, point_on_chord, reversed_lookup};
use super::octahedral::cell_width;
use super::{VisibilityField, decode_u8};

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
/// let bias = visfield::field::query::Bias::default();
/// // Near the far end of a long chord the exit cell spreads wider than near its start.
/// assert!(bias.height(32, 1.8, 2.0) > bias.height(32, 0.2, 2.0));
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
    #[inline]
    pub fn height(&self, exits: u32, before: f32, length: f32) -> f32 {
        length * HALF_QUANTUM + exit_spread(exits, before, length) * self.height
    }

    /// The least distance along the ray, likewise.
    #[inline]
    pub fn along(&self, exits: u32, before: f32, length: f32) -> f32 {
        length * HALF_QUANTUM + exit_spread(exits, before, length) * self.along
    }
}

impl Default for Bias {
    /// Near the least error over meshes from smooth to thin-walled; the bake crate's test `own_surface` bounds it.
    fn default() -> Self {
        Self { height: 0.15, along: 0.25 }
    }
}

/// Half a step of the chord fraction.
const HALF_QUANTUM: f32 = 0.5 / 254.0;

/// How wide the chords of one exit cell spread, where they have come `before` of their `length`.
#[inline]
fn exit_spread(exits: u32, before: f32, length: f32) -> f32 {
    cell_width(exits) * before / length.max(f32::MIN_POSITIVE)
}

impl VisibilityField {
    /// Where the line `origin + t·direction` first meets the mesh after entering the bounding sphere, as the ray parameter
    /// t. Meant for origins outside the sphere; from inside it answers for the whole line.
    ///
    /// ```
    /// # let field = visfield::field::example_field();
    /// let t = field.first_hit(glam::vec3(0.0, 0.0, 4.0), glam::vec3(0.0, 0.0, -2.0)).unwrap();
    /// assert!((t - 1.75).abs() < 0.05); // a ball of radius 1/2; t counts direction vectors
    /// ```
    #[inline]
    pub fn first_hit(&self, origin: Vec3, direction: Vec3) -> Option<f32> {
        self.first_hit_on_chord(direction, &chord(origin, direction)?)
    }

    /// Where the line `origin + t·direction` last meets the mesh before leaving the bounding sphere, as the ray parameter
    /// t: the reversed lookup of the 2010 paper (§3.2, *intra-object occlusion*). Meant for origins inside the sphere.
    #[inline]
    pub fn last_hit(&self, origin: Vec3, direction: Vec3) -> Option<f32> {
        let c = chord(origin, direction)?;
        let lookup = reversed_lookup(self.shape(), origin, direction, &c);
        Some((lookup.before - self.fraction(&lookup)? * lookup.length) / direction.length())
    }

    /// Whether anything lies between the origin and `t_max` along the ray.
    ///
    /// `normal` is the unit normal, in field space, of the surface that the ray leaves, or zero if it leaves none; `t_max`
    /// may be infinite. An origin outside the sphere asks forwards. An origin inside asks backwards, from the far side: the
    /// ray is occluded iff the last hit lies beyond the bias. For a *segment* that ends before the last hit, the forward
    /// lookup decides; from inside it is blocked by whatever lies behind the origin, so that a short segment from the
    /// mesh's own surface may miss what it should hit. A table knows lines, not points within them.
    ///
    /// ```
    /// use glam::{Vec3, vec3};
    /// use visfield::field::query::Bias;
    /// # let field = visfield::field::example_field();
    /// let occluded = |x: f32, t_max: f32| {
    ///     field.occluded(vec3(x, 0.0, 0.0), vec3(1.0, 0.0, 0.0), t_max, Vec3::ZERO, Bias::default())
    /// };
    /// assert!(occluded(-3.0, f32::INFINITY)); // outside, the ball ahead
    /// assert!(!occluded(-3.0, 2.0)); // too short to reach it
    /// assert!(occluded(-0.8, f32::INFINITY)); // inside the bounding sphere, the ball ahead
    /// assert!(!occluded(0.8, f32::INFINITY)); // and behind
    /// ```
    #[inline]
    pub fn occluded(&self, origin: Vec3, direction: Vec3, t_max: f32, normal: Vec3, bias: Bias) -> bool {
        let Some(c) = chord(origin, direction) else { return false };
        if c.t_exit() <= 0.0 || c.t_entry() >= t_max {
            return false;
        }
        let forward = || self.first_hit_on_chord(direction, &c);
        if c.t_entry() >= 0.0 {
            return forward().is_some_and(|t| t < t_max);
        }
        let lookup = reversed_lookup(self.shape(), origin, direction, &c);
        let Some(fraction) = self.fraction(&lookup) else { return false };
        let length = direction.length();
        let t_last = (lookup.before - fraction * lookup.length) / length;
        let t_bias = bias.along(self.shape().exits, lookup.before, lookup.length) / length;
        if t_last <= t_bias || !self.rises_above(&lookup, fraction, origin, normal, bias) {
            return false;
        }
        t_last < t_max || forward().is_some_and(|t| t > t_bias && t < t_max)
    }

    /// Whether a hit rises above the surface that the ray leaves, by more than the bias.
    #[inline]
    fn rises_above(&self, lookup: &Lookup, fraction: f32, origin: Vec3, normal: Vec3, bias: Bias) -> bool {
        let height = (point_on_chord(self.shape(), lookup.index, fraction) - origin).dot(normal);
        normal == Vec3::ZERO || height > bias.height(self.shape().exits, lookup.before, lookup.length)
    }

    #[inline]
    fn first_hit_on_chord(&self, direction: Vec3, chord: &Chord) -> Option<f32> {
        let lookup = forward_lookup(self.shape(), direction, chord);
        let past_middle = self.fraction(&lookup)? * lookup.length - lookup.before;
        Some(chord.t_middle + past_middle / direction.length())
    }

    #[inline]
    fn fraction(&self, lookup: &Lookup) -> Option<f32> {
        decode_u8(self.table[lookup.index as usize])
    }
}
