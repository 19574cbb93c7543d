//! Binary glTF with one mesh of positions, normals and 16-bit indices.

use gltf::binary::{Glb, Header};
use gltf::json::accessor::{ComponentType, GenericComponentType, Type};
use gltf::json::buffer::{Buffer, Target, View};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked::Valid;
use gltf::json::validation::USize64;
use gltf::json::{Accessor, Extras, Index, Mesh, Node, Root, Scene, Value, serialize};

use crate::surface::Surface;

pub(crate) fn encode(name: &str, surface: &Surface) -> Result<Vec<u8>, gltf::Error> {
    let mut file = File::default();
    let positions: Vec<[f32; 3]> = surface.positions.iter().map(|p| p.as_vec3().to_array()).collect();
    let normals: Vec<[f32; 3]> = surface.normals.iter().map(|n| n.as_vec3().to_array()).collect();
    let position_accessor = file.add_vectors(&positions);
    // glTF asks for the positions' box.
    let fold = |by: fn(f32, f32) -> f32| positions.iter().copied().reduce(|a, b| [0, 1, 2].map(|i| by(a[i], b[i])));
    let accessor = &mut file.root.accessors[position_accessor.value()];
    accessor.min = fold(f32::min).map(Value::from_iter);
    accessor.max = fold(f32::max).map(Value::from_iter);
    let normal_accessor = file.add_vectors(&normals);
    let indices: Vec<u8> = surface.triangles.as_flattened().iter().flat_map(|i| i.to_le_bytes()).collect();
    let index_accessor =
        file.add(&indices, surface.triangles.len() * 3, ComponentType::U16, Type::Scalar, Target::ElementArrayBuffer);
    let primitive = Primitive {
        attributes: [(Valid(Semantic::Positions), position_accessor), (Valid(Semantic::Normals), normal_accessor)]
            .into(),
        indices: Some(index_accessor),
        mode: Valid(Mode::Triangles),
        material: None,
        targets: None,
        extensions: None,
        extras: Extras::default(),
    };
    let name = Some(name.to_owned());
    let mesh = Mesh {
        name: name.clone(),
        primitives: vec![primitive],
        weights: None,
        extensions: None,
        extras: Extras::default(),
    };
    let mesh = file.root.push(mesh);
    let node = file.root.push(Node { name: name.clone(), mesh: Some(mesh), ..Node::default() });
    let scene = file.root.push(Scene { name, nodes: vec![node], extensions: None, extras: Extras::default() });
    file.root.scene = Some(scene);
    file.encode()
}

#[derive(Default)]
struct File {
    root: Root,
    binary: Vec<u8>,
}

impl File {
    fn add_vectors(&mut self, vectors: &[[f32; 3]]) -> Index<Accessor> {
        let bytes: Vec<u8> = vectors.as_flattened().iter().flat_map(|c| c.to_le_bytes()).collect();
        self.add(&bytes, vectors.len(), ComponentType::F32, Type::Vec3, Target::ArrayBuffer)
    }

    fn add(
        &mut self,
        bytes: &[u8],
        count: usize,
        component: ComponentType,
        kind: Type,
        target: Target,
    ) -> Index<Accessor> {
        // Indices come last and are the only ones whose length may not be a multiple of four.
        let offset = self.binary.len();
        self.binary.extend_from_slice(bytes);
        let view = self.root.push(View {
            buffer: Index::new(0),
            byte_length: USize64::from(bytes.len()),
            byte_offset: Some(USize64::from(offset)),
            byte_stride: None,
            target: Some(Valid(target)),
            name: None,
            extensions: None,
            extras: Extras::default(),
        });
        self.root.push(Accessor {
            buffer_view: Some(view),
            byte_offset: None,
            count: USize64::from(count),
            component_type: Valid(GenericComponentType(component)),
            type_: Valid(kind),
            min: None,
            max: None,
            normalized: false,
            sparse: None,
            name: None,
            extensions: None,
            extras: Extras::default(),
        })
    }

    fn encode(mut self) -> Result<Vec<u8>, gltf::Error> {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        self.root.asset.generator = Some("visfield example_meshes".to_owned());
        self.root.push(Buffer {
            byte_length: USize64::from(self.binary.len()),
            uri: None,
            name: None,
            extensions: None,
            extras: Extras::default(),
        });
        let json = serialize::to_vec(&self.root).map_err(gltf::Error::Deserialize)?;
        // The writer fills in the header.
        let header = Header { magic: *b"glTF", version: 2, length: 0 };
        Glb { header, json: json.into(), bin: Some(self.binary.into()) }.to_vec()
    }
}
