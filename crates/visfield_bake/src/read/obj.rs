//! Wavefront OBJ, by crate `tobj`.

use thiserror::Error;

use crate::mesh::Mesh;

/// What is wrong with an `.obj` file.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ObjError {
    /// OBJ is text; this is not.
    #[error("this is binary data and not OBJ text; was another format renamed?")]
    Binary,
    /// A face has fewer than three corners: the file ends early, or the face is a line.
    #[error("line {line}: a face needs at least three corners; the file may be cut short, export it again")]
    ShortFace {
        /// The line, from 1.
        line: usize,
    },
    /// A number or a reference cannot be read.
    #[error("{0}; the file may be damaged, export it again")]
    Syntax(#[from] tobj::LoadError),
}

/// The mesh of all faces of the file.
pub(super) fn meshes(bytes: &[u8]) -> Result<Vec<Mesh>, ObjError> {
    if bytes.contains(&0) {
        return Err(ObjError::Binary);
    }
    let geometry = keep_geometry(&String::from_utf8_lossy(bytes))?;
    let options = tobj::LoadOptions { triangulate: true, ..tobj::LoadOptions::default() };
    let no_materials = |_: &std::path::Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut geometry.as_bytes(), &options, no_materials)?;
    let mut merged = Mesh { name: "Mesh0/Primitive0".to_owned(), ..Mesh::default() };
    for model in models {
        let first = merged.positions.len() as u32;
        merged.positions.extend(model.mesh.positions.as_chunks::<3>().0);
        merged.indices.extend(model.mesh.indices.as_chunks::<3>().0.iter().map(|t| t.map(|i| first + i)));
    }
    Ok(vec![merged])
}

/// Keeps only the positions, and of the faces only their references to positions.
///
/// Normals, texture coordinates, colours, groups and materials say nothing about visibility, so that errors in them must
/// not matter; and `tobj` would take polylines (`l`) for faces.
fn keep_geometry(text: &str) -> Result<String, ObjError> {
    let mut geometry = String::with_capacity(text.len());
    let mut lines = text.lines().enumerate();
    while let Some((number, line)) = lines.next() {
        let mut words: Vec<&str> = line.split_whitespace().collect();
        if !matches!(words.first(), Some(&("v" | "f"))) {
            continue;
        }
        // A backslash at the end continues the line.
        while words.last() == Some(&"\\") || words.last().is_some_and(|word| word.ends_with('\\')) {
            if let Some(last) = words.last_mut() {
                *last = last.trim_end_matches('\\');
            }
            words.extend(lines.next().iter().flat_map(|(_, next)| next.split_whitespace()));
        }
        words.retain(|word| !word.is_empty());
        // Comments may follow.
        let end = words.iter().position(|word| word.starts_with('#')).unwrap_or(words.len());
        words.truncate(end);
        if words.first() == Some(&"f") {
            if words.len() < 4 {
                return Err(ObjError::ShortFace { line: number + 1 });
            }
            // A corner without a position stays as it is, for `tobj` to refuse.
            for word in &mut words {
                *word = word.split('/').next().filter(|position| !position.is_empty()).unwrap_or(word);
            }
        } else if words.len() > 5 {
            // Vertex colours.
            words.truncate(4);
        }
        geometry.push_str(&words.join(" "));
        geometry.push('\n');
    }
    Ok(geometry)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Mesh, ObjError> {
        meshes(text.as_bytes()).map(|mut meshes| meshes.remove(0))
    }

    const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

    #[test]
    fn all_ways_to_write_a_face() {
        for face in [
            "f 1 2 3 4",
            "f 1/1 2/2 3/3 4/4",
            "f 1//1 2//1 3//1 4//1",
            "f -4 -3 -2 -1",
            "f 1 2 3\nf 1 3 4",
            "f 1 2 \\\n3 4",
            "f 1 2\\\n 3 4",
            "o a\nf 1 2 3\no b\nusemtl none\nf 1 3 4",
            "f 1 2 3 4 # a comment",
            "mtllib none.mtl\nvt nonsense\nvn 0 0\nf 1/99/99 2 3 4\nl 1 2 3\np 1",
        ] {
            let mesh = read(&format!("{SQUARE}{face}\n")).unwrap();
            let corners: Vec<[f32; 3]> =
                mesh.indices.as_flattened().iter().map(|&i| mesh.positions[i as usize]).collect();
            let [a, b, c, d] = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
            assert_eq!(corners, [a, b, c, a, c, d], "{face}");
        }
    }

    #[test]
    fn colours_weights_and_foreign_letters_are_no_trouble() {
        let text = "# Gr\u{fffd}\u{fffd}e\nv 0 0 0 1 1 1\nv 2 0 0 2\nv 0 1 0 1 0 0 0.5\nf 1 2 3\n";
        assert_eq!(read(text).unwrap().positions, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let latin1 = [b"# Gr\xfc\xdfe\n", text.as_bytes()].concat();
        assert_eq!(meshes(&latin1).unwrap()[0].indices.len(), 1);
    }

    #[test]
    fn damage_is_told_apart() {
        let face = |face: &str| read(&format!("{SQUARE}{face}\n"));
        assert_eq!(face("f 1 2"), Err(ObjError::ShortFace { line: 5 }));
        assert_eq!(face("f"), Err(ObjError::ShortFace { line: 5 }));
        for out_of_range in
            ["f 1 2 5", "f 0 1 2", "f 1 2 -5", "f 1 2 9223372036854775807", "f 1 2 -9223372036854775808"]
        {
            let error = face(out_of_range).unwrap_err();
            assert_eq!(error, ObjError::Syntax(tobj::LoadError::FaceVertexOutOfBounds), "{out_of_range}");
        }
        for garbled in ["f 1 2 x", "f 1.5 2 3", "f 1 2 99999999999999999999", "f 1 2 /3"] {
            assert!(matches!(face(garbled), Err(ObjError::Syntax(_))), "{garbled}");
        }
        for garbled in ["v 1 2", "v a b c", "v 1 2 3 0", "v"] {
            assert!(matches!(read(&format!("{garbled}\nf 1 1 1")), Err(ObjError::Syntax(_))), "{garbled}");
        }
        assert_eq!(meshes(b"v 0 0 0\n\0\x01"), Err(ObjError::Binary));
        assert_eq!(read("hello, world").unwrap().indices.len(), 0);
    }

    #[test]
    fn every_truncation_gives_a_mesh_or_an_error() {
        let whole = format!("{SQUARE}f 1/1/1 2/2/2 3//3 4\nf -1 \\\n -2 -3\n");
        for length in 0..whole.len() {
            let _ = read(&whole[..length]);
        }
    }
}
