//! The `.vfield` file: every field of one source file, compressed without loss.
//!
//! | bytes | content |
//! | --- | --- |
//! | 8 | magic, [`MAGIC`] |
//! | 4 | format version, `u32` little-endian, [`VERSION`] |
//! | 4 | length of the index, `u32` little-endian, at most [`MAX_INDEX_BYTES`] |
//! | 4 | CRC-32 of everything after this number |
//! | … | the index: JSON, for each field its [`FieldHeader`] and for each of its parts what it is and how long its stream |
//! | … | the parts, one zlib stream each: field by field in the index's order, within a field in a fixed order |
//!
//! Files are untrusted: every length is checked against the bytes that are there before anything is allocated for it.

use std::collections::HashSet;
use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use flate2::{Compression, read::ZlibDecoder, write::ZlibEncoder};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::field::cap_grid::CapGridHeader;
use crate::field::{CapGrid, ChordTable, FieldError, FieldHeader, FieldParts, TableFormat, VisibilityField};

/// The first bytes of every `.vfield` file. The leading non-ASCII byte and the line break expose text-mode transfers.
pub const MAGIC: [u8; 8] = *b"\x89VFIELD\n";
/// The format version that this build reads and writes.
pub const VERSION: u32 = 3;
/// Largest index that is accepted, in bytes: room for thousands of fields.
pub const MAX_INDEX_BYTES: u32 = 1 << 22;

/// Deflate cannot expand more than this (RFC 1951: a 258-byte match takes at least two bits), so a part that claims more
/// than this times its compressed size is a lie.
const MAX_EXPANSION: u64 = 1032;
const PREAMBLE_BYTES: usize = 20;

/// Why a `.vfield` file cannot be read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The file does not start with [`MAGIC`].
    #[error("this is not a .vfield file; bake one with `visfield bake MESH`")]
    NotAField,
    /// The file was written by another format version.
    #[error("format version {found} is not the version {VERSION} that this build reads; bake the mesh again")]
    Version {
        /// The version in the file.
        found: u32,
    },
    /// The file ends early, or a length in it exceeds what follows.
    #[error("the file is cut short: {expected} bytes of {what} expected, {found} found; copy or bake it again")]
    Truncated {
        /// What was being read.
        what: &'static str,
        /// Bytes that should be there.
        expected: u64,
        /// Bytes that are there.
        found: u64,
    },
    /// The file is longer than its index says.
    #[error("{extra} unexpected bytes follow the last field; copy or bake the file again")]
    TrailingBytes {
        /// Bytes left over.
        extra: u64,
    },
    /// The content is not what was written.
    #[error("the checksum does not match: the file is damaged; copy or bake it again")]
    Checksum,
    /// The index is larger than [`MAX_INDEX_BYTES`].
    #[error("an index of {bytes} bytes is over the limit of {MAX_INDEX_BYTES}; bake the meshes into several files")]
    IndexTooLarge {
        /// The size claimed, in bytes.
        bytes: u32,
    },
    /// The index is not valid.
    #[error("the index cannot be read: {0}; copy or bake the file again")]
    Index(#[from] serde_json::Error),
    /// A number of a field is out of range, or it has no part.
    #[error("field {name:?}: {source}")]
    Field {
        /// The field's name.
        name: String,
        /// What is wrong with it.
        source: FieldError,
    },
    /// Two fields have the same name.
    #[error("two fields are named {name:?}; bake the mesh again")]
    Duplicate {
        /// The name.
        name: String,
    },
    /// A part of a field does not decompress to the length that the index says, or that length cannot be allocated.
    #[error("the {part} of field {name:?} does not decompress to its {expected} bytes; bake the mesh again")]
    Part {
        /// The field's name.
        name: String,
        /// Which part of it.
        part: &'static str,
        /// Bytes that the index asks for.
        expected: u64,
    },
}

/// Why a `.vfield` file on disk cannot be read or written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FileError {
    /// The operating system refused.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Something that is not a file has this name: a folder, a device or a pipe.
    #[error("{path} is not a regular file; name one to write to")]
    NotAFile {
        /// What is there.
        path: PathBuf,
    },
    /// The content cannot be decoded.
    #[error("{path}: {source}")]
    Decode {
        /// The file.
        path: PathBuf,
        /// What is wrong with its content.
        source: DecodeError,
    },
}

/// A field in the index: its header and its parts, in the order of their streams.
#[derive(Serialize, Deserialize)]
struct IndexEntry {
    #[serde(flatten)]
    header: FieldHeader,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    table: Option<PartEntry<TableFormat>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    cap_grid: Option<PartEntry<CapGridHeader>>,
}

/// A part in the index: what it is, and the length of its stream.
#[derive(Serialize, Deserialize)]
struct PartEntry<F> {
    #[serde(flatten)]
    format: F,
    compressed_bytes: u64,
}

/// The streams of a field's parts.
struct FieldStreams<'a> {
    table: Option<&'a [u8]>,
    cap_grid: Option<&'a [u8]>,
}

