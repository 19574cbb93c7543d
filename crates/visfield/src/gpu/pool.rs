//! All fields' parts in one storage buffer: instances share them, and no binding arrays are needed.
//!
//! Cap grids are in it too, and not in a 3D texture. On a software adapter a filtered read of a texture took half the time of eight
//! words and their interpolation, but that read is a sixth of what the caps pass does for an object. The buffer interpolates with
//! full precision, holds grids of any size and both precisions, and needs no atlas.

use glam::Affine3A;
use range_alloc::RangeAllocator;
use thiserror::Error;

use super::layout::{CapGridData, DistanceData, cap_grid_words, distance_words};
use crate::distance::DistanceField;
use crate::estimate::source::Answers;
use crate::field::cap_grid::HarmonicOrder;
use crate::field::lookup::{Grid, TwoPointGrid};
use crate::field::{BoundingEllipsoid, CapGrid, ChordTable, Encoding, VisibilityField};

/// First size of the buffer in words: next to nothing, for scenes without fields.
const FIRST_WORDS: u64 = 1024;

/// Words of what a cap grid starts with.
const HEADER_WORDS: u64 = (size_of::<CapGridData>() / 4) as u64;

/// Why a field cannot be uploaded.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PoolError {
    /// The pool would exceed its [limit](FieldPool::limit), or no run of free bytes is long enough: then
    /// [repacking](FieldPool::repack) may help.
    #[error(
        "a field of {bytes} bytes does not fit the field pool of at most {limit} bytes; bake smaller parts (fewer \
         entries, exits or points) or use fewer meshes"
    )]
    Full {
        /// Bytes that were asked for.
        bytes: u64,
        /// Largest pool that is allowed, in bytes.
        limit: u64,
    },
    /// Of tables, the passes read two-point ones only.
    #[error("the GPU passes read two-point fields only; bake this one without `--representation hemisphere`")]
    Representation,
}

/// A table in the pool.
///
/// ```no_run
/// # fn show(slot: &visfield::gpu::FieldSlot) {
/// if let Some(table) = slot.table() {
///     println!("{:?} from byte {}", table.grid, table.first_byte);
/// }
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct TableSlot {
    /// Where the table starts, in bytes.
    pub first_byte: u32,
    /// The sides of its grids.
    pub grid: TwoPointGrid,
    /// How it is encoded.
    pub encoding: Encoding,
}

/// A cap grid in the pool.
///
/// ```no_run
/// # fn show(slot: &visfield::gpu::FieldSlot) {
/// let is_trusted_inside = slot.cap_grid().is_some_and(|grid| grid.serves_inside);
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct CapGridSlot {
    /// Where the grid starts, in headers: it is aligned to them.
    pub number: u32,
    /// Harmonics per point.
    pub order: HarmonicOrder,
    /// [`CapGrid::serves_inside`](crate::CapGrid::serves_inside)
    pub serves_inside: bool,
    /// From field space to that of the grid.
    pub cap_from_field: Affine3A,
}

/// Distances in the pool.
///
/// ```no_run
/// # fn show(slot: &visfield::gpu::FieldSlot) {
/// let first_word = slot.distance().map(|distance| distance.first_word);
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct DistanceSlot {
    /// Where they start, in words: their [`DistanceData`].
    pub first_word: u32,
    /// From field space to that of the distances.
    pub distance_from_field: Affine3A,
}

/// Where a field lies in the pool. Give it back with [`FieldPool::remove`].
#[derive(Debug)]
pub struct FieldSlot {
    words: std::ops::Range<u64>,
    table: Option<TableSlot>,
    cap_grid: Option<CapGridSlot>,
    distance: Option<DistanceSlot>,
    answers: Answers,
    bounds: BoundingEllipsoid,
}

impl FieldSlot {
    /// The field's table, if it has one.
    pub fn table(&self) -> Option<&TableSlot> {
        self.table.as_ref()
    }

    /// The field's cap grid, if it has one.
    pub fn cap_grid(&self) -> Option<&CapGridSlot> {
        self.cap_grid.as_ref()
    }

    /// The field's distances, if it has any.
    pub fn distance(&self) -> Option<&DistanceSlot> {
        self.distance.as_ref()
    }

