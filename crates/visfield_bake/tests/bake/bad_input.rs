//! Files that are not what they should be: each gives one typed error, and nothing panics.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use visfield::{CapGridFormat, file};
use visfield_bake::measure::{MeasureScene, ShadowQuestion, measure_shadow_of};
use visfield_bake::read::{GltfError, ObjError};
use visfield_bake::{BakeError, BakeSettings, Mesh, MeshError, ReadError, bake, read_meshes};

use super::support::{glb, shared_mesh, triangle_bytes, triangle_json};

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn read(&self, name: &str, content: &[u8]) -> Result<Vec<Mesh>, ReadError> {
        fs::write(self.path(name), content).unwrap();
        read_named(&self.path(name))
    }

    /// Reads the triangle after a change to its JSON.
    fn read_changed(&self, change: impl FnOnce(&mut Value)) -> Result<Vec<Mesh>, ReadError> {
        let mut json = triangle_json();
        change(&mut json);
        self.read("changed.glb", &glb(&json, &triangle_bytes()))
    }
}

/// Every message is one line that names the file.
fn read_named(path: &Path) -> Result<Vec<Mesh>, ReadError> {
    read_meshes(path).inspect_err(|error| {
        let message = error.to_string();
        assert!(message.starts_with(&format!("{}: ", path.display())) && !message.contains('\n'), "{message}");
    })
}

fn gltf_error(result: Result<Vec<Mesh>, ReadError>) -> GltfError {
    match result {
        Err(ReadError::Gltf { source, .. }) => source,
        other => panic!("{other:?}"),
    }
}

