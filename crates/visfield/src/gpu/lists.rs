//! The buffer of the tiles' lists: how it is laid out (`shaders/lists.wgsl`), and how it grows.
//!
//! Only the GPU knows how many entries the lists need. It says so some frames later, and the buffer grows to that. Until then, a
//! tile whose list finds no room looks at all instances, which is slower and just as right.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use glam::{UVec2, uvec2};

/// Pixels along the side of a tile.
pub(super) const TILE_SIDE: u32 = 16;
/// Tiles along the side of a block.
pub(super) const BLOCK_SIDE: u32 = 8;
/// Words before the headers; the first one counts entries.
const HEAD_WORDS: u32 = 4;
/// Words of a tile's bounds.
const BOUNDS_WORDS: u32 = 12;
/// Entries per tile that there is room for at first.
const FIRST_ENTRIES_PER_TILE: u32 = 24;
/// What the lists of a camera may take.
const MOST_BYTES: u64 = 64 << 20;
/// Instances that entries can name.
pub(super) const MAX_INSTANCES: usize = 1 << 20;

/// Tiles of a viewport along both axes.
pub(super) fn tiles(viewport: UVec2) -> UVec2 {
    uvec2(viewport.x.div_ceil(TILE_SIDE), viewport.y.div_ceil(TILE_SIDE))
}

/// Blocks of tiles along both axes.
pub(super) fn blocks(tiles: UVec2) -> UVec2 {
    uvec2(tiles.x.div_ceil(BLOCK_SIDE), tiles.y.div_ceil(BLOCK_SIDE))
}

/// One camera's lists.
#[derive(Debug)]
pub(super) struct TileLists {
    tiles: UVec2,
    capacity: u32,
    buffer: wgpu::Buffer,
    read_back: ReadBack,
}

/// The number of entries on its way back from the GPU.
#[derive(Debug)]
struct ReadBack {
    staging: wgpu::Buffer,
    state: Arc<ReadBackState>,
}

#[derive(Debug, Default)]
struct ReadBackState {
    on_its_way: AtomicBool,
    entries: AtomicU32,
}

impl TileLists {
    /// Lists for a viewport, with room for as many entries as the last frame that was heard of needed.
    pub(super) fn fit(kept: &mut Option<Self>, device: &wgpu::Device, viewport: UVec2) {
        let tiles = tiles(viewport);
        let needed = kept.as_ref().map_or(0, Self::entries);
        let first = tiles.element_product() * FIRST_ENTRIES_PER_TILE;
        // What the adapter can bind limits it, and reason; lists beyond that are of all instances.
        let limits = device.limits();
        let largest = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size).min(MOST_BYTES) / 4;
        let room = largest.saturating_sub(u64::from(words_before_entries(tiles))) as u32;
        let too_small = |lists: &Self| lists.capacity < needed.min(room);
        if kept.as_ref().is_some_and(|lists| lists.tiles == tiles && !too_small(lists)) {
            return;
        }
        // A little more than was needed: what moves needs more in the next frame.
        let capacity = first.max(needed.saturating_add(needed / 2)).min(room);
        let buffer = |label, words, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: u64::from(words) * 4,
                usage,
                mapped_at_creation: false,
            })
        };
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let staging = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        *kept = Some(Self {
            tiles,
            capacity,
            buffer: buffer("field occlusion lists", words_before_entries(tiles) + capacity, usage),
            read_back: ReadBack {
                staging: buffer("field occlusion list entries", HEAD_WORDS, staging),
                state: Arc::default(),
            },
        });
    }

    pub(super) fn buffer(&self) -> &wgpu::Buffer {
        &self.buffer
    }

    pub(super) fn tiles(&self) -> UVec2 {
        self.tiles
    }

    /// Entries that there is room for.
    pub(super) fn capacity(&self) -> u32 {
        self.capacity
    }

    /// Entries that the last frame that was heard of needed.
    pub(super) fn entries(&self) -> u32 {
        self.read_back.state.entries.load(Ordering::Relaxed)
    }

    /// Before the lists are made: none has entries.
    pub(super) fn clear(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.clear_buffer(&self.buffer, 0, Some(u64::from(HEAD_WORDS) * 4));
    }

    /// After the lists were made: asks how many entries they need, unless that is under way.
    pub(super) fn ask(&self, encoder: &mut wgpu::CommandEncoder) {
        let ReadBack { staging, state } = &self.read_back;
        if state.on_its_way.swap(true, Ordering::Relaxed) {
            return;
        }
        encoder.copy_buffer_to_buffer(&self.buffer, 0, staging, 0, staging.size());
        let (mapped, state) = (staging.clone(), Arc::clone(state));
        encoder.map_buffer_on_submit(staging, wgpu::MapMode::Read, .., move |result| {
            if result.is_ok() {
                let bytes = mapped.slice(..).get_mapped_range();
                state.entries.store(bytemuck::pod_read_unaligned(&bytes[..4]), Ordering::Relaxed);
                drop(bytes);
                mapped.unmap();
            }
            state.on_its_way.store(false, Ordering::Relaxed);
        });
    }
}

fn words_before_entries(tiles: UVec2) -> u32 {
    let (tiles, blocks) = (tiles.element_product(), blocks(tiles).element_product());
    HEAD_WORDS + 2 * (tiles + blocks) + BOUNDS_WORDS * tiles
}