    /// What the field can answer.
    pub fn answers(&self) -> Answers {
        self.answers
    }

    /// Bytes that it occupies.
    pub fn bytes(&self) -> u64 {
        (self.words.end - self.words.start) * 4
    }

    /// The field's bounding ellipsoid in its mesh's space.
    pub fn bounds(&self) -> &BoundingEllipsoid {
        &self.bounds
    }
}

/// What a [`FieldPool`] has done, to see that a field is uploaded once however many instances use it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PoolStatistics {
    /// Fields uploaded so far.
    pub uploads: u64,
    /// Bytes uploaded so far.
    pub uploaded_bytes: u64,
    /// Bytes that resident fields occupy.
    pub resident_bytes: u64,
    /// Size of the buffer in bytes.
    pub buffer_bytes: u64,
}

/// All resident fields' parts in one growing storage buffer.
///
/// ```no_run
/// # fn upload(device: &wgpu::Device, queue: &wgpu::Queue, field: &visfield::VisibilityField) {
/// use visfield::gpu::FieldPool;
/// let mut pool = FieldPool::new(device);
/// let slot = pool.insert(device, queue, field).expect("the first table fits");
/// assert_eq!(pool.statistics().uploads, 1);
/// pool.remove(slot);
/// # }
/// ```
#[derive(Debug)]
pub struct FieldPool {
    buffer: wgpu::Buffer,
    words: RangeAllocator<u64>,
    /// What the adapter can bind.
    most_words: u64,
    /// What it may grow to.
    limit_words: u64,
    statistics: PoolStatistics,
}

/// Where the parts of a field go, in words from the start of its place: the table, then whole headers: that of the cap grid and
/// room for its points, and that of the distances and room for them. All places are whole headers too, so that a grid starts at one.
struct Plan {
    cap_grid: u64,
    distance: u64,
    total: u64,
}

impl Plan {
    fn new(field: &VisibilityField) -> Self {
        let table = field.table().map_or(0, |table| table.bytes().len() as u64).div_ceil(4);
        let cap_grid = table.next_multiple_of(HEADER_WORDS);
        let caps = field.cap_grid().map_or(0, |grid| HEADER_WORDS + cap_grid_words(grid).len() as u64);
        let distance = (cap_grid + caps).next_multiple_of(HEADER_WORDS);
        let distances = field.distance_field().map_or(0, |field| HEADER_WORDS + distance_words(field).len() as u64);
        Self { cap_grid, distance, total: (distance + distances).next_multiple_of(HEADER_WORDS) }
    }
}