impl IndexEntry {
    fn take_streams<'a>(&self, rest: &mut &'a [u8]) -> Result<FieldStreams<'a>, DecodeError> {
        let table = self.table.as_ref().map(|part| take(rest, part.compressed_bytes, "a table")).transpose()?;
        let cap_grid =
            self.cap_grid.as_ref().map(|part| take(rest, part.compressed_bytes, "a cap grid")).transpose()?;
        Ok(FieldStreams { table, cap_grid })
    }
}

/// Encodes fields as one file.
///
/// ```
/// # let field = visfield::field::example_field();
/// let bytes = visfield::file::encode(std::slice::from_ref(&field));
/// assert_eq!(visfield::file::decode(&bytes).unwrap(), [field]);
/// ```
///
/// # Panics
/// Never: writing to memory cannot fail, and headers always serialise.
pub fn encode(fields: &[VisibilityField]) -> Vec<u8> {
    let mut streams = Vec::new();
    let mut store = |bytes: &[u8]| {
        let stream = compress(bytes);
        streams.extend_from_slice(&stream);
        stream.len() as u64
    };
    let index: Vec<IndexEntry> = fields
        .iter()
        .map(|field| IndexEntry {
            header: field.header().clone(),
            table: field
                .table()
                .map(|table| PartEntry { format: table.format(), compressed_bytes: store(table.bytes()) }),
            cap_grid: field
                .cap_grid()
                .map(|grid| PartEntry { format: grid.header().clone(), compressed_bytes: store(&grid.bytes()) }),
        })
        .collect();
    let index = serde_json::to_vec(&index).expect("headers are plain data");

    let content = [&index[..], &streams].concat();
    let mut file = Vec::with_capacity(PREAMBLE_BYTES + content.len());
    file.extend_from_slice(&MAGIC);
    file.extend_from_slice(&VERSION.to_le_bytes());
    file.extend_from_slice(&(index.len() as u32).to_le_bytes());
    file.extend_from_slice(&crc32fast::hash(&content).to_le_bytes());
    file.extend_from_slice(&content);
    file
}

/// Decodes a file's fields.
///
/// # Errors
/// [`DecodeError`] for anything that is not such a file, whole and undamaged. Hostile bytes neither panic nor allocate more
/// than their size justifies: an index up to [`MAX_INDEX_BYTES`], and per part what deflate can make of its bytes.
pub fn decode(bytes: &[u8]) -> Result<Vec<VisibilityField>, DecodeError> {
    let mut rest = bytes;
    if take(&mut rest, 8, "magic").map_err(|_| DecodeError::NotAField)? != MAGIC {
        return Err(DecodeError::NotAField);
    }
    let version = take_u32(&mut rest, "version")?;
    if version != VERSION {
        return Err(DecodeError::Version { found: version });
    }
    let index_bytes = take_u32(&mut rest, "index length")?;
    if index_bytes > MAX_INDEX_BYTES {
        return Err(DecodeError::IndexTooLarge { bytes: index_bytes });
    }
    let checksum = take_u32(&mut rest, "checksum")?;
    // A cut file is the commonest damage; say so before the checksum merely says "damaged".
    let content = rest;
    let index = take(&mut rest, u64::from(index_bytes), "index")?;
    let damaged = crc32fast::hash(content) != checksum;
    let entries: Vec<IndexEntry> = match serde_json::from_slice(index) {
        Ok(entries) => entries,
        Err(_) if damaged => return Err(DecodeError::Checksum),
        Err(error) => return Err(error.into()),
    };
    let mut names = HashSet::new();
    if let Some(twice) = entries.iter().find(|entry| !names.insert(&entry.header.name)) {
        return Err(DecodeError::Duplicate { name: twice.header.name.clone() });
    }
    let streams = entries.iter().map(|entry| entry.take_streams(&mut rest)).collect::<Result<Vec<_>, _>>()?;
    if !rest.is_empty() {
        return Err(DecodeError::TrailingBytes { extra: rest.len() as u64 });
    }
    if damaged {
        return Err(DecodeError::Checksum);
    }
    entries.into_iter().zip(streams).map(|(entry, streams)| decode_field(entry, &streams)).collect()
}

/// Writes fields to `path`, atomically: the file is complete or, on failure, as it was before. Symbolic links are followed,
/// and a file that is there keeps its permissions.
///
/// # Errors
/// [`FileError::Io`] if the folder cannot be written to, [`FileError::NotAFile`] if something else than a file is there.
pub fn write(path: &Path, fields: &[VisibilityField]) -> Result<(), FileError> {
    write_bytes(path, &encode(fields))
}

