//! How much a hit counts by its distance.

/// How ambient occlusion fades with the distance of what occludes: the weight of a hit, from 1 to 0, up to a maximum distance D
/// beyond which nothing counts.
///
/// With rays, each ray has a reach of its own, drawn so that as many rays reach a hit as the hit's weight says. The mean is that
/// of weighted rays, at the cost of plain ones.
///
/// ```
/// use visfield::estimate::Falloff;
/// assert_eq!(Falloff::Linear.weight(0.5, 2.0), 0.75);
/// assert_eq!(Falloff::Binary.weight(0.5, 2.0), 1.0);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Falloff {
    /// 1 up to D.
    #[default]
    Binary,
    /// From 1 at the receiver evenly to 0 at D.
    Linear,
    /// Obscurance, e^(−`tau`·distance) (2012, eq. 3.23, as occlusion).
    Obscurance {
        /// Per world unit; above 0.
        tau: f32,
    },
}

/// Smallest exponent of which the exponential is taken.
const SMALLEST_EXPONENT: f32 = 0.01;

impl Falloff {
    /// The weight of a hit at a distance, in world units.
    pub fn weight(self, distance: f32, max_distance: f32) -> f32 {
        let within = f32::from(distance < max_distance);
        within
            * match self {
                Self::Binary => 1.0,
                Self::Linear => (1.0 - distance / max_distance).max(0.0),
                Self::Obscurance { tau } => (-tau * distance).exp(),
            }
    }

    /// How far a ray reaches: a hit beyond it does not count. `level`, from 0 to 1, is the share of rays that reach less far.
    pub fn reach(self, level: f32, max_distance: f32) -> f32 {
        match self {
            Self::Binary => max_distance,
            Self::Linear => max_distance * (1.0 - level),
            // A level of 1 reaches nothing, and one of 0 everything.
            Self::Obscurance { tau } => (-level.max(f32::MIN_POSITIVE).ln() / tau).min(max_distance),
        }
    }

    /// The mean weight of what lies between two distances.
    #[inline(always)]
    pub(super) fn mean_weight(self, nearest: f32, depth: f32, max_distance: f32) -> f32 {
        let within = (max_distance - nearest).clamp(0.0, depth);
        match self {
            Self::Binary => within / depth,
            Self::Linear => {
                let middle = nearest + 0.5 * within;
                within / depth * (1.0 - middle / max_distance.max(f32::MIN_POSITIVE)).max(0.0)
            }
            Self::Obscurance { tau } => {
                let x = tau * within;
                // Where the difference from 1 would be lost in rounding, the first terms of its series.
                let faded = if x < SMALLEST_EXPONENT { 1.0 - x * (0.5 - x / 6.0) } else { (1.0 - (-x).exp()) / x };
                (-tau * nearest).exp() * (within / depth) * faded
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_rays_reach_a_hit_as_its_weight_says() {
        for falloff in [Falloff::Binary, Falloff::Linear, Falloff::Obscurance { tau: 0.7 }] {
            for distance in [0.1, 0.5, 1.5, 2.9, 3.1] {
                let reaching = (0..1000).filter(|i| falloff.reach((*i as f32 + 0.5) / 1000.0, 3.0) > distance).count();
                let weight = falloff.weight(distance, 3.0);
                assert!((reaching as f32 / 1000.0 - weight).abs() < 0.002, "{falloff:?} at {distance}: {reaching}");
            }
        }
    }

    #[test]
    fn mean_weights_are_means_of_weights() {
        for falloff in [Falloff::Binary, Falloff::Linear, Falloff::Obscurance { tau: 0.7 }] {
            for (nearest, depth) in [(0.0, 1.0e-6), (0.0, 0.5), (0.5, 2.0), (2.0, 3.0), (4.0, 1.0)] {
                let at = |i: i32| falloff.weight(nearest + depth * (i as f32 + 0.5) / 1000.0, 3.0);
                let mean = (0..1000).map(at).sum::<f32>() / 1000.0;
                let found = falloff.mean_weight(nearest, depth, 3.0);
                assert!((found - mean).abs() < 0.002, "{falloff:?} from {nearest} by {depth}: {found}, {mean}");
            }
        }
    }
}
