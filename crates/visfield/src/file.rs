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

use crate::distance::{DistanceField, DistanceGrid, DistanceGridHeader, Solid};
use crate::field::cap_grid::CapGridHeader;
use crate::field::{CapGrid, ChordTable, FieldError, FieldHeader, FieldParts, TableFormat, VisibilityField};
use crate::shape::Shape;

/// The first bytes of every `.vfield` file. The leading non-ASCII byte and the line break expose text-mode transfers.
pub const MAGIC: [u8; 8] = *b"\x89VFIELD\n";
/// The format version that this build reads and writes.
pub const VERSION: u32 = 4;
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
    #[serde(default, skip_serializing_if = "Option::is_none")]
    distance_grid: Option<PartEntry<DistanceGridHeader>>,
    /// In the place of a grid; it has no stream.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    shape: Option<Shape>,
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
    distance_grid: Option<&'a [u8]>,
}

impl IndexEntry {
    fn take_streams<'a>(&self, rest: &mut &'a [u8]) -> Result<FieldStreams<'a>, DecodeError> {
        let mut stream = |bytes: Option<u64>, what| bytes.map(|bytes| take(rest, bytes, what)).transpose();
        Ok(FieldStreams {
            table: stream(self.table.as_ref().map(|part| part.compressed_bytes), "a table")?,
            cap_grid: stream(self.cap_grid.as_ref().map(|part| part.compressed_bytes), "a cap grid")?,
            distance_grid: stream(self.distance_grid.as_ref().map(|part| part.compressed_bytes), "a distance grid")?,
        })
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
            distance_grid: field
                .distance_field()
                .and_then(DistanceField::grid)
                .map(|grid| PartEntry { format: *grid.header(), compressed_bytes: store(&grid.bytes()) }),
            shape: field.distance_field().and_then(DistanceField::shape).cloned(),
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
    if let (Some(PartEntry { format: header, .. }), Some(stream)) = (entry.distance_grid, streams.distance_grid) {
        header.validate().map_err(in_field)?;
        let bytes = decompressed(stream, "distance grid", header.bytes())?;
        parts.distance = Some(DistanceGrid::new(header, &bytes).map_err(in_field)?.into());
    } else if let Some(shape) = entry.shape {
        parts.distance = Some(Solid::new(shape).map_err(|error| in_field(error.into()))?.into());
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
mod tests;
