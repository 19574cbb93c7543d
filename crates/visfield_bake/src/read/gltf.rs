//! glTF 2.0, by crate `gltf`. Its readers trust offsets, strides and component types, so these are checked here first.

use std::path::Path;

use gltf::accessor::{Accessor, DataType, Dimensions};
use gltf::buffer::{self, View};
use gltf::mesh::{Mode, Semantic};
use gltf::{Document, Gltf, Primitive};
use thiserror::Error;

use crate::mesh::Mesh;

/// What is wrong with a `.glb` or `.gltf` file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum GltfError {
    /// The container or its JSON cannot be parsed.
    #[error("this is not glTF 2.0, or it is cut short ({0}); export it again")]
    Syntax(gltf::Error),
    /// The JSON breaks a rule of glTF.
    #[error("the glTF is not valid ({0}); export it again")]
    Invalid(gltf::Error),
    /// The file needs an extension that may change its triangles.
    #[error(
        "extension {name} is required and not supported; export the file without it (no compression or quantisation)"
    )]
    Extension {
        /// The extension.
        name: String,
    },
    /// A buffer cannot be read.
    #[error("buffer {uri} cannot be read ({source}); it belongs beside the .gltf file")]
    Buffer {
        /// Where the file says it is, or `in the file itself`.
        uri: String,
        /// Why not.
        source: gltf::Error,
    },
    /// A buffer is shorter than the file says.
    #[error("buffer {uri} is cut short: {expected} bytes expected, {found} found; copy or export it again")]
    BufferLength {
        /// Where the file says it is.
        uri: String,
        /// Bytes that should be there.
        expected: usize,
        /// Bytes that are there.
        found: usize,
    },
    /// An accessor's type or range is wrong.
    #[error(
        "the {what} of {mesh} do not lie inside their buffer, or are not of the type that glTF asks for; export it again"
    )]
    Accessor {
        /// The mesh.
        mesh: String,
        /// Which of its data.
        what: &'static str,
    },
}

/// Required extensions whose name starts so say nothing about triangles, and are not looked at.
const NO_GEOMETRY: [&str; 6] =
    ["KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_", "KHR_animation_"];

/// All primitives of the file. Buffers are looked for in `folder`.
pub(super) fn meshes(bytes: &[u8], folder: Option<&Path>) -> Result<Vec<Mesh>, GltfError> {
    let (document, mut blob) = parse(bytes)?;
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        buffers.push(read_buffer(&buffer, folder, &mut blob)?);
    }
    document
        .meshes()
        .flat_map(|mesh| mesh.primitives().map(move |p| (mesh.index(), p)).collect::<Vec<_>>())
        .map(|(mesh, primitive)| read_primitive(mesh, &primitive, &buffers))
        .collect()
}

/// The document, validated but for extensions that do not matter here, and the binary chunk.
fn parse(bytes: &[u8]) -> Result<(Document, Option<Vec<u8>>), GltfError> {
    // `gltf` subtracts the header's length without a check.
    if bytes.starts_with(b"glTF") {
        let length = bytes.get(8..12).map_or(0, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        if length < 12 {
            let error = gltf::binary::Error::Length { length, length_read: bytes.len() };
            return Err(GltfError::Syntax(gltf::Error::Binary(error)));
        }
    }
    let Gltf { document, blob } = Gltf::from_slice_without_validation(bytes).map_err(GltfError::Syntax)?;
    let mut json = document.into_json();
    let matters = |name: &String| !NO_GEOMETRY.iter().any(|prefix| name.starts_with(prefix));
    if let Some(name) = json.extensions_required.iter().find(|name| matters(name)) {
        return Err(GltfError::Extension { name: name.clone() });
    }
    json.extensions_required.clear();
    // The validation below indexes with these before it checks them.
    let positions = gltf::json::validation::Checked::Valid(Semantic::Positions);
    for (mesh, primitive) in
        json.meshes.iter().enumerate().flat_map(|(m, mesh)| mesh.primitives.iter().map(move |p| (m, p)))
    {
        let accessor = primitive.attributes.get(&positions);
        if accessor.is_some_and(|accessor| accessor.value() >= json.accessors.len()) {
            return Err(GltfError::Accessor { mesh: format!("Mesh{mesh}"), what: "positions" });
        }
    }
    let document = Document::from_json(json).map_err(GltfError::Invalid)?;
    Ok((document, blob))
}

fn read_buffer(
    buffer: &buffer::Buffer,
    folder: Option<&Path>,
    blob: &mut Option<Vec<u8>>,
) -> Result<buffer::Data, GltfError> {
    let uri = match buffer.source() {
        buffer::Source::Bin => "in the file itself".to_owned(),
        // Embedded data can be megabytes long.
        buffer::Source::Uri(uri) => uri.chars().take(80).collect(),
    };
    // `gltf` decodes such names without a check.
    if let buffer::Source::Uri(encoded) = buffer.source()
        && !percent_decodes_to_text(encoded)
    {
        return Err(GltfError::Buffer { uri, source: gltf::Error::UnsupportedScheme });
    }
    let data = buffer::Data::from_source_and_blob(buffer.source(), folder, blob)
        .map_err(|source| GltfError::Buffer { uri: uri.clone(), source })?;
    let (expected, found) = (buffer.length(), data.len());
    if found < expected {
        return Err(GltfError::BufferLength { uri, expected, found });
    }
    Ok(data)
}

/// Whether the bytes that `%` escapes stand for are UTF-8.
fn percent_decodes_to_text(uri: &str) -> bool {
    let mut bytes = Vec::new();
    let mut rest = uri.as_bytes();
    while let [first, tail @ ..] = rest {
        let escaped = tail.get(..2).and_then(|hex| u8::from_str_radix(str::from_utf8(hex).ok()?, 16).ok());
        match escaped {
            Some(byte) if *first == b'%' => {
                bytes.push(byte);
                rest = &tail[2..];
            }
            _ => {
                bytes.push(*first);
                rest = tail;
            }
        }
    }
    str::from_utf8(&bytes).is_ok()
}

fn read_primitive(mesh: usize, primitive: &Primitive, buffers: &[buffer::Data]) -> Result<Mesh, GltfError> {
    let name = format!("Mesh{mesh}/Primitive{}", primitive.index());
    let check = |accessor: &Accessor, what, types: &[DataType], dimensions| {
        let right_type = types.contains(&accessor.data_type()) && accessor.dimensions() == dimensions;
        if right_type && lies_inside(accessor, buffers).is_some() {
            Ok(())
        } else {
            Err(GltfError::Accessor { mesh: name.clone(), what })
        }
    };
    if let Some(accessor) = primitive.get(&Semantic::Positions) {
        check(&accessor, "positions", &[DataType::F32], Dimensions::Vec3)?;
    }
    if let Some(accessor) = primitive.indices() {
        check(&accessor, "indices", &[DataType::U8, DataType::U16, DataType::U32], Dimensions::Scalar)?;
    }
    let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(|data| data.0.as_slice()));
    let positions: Vec<[f32; 3]> = reader.read_positions().map(Iterator::collect).unwrap_or_default();
    let corners: Vec<u32> = match reader.read_indices() {
        Some(indices) => indices.into_u32().collect(),
        None => (0..positions.len() as u32).collect(),
    };
    Ok(Mesh { name, positions, indices: triangulate(primitive.mode(), &corners) })
}

