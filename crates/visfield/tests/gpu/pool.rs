//! The pool keeps every part intact while it grows and frees, and says when it is full.

use visfield::field::cap_grid::{self, CapGridHeader, CapPrecision, HarmonicOrder};
use visfield::field::directions::DirectionMap;
use visfield::field::{FieldParts, ball, ball_field};
use visfield::gpu::layout::{CapGridData, cap_grid_words};
use visfield::gpu::{FieldPool, FieldSlot, PoolError};
use visfield::{CapGridFormat, Encoding, Representation, VisibilityField};

use super::device::{device, read_buffer};

/// Places are as long as whole numbers of these.
const HEADER_BYTES: u64 = size_of::<CapGridData>() as u64;

/// Each part of a field lies where its slot says. `content` is the whole buffer.
fn assert_intact(content: &[u8], slot: &FieldSlot, field: &VisibilityField) {
    assert_eq!(slot.table().is_some(), field.table().is_some());
    if let (Some(slot), Some(table)) = (slot.table(), field.table()) {
        let start = slot.first_byte as usize;
        assert!(content[start..start + table.bytes().len()] == *table.bytes(), "table at {start}");
    }
    assert_eq!(slot.cap_grid().is_some(), field.cap_grid().is_some());
    if let (Some(slot), Some(grid)) = (slot.cap_grid(), field.cap_grid()) {
        let start = slot.number as usize * size_of::<CapGridData>();
        let first_texel = start + size_of::<CapGridData>();
        let (words, header) = (cap_grid_words(grid), CapGridData::new(grid, (first_texel / 4) as u32));
        assert!(content[start..first_texel] == *bytemuck::bytes_of(&header), "header at {start}");
        let points: &[u8] = bytemuck::cast_slice(&words);
        assert!(content[first_texel..first_texel + points.len()] == *points, "points at {first_texel}");
    }
}

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
        assert_intact(&content, slot, field);
    }
}

/// Fields that are as large for every `radius`, and hold other numbers: a cap grid beside a table that ends in the middle of a
/// word, a cap grid of many harmonics alone, and such a table alone.
fn fields_with_caps(radius: f32) -> [VisibilityField; 3] {
    let grid = |order: HarmonicOrder, precision, points| {
        let numbers = vec![0.0; order.coefficients()];
        Some(cap_grid::ball(CapGridHeader {
            format: CapGridFormat { order, precision, points, ..CapGridFormat::DEFAULT },
            half_extents: [1.0, 0.8, radius],
            low: numbers.clone(),
            range: numbers,
            ..CapGridHeader::default()
        }))
    };
    let ball = ball_field(radius, 31, 15);
    let table = ball.table().cloned();
    assert_eq!(ball.bytes() % 4, 1);
    [
        FieldParts { cap_grid: grid(HarmonicOrder::One, CapPrecision::U8, 9), table: table.clone(), distance: None },
        FieldParts { cap_grid: grid(HarmonicOrder::Three, CapPrecision::F16, 7), table: None, distance: None },
        FieldParts { cap_grid: None, table, distance: None },
    ]
    .map(|parts| VisibilityField::new(ball.header().clone(), parts).unwrap())
}

#[test]
fn cap_grids_survive_growth_and_removal() {
    let Some((device, queue)) = device() else { return };
    let mut pool = FieldPool::new(&device);
    let mut fields: Vec<VisibilityField> = [0.3, 0.4, 0.5].into_iter().flat_map(fields_with_caps).collect();
    let mut slots: Vec<FieldSlot> = fields.iter().map(|f| pool.insert(&device, &queue, f).unwrap()).collect();
    let before = pool.statistics();
    assert!(before.buffer_bytes >= before.resident_bytes && before.resident_bytes > 600_000, "it had to grow, often");
    let check = |pool: &FieldPool, slots: &[FieldSlot], fields: &[VisibilityField]| {
        let content = read_buffer(&device, &queue, pool.buffer(), pool.statistics().buffer_bytes);
        for (slot, field) in slots.iter().zip(fields) {
            assert_intact(&content, slot, field);
        }
    };
    check(&pool, &slots, &fields);

    // Others of the same sizes take the freed places, in another order.
    for (index, field) in (3..).zip(fields_with_caps(0.7)) {
        fields[index] = field;
    }
    for slot in slots.drain(3..6) {
        pool.remove(slot);
    }
    let mut again: Vec<FieldSlot> =
        fields[3..6].iter().rev().map(|f| pool.insert(&device, &queue, f).unwrap()).collect();
    again.reverse();
    slots.splice(3..3, again);
    let after = pool.statistics();
    assert_eq!((after.resident_bytes, after.buffer_bytes), (before.resident_bytes, before.buffer_bytes));
    check(&pool, &slots, &fields);

    // And stay as they are when the buffer grows once more.
    while pool.statistics().buffer_bytes == before.buffer_bytes {
        for field in fields_with_caps(0.6) {
            slots.push(pool.insert(&device, &queue, &field).unwrap());
            fields.push(field);
        }
    }
    check(&pool, &slots, &fields);
}

#[test]
fn repacking_closes_gaps_and_keeps_every_part() {
    let Some((device, queue)) = device() else { return };
    let mut pool = FieldPool::new(&device);
    let fields: Vec<VisibilityField> = [0.3, 0.4, 0.5, 0.6].into_iter().flat_map(fields_with_caps).collect();
    pool.set_limit(fields.iter().map(FieldPool::bytes_of).sum());
    let mut slots: Vec<(FieldSlot, VisibilityField)> =
        fields.into_iter().map(|field| (pool.insert(&device, &queue, &field).unwrap(), field)).collect();
    // Every other one goes.
    let mut index = 0;
    for (slot, _) in slots.extract_if(.., |_| (index % 2 == 0, index += 1).0) {
        pool.remove(slot);
    }
    let resident = pool.statistics().resident_bytes;
    assert_eq!(slots.iter().map(|(_, field)| FieldPool::bytes_of(field)).sum::<u64>(), resident);

    // There is room for one more, but not in one piece.
    let large = ball_field(0.7, 45, 17);
    let full = PoolError::Full { bytes: FieldPool::bytes_of(&large), limit: pool.limit() };
    assert!(resident + FieldPool::bytes_of(&large) < pool.limit());
    assert_eq!(pool.insert(&device, &queue, &large).unwrap_err(), full);
    pool.repack(&device, &queue, slots.iter_mut().map(|(slot, field)| (slot, &*field)), FieldPool::bytes_of(&large));
    slots.push((pool.insert(&device, &queue, &large).expect("the gaps are closed"), large));
    let found = pool.statistics();
    assert_eq!(found.resident_bytes, found.buffer_bytes);
    let content = read_buffer(&device, &queue, pool.buffer(), found.buffer_bytes);
    for (slot, field) in &slots {
        assert_intact(&content, slot, field);
    }

    // Empty, it takes next to nothing, whatever the limit.
    slots.drain(..).for_each(|(slot, _)| pool.remove(slot));
    pool.set_limit(0);
    pool.repack(&device, &queue, [], 0);
    assert_eq!((pool.statistics().resident_bytes, pool.statistics().buffer_bytes), (0, pool.limit()));
    assert!(pool.limit() <= 4096);
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