impl FieldPool {
    /// An empty pool. Its buffer grows up to the device's limit for storage bindings.
    pub fn new(device: &wgpu::Device) -> Self {
        let limits = device.limits();
        // Positions are u32 byte offsets in the shader.
        let limit_bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size).min(u64::from(u32::MAX));
        let limit_words = limit_bytes / 4 / HEADER_WORDS * HEADER_WORDS;
        let first = FIRST_WORDS.min(limit_words);
        Self {
            buffer: create_buffer(device, first),
            words: RangeAllocator::new(0..first),
            most_words: limit_words,
            limit_words,
            statistics: PoolStatistics { buffer_bytes: first * 4, ..PoolStatistics::default() },
        }
    }

    /// Bytes that a field takes in a pool: a little more than its own, since places are aligned.
    ///
    /// ```
    /// # let field = visfield::field::example_field();
    /// let bytes = visfield::gpu::FieldPool::bytes_of(&field);
    /// assert!((field.bytes()..field.bytes() + 200).contains(&bytes));
    /// ```
    pub fn bytes_of(field: &VisibilityField) -> u64 {
        Plan::new(field).total * 4
    }

    /// Largest size of the buffer, in bytes.
    pub fn limit(&self) -> u64 {
        self.limit_words * 4
    }

    /// Largest size that the adapter allows, in bytes.
    pub fn adapter_limit(&self) -> u64 {
        self.most_words * 4
    }

    /// Lets the buffer grow no further than to `bytes`, or to what the adapter can bind if that is less, but always to 4 KiB. A
    /// buffer that is larger already stays so until the pool is [repacked](Self::repack).
    pub fn set_limit(&mut self, bytes: u64) {
        let words = (bytes / 4).max(FIRST_WORDS) / HEADER_WORDS * HEADER_WORDS;
        self.limit_words = words.min(self.most_words);
    }

    /// Uploads a field's parts.
    ///
    /// # Errors
    /// [`PoolError::Full`] if the adapter's limit leaves no room, [`PoolError::Representation`] for a table that the passes do
    /// not read; the pool stays as it was.
    pub fn insert(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        field: &VisibilityField,
    ) -> Result<FieldSlot, PoolError> {
        let grid = match field.table().map(ChordTable::grid) {
            Some(Grid::TwoPoint(grid)) => Some(grid),
            Some(Grid::Hemisphere(_)) => return Err(PoolError::Representation),
            None => None,
        };
        let table = field.table().map_or(&[][..], ChordTable::bytes);
        let plan = Plan::new(field);
        let words = plan.total;
        let range = if let Ok(range) = self.words.allocate_range(words) {
            range
        } else {
            self.grow(device, queue, words)?;
            self.words.allocate_range(words).map_err(|_| self.full(words))?
        };
        // Writes come in whole words; the slack after the table is never read.
        let (whole, rest) = table.split_at(table.len() & !3);
        queue.write_buffer(&self.buffer, range.start * 4, whole);
        if !rest.is_empty() {
            let mut last = [0; 4];
            last[..rest.len()].copy_from_slice(rest);
            queue.write_buffer(&self.buffer, range.start * 4 + whole.len() as u64, &last);
        }
        let header_start = range.start + plan.cap_grid;
        if let Some(grid) = field.cap_grid() {
            self.write_header(queue, grid, header_start);
            let texels = cap_grid_words(grid);
            queue.write_buffer(&self.buffer, (header_start + HEADER_WORDS) * 4, bytemuck::cast_slice(&texels));
        }
        let distance_start = range.start + plan.distance;
        if let Some(distance) = field.distance_field() {
            self.write_distance_header(queue, distance, distance_start);
            let words = distance_words(distance);
            queue.write_buffer(&self.buffer, (distance_start + HEADER_WORDS) * 4, bytemuck::cast_slice(&words));
        }
        self.statistics.uploads += 1;
        self.statistics.uploaded_bytes += words * 4;
        self.statistics.resident_bytes += words * 4;
        Ok(FieldSlot {
            table: field.table().zip(grid).map(|(table, grid)| TableSlot {
                first_byte: (range.start * 4) as u32,
                grid,
                encoding: table.encoding(),
            }),
            cap_grid: field.cap_grid().zip(field.cap_from_field()).map(|(grid, cap_from_field)| CapGridSlot {
                number: (header_start / HEADER_WORDS) as u32,
                order: grid.header().format.order,
                serves_inside: grid.serves_inside(),
                cap_from_field,
            }),
            distance: field
                .distance_from_field()
                .map(|distance_from_field| DistanceSlot { first_word: distance_start as u32, distance_from_field }),
            answers: Answers::of(field),
            bounds: field.header().bounds,
            words: range,
        })
    }

    /// Frees a field's place. Frames already encoded may still read it; its bytes stay until the next insertion.
    pub fn remove(&mut self, slot: FieldSlot) {
        self.statistics.resident_bytes -= slot.bytes();
        self.words.free_range(slot.words);
    }

    /// Moves the fields together at the start of a buffer that has room for `bytes` more, as far as the limit allows, and is no
    /// larger than the limit if the fields are not. On the GPU, so that nothing is uploaded but a few words for each field.
    ///
    /// ```no_run
    /// # use visfield::{VisibilityField, gpu::{FieldPool, FieldSlot}};
    /// # fn shrink(device: &wgpu::Device, queue: &wgpu::Queue, pool: &mut FieldPool, fields: &mut [(FieldSlot, VisibilityField)]) {
    /// pool.set_limit(64 << 20);
    /// pool.repack(device, queue, fields.iter_mut().map(|(slot, field)| (slot, &*field)), 0);
    /// # }
    /// ```
    ///
    /// `resident` are all slots that the pool has given and not got back, with the fields that they were given for.
    ///
    /// # Panics
    /// If some of them are of another pool, and together take more than this one holds.
    pub fn repack<'a>(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        resident: impl IntoIterator<Item = (&'a mut FieldSlot, &'a VisibilityField)>,
        bytes: u64,
    ) {
        let used = self.statistics.resident_bytes / 4;
        let new = (used + bytes.div_ceil(4)).clamp(FIRST_WORDS.min(self.limit_words), self.limit_words).max(used);
        let buffer = create_buffer(device, new);
        let mut words = RangeAllocator::new(0..new);
        let mut encoder =
            device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("repack field pool") });
        let (mut headers, mut distances) = (Vec::new(), Vec::new());
        for (slot, field) in resident {
            let bytes = slot.bytes();
            let range = words.allocate_range(bytes / 4).expect("the buffer was made for all of them");
            encoder.copy_buffer_to_buffer(&self.buffer, slot.words.start * 4, &buffer, range.start * 4, bytes);
            if let Some(table) = &mut slot.table {
                table.first_byte = (range.start * 4) as u32;
            }
            if let Some((grid, cap_grid)) = slot.cap_grid.as_mut().zip(field.cap_grid()) {
                let start = u64::from(grid.number) * HEADER_WORDS - slot.words.start + range.start;
                grid.number = (start / HEADER_WORDS) as u32;
                headers.push((cap_grid, start));
            }
            if let Some((slot_distance, distance)) = slot.distance.as_mut().zip(field.distance_field()) {
                let start = u64::from(slot_distance.first_word) - slot.words.start + range.start;
                slot_distance.first_word = start as u32;
                distances.push((distance, start));
            }
            slot.words = range;
        }
        queue.submit([encoder.finish()]);
        self.buffer = buffer;
        self.words = words;
        self.statistics.buffer_bytes = new * 4;
        // Headers say where their points are. These writes come after what was submitted.
        for (grid, start) in headers {
            self.write_header(queue, grid, start);
        }
        for (distance, start) in distances {
            self.write_distance_header(queue, distance, start);
        }
    }

    /// Writes what a cap grid starts with, `start` words into the buffer.
    fn write_header(&self, queue: &wgpu::Queue, grid: &CapGrid, start: u64) {
        let header = CapGridData::new(grid, (start + HEADER_WORDS) as u32);
        queue.write_buffer(&self.buffer, start * 4, bytemuck::bytes_of(&header));
    }

    /// Writes what distances start with, likewise.
    fn write_distance_header(&self, queue: &wgpu::Queue, distance: &DistanceField, start: u64) {
        let header = DistanceData::new(distance, (start + HEADER_WORDS) as u32);
        queue.write_buffer(&self.buffer, start * 4, bytemuck::bytes_of(&header));
    }

    /// What the pool has done so far.
    pub fn statistics(&self) -> PoolStatistics {
        self.statistics
    }

    /// The buffer that shaders read fields from. Growth replaces it, so ask again each frame.
    pub fn buffer(&self) -> &wgpu::Buffer {
        &self.buffer
    }

    /// Moves the fields to a buffer that has room for `words` more at its end.
    fn grow(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, words: u64) -> Result<(), PoolError> {
        let old = self.statistics.buffer_bytes / 4;
        let used = self.words.allocated_ranges().map(|range| range.end).max().unwrap_or(0);
        let new = (old * 2).max(used + words).min(self.limit_words);
        if new < used + words || new <= old {
            return Err(self.full(words));
        }
        let buffer = create_buffer(device, new);
        let mut encoder =
            device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("grow field pool") });
        encoder.copy_buffer_to_buffer(&self.buffer, 0, &buffer, 0, old * 4);
        queue.submit([encoder.finish()]);
        self.buffer = buffer;
        self.words.grow_to(new);
        self.statistics.buffer_bytes = new * 4;
        Ok(())
    }

    fn full(&self, words: u64) -> PoolError {
        PoolError::Full { bytes: words * 4, limit: self.limit_words * 4 }
    }
}

fn create_buffer(device: &wgpu::Device, words: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("field pool"),
        size: words * 4,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    })
}
