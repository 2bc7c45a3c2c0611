// The items that a work list is to have: a bit each.

@group(0) @binding(20) var<storage, read_write> marks: array<atomic<u32>>;

fn mark(item: u32) {
    atomicOr(&marks[item / 32u], 1u << (item % 32u));
}
