// The items that a work list is to have: a bit each.

struct ListParams {
    count: u32,
    blocks: u32, // of SCAN_BLOCK words of marks
}

@group(0) @binding(20) var<storage, read_write> marks: array<atomic<u32>>;

fn mark(item: u32) {
    atomicOr(&marks[item / 32u], 1u << (item % 32u));
}

// The bits of a word of marks that stand for one of `count` items.
fn marked(word: u32, count: u32) -> u32 {
    let begin = 32u * word;
    if begin >= count { return 0u; }
    let beyond = max(begin + 32u, count) - count;
    return atomicLoad(&marks[word]) & (0xffffffffu >> beyond);
}