#[test]
fn files_that_are_no_meshes() {
    let folder = Folder::new();
    for name in ["missing.obj", "missing.glb", "no/folder/missing.gltf"] {
        assert!(matches!(read_named(&folder.path(name)), Err(ReadError::Io { .. })), "{name}");
    }
    fs::create_dir(folder.path("folder.obj")).unwrap();
    assert!(matches!(read_named(&folder.path("folder.obj")), Err(ReadError::Io { .. })));
    for name in ["mesh.stl", "mesh", "mesh.glb.gz", ".glb"] {
        assert!(matches!(folder.read(name, b"solid"), Err(ReadError::UnknownExtension { .. })), "{name}");
    }
    let garbage: Vec<u8> = (0..4000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    for name in ["a.obj", "a.glb", "a.gltf", "A.GLB"] {
        assert!(matches!(folder.read(name, b""), Err(ReadError::Empty { .. })), "{name}");
        let text = folder.read(name, "Dear reader,\nno mesh here.\n".as_bytes());
        let binary = folder.read(name, &garbage);
        if name == "a.obj" {
            assert!(matches!(text, Err(ReadError::NoTriangles { .. })));
            assert!(matches!(binary, Err(ReadError::Obj { source: ObjError::Binary, .. })));
        } else {
            assert!(matches!(gltf_error(text), GltfError::Syntax(_)), "{name}");
            assert!(matches!(gltf_error(binary), GltfError::Syntax(_)), "{name}");
        }
    }
    assert!(matches!(folder.read("a.obj", b"v 0 0 0\nl 1 1\n"), Err(ReadError::NoTriangles { .. })));
    assert!(matches!(folder.read("a.obj", b"v 0 0 0\nf 1 1 2\n"), Err(ReadError::Obj { .. })));
}

#[test]
fn a_sound_triangle_in_many_guises() {
    let folder = Folder::new();
    let sound = folder.read_changed(|_| ()).unwrap();
    assert_eq!(sound[0].indices, [[0, 1, 2]]);
    assert_eq!(sound[0].positions, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let unindexed = folder.read_changed(|json| {
        json["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("indices");
    });
    assert_eq!(unindexed.unwrap(), sound);
    // What is said about images and materials must not matter, nor extensions about them.
    let textured = folder.read_changed(|json| {
        json["extensionsRequired"] = json!(["KHR_texture_transform", "KHR_materials_unlit"]);
        json["extensionsUsed"] = json["extensionsRequired"].clone();
        json["images"] = json!([{ "uri": "missing.png" }]);
    });
    assert_eq!(textured.unwrap(), sound);
    // Points beside triangles stay as a mesh that a bake refuses.
    let mixed = folder
        .read_changed(|json| {
            let mut points = json["meshes"][0]["primitives"][0].clone();
            points["mode"] = json!(0);
            json["meshes"][0]["primitives"].as_array_mut().unwrap().push(points);
        })
        .unwrap();
    assert_eq!((mixed.len(), mixed[1].name.as_str()), (2, "Mesh0/Primitive1"));
    assert_eq!(mixed[1].validate(), Err(MeshError::NoTriangles));
    for mode in 0..4 {
        let other = folder.read_changed(|json| json["meshes"][0]["primitives"][0]["mode"] = json!(mode));
        assert!(matches!(other, Err(ReadError::NoTriangles { .. })), "mode {mode}");
    }
    assert!(matches!(folder.read_changed(|json| json["meshes"] = json!([])), Err(ReadError::NoTriangles { .. })));
}

#[test]
fn buffers_elsewhere() {
    let folder = Folder::new();
    let mut json = triangle_json();
    let mut with_uri = |uri: &str| {
        json["buffers"][0]["uri"] = json!(uri);
        folder.read("triangle.gltf", json.to_string().as_bytes())
    };
    let missing = gltf_error(with_uri("missing.bin"));
    assert!(matches!(&missing, GltfError::Buffer { uri, .. } if uri == "missing.bin"), "{missing}");
    fs::write(folder.path("short.bin"), [0; 8]).unwrap();
    assert!(matches!(gltf_error(with_uri("short.bin")), GltfError::BufferLength { expected: 44, found: 8, .. }));
    fs::write(folder.path("a whole.bin"), triangle_bytes()).unwrap();
    assert_eq!(with_uri("a%20whole.bin").unwrap()[0].indices.len(), 1);
    for uri in ["%ff.bin", "https://example.org/a.bin", "data:application/octet-stream;base64,!", ""] {
        assert!(matches!(gltf_error(with_uri(uri)), GltfError::Buffer { .. }), "{uri}");
    }
    // Binary data that is announced and not there.
    let no_blob = folder.read("triangle.gltf", triangle_json().to_string().as_bytes());
    assert!(matches!(gltf_error(no_blob), GltfError::Buffer { .. }));
}

#[test]
fn accessors_that_lie() {
    let folder = Folder::new();
    for (accessor, key, value) in [
        (0, "count", json!(0)),
        (0, "count", json!(4)),
        (0, "count", json!(u64::MAX)),
        (0, "count", json!(1_u64 << 62)),
        (0, "byteOffset", json!(4)),
        (0, "byteOffset", json!(u64::MAX)),
        (0, "componentType", json!(5122)),
        (0, "type", json!("VEC2")),
        (1, "count", json!(5)),
        (1, "componentType", json!(5126)),
        (1, "type", json!("VEC2")),
    ] {
        let error = gltf_error(folder.read_changed(|json| json["accessors"][accessor][key] = value.clone()));
        assert!(matches!(error, GltfError::Accessor { .. }), "accessor {accessor}, {key} {value}: {error}");
    }
    for (key, value) in [("byteLength", json!(u64::MAX)), ("byteOffset", json!(u64::MAX)), ("byteStride", json!(4))] {
        let error = gltf_error(folder.read_changed(|json| json["bufferViews"][0][key] = value));
        assert!(matches!(error, GltfError::Accessor { .. }), "{key}: {error}");
    }
    let dangling = folder.read_changed(|json| json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(9));
    assert!(matches!(gltf_error(dangling), GltfError::Accessor { .. }));
    for (index, what) in [("indices", "accessor"), ("material", "material")] {
        let dangling = folder.read_changed(|json| json["meshes"][0]["primitives"][0][index] = json!(9));
        assert!(matches!(gltf_error(dangling), GltfError::Invalid(_)), "{what}");
    }
    let sparse = |count: u64, offset: u64| {
        folder.read_changed(|json| {
            json["accessors"][0]["sparse"] = json!({
                "count": count,
                "indices": { "bufferView": 1, "componentType": 5123 },
                "values": { "bufferView": 0, "byteOffset": offset },
            });
        })
    };
    // Vertices 0, 1 and 2 are replaced by themselves.
    assert_eq!(sparse(3, 0).unwrap(), folder.read_changed(|_| ()).unwrap());
    for (count, offset) in [(0, 0), (5, 0), (3, 4), (u64::MAX, 0)] {
        assert!(matches!(gltf_error(sparse(count, offset)), GltfError::Accessor { .. }), "{count} from {offset}");
    }
    for extension in ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_mesh_quantization", "X_unheard_of"]
    {
        let error = gltf_error(folder.read_changed(|json| json["extensionsRequired"] = json!([extension])));
        assert!(matches!(&error, GltfError::Extension { name } if name == extension), "{error}");
    }
}

#[test]
fn no_truncation_and_no_flipped_byte_panics() {
    let folder = Folder::new();
    let whole = glb(&triangle_json(), &triangle_bytes());
    let mut refused = 0;
    for length in 1..whole.len() {
        refused += u32::from(folder.read("a.glb", &whole[..length]).is_err());
    }
    assert_eq!(refused as usize, whole.len() - 1, "every truncation shows");
    for position in 0..whole.len() {
        for flip in [1, 0x10, 0x80, 0xff] {
            let mut damaged = whole.clone();
            damaged[position] ^= flip;
            for mesh in folder.read("a.glb", &damaged).into_iter().flatten() {
                // What is read can be anything, and is checked before it is used.
                let _ = bake(&mesh, &BakeSettings::two_point(2, 2), |_| ());
            }
        }
    }
}

#[test]
fn meshes_that_cannot_be_baked() {
    let folder = Folder::new();
    let bake_obj = |text: &str| {
        let meshes = folder.read("a.obj", text.as_bytes()).unwrap();
        match bake(&meshes[0], &BakeSettings::default(), |_| ()) {
            Err(BakeError::Mesh { source, .. }) => source,
            other => panic!("{other:?}"),
        }
    };
    for bad in ["nan", "inf", "-inf", "1e39"] {
        let error = bake_obj(&format!("v 0 0 0\nv 1 {bad} 0\nv 0 1 0\nf 1 2 3\n"));
        assert!(matches!(error, MeshError::NotFinite { triangle: 0, vertex: 1, .. }), "{bad}: {error}");
    }
    assert!(matches!(bake_obj("v nan nan nan\nf 1 1 1\n"), MeshError::NotFinite { .. }));
    assert_eq!(bake_obj("v 1 1 1\nv 2 2 2\nv 3 3 3\nf 1 2 3\nf 1 1 1\n"), MeshError::ZeroArea);
    let mut out_of_range = triangle_bytes();
    out_of_range[36] = 3;
    let meshes = folder.read("a.glb", &glb(&triangle_json(), &out_of_range)).unwrap();
    assert_eq!(meshes[0].validate(), Err(MeshError::IndexOutOfRange { triangle: 0, vertex: 3, vertices: 3 }));
}

#[test]
fn a_field_that_answers_no_rays_has_none_to_measure() {
    let folder = Folder::new();
    let mesh = folder.read("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap().remove(0);
    let caps = CapGridFormat { points: 4, ..CapGridFormat::default() };
    let baked = bake(&mesh, &BakeSettings::of_cap_grid(caps), |_| ()).unwrap();
    file::write(&folder.path("a.vfield"), &[baked]).unwrap();
    let field = file::read(&folder.path("a.vfield")).unwrap().remove(0);
    let ask = ShadowQuestion { speed: false, scene: MeasureScene::OwnSurface, ..ShadowQuestion::default() };
    let error = measure_shadow_of(&mesh, &field, &ask).unwrap_err();
    assert_eq!(error, BakeError::NoRays { name: "Mesh0/Primitive0".to_owned() });
}

#[test]
fn a_missing_texture_does_not_matter() {
    let Some(path) = shared_mesh("FlightHelmet/FlightHelmet.gltf") else { return };
    let folder = Folder::new();
    for name in ["FlightHelmet.gltf", "FlightHelmet.bin"] {
        fs::copy(path.with_file_name(name), folder.path(name)).unwrap();
    }
    assert_eq!(read_meshes(&folder.path("FlightHelmet.gltf")).unwrap().len(), 6);
}
