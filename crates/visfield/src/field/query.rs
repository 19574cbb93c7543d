//! Rays against one field, in field space (the bounding sphere is the unit sphere).

use glam::Vec3;

use super::chord::{Chord, chord};
use super::lookup::{Lookup, forward_lookup, reversed_lookup};
use super::octahedral::cell_width;
use super::{VisibilityField, decode_u8};

/// How near to its origin a ray's hits do not count.
///
/// A reversed lookup recovers the surface under the origin only to within the table's own resolution, so without a bias
/// surfaces shadow themselves. The bias is made of what the resolution is made of, never of an absolute length: half a
/// quantum of the chord, plus the sideways spread of the exit cell at the origin times the slope at which the ray leaves
/// its surface (as shadow maps scale theirs).
///
/// ```
/// let bias = visfield::field::query::Bias::default();
/// // A ray along the normal needs less than a grazing one.
/// assert!(bias.distance(32, 1.0, 2.0, 1.0) < bias.distance(32, 1.0, 2.0, 0.2));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bias {
    /// Exit-cell spreads that are skipped for a ray along the surface normal. Covers curvature below the grid.
    pub constant: f32,
    /// Exit-cell spreads that are skipped per unit of slope (tangent of the angle to the normal).
    pub slope: f32,
}

impl Bias {
    /// No bias: for rays that do not start on the occluder.
    pub const NONE: Self = Self { constant: 0.0, slope: 0.0 };
    /// Slopes above this do not increase the bias further.
    pub const MAX_SLOPE: f32 = 4.0;

    /// The bias in field-space length for an origin that lies `before` along a stored chord of `length`; `cosine` is
    /// between the ray and the surface normal.
    #[inline]
    pub fn distance(&self, exits: u32, before: f32, length: f32, cosine: f32) -> f32 {
        let c = cosine.clamp(0.05, 1.0);
        let slope = ((1.0 - c * c).sqrt() / c).min(Self::MAX_SLOPE);
        let spread = cell_width(exits) * before / length.max(f32::MIN_POSITIVE);
        length * HALF_QUANTUM + spread * (self.constant + self.slope * slope)
    }
}

impl Default for Bias {
    /// The least mean error of own-surface ambient occlusion over nine meshes, from smooth to thin-walled.
    fn default() -> Self {
        Self { constant: 0.5, slope: 0.5 }
    }
}

/// Half a step of the chord fraction.
const HALF_QUANTUM: f32 = 0.5 / 254.0;

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
    /// `cosine` is between the ray and the normal of the surface it leaves (1 if it leaves none); `t_max` may be infinite.
    /// An origin outside the sphere asks forwards. An origin inside asks backwards, from the far side: the ray is occluded
    /// iff the last hit lies beyond the bias; forward lookups there are blocked by whatever is nearer and only decide
    /// whether a *segment* ends before its first hit.
    ///
    /// ```
    /// use glam::vec3;
    /// use visfield::field::query::Bias;
    /// # let field = visfield::field::example_field();
    /// let occluded = |x: f32, t_max: f32| {
    ///     field.occluded(vec3(x, 0.0, 0.0), vec3(1.0, 0.0, 0.0), t_max, 1.0, Bias::default())
    /// };
    /// assert!(occluded(-3.0, f32::INFINITY)); // outside, the ball ahead
    /// assert!(!occluded(-3.0, 2.0)); // too short to reach it
    /// assert!(occluded(-0.8, f32::INFINITY)); // inside the bounding sphere, the ball ahead
    /// assert!(!occluded(0.8, f32::INFINITY)); // and behind
    /// ```
    #[inline]
    pub fn occluded(&self, origin: Vec3, direction: Vec3, t_max: f32, cosine: f32, bias: Bias) -> bool {
        let Some(c) = chord(origin, direction) else { return false };
        if c.t_exit() <= 0.0 || c.t_entry() >= t_max {
            return false;
        }
        if c.t_entry() >= 0.0 {
            return self.first_hit_on_chord(direction, &c).is_some_and(|t| t < t_max);
        }
        let lookup = reversed_lookup(self.shape(), origin, direction, &c);
        let Some(fraction) = self.fraction(&lookup) else { return false };
        let scale = 1.0 / direction.length();
        let t_last = (lookup.before - fraction * lookup.length) * scale;
        let t_bias = bias.distance(self.shape().exits, lookup.before, lookup.length, cosine) * scale;
        if t_last <= t_bias {
            return false;
        }
        t_last < t_max || self.first_hit_on_chord(direction, &c).is_some_and(|t| t > t_bias && t < t_max)
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
