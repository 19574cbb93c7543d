// Reads the lists that tiles.wgsl makes. Joined after frame.wgsl and lists.wgsl.

@group(0) @binding(7) var<storage, read> lists: array<u32>;

struct List {
    first: u32,
    count: u32,
}

// What can matter at a pixel of the viewport.
fn list_at(pixel: vec2<u32>) -> List {
    let word = tile_word(pixel / TILE_SIDE);
    return List(lists[word], lists[word + 1u]);
}

fn entry(list: List, k: u32) -> u32 {
    if list.first == ALL_INSTANCES {
        return k | ~(AMBIENT_BIT - 1u);
    }
    return lists[list.first + k];
}
