//! The pool keeps every table intact while it grows and frees, and says when it is full.

use visfield::field::directions::DirectionMap;
use visfield::field::{ball, ball_field};
use visfield::gpu::layout::CapGridData;
use visfield::gpu::{FieldPool, FieldSlot, PoolError};
use visfield::{Encoding, Representation, VisibilityField};

use super::device::{device, read_buffer};

/// Places are as long as whole numbers of these.
const HEADER_BYTES: u64 = size_of::<CapGridData>() as u64;

#[test]
fn tables_survive_growth_and_removal() {
    let Some((device, queue)) = device() else { return };
    let mut pool = FieldPool::new(&device);
    // 3.9 MB each; odd sizes leave tables that do not end on a word. Each makes the buffer grow, or nearly.
    let fields: Vec<VisibilityField> = (0..5).map(|i| ball_field(0.3 + 0.1 * i as f32, 63 - (i & 1), 31)).collect();
    let mut slots: Vec<FieldSlot> = fields.iter().map(|f| pool.insert(&device, &queue, f).unwrap()).collect();
    let tables: u64 = fields.iter().map(|field| field.bytes().next_multiple_of(HEADER_BYTES)).sum();
    let before = pool.statistics();
    assert_eq!((before.uploads, before.uploaded_bytes, before.resident_bytes), (5, tables, tables));
    assert!(before.buffer_bytes >= tables, "it had to grow");

    pool.remove(slots.remove(1));
    slots.insert(1, pool.insert(&device, &queue, &fields[1]).unwrap());
    assert_eq!(pool.statistics().buffer_bytes, before.buffer_bytes, "the freed place is used again");
    assert_eq!(pool.statistics().resident_bytes, tables);

    let content = read_buffer(&device, &queue, pool.buffer(), before.buffer_bytes);
    for (slot, field) in slots.iter().zip(&fields) {
        let start = slot.table().unwrap().first_byte as usize;
        let table = field.table().unwrap().bytes();
        assert!(content[start..start + table.len()] == *table, "table at {start}");
    }
}

#[test]
fn a_full_pool_says_so_and_stays_usable() {
    let Some((device, queue)) = device() else { return };
    let limit = device.limits().max_storage_buffer_binding_size;
    let mut pool = FieldPool::new(&device);
    // 33 MB each, against the default limit of 128 MiB.
    let large = ball_field(0.5, 90, 64);
    let fitting = (limit / large.bytes()) as usize;
    for i in 0..fitting {
        assert!(pool.insert(&device, &queue, &large).is_ok(), "{i} of {fitting}");
    }
    let full = PoolError::Full { bytes: large.bytes(), limit };
    assert_eq!(pool.insert(&device, &queue, &large).unwrap_err(), full);
    assert!(pool.insert(&device, &queue, &ball_field(0.5, 9, 8)).is_ok(), "small ones still fit");
}

#[test]
fn what_the_passes_do_not_read_is_refused() {
    let Some((device, queue)) = device() else { return };
    let mut pool = FieldPool::new(&device);
    let representation = Representation::Hemisphere { positions: 290, directions: 4, map: DirectionMap::Concentric };
    let papers = ball(0.5, representation, Encoding::U8);
    assert_eq!(pool.insert(&device, &queue, &papers).unwrap_err(), PoolError::Representation);
    assert_eq!(pool.statistics().uploads, 0);
}
