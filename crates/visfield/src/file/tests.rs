use super::*;
use crate::distance::{DistanceGridFormat, DistancePrecision, ball_grid};
use crate::field::cap_grid::{CapGridFormat, CapPrecision, HarmonicOrder, ball};
use crate::field::{Representation, ball_field};

fn sample() -> Vec<u8> {
    encode(&two_fields())
}

fn two_fields() -> [VisibilityField; 2] {
    let named = |name: &str, field: VisibilityField| {
        let header = FieldHeader { name: name.to_owned(), ..field.header().clone() };
        VisibilityField::new(header, field.parts().clone()).unwrap()
    };
    [named("Mesh0/Primitive0", ball_field(0.5, 9, 8)), named("Mesh1/Primitive0", ball_field(0.25, 5, 4))]
}

/// Writes `index` as JSON and `payload` behind it, with a right checksum: a forger can compute one too.
fn forge(index: &str, payload: &[u8]) -> Vec<u8> {
    let content = [index.as_bytes(), payload].concat();
    let mut file = MAGIC.to_vec();
    file.extend(VERSION.to_le_bytes());
    file.extend((index.len() as u32).to_le_bytes());
    file.extend(crc32fast::hash(&content).to_le_bytes());
    file.extend(content);
    file
}

#[test]
fn round_trip_on_disk() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.vfield");
    let fields = two_fields();
    write(&path, &fields).unwrap();
    assert_eq!(read(&path).unwrap(), fields);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays behind");
}

#[test]
#[cfg(unix)]
fn links_are_followed_and_what_is_no_file_is_left_alone() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let folder = tempfile::tempdir().unwrap();
    let (real, link) = (folder.path().join("real.vfield"), folder.path().join("link.vfield"));
    fs::write(&real, b"old").unwrap();
    fs::set_permissions(&real, fs::Permissions::from_mode(0o600)).unwrap();
    symlink(&real, &link).unwrap();
    write(&link, &two_fields()).unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert_eq!(read(&real).unwrap(), two_fields());
    assert_eq!(fs::metadata(&real).unwrap().permissions().mode() & 0o777, 0o600);
    assert!(matches!(write(folder.path(), &[]), Err(FileError::NotAFile { .. })));
    let socket = folder.path().join("socket");
    let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    assert!(matches!(write(&socket, &[]), Err(FileError::NotAFile { .. })));
}

#[test]
fn every_truncation_is_an_error() {
    let file = sample();
    for length in 0..file.len() {
        let error = decode(&file[..length]).unwrap_err();
        let expected = if length < 8 {
            matches!(error, DecodeError::NotAField)
        } else {
            matches!(error, DecodeError::Truncated { .. })
        };
        assert!(expected, "{length} bytes: {error}");
    }
}

#[test]
fn every_flipped_bit_is_an_error() {
    let file = sample();
    for position in 0..file.len() {
        let mut damaged = file.clone();
        damaged[position] ^= 1 << (position % 8);
        assert!(decode(&damaged).is_err(), "byte {position}");
    }
}

#[test]
fn damage_is_told_apart() {
    let mut newer = sample();
    newer[8] = 99;
    assert!(matches!(decode(&newer), Err(DecodeError::Version { found: 99 })));
    let mut flipped = sample();
    *flipped.last_mut().unwrap() ^= 1;
    assert!(matches!(decode(&flipped), Err(DecodeError::Checksum)));
    assert!(matches!(decode(b"v 0 0 0\nf 1 2 3\n"), Err(DecodeError::NotAField)));
    assert!(matches!(decode(&[]), Err(DecodeError::NotAField)));
    let longer = [sample(), vec![0; 3]].concat();
    assert!(matches!(decode(&longer), Err(DecodeError::TrailingBytes { extra: 3 })));
}

