//! The committed example meshes and their fields belong together, and can be rendered.

use glam::DVec3;
use visfield::file;
use visfield_bake::{BakeSettings, bake, read_meshes};

use crate::support::asset;

const NAMES: [&str; 3] = ["torus_knot", "supershape", "chair"];

#[test]
fn fields_are_baked_from_their_meshes() {
    for name in NAMES {
        let meshes = read_meshes(&asset(name, "glb")).unwrap();
        let fields = file::read(&asset(name, "vfield")).unwrap();
        assert_eq!((meshes.len(), fields.len()), (1, 1), "{name}");
        let again = bake(&meshes[0], &BakeSettings::default(), |_| ()).unwrap();
        assert_eq!(fields[0].header(), again.header(), "{name}: run the generator again");
        // Another processor may round a ray along an edge to the other side.
        let [table, again] = [&fields[0], &again].map(|field| field.table().unwrap());
        assert_eq!(table.format(), again.format(), "{name}: run the generator again");
        let same = table.bytes().iter().zip(again.bytes()).filter(|(a, b)| a == b).count();
        assert!(same as f64 > 0.999 * again.bytes().len() as f64, "{name}: run the generator again");
    }
}

#[test]
fn meshes_stand_upright_with_normals_that_point_outwards() {
    for name in NAMES {
        let bytes = std::fs::read(asset(name, "glb")).unwrap();
        assert!(bytes.len() < 400_000, "{name}: {} bytes", bytes.len());
        let gltf = gltf::Gltf::from_slice(&bytes).unwrap();
        let primitive = gltf.meshes().next().unwrap().primitives().next().unwrap();
        let reader = primitive.reader(|_| gltf.blob.as_deref());
        let vector = |v: [f32; 3]| DVec3::from(v.map(f64::from));
        let positions: Vec<DVec3> = reader.read_positions().unwrap().map(vector).collect();
        let normals: Vec<DVec3> = reader.read_normals().unwrap().map(vector).collect();
        assert!(normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5), "{name}");

        let low = positions.iter().copied().reduce(DVec3::min).unwrap();
        let high = positions.iter().copied().reduce(DVec3::max).unwrap();
        assert!((1.0..=2.0).contains(&(high.y - low.y)), "{name}: {low} to {high}");
        // The knot has three-fold symmetry around the origin, so that its box is a little off.
        assert!(((low + high) * 0.5).abs().max_element() < 0.1, "{name}: {low} to {high}");

        let indices: Vec<usize> = reader.read_indices().unwrap().into_u32().map(|i| i as usize).collect();
        let mut volume = 0.0;
        for corners in indices.as_chunks::<3>().0 {
            let [a, b, c] = corners.map(|i| positions[i]);
            let outwards = (b - a).cross(c - a).normalize();
            volume += a.dot(b.cross(c)) / 6.0;
            let agrees = corners.iter().all(|&i| normals[i].dot(outwards) > 0.5);
            assert!(agrees, "{name}: a normal disagrees with triangle {corners:?}");
        }
        // The divergence theorem: winding is outwards if the volume is positive.
        assert!(volume > 0.01, "{name}: volume {volume}");
    }
}
