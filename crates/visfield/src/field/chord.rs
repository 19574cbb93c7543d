//! The chord: the part of a ray inside the unit sphere.

use glam::Vec3;

/// The part of the line `origin + t·direction` inside the unit sphere, described from its middle.
///
/// ```
/// use glam::vec3;
/// use visfield::field::chord::chord;
/// let c = chord(vec3(-3.0, 0.0, 0.0), vec3(2.0, 0.0, 0.0)).unwrap();
/// assert_eq!((c.t_entry(), c.t_exit()), (1.0, 2.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chord {
    /// The middle of the chord: the point of the line nearest to the sphere's centre.
    pub middle: Vec3,
    /// The ray parameter of the middle.
    pub t_middle: f32,
    /// Half the chord's extent in the ray parameter, above 0.
    pub t_half: f32,
}

impl Chord {
    /// The ray parameter where the line enters the sphere.
    #[inline(always)]
    pub fn t_entry(&self) -> f32 {
        self.t_middle - self.t_half
    }

    /// The ray parameter where the line leaves the sphere.
    #[inline(always)]
    pub fn t_exit(&self) -> f32 {
        self.t_middle + self.t_half
    }
}

/// The chord of the line `origin + t·direction`, or `None` if the line passes the unit sphere by. The direction needs no
/// normalisation.
#[inline(always)]
pub fn chord(origin: Vec3, direction: Vec3) -> Option<Chord> {
    let chord = line_chord(origin, direction);
    // A NaN from a zero direction fails this test too.
    (chord.t_half > 0.0).then_some(chord)
}

/// The same without a branch: `t_half` is not above 0, maybe NaN, for a line that passes by.
///
/// The stable form of Haines et al., *Precision Improvements for Ray/Sphere Intersection* (Ray Tracing Gems, ch. 7):
/// first the nearest point to the centre, then the half-length from its remaining distance. `b² − 4ac` is never formed.
#[inline(always)]
pub(super) fn line_chord(origin: Vec3, direction: Vec3) -> Chord {
    let a = direction.dot(direction);
    let t_middle = -origin.dot(direction) / a;
    let middle = origin + direction * t_middle;
    let inside = 1.0 - middle.dot(middle);
    Chord { middle, t_middle, t_half: (inside / a).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::vec3;

    #[test]
    fn a_ray_through_the_centre_spans_the_diameter() {
        let c = chord(vec3(0.0, -5.0, 0.0), Vec3::Y).unwrap();
        assert_eq!((c.t_entry(), c.t_exit()), (4.0, 6.0));
    }

    #[test]
    fn misses_and_degenerate_rays_have_no_chord() {
        assert_eq!(chord(vec3(0.0, -5.0, 1.0001), Vec3::Y), None);
        assert_eq!(chord(vec3(0.0, 0.5, 0.0), Vec3::ZERO), None);
        assert_eq!(chord(Vec3::NAN, Vec3::Y), None);
        assert_eq!(chord(Vec3::ZERO, Vec3::INFINITY), None);
    }

    #[test]
    fn chords_from_far_away_keep_their_length() {
        let c = chord(vec3(-1.0e4, 0.5, 0.0), Vec3::X).unwrap();
        assert!((c.t_half - 0.75_f32.sqrt()).abs() < 1e-3);
    }
}
