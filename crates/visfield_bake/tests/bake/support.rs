//! Random rays, what a field gets wrong on them, and where the test meshes are.

use std::path::PathBuf;

use glam::{DVec3, dvec3};
use gltf::binary::{Glb, Header};
use visfield::field::lookup::Aim;
use visfield::field::query::Bias;
use visfield::{QueryOptions, Ray, VisibilityField};
use visfield_bake::{ExactScene, Mesh};

/// The public test models, or `None` where they are not at hand. Never skips on the project's own checks.
pub(crate) fn shared_mesh(name: &str) -> Option<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/meshes");
    let path = folder.join(name);
    if path.exists() {
        return Some(path);
    }
    assert!(std::env::var_os("CI").is_none(), "{} is missing", path.display());
    println!("skipped: {} is missing", path.display());
    None
}

/// A committed example mesh, or its field.
pub(crate) fn asset(name: &str, extension: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../assets/meshes").join(name).with_extension(extension)
}

/// `SplitMix64` (Steele et al., *Fast Splittable Pseudorandom Number Generators*, 2014).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number in [−1, 1).
    pub(crate) fn signed(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// A point of the unit ball.
    pub(crate) fn in_ball(&mut self) -> DVec3 {
        loop {
            let point = dvec3(self.signed(), self.signed(), self.signed());
            if point.length_squared() < 1.0 {
                return point;
            }
        }
    }
}

/// What a field gets wrong. Distances are in bounding radii.
#[derive(Debug, Default)]
pub(crate) struct Errors {
    /// Share of rays from outside for which the field hits and the truth misses, or the other way round.
    pub(crate) first_disagree: f64,
    /// Mean distance between the first hits where both hit.
    pub(crate) first_distance: f64,
    /// Share of rays from inside that `occluded` gets wrong.
    pub(crate) occluded_disagree: f64,
    /// Mean distance between the last hits where both hit.
    pub(crate) last_distance: f64,
    /// Share of true answers that are hits, from outside.
    pub(crate) hits: f64,
}

impl Errors {
    /// Fails if one of `first_disagree`, `first_distance`, `occluded_disagree` and `last_distance` exceeds its bound, if the
    /// rays did not try both hits and misses, or if one constant answer would have done as well.
    pub(crate) fn assert_below(&self, what: &str, bounds: [f64; 4]) {
        println!("{what}: {self:.4?}");
        let found = [self.first_disagree, self.first_distance, self.occluded_disagree, self.last_distance];
        assert!(found.iter().zip(bounds).all(|(found, bound)| *found < bound), "{what}: {self:?} exceeds {bounds:?}");
        assert!((0.05..0.95).contains(&self.hits), "{what}: {self:?}");
        // A field that always hits, or never, must not pass where one answer is rare.
        assert!(self.first_disagree < 0.9 * self.hits.min(1.0 - self.hits), "{what}: {self:?}");
    }
}

/// Compares a field with the truth on `count` random rays from outside its bounds and as many from inside.
///
/// `truth` gives the first and last surface ahead of the origin, along rays in mesh space.
pub(crate) fn compare(
    field: &VisibilityField,
    count: u32,
    truth: impl Fn(DVec3, DVec3) -> Option<(f64, f64)>,
) -> Errors {
    let field_from_mesh = field.header().bounds.field_from_mesh();
    let mesh_from_field = field_from_mesh.inverse();
    let mut random = Random(1);
    let (mut errors, mut first_both, mut last_both) = (Errors::default(), 0, 0);
    for _ in 0..count {
        let target = random.in_ball();
        let outside = random.in_ball().normalize() * 3.0;
        // Any length: directions need no normalisation.
        let direction = (target - outside) * (1.5 + random.signed());
        let found = field.hit(&Ray::new(outside.as_vec3(), direction.as_vec3()), &QueryOptions::default());
        let exact = truth(mesh_from_field.transform_point3(outside), mesh_from_field.transform_vector3(direction));
        errors.hits += f64::from(exact.is_some());
        match (found, exact) {
            (Some(found), Some((first, _))) => {
                errors.first_distance += (f64::from(found) - first).abs() * direction.length();
                first_both += 1;
            }
            (None, None) => {}
            _ => errors.first_disagree += 1.0,
        }

        let inside = random.in_ball();
        let direction = random.in_ball() * 2.0;
        let exact = truth(mesh_from_field.transform_point3(inside), mesh_from_field.transform_vector3(direction));
        let ray = Ray::new(inside.as_vec3(), direction.as_vec3());
        let occluded = field.occluded(&ray, &QueryOptions { bias: Bias::NONE, ..QueryOptions::default() });
        errors.occluded_disagree += f64::from(occluded != exact.is_some());
        if let (true, Some(found), Some((_, last))) = (occluded, field.last_hit(&ray, Aim::Point), exact) {
            errors.last_distance += (f64::from(found) - last).abs() * direction.length();
            last_both += 1;
        }
    }
    errors.first_distance /= f64::from(first_both);
    errors.last_distance /= f64::from(last_both);
    for share in [&mut errors.first_disagree, &mut errors.occluded_disagree, &mut errors.hits] {
        *share /= f64::from(count);
    }
    errors
}

/// The truth for [`compare`] by exact rays.
pub(crate) fn exact_hits(mesh: &Mesh) -> impl Fn(DVec3, DVec3) -> Option<(f64, f64)> {
    let scene = ExactScene::new(&[(mesh, glam::DAffine3::IDENTITY)], DVec3::ZERO).unwrap();
    let size = f64::from(visfield_bake::bounding_sphere(mesh).unwrap().sphere_radius().unwrap());
    move |origin, direction| {
        let first = scene.closest_hit(origin, direction.as_vec3(), f32::INFINITY)?;
        // Back from beyond the far side; rays start at most 3 radii from the centre.
        let end = 5.0 * size / direction.length();
        let back = scene.closest_hit(origin + direction * end, -direction.as_vec3(), f32::INFINITY)?;
        Some((f64::from(first), end - f64::from(back)))
    }
}

/// A triangle and its indices: 36 bytes of positions, then three `u16`.
pub(crate) fn triangle_bytes() -> Vec<u8> {
    let positions: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let mut bytes: Vec<u8> = positions.iter().flat_map(|c| c.to_le_bytes()).collect();
    bytes.extend([0_u16, 1, 2, 0].iter().flat_map(|i| i.to_le_bytes()));
    bytes
}

/// The glTF that describes [`triangle_bytes`], to be changed by tests.
pub(crate) fn triangle_json() -> serde_json::Value {
    serde_json::json!({
        "asset": { "version": "2.0" },
        "buffers": [{ "byteLength": 44 }],
        "bufferViews": [
            { "buffer": 0, "byteLength": 36 },
            { "buffer": 0, "byteOffset": 36, "byteLength": 8 },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR" },
        ],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
    })
}

/// A `.glb` file.
pub(crate) fn glb(json: &serde_json::Value, binary: &[u8]) -> Vec<u8> {
    let header = Header { magic: *b"glTF", version: 2, length: 0 };
    Glb { header, json: json.to_string().into_bytes().into(), bin: Some(binary.into()) }.to_vec().unwrap()
}
