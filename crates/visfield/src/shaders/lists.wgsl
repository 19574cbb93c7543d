// How the lists of instances that matter to a part of the viewport lie in their buffer, in words: a head, where the list of each
// block and of each tile is, the bounds of each tile, and the entries of all lists. Twin: gpu/lists.rs.

// Pixels along the side of a tile, and tiles along that of a block.
const TILE_SIDE: u32 = 16u;
const BLOCK_SIDE: u32 = 8u;
// The first word of the head counts the entries of all lists, also of those that there is no room for.
const HEAD_WORDS: u32 = 4u;
const BOUNDS_WORDS: u32 = 12u;
// Stands for a list that found no room: of all instances.
const ALL_INSTANCES: u32 = 0xffffffffu;

// An entry: the instance, then a bit for ambient occlusion and one for each light.
const INDEX_BITS: u32 = 20u;
const AMBIENT_BIT: u32 = 1u << INDEX_BITS;

fn light_bit(light: u32) -> u32 {
    return 2u << (INDEX_BITS + light);
}

fn entry_index(entry: u32) -> u32 {
    return entry & (AMBIENT_BIT - 1u);
}

fn blocks() -> vec2<u32> {
    return (frame.tiles + BLOCK_SIDE - 1u) / BLOCK_SIDE;
}

fn block_word(block: vec2<u32>) -> u32 {
    return HEAD_WORDS + 2u * (block.y * blocks().x + block.x);
}

fn tile_word(tile: vec2<u32>) -> u32 {
    return HEAD_WORDS + 2u * (blocks().x * blocks().y + tile.y * frame.tiles.x + tile.x);
}

fn bounds_word(tile: vec2<u32>) -> u32 {
    let headers = blocks().x * blocks().y + frame.tiles.x * frame.tiles.y;
    return HEAD_WORDS + 2u * headers + BOUNDS_WORDS * (tile.y * frame.tiles.x + tile.x);
}

fn first_entry() -> u32 {
    return bounds_word(vec2<u32>(0u, frame.tiles.y));
}
