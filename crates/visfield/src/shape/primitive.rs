//! Signed distances to primitives, and to what two of them make together. Twins: `shaders/shape.wgsl`, same names, same order of
//! operations.
//!
//! Those of primitives are exact, inside and outside. Formulas of box and sphere are those of *Distance Field Ray Marching*
//! (2012), which has them from Hart, *Sphere Tracing* (1996), and from Quilez; the others measure in the half-plane through the
//! axis, (distance from the axis, height), where a solid of revolution is its outline.

use glam::{Vec2, Vec3, vec2};

/// A ball (2012, eq. 2.12).
#[inline(always)]
pub(super) fn sphere_distance(position: Vec3, radius: f32) -> f32 {
    position.length() - radius
}

/// A cuboid (2012, algorithm 3.6; algorithm 3.5 underestimates beside edges, which showed in ambient occlusion).
#[inline(always)]
pub(super) fn box_distance(position: Vec3, half_extents: Vec3) -> f32 {
    let beyond = position.abs() - half_extents;
    let inside = beyond.x.max(beyond.y.max(beyond.z));
    if inside > 0.0 { beyond.max(Vec3::ZERO).length() } else { inside }
}

/// What is below y = 0 (2012, eq. 3.15, with the normal +y and h = 0: moving it is its node's affair).
#[inline(always)]
pub(super) fn half_space_distance(position: Vec3) -> f32 {
    position.y
}

/// What is near a segment along y.
#[inline(always)]
pub(super) fn capsule_distance(position: Vec3, half_length: f32, radius: f32) -> f32 {
    let along = position.y.clamp(-half_length, half_length);
    Vec3::new(position.x, position.y - along, position.z).length() - radius
}

/// A cylinder along y: algorithm 3.6 again, for the rectangle that is its outline.
#[inline(always)]
pub(super) fn cylinder_distance(position: Vec3, half_height: f32, radius: f32) -> f32 {
    let beyond = vec2(from_axis(position) - radius, position.y.abs() - half_height);
    let inside = beyond.x.max(beyond.y);
    if inside > 0.0 { beyond.max(Vec2::ZERO).length() } else { inside }
}

/// A ring around y.
#[inline(always)]
pub(super) fn torus_distance(position: Vec3, major_radius: f32, minor_radius: f32) -> f32 {
    vec2(from_axis(position) - major_radius, position.y).length() - minor_radius
}