/// Writes any file as [`write()`] writes fields: whole or not at all, through links, and to nothing but a file.
///
/// ```
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("note.txt");
/// visfield::file::write_bytes(&path, b"whole")?;
/// assert_eq!(std::fs::read(&path)?, b"whole");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// As for [`write()`].
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    let io_error = |source| FileError::Io { path: path.to_owned(), source };
    // What is replaced is the file itself, not a link to it.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let existing = fs::metadata(&target).ok();
    if existing.as_ref().is_some_and(|metadata| !metadata.is_file()) {
        return Err(FileError::NotAFile { path: path.to_owned() });
    }
    let folder = match target.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    if let Some(existing) = existing {
        builder.permissions(existing.permissions());
    } else {
        // A temporary file is private by default; this one is meant to be read by others.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o644));
    }
    let mut temporary = builder.tempfile_in(folder).map_err(io_error)?;
    temporary.write_all(bytes).map_err(io_error)?;
    temporary.as_file().sync_all().map_err(io_error)?;
    temporary.persist(&target).map_err(|error| io_error(error.error))?;
    Ok(())
}

/// Reads the fields of the file at `path`.
///
/// # Errors
/// [`FileError`] if the file cannot be read or decoded.
pub fn read(path: &Path) -> Result<Vec<VisibilityField>, FileError> {
    let bytes = fs::read(path).map_err(|source| FileError::Io { path: path.to_owned(), source })?;
    decode(&bytes).map_err(|source| FileError::Decode { path: path.to_owned(), source })
}

fn decode_field(entry: IndexEntry, streams: &FieldStreams) -> Result<VisibilityField, DecodeError> {
    let name = entry.header.name.clone();
    let in_field = |source| DecodeError::Field { name: name.clone(), source };
    let decompressed = |stream, part, expected| {
        decompress(stream, expected).ok_or_else(|| DecodeError::Part { name: name.clone(), part, expected })
    };
    // Before anything is decompressed for it.
    entry.header.validate().map_err(in_field)?;
    let mut parts = FieldParts::default();
    if let (Some(PartEntry { format, .. }), Some(stream)) = (entry.table, streams.table) {
        format.validate().map_err(in_field)?;
        let bytes = decompressed(stream, "table", format.bytes())?;
        parts.table = Some(ChordTable::new(format, bytes).map_err(in_field)?);
    }
    if let (Some(PartEntry { format: header, .. }), Some(stream)) = (entry.cap_grid, streams.cap_grid) {
        header.validate().map_err(in_field)?;
        let bytes = decompressed(stream, "cap grid", header.format.bytes())?;
        parts.cap_grid = Some(CapGrid::new(header, &bytes).map_err(in_field)?);
    }
    VisibilityField::new(entry.header, parts).map_err(in_field)
}

fn compress(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).and_then(|()| encoder.finish()).expect("writing to memory cannot fail")
}

/// What a stream holds, if that is as many bytes as `expected`, they can be allocated, and nothing follows them.
fn decompress(stream: &[u8], expected: u64) -> Option<Vec<u8>> {
    if expected > stream.len() as u64 * MAX_EXPANSION {
        return None;
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(usize::try_from(expected).ok()?).ok()?;
    // One byte more than expected, so that a longer stream shows.
    let mut decoder = ZlibDecoder::new(stream).take(expected + 1);
    decoder.read_to_end(&mut bytes).ok()?;
    let read_to_its_end = decoder.into_inner().total_in() == stream.len() as u64;
    (bytes.len() as u64 == expected && read_to_its_end).then_some(bytes)
}

fn take<'a>(rest: &mut &'a [u8], count: u64, what: &'static str) -> Result<&'a [u8], DecodeError> {
    let found = rest.len() as u64;
    if count > found {
        return Err(DecodeError::Truncated { what, expected: count, found });
    }
    let (head, tail) = rest.split_at(count as usize);
    *rest = tail;
    Ok(head)
}

fn take_u32(rest: &mut &[u8], what: &'static str) -> Result<u32, DecodeError> {
    let bytes = take(rest, 4, what)?;
    Ok(u32::from_le_bytes(bytes.try_into().expect("four bytes were taken")))
}

#[cfg(test)]
mod tests {
    use super::*;
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
        let decode_forged =
            |entries, exits, radius| decode(&forge(&entry(entries, exits, radius, zeros.len()), &zeros));
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
        let entry = IndexEntry { header: ball.header().clone(), table: None, cap_grid: None };
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
        let grid = ball(CapGridHeader {
            format,
            low: low_and_range.clone(),
            range: low_and_range,
            ..CapGridHeader::default()
        });
        let header = FieldHeader { name: name.to_owned(), ..field.header().clone() };
        let table = field.table().filter(|_| table).cloned();
        VisibilityField::new(header, FieldParts { table, cap_grid: Some(grid) }).unwrap()
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
            assert!(
                matches!(with("points", points.into()), Err(DecodeError::Part { part: "cap grid", .. })),
                "{points}"
            );
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
        let index: serde_json::Value =
            serde_json::from_slice(&file[PREAMBLE_BYTES..PREAMBLE_BYTES + index_bytes]).unwrap();
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
        let fields: Vec<_> =
            (0..4000).map(|index| with_caps(&format!("Mesh{index}/Primitive0"), format, true)).collect();
        assert_eq!(decode(&encode(&fields)).unwrap().len(), fields.len());
    }
}
