//! Exact rays against triangles: a compressed wide BVH of crate `obvhs` (Ylitie et al., *Efficient Incoherent Ray Traversal
//! on GPUs Through Compressed Wide BVHs*, 2017). For queries that are no rays, its binary BVH as plain data.
//!
//! This is the only module that speaks `obvhs`, whose `glam` is another version than ours: vectors cross as arrays.

use std::time::Duration;

use glam::{DVec3, Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh_from_tris};
use obvhs::ray::{Ray, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;

/// Triangles that answer rays, from both sides alike.
///
/// Ray parameters t count direction vectors, which need no normalisation. Rays with a zero or non-finite direction or
/// origin hit nothing.
///
/// ```
/// use glam::{DVec3, Vec3, dvec3, vec3};
/// use visfield_bake::TriangleBvh;
/// let floor = [dvec3(-1.0, 0.0, -1.0), dvec3(1.0, 0.0, -1.0), dvec3(0.0, 0.0, 1.0)];
/// let triangles = TriangleBvh::new(&[floor]);
/// let t = triangles.closest_hit(vec3(0.0, 3.0, 0.0), vec3(0.0, -2.0, 0.0), f32::INFINITY);
/// assert_eq!(t, Some(1.5));
/// assert!(!triangles.occluded(vec3(0.0, 3.0, 0.0), vec3(0.0, -2.0, 0.0), 0.0, 1.4));
/// ```
pub struct TriangleBvh {
    /// `None` without triangles, which the builder does not take.
    bvh: Option<CwBvh>,
    /// In the order of the BVH's leaves, so that no index stands between a leaf and its triangles.
    triangles: Vec<RtTriangle>,
    /// Brings the triangles to about [`SIZE`].
    scale: f32,
    extent: f32,
}

/// A ray that is ready to be traced, for those who trace it again and again or time nothing but the tracing.
///
/// Of use only to the [`TriangleBvh`] that prepared it.
///
/// ```
/// use glam::{Vec3, dvec3};
/// use visfield_bake::TriangleBvh;
/// let floor = [dvec3(-1.0, 0.0, -1.0), dvec3(1.0, 0.0, -1.0), dvec3(0.0, 0.0, 1.0)];
/// let triangles = TriangleBvh::new(&[floor]);
/// let down = triangles.prepare(Vec3::Y, Vec3::NEG_Y, 0.0, f32::INFINITY).expect("the ray has a direction");
/// assert!(triangles.occluded_prepared(&down));
/// assert!(triangles.prepare(Vec3::Y, Vec3::ZERO, 0.0, f32::INFINITY).is_none());
/// ```
#[derive(Clone, Copy)]
pub struct PreparedRay {
    ray: Ray,
    /// Length of the direction as the triangles are scaled.
    length: f32,
}

/// Binary exponent of the largest coordinate as `obvhs` sees it. A power of two scales exactly, and keeps products of tiny
/// or huge coordinates in the range of `f32`. Well above 1, because `obvhs` 0.4 never enters boxes that a ray leaves before
/// t = 10⁻⁴.
const SIZE: i32 = 10;

/// A BVH as a shader reads it.
#[cfg(feature = "command")]
pub(crate) struct BvhWords {
    /// 20 for each node, as `obvhs` lays them out: the paper's 80 bytes.
    pub(crate) nodes: Vec<u32>,
    /// 12 for each triangle, in the order of the leaves: a corner, the edges `v0 − v1` and `v2 − v0`, and after each of the three
    /// a component of their cross product.
    pub(crate) triangles: Vec<f32>,
}

#[cfg(feature = "command")]
impl PreparedRay {
    /// Origin, unit direction and end, as the shader's triangles are scaled.
    pub(crate) fn words(&self) -> ([f32; 3], [f32; 3], f32) {
        let Ray { origin, direction, tmax, .. } = self.ray;
        (origin.to_array(), direction.to_array(), tmax)
    }
}

impl TriangleBvh {
    /// Builds the BVH over triangles with finite corners, which are rounded to `f32`.
    pub fn new(corners: &[[DVec3; 3]]) -> Self {
        let extent = corners.as_flattened().iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        // Clamped so that the scale itself stays a normal number.
        let exponent = extent.max(f64::MIN_POSITIVE).log2().floor().clamp(-110.0, 110.0) as i32;
        let scale = 2.0_f64.powi(SIZE - exponent);
        let soup: Vec<Triangle> = corners
            .iter()
            .map(|&[v0, v1, v2]| {
                let scaled = |p: DVec3| (p * scale).as_vec3().to_array().into();
                Triangle { v0: scaled(v0), v1: scaled(v1), v2: scaled(v2) }
            })
            .collect();
        let bvh = (!soup.is_empty())
            .then(|| build_cwbvh_from_tris(&soup, BvhBuildParams::medium_build(), &mut Duration::default()));
        let leaves = bvh.iter().flat_map(|bvh| &bvh.primitive_indices);
        let triangles = leaves.map(|&i| RtTriangle::from(&soup[i as usize])).collect();
        Self { bvh, triangles, scale: scale as f32, extent: extent as f32 }
    }

    /// What [`occluded_prepared`](Self::occluded_prepared) reads, for a shader that does the same.
    #[cfg(feature = "command")]
    pub(crate) fn words(&self) -> BvhWords {
        let nodes = self.bvh.iter().flat_map(|bvh| bytemuck::cast_slice::<_, u32>(&bvh.nodes)).copied().collect();
        let triangle = |t: &RtTriangle| {
            let corners = [t.v0, t.e1, t.e2].map(|v| v.to_array());
            let normal = t.ng.to_array();
            [0, 1, 2].map(|i| [corners[i][0], corners[i][1], corners[i][2], normal[i]])
        };
        BvhWords { nodes, triangles: self.triangles.iter().flat_map(triangle).flatten().collect() }
    }

    /// The largest coordinate of any corner, as an absolute value: what the rounding of hits scales with.
    pub fn extent(&self) -> f32 {
        self.extent
    }

    /// The ray parameter t of the first hit in [0, `t_max`), if there is one.
    pub fn closest_hit(&self, origin: Vec3, direction: Vec3, t_max: f32) -> Option<f32> {
        let PreparedRay { ray, length } = self.prepare(origin, direction, 0.0, t_max)?;
        let mut hit = RayHit::none();
        let bvh = self.bvh.as_ref()?;
        bvh.ray_traverse(ray, &mut hit, |ray, leaf| self.triangles[leaf].intersect(ray)).then(|| hit.t / length)
    }

    /// Like [`closest_hit`](Self::closest_hit), with the unit normal of the triangle that is hit. Which side it points to
    /// depends on the triangle's winding.
    pub fn closest_hit_normal(&self, origin: Vec3, direction: Vec3, t_max: f32) -> Option<(f32, Vec3)> {
        let PreparedRay { ray, length } = self.prepare(origin, direction, 0.0, t_max)?;
        let mut hit = RayHit::none();
        let bvh = self.bvh.as_ref()?;
        let normal = |leaf: u32| self.triangles[leaf as usize].compute_normal().to_array().into();
        bvh.ray_traverse(ray, &mut hit, |ray, leaf| self.triangles[leaf].intersect(ray))
            .then(|| (hit.t / length, normal(hit.primitive_id)))
    }

    /// Whether anything is hit in [`t_min`, `t_max`). Cheaper than [`closest_hit`](Self::closest_hit).
    pub fn occluded(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> bool {
        self.prepare(origin, direction, t_min, t_max).is_some_and(|ray| self.occluded_prepared(&ray))
    }

    /// Whether the ray hits anything between the ends that it was prepared with.
    pub fn occluded_prepared(&self, ray: &PreparedRay) -> bool {
        let hit = |bvh: &CwBvh| !bvh.ray_traverse_miss(ray.ray, |ray, leaf| self.triangles[leaf].intersect(ray));
        self.bvh.as_ref().is_some_and(hit)
    }

    /// The part of [`occluded`](Self::occluded) that comes before the tracing. `None` hits nothing.
    pub fn prepare(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> Option<PreparedRay> {
        let largest = direction.abs().max_element();
        let shrunk = direction / largest;
        let length = shrunk.length();
        // Normalised, because `obvhs` treats components below 10⁻⁷ as zero; plus 0, because it takes −0 for a direction
        // that points both ways.
        let unit = shrunk / length + Vec3::ZERO;
        let origin = origin * self.scale;
        // A zero or NaN direction fails here.
        if !(origin.is_finite() && unit.is_finite() && t_max > t_min) {
            return None;
        }
        let length = length * largest * self.scale;
        let ray = Ray::new(origin.to_array().into(), unit.to_array().into(), t_min * length, t_max * length);
        Some(PreparedRay { ray, length })
    }
}

/// A binary BVH as plain data, for queries that are no rays.
#[derive(Debug)]
pub(crate) struct BinaryBvh {
    /// The root comes first. None without triangles.
    pub(crate) nodes: Vec<BinaryNode>,
    /// In the order of the leaves.
    pub(crate) triangles: Vec<[Vec3; 3]>,
}

/// A box and what is in it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BinaryNode {
    pub(crate) low: Vec3A,
    pub(crate) high: Vec3A,
    /// The first of a leaf's triangles, or the first of an inner node's two children, which are neighbours.
    pub(crate) first: u32,
    /// Number of triangles; 0 for an inner node.
    pub(crate) count: u32,
}

impl BinaryBvh {
    /// Builds the BVH over triangles with finite corners.
    pub(crate) fn new(triangles: &[[Vec3; 3]]) -> Self {
        if triangles.is_empty() {
            return Self { nodes: Vec::new(), triangles: Vec::new() };
        }
        let soup: Vec<Triangle> = triangles
            .iter()
            .map(|corners| {
                let [v0, v1, v2] = corners.map(|p| p.to_array().into());
                Triangle { v0, v1, v2 }
            })
            .collect();
        // Boxes are cheap to test beside triangles, at any distance: small leaves, whatever a ray would prefer.
        let settings =
            BvhBuildParams { max_prims_per_leaf: 4, collapse_traversal_cost: 1.0, ..BvhBuildParams::medium_build() };
        let bvh = build_bvh2_from_tris(&soup, settings, &mut Duration::default());
        let node = |node: &obvhs::bvh2::node::Bvh2Node| BinaryNode {
            low: node.aabb().min.to_array().into(),
            high: node.aabb().max.to_array().into(),
            first: node.first_index,
            count: node.prim_count,
        };
        Self {
            nodes: bvh.nodes.iter().map(node).collect(),
            triangles: bvh.primitive_indices.iter().map(|&i| triangles[i as usize]).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{dvec3, vec3};

    fn wall(scale: f64) -> TriangleBvh {
        let corner = |y: f64, z: f64| dvec3(1.0, y, z) * scale;
        TriangleBvh::new(&[
            [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0)],
            [corner(-1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        ])
    }

    #[test]
    fn both_sides_are_hit_at_any_scale() {
        for scale in [1e-15, 1e-6, 1.0, 1e6, 1e15_f32] {
            let wall = wall(scale.into());
            for (x, direction) in [(0.0, 2.0), (2.0, -2.0)] {
                let (origin, direction) = (vec3(x, 0.3, 0.2) * scale, Vec3::X * direction * scale);
                let t = wall.closest_hit(origin, direction, f32::INFINITY).expect("the wall is ahead");
                assert!((t - 0.5).abs() < 1e-6, "scale {scale}: {t}");
                let (same, normal) = wall.closest_hit_normal(origin, direction, f32::INFINITY).expect("likewise");
                assert_eq!((same, normal.abs()), (t, Vec3::X));
                assert_eq!(wall.closest_hit(origin, direction, 0.499), None);
                assert!(wall.occluded(origin, direction, 0.499, 0.501));
                assert!(!wall.occluded(origin, direction, 0.501, f32::INFINITY));
            }
            assert_eq!(wall.closest_hit(Vec3::ZERO, -Vec3::X, f32::INFINITY), None, "behind");
        }
    }

    #[test]
    fn degenerate_rays_and_empty_soups_hit_nothing() {
        for direction in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY] {
            assert_eq!(wall(1.0).closest_hit(Vec3::ZERO, direction, f32::INFINITY), None);
        }
        assert_eq!(wall(1.0).closest_hit(Vec3::NAN, Vec3::X, f32::INFINITY), None);
        assert_eq!(wall(1.0).closest_hit(Vec3::ZERO, Vec3::X, f32::NAN), None);
        assert!(!TriangleBvh::new(&[]).occluded(Vec3::ZERO, Vec3::X, 0.0, f32::INFINITY));
    }
}
