// Nothing but random bytes of a table: the gather limit. Joined after rays.wgsl, of which it reads no ray. It has no twin: nobody
// asks what it finds.

// Bytes that each thread gathers; its answers are as many fewer.
const GATHERS: u32 = 8u;

@group(0) @binding(2) var<storage, read> pool: array<u32>;
// The table's first byte, and the largest power of two of its bytes, less 1.
@group(0) @binding(3) var<uniform> gathered: vec2<u32>;

// Two rounds of a multiplicative hash: cheap, and nothing that a cache could foresee.
fn scattered(number: u32) -> u32 {
    let mixed = number * 0x9e3779b1u;
    return (mixed ^ (mixed >> 15u)) * 0x85ebca6bu;
}

@compute @workgroup_size(GROUP)
fn gather(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = thread_number(id, groups);
    if i >= arrayLength(&answers) / GATHERS {
        return;
    }
    var sum = 0u;
    for (var k = 0u; k < GATHERS; k++) {
        let at = gathered.x + (scattered(i * GATHERS + k) & gathered.y);
        sum += (pool[at >> 2u] >> ((at & 3u) * 8u)) & 0xffu;
    }
    answers[i] = sum;
}