#[test]
fn forged_lengths_allocate_nothing() {
    let mut huge_index = sample();
    huge_index[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(matches!(decode(&huge_index), Err(DecodeError::IndexTooLarge { .. })));

    let entry = |entries: u32, exits: u32, radius: &str, compressed: usize| {
        format!(
            r#"[{{"name":"x","bounds":{{"center":[0,0,0],"axes":[[{radius},0,0],[0,1,0],[0,0,1]]}},"triangles":1,
            "table":{{"representation":{{"two-point":{{"entries":{entries},"exits":{exits}}}}},"encoding":"u8",
            "compressed_bytes":{compressed}}}}}]"#
        )
    };
    let zeros = compress(&[0; 16]);
    let decode_forged = |entries, exits, radius| decode(&forge(&entry(entries, exits, radius, zeros.len()), &zeros));
    assert!(decode_forged(2, 2, "1").is_ok(), "the forger's template itself is sound");
    assert!(
        matches!(decode_forged(180, 180, "1"), Err(DecodeError::Part { part: "table", .. })),
        "a gigabyte from 20 bytes"
    );
    assert!(matches!(decode_forged(2, 3, "1"), Err(DecodeError::Part { part: "table", .. })));
    assert!(matches!(decode_forged(1, 2, "1"), Err(DecodeError::Part { part: "table", .. })));
    for (entries, exits, radius) in [(0, 2, "1"), (100_000, 2, "1"), (2, 2, "0"), (2, 2, "1e-30")] {
        assert!(matches!(decode_forged(entries, exits, radius), Err(DecodeError::Field { .. })));
    }
    let padded = [&zeros[..], &[0; 4]].concat();
    let longer_stream = decode(&forge(&entry(2, 2, "1", padded.len()), &padded));
    assert!(matches!(longer_stream, Err(DecodeError::Part { part: "table", .. })), "bytes after the stream");
    let twice = encode(&[ball_field(0.5, 3, 3), ball_field(0.5, 3, 3)]);
    assert!(matches!(decode(&twice), Err(DecodeError::Duplicate { .. })));
    assert!(decode_forged(2, 2, "1e999").is_err(), "infinite radius");
    let past_end = entry(2, 2, "1", usize::MAX);
    assert!(matches!(decode(&forge(&past_end, &zeros)), Err(DecodeError::Truncated { .. })));
    assert!(matches!(decode(&forge("{", &[])), Err(DecodeError::Index(_))));
}

#[test]
fn a_field_without_parts_is_an_error() {
    let ball = ball_field(0.5, 3, 3);
    let entry =
        IndexEntry { header: ball.header().clone(), table: None, cap_grid: None, distance_grid: None, shape: None };
    let index = serde_json::to_string(&[entry]).unwrap();
    assert!(!index.contains("table"), "{index}");
    let empty = decode(&forge(&index, &[]));
    assert!(matches!(empty, Err(DecodeError::Field { source: FieldError::Empty, .. })));
    let with_stream = decode(&forge(&index, &compress(ball.table().unwrap().bytes())));
    assert!(matches!(with_stream, Err(DecodeError::TrailingBytes { .. })));
}

/// A field with a cap grid, and a table beside it if asked for.
fn with_caps(name: &str, format: CapGridFormat, table: bool) -> VisibilityField {
    let field = ball_field(1.0, 5, 4);
    let low_and_range = vec![0.0; format.order.coefficients()];
    let grid =
        ball(CapGridHeader { format, low: low_and_range.clone(), range: low_and_range, ..CapGridHeader::default() });
    let header = FieldHeader { name: name.to_owned(), ..field.header().clone() };
    let table = field.table().filter(|_| table).cloned();
    VisibilityField::new(header, FieldParts { table, cap_grid: Some(grid), ..FieldParts::default() }).unwrap()
}

#[test]
fn cap_grids_round_trip_alone_and_beside_tables() {
    let mut fields = Vec::new();
    for order in [HarmonicOrder::One, HarmonicOrder::Three] {
        for precision in [CapPrecision::U8, CapPrecision::F16] {
            for table in [false, true] {
                let format = CapGridFormat { points: 5, order, precision, ..CapGridFormat::DEFAULT };
                fields.push(with_caps(&fields.len().to_string(), format, table));
            }
        }
    }
    let decoded = decode(&encode(&fields)).unwrap();
    assert_eq!(decoded, fields);
    for (index, field) in decoded.iter().enumerate() {
        assert_eq!((field.table().is_some(), field.cap_grid().is_some()), (index % 2 == 1, true));
    }
}

