//! Where the points of a cap grid lie: uniform inside the mesh's box, then ever farther apart.
//!
//! Lengths are in *cap space*: the origin is the centre of the mesh's bounding box, the axes are the mesh's, and the largest
//! half-extent of the box is 1.

use glam::Vec3;

/// Share of the grid's index range, from its middle, that is uniform.
const KNEE: f32 = 0.65;
/// How far the grid reaches beyond the box on every side, in largest half-extents.
const REACH: f32 = 4.0;
/// How far beyond the box's face the uniform part should end, in largest half-extents…
const MARGIN: f32 = 0.1;
/// …and how much nearer or farther it may, so that the face lies on a grid plane.
const TOLERANCE: f32 = 0.3;

/// One axis of a cap grid: from positions to the grid's coordinate u, −1 at one end and 1 at the other.
///
/// Both directions are odd functions: linear up to `knee`, rational beyond.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisWarp {
    /// Where the linear part ends.
    pub knee: f32,
    /// Position per u of the linear part.
    pub slope: f32,
    /// 1 / `slope`.
    pub inverse_slope: f32,
    /// How fast the rational part widens.
    pub curvature: f32,
    /// Where the grid ends.
    pub extent: f32,
    /// 1 / `extent`.
    pub inverse_extent: f32,
}

impl AxisWarp {
    /// The warp of an axis along which the box reaches to ±`half_extent`, 0 to 1, with `points` grid planes. The box's faces
    /// lie on grid planes unless the box is very thin: half a cell beside them, the error doubles.
    pub fn new(half_extent: f32, points: u32) -> Self {
        let wanted = half_extent + MARGIN;
        // Grid planes lie at u = (2i − (n−1))/(n−1).
        let last = points as f32 - 1.0;
        let planes = (0..points).map(|plane| (2.0 * plane as f32 - last) / last).filter(|u| *u > 0.0);
        let aligned = planes
            .filter_map(|u| Self::with_face_at(half_extent, u, wanted))
            .min_by(|a, b| (a.knee - wanted).abs().total_cmp(&(b.knee - wanted).abs()));
        aligned.unwrap_or_else(|| Self::with_knee(half_extent, wanted))
    }

    fn with_knee(half_extent: f32, knee: f32) -> Self {
        let extent = half_extent + REACH;
        let slope = knee / KNEE;
        // So that u = 1 lies at the extent.
        let curvature = (1.0 - slope * (1.0 - KNEE) / (extent - knee)) / (1.0 - KNEE);
        Self { knee, slope, inverse_slope: 1.0 / slope, curvature, extent, inverse_extent: 1.0 / extent }
    }

    /// The warp that puts the box's face at u, if its knee is near enough to the one that is wanted.
    fn with_face_at(half_extent: f32, u: f32, wanted: f32) -> Option<Self> {
        // The farther the knee, the nearer to the middle lies the face.
        let (mut near, mut far) = ((wanted - TOLERANCE).max(0.5 * MARGIN), wanted + TOLERANCE);
        let face = |knee: f32| Self::with_knee(half_extent, knee).coordinate(half_extent);
        if face(near) < u || face(far) > u {
            return None;
        }
        for _ in 0..30 {
            let middle = 0.5 * (near + far);
            if face(middle) > u { near = middle } else { far = middle }
        }
        Some(Self::with_knee(half_extent, near))
    }

    /// Where the grid plane at u lies, u in [−1, 1].
    pub fn position(&self, u: f32) -> f32 {
        let beyond = u.abs() - KNEE;
        let outer = self.knee + self.slope * beyond / (1.0 - self.curvature * beyond);
        (if beyond > 0.0 { outer } else { self.slope * u.abs() }).copysign(u)
    }

    /// u of a position within ±`extent`: the inverse of [`position`](Self::position).
    #[inline(always)]
    pub fn coordinate(&self, position: f32) -> f32 {
        let beyond = position.abs() - self.knee;
        let outer = KNEE + beyond / (self.slope + self.curvature * beyond);
        let inner = position.abs() * self.inverse_slope;
        (if beyond > 0.0 { outer } else { inner }).copysign(position)
    }
}

/// By what stored values are multiplied, so that far ones, which fall with the square of the distance, keep their digits.
#[inline(always)]
pub fn storage_scale(position: Vec3) -> f32 {
    position.dot(position).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_and_coordinates_are_inverse() {
        for points in [4, 8, 16, 33, 64] {
            for half_extent in [0.0, 1e-3, 0.2, 0.5, 1.0] {
                let warp = AxisWarp::new(half_extent, points);
                assert!((warp.position(1.0) - half_extent - REACH).abs() < 1e-4, "{warp:?}");
                let mut previous = f32::NEG_INFINITY;
                for step in -100..=100 {
                    let u = step as f32 / 100.0;
                    let position = warp.position(u);
                    assert!(position > previous, "{warp:?} is monotonic");
                    assert!((warp.coordinate(position) - u).abs() < 1e-4, "{warp:?} at {u}");
                    previous = position;
                }
            }
        }
    }

    #[test]
    fn faces_lie_on_grid_planes() {
        for points in [8, 16, 24, 32] {
            for half_extent in [0.4, 0.7, 1.0] {
                let warp = AxisWarp::new(half_extent, points);
                let plane = (warp.coordinate(half_extent) + 1.0) * 0.5 * (points - 1) as f32;
                assert!((plane - plane.round()).abs() < 1e-3, "{points} points, ±{half_extent}: plane {plane}");
            }
        }
    }
}