/// Triangles of a list of corners (glTF 2.0 §3.7.2.1); none for points and lines.
fn triangulate(mode: Mode, corners: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::Triangles => corners.as_chunks::<3>().0.to_vec(),
        Mode::TriangleStrip => {
            let flip = |i: usize, [a, b, c]: [u32; 3]| if i.is_multiple_of(2) { [a, b, c] } else { [a, c, b] };
            corners.windows(3).enumerate().map(|(i, w)| flip(i, [w[0], w[1], w[2]])).collect()
        }
        Mode::TriangleFan => corners.windows(2).skip(1).map(|pair| [pair[0], pair[1], corners[0]]).collect(),
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => Vec::new(),
    }
}

/// `Some` if all of an accessor's bytes, sparse ones included, lie inside their buffers.
fn lies_inside(accessor: &Accessor, buffers: &[buffer::Data]) -> Option<()> {
    let size = accessor.size();
    if let Some(sparse) = accessor.sparse() {
        let (indices, values) = (sparse.indices(), sparse.values());
        let index_size = indices.index_type().size();
        range_fits(&indices.view(), indices.offset(), sparse.count(), index_size, buffers)?;
        range_fits(&values.view(), values.offset(), sparse.count(), size, buffers)?;
    }
    // Without a view all values are zero: nothing that could be baked.
    range_fits(&accessor.view()?, accessor.offset(), accessor.count(), size, buffers)
}

fn range_fits(view: &View, offset: usize, count: usize, size: usize, buffers: &[buffer::Data]) -> Option<()> {
    let stride = view.stride().unwrap_or(size);
    let end = count.checked_sub(1)?.checked_mul(stride)?.checked_add(size)?.checked_add(offset)?;
    let view_end = view.offset().checked_add(view.length())?;
    let inside = end <= view.length() && view_end <= buffers.get(view.buffer().index())?.len();
    (stride >= size && inside).then_some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_keep_their_winding() {
        assert_eq!(triangulate(Mode::Triangles, &[0, 1, 2, 3]), [[0, 1, 2]]);
        assert_eq!(triangulate(Mode::TriangleStrip, &[0, 1, 2, 3]), [[0, 1, 2], [1, 3, 2]]);
        assert_eq!(triangulate(Mode::TriangleFan, &[0, 1, 2, 3]), [[1, 2, 0], [2, 3, 0]]);
        for mode in [Mode::Triangles, Mode::TriangleStrip, Mode::TriangleFan] {
            for corners in [&[][..], &[0], &[0, 1]] {
                assert!(triangulate(mode, corners).is_empty());
            }
        }
        assert!(triangulate(Mode::LineStrip, &[0, 1, 2]).is_empty());
    }

    #[test]
    fn percent_escapes_are_checked() {
        assert!(percent_decodes_to_text("a%20b%C3%BC.bin") && percent_decodes_to_text("100%.bin%4"));
        assert!(!percent_decodes_to_text("%ff.bin"));
    }
}