/// A cone along y, its base at −`height`/2 and its tip at `height`/2: the nearer of the base and the flank, which end where they
/// meet.
#[inline(always)]
pub(super) fn cone_distance(position: Vec3, height: f32, radius: f32) -> f32 {
    // From the edge of the base, which the flank leaves along `flank`.
    let from_edge = vec2(from_axis(position) - radius, position.y + 0.5 * height);
    let flank = vec2(-radius, height);
    let along = (from_edge.dot(flank) / flank.dot(flank).max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    let to_flank = from_edge - flank * along;
    let to_base = vec2(from_edge.x.max(0.0), from_edge.y);
    let distance = to_flank.dot(to_flank).min(to_base.dot(to_base)).sqrt();
    let outside_flank = from_edge.x * height + from_edge.y * radius;
    if outside_flank.max(-from_edge.y) < 0.0 { -distance } else { distance }
}

/// 2012, eq. 3.11.
#[inline(always)]
pub(super) fn union_distance(a: f32, b: f32) -> f32 {
    a.min(b)
}

/// 2012, eq. 3.12: a lower bound.
#[inline(always)]
pub(super) fn intersection_distance(a: f32, b: f32) -> f32 {
    a.max(b)
}

/// 2012, eq. 3.14 with 3.13: a lower bound.
#[inline(always)]
pub(super) fn difference_distance(a: f32, b: f32) -> f32 {
    a.max(-b)
}

/// The quadratic smooth minimum of Quilez: below the minimum where the two are less than `width` apart, by width/4 where they
/// are equal. Its slopes add up to 1, so that of two lower bounds it makes a lower bound.
#[inline(always)]
pub(super) fn smooth_union_distance(a: f32, b: f32, width: f32) -> f32 {
    let overlap = (width - (a - b).abs()).max(0.0) / width;
    a.min(b) - overlap * overlap * width * 0.25
}

#[inline(always)]
fn from_axis(position: Vec3) -> f32 {
    vec2(position.x, position.z).length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::sampling::sphere_samples;
    use glam::vec3;

    /// The least distance to a surface of revolution, of which `outline` has the points: in half-planes evenly around the axis,
    /// one of which has the position.
    fn to_surface(outline: &[Vec2], position: Vec3) -> f32 {
        let azimuth = position.z.atan2(position.x);
        let turned = |i: i32| {
            let (sin, cos) = (azimuth + i as f32 * (std::f32::consts::TAU / 8.0)).sin_cos();
            outline.iter().map(move |p| vec3(p.x * cos, p.y, p.x * sin).distance_squared(position))
        };
        (0..8).flat_map(turned).fold(f32::INFINITY, f32::min).sqrt()
    }

    fn line(from: Vec2, to: Vec2) -> impl Iterator<Item = Vec2> {
        (0..=1000).map(move |i| from.lerp(to, i as f32 / 1000.0))
    }

    fn arc(center: Vec2, radius: f32, from: f32, to: f32) -> impl Iterator<Item = Vec2> {
        (0..=2000)
            .map(move |i| center + radius * Vec2::from_angle((from + (to - from) * i as f32 / 2000.0).to_radians()))
    }

    /// Compares with points of the surface, closer together than a thousandth, and with a test of what is inside.
    fn compare(outline: &[Vec2], distance: impl Fn(Vec3) -> f32, inside: impl Fn(Vec3) -> bool) {
        let mut found_inside = 0;
        for (i, direction) in sphere_samples(1500).into_iter().enumerate() {
            let position = direction * (0.002 * i as f32);
            let (found, expected) = (distance(position), to_surface(outline, position));
            assert!((found.abs() - expected).abs() < 2.0e-3, "{position}: {found}, sampled {expected}");
            assert!(found.abs() < expected + 1.0e-5, "{position}: {found} is more than {expected}");
            assert!(found.abs() < 1.0e-5 || (found < 0.0) == inside(position), "{position}: {found}");
            found_inside += usize::from(found < 0.0);
        }
        assert!((50..1450).contains(&found_inside), "{found_inside} are inside");
    }

    #[test]
    fn spheres_and_half_spaces_are_as_far_as_they_are() {
        assert_eq!(sphere_distance(vec3(2.0, -3.0, 6.0), 2.5), 4.5);
        assert_eq!(sphere_distance(Vec3::ZERO, 2.5), -2.5);
        assert_eq!(half_space_distance(vec3(7.0, 2.0, -7.0)), 2.0);
        assert_eq!(half_space_distance(vec3(7.0, -2.0, -7.0)), -2.0);
    }

    #[test]
    fn boxes_have_faces_edges_and_corners() {
        let half = vec3(1.0, 2.0, 3.0);
        for sign in [Vec3::ONE, Vec3::NEG_ONE, vec3(1.0, -1.0, 1.0), vec3(-1.0, 1.0, -1.0)] {
            let at = |x: f32, y: f32, z: f32| box_distance(vec3(x, y, z) * sign, half);
            assert_eq!(at(1.5, 1.9, 2.9), 0.5, "before a face");
            assert_eq!(at(4.0, 6.0, 0.0), 5.0, "beside an edge");
            assert_eq!(at(0.5, 5.0, 7.0), 5.0, "beside another");
            assert_eq!(at(3.0, 5.0, 9.0), 7.0, "off a corner");
            assert_eq!(at(0.25, 0.0, 0.0), -0.75, "below a face");
            assert_eq!(at(0.5, 1.75, 2.875), -0.125, "below the nearest of three");
            assert_eq!(at(1.0, 2.0, 3.0), 0.0, "at a corner");
        }
    }

    #[test]
    fn capsules_are_as_far_as_their_surface() {
        let (half_length, radius) = (0.7, 0.4);
        let outline: Vec<_> = arc(vec2(0.0, half_length), radius, 0.0, 90.0)
            .chain(line(vec2(radius, -half_length), vec2(radius, half_length)))
            .chain(arc(vec2(0.0, -half_length), radius, -90.0, 0.0))
            .collect();
        let inside = |p: Vec3| {
            let ends = [half_length, -half_length].map(|y| p.distance(Vec3::Y * y) < radius);
            p.x.hypot(p.z) < radius && p.y.abs() < half_length || ends[0] || ends[1]
        };
        compare(&outline, |p| capsule_distance(p, half_length, radius), inside);
    }

    #[test]
    fn cylinders_are_as_far_as_their_surface() {
        let (half_height, radius) = (0.5, 0.8);
        let outline: Vec<_> = line(vec2(0.0, half_height), vec2(radius, half_height))
            .chain(line(vec2(radius, half_height), vec2(radius, -half_height)))
            .chain(line(vec2(radius, -half_height), vec2(0.0, -half_height)))
            .collect();
        let inside = |p: Vec3| p.x.hypot(p.z) < radius && p.y.abs() < half_height;
        compare(&outline, |p| cylinder_distance(p, half_height, radius), inside);
    }

    #[test]
    fn tori_are_as_far_as_their_surface() {
        let (major, minor) = (0.9, 0.35);
        let outline: Vec<_> = arc(vec2(major, 0.0), minor, 0.0, 360.0).collect();
        let inside = |p: Vec3| (p.x.hypot(p.z) - major).hypot(p.y) < minor;
        compare(&outline, |p| torus_distance(p, major, minor), inside);
    }

    #[test]
    fn cones_are_as_far_as_their_surface() {
        for (height, radius) in [(1.4, 0.7), (0.5, 1.2), (2.0, 0.35)] {
            let (edge, tip) = (vec2(radius, -0.5 * height), vec2(0.0, 0.5 * height));
            let outline: Vec<_> = line(vec2(0.0, edge.y), edge).chain(line(edge, tip)).collect();
            let inside = |p: Vec3| p.y > edge.y && p.x.hypot(p.z) < radius * (tip.y - p.y) / height;
            compare(&outline, |p| cone_distance(p, height, radius), inside);
        }
    }

    #[test]
    fn what_has_no_volume_has_no_inside() {
        for position in sphere_samples(200).into_iter().chain([Vec3::ZERO, Vec3::Y, Vec3::X, vec3(0.5, 0.5, 0.0)]) {
            for distance in [
                sphere_distance(position, 0.0),
                box_distance(position, vec3(1.0, 0.0, 1.0)),
                box_distance(position, Vec3::ZERO),
                capsule_distance(position, 1.0, 0.0),
                cylinder_distance(position, 0.0, 1.0),
                cylinder_distance(position, 1.0, 0.0),
                torus_distance(position, 0.5, 0.0),
                cone_distance(position, 0.0, 1.0),
                cone_distance(position, 1.0, 0.0),
                cone_distance(position, 0.0, 0.0),
            ] {
                assert!((0.0..2.0).contains(&distance), "{position}: {distance}");
            }
        }
        assert_eq!(cone_distance(Vec3::ZERO, 0.0, 0.0), 0.0);
        assert_eq!(cylinder_distance(vec3(0.5, 2.0, 0.0), 0.0, 1.0), 2.0, "a disc");
        assert_eq!(torus_distance(Vec3::X, 0.0, 0.25), 0.75, "a ball");
    }

    #[test]
    fn smooth_unions_are_lower_by_a_quarter_of_their_width_at_most() {
        assert_eq!(smooth_union_distance(0.5, 0.5, 0.4), 0.4);
        assert_eq!(smooth_union_distance(0.5, 0.9, 0.4), 0.5, "as far apart as the seam is wide");
        assert!((smooth_union_distance(0.7, 0.5, 0.4) - 0.475).abs() < 1e-6);
        assert_eq!(smooth_union_distance(-1.0, 3.0, 0.4), -1.0);
    }
}