#[test]
fn forged_cap_grids_allocate_nothing() {
    let format = CapGridFormat { points: 4, ..CapGridFormat::DEFAULT };
    let file = encode(&[with_caps("x", format, false)]);
    let index_bytes = u32::from_le_bytes(file[12..16].try_into().unwrap()) as usize;
    let (index, stream) = file[PREAMBLE_BYTES..].split_at(index_bytes);
    let index: serde_json::Value = serde_json::from_slice(index).unwrap();
    let with = |key: &str, value: serde_json::Value| {
        let mut forged = index.clone();
        forged[0]["cap_grid"][key] = value;
        decode(&forge(&forged.to_string(), stream))
    };
    assert!(with("points", 4.into()).is_ok(), "the forger's template itself is sound");
    // A wrong length: the header is sound, and its numbers are not there. 64³ is a mebibyte from a few hundred bytes.
    for points in [5, 64] {
        assert!(matches!(with("points", points.into()), Err(DecodeError::Part { part: "cap grid", .. })), "{points}");
    }
    let field_error = |result| match result {
        Err(DecodeError::Field { source, .. }) => source,
        other => panic!("{other:?}"),
    };
    for points in [0_u32, 3, 65, 100_000, u32::MAX] {
        assert_eq!(field_error(with("points", points.into())), FieldError::CapPoints { points });
    }
    let numbers = |numbers: &[f64]| serde_json::json!(numbers);
    for (key, value) in [
        ("low", numbers(&[0.0; 3])),
        ("low", numbers(&[0.0; 16])),
        ("low", numbers(&[])),
        ("range", numbers(&[1.0; 5])),
        // Beyond f32, and so infinite.
        ("low", numbers(&[1e300, 0.0, 0.0, 0.0])),
        ("half_extents", numbers(&[0.0; 3])),
        ("half_extents", numbers(&[-1.0, 1.0, 1.0])),
        ("center", numbers(&[1e300, 0.0, 0.0])),
        ("order", "three".into()),
        ("falloff", serde_json::json!({"linear": {"distance": 0.0}})),
        ("error", serde_json::json!({"outside": 1e300, "inside": 0.0})),
    ] {
        assert_eq!(field_error(with(key, value.clone())), FieldError::CapGrid, "{key}: {value}");
    }
    // JSON has no NaN.
    assert!(matches!(with("low", serde_json::json!([null, 0.0, 0.0, 0.0])), Err(DecodeError::Index(_))));
    assert!(matches!(with("compressed_bytes", u64::MAX.into()), Err(DecodeError::Truncated { .. })));
    assert!(matches!(with("compressed_bytes", 7.into()), Err(DecodeError::TrailingBytes { .. })));
    assert!(matches!(with("precision", "u4".into()), Err(DecodeError::Index(_))));
}

#[test]
fn the_index_names_the_parts() {
    let file = encode(&[ball_field(0.5, 3, 2)]);
    let index_bytes = u32::from_le_bytes(file[12..16].try_into().unwrap()) as usize;
    let index: serde_json::Value = serde_json::from_slice(&file[PREAMBLE_BYTES..PREAMBLE_BYTES + index_bytes]).unwrap();
    let table = &index[0]["table"];
    assert_eq!(table["representation"], serde_json::json!({"two-point": {"entries": 3, "exits": 2}}));
    assert_eq!(table["encoding"], "u8");
    assert_eq!(table["compressed_bytes"], file.len() - PREAMBLE_BYTES - index_bytes);
}

#[test]
fn errors_name_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing.vfield");
    assert!(read(&missing).unwrap_err().to_string().contains("missing.vfield"));
    let unwritable = folder.path().join("no/such/folder/x.vfield");
    assert!(matches!(write(&unwritable, &[]), Err(FileError::Io { .. })));
}

#[test]
fn representation_names_are_stable() {
    let json = serde_json::to_string(&Representation::TwoPoint { entries: 65, exits: 32 }).unwrap();
    assert_eq!(json, r#"{"two-point":{"entries":65,"exits":32}}"#);
}

#[test]
fn thousands_of_fields_fit_one_file() {
    let format = CapGridFormat { points: 4, ..CapGridFormat::DEFAULT };
    let fields: Vec<_> = (0..4000).map(|index| with_caps(&format!("Mesh{index}/Primitive0"), format, true)).collect();
    assert_eq!(decode(&encode(&fields)).unwrap().len(), fields.len());
}

/// A field with a distance grid, alone.
fn with_distances(name: &str, precision: DistancePrecision) -> VisibilityField {
    let header = FieldHeader { name: name.to_owned(), ..ball_field(1.0, 5, 4).header().clone() };
    VisibilityField::new(header, ball_grid(1.0, DistanceGridFormat { voxels: 12, precision }).into()).unwrap()
}

#[test]
fn distance_grids_round_trip() {
    let fields = [DistancePrecision::U8, DistancePrecision::U16]
        .map(|precision| with_distances(if precision == DistancePrecision::U8 { "u8" } else { "u16" }, precision));
    assert_eq!(decode(&encode(&fields)).unwrap(), fields);
}

#[test]
fn forged_distance_grids_allocate_nothing() {
    let file = encode(&[with_distances("x", DistancePrecision::U8)]);
    let index_bytes = u32::from_le_bytes(file[12..16].try_into().unwrap()) as usize;
    let (index, stream) = file[PREAMBLE_BYTES..].split_at(index_bytes);
    let index: serde_json::Value = serde_json::from_slice(index).unwrap();
    let with = |key: &str, value: serde_json::Value| {
        let mut forged = index.clone();
        forged[0]["distance_grid"][key] = value;
        decode(&forge(&forged.to_string(), stream))
    };
    assert!(with("voxels", 12.into()).is_ok(), "the forger's template itself is sound");
    let points = |points: [u32; 3]| serde_json::json!(points);
    assert!(matches!(with("points", points([12, 12, 11])), Err(DecodeError::Part { part: "distance grid", .. })));
    assert!(matches!(with("precision", "u16".into()), Err(DecodeError::Part { part: "distance grid", .. })));
    for (key, value) in [
        ("points", points([0, 12, 12])),
        ("points", points([1, 12, 12])),
        ("points", points([12, 12, 13])),
        ("points", points([u32::MAX; 3])),
        ("voxels", 7.into()),
        ("voxels", 100_000.into()),
        ("voxel", 0.0.into()),
        ("voxel", (-1.0).into()),
        ("voxel", 1e300.into()),
        ("first", serde_json::json!([1e300, 0.0, 0.0])),
        ("low", 1e300.into()),
        ("range", (-1.0).into()),
        ("excess", (-1.0).into()),
    ] {
        assert!(matches!(with(key, value.clone()), Err(DecodeError::Field { .. })), "{key}: {value}");
    }
}

#[test]
fn shapes_round_trip() {
    let ground = Shape::HalfSpace.moved([0.0, -1.0, 0.0]);
    let fields = [
        VisibilityField::of_shape(ground.union(Shape::Sphere { radius: 0.5 })).unwrap(),
        VisibilityField::of_shape(Shape::Union(vec![])).unwrap(),
    ];
    for field in fields {
        assert_eq!(decode(&encode(std::slice::from_ref(&field))).unwrap(), [field]);
    }
    let file = encode(&[VisibilityField::of_shape(Shape::Sphere { radius: 0.5 }).unwrap()]);
    let index = String::from_utf8(file[PREAMBLE_BYTES..].to_vec()).unwrap();
    assert!(decode(&forge(&index, &[])).is_ok(), "the forger's template itself is sound");
    let negative = index.replace(r#""sphere":{"radius":0.5}"#, r#""sphere":{"radius":-0.5}"#);
    assert!(matches!(decode(&forge(&negative, &[])), Err(DecodeError::Field { source: FieldError::Shape(_), .. })));
}
