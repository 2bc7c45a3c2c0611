// Counting the digits of one block of a radix sort. Each thread counts a run of
// consecutive items in its own column, so that the order of equal keys is kept
// without atomics.

import package::constants::{GROUP, SORT_BLOCK, RADIX};

struct SortParams {
    count: u32,
    blocks: u32,
    shift: u32,
    mask: u32,
}

const EACH: u32 = SORT_BLOCK / GROUP;

var<workgroup> tally: array<u32, RADIX * GROUP>;

@group(0) @binding(8) var<uniform> params: SortParams;
@group(0) @binding(9) var<storage, read> keys: array<u32>;

fn digit_of(key: u32) -> u32 {
    return (key >> params.shift) & params.mask;
}

// The items of one thread of a block.
struct Run {
    begin: u32,
    end: u32,
}

fn run_of(block: u32, local: u32) -> Run {
    let begin = block * SORT_BLOCK + local * EACH;
    return Run(begin, min(begin + EACH, params.count));
}

// Counts every digit of the block; a barrier must follow.
fn count_digits(run: Run, local: u32) {
    for (var d = 0u; d < RADIX; d++) { tally[d * GROUP + local] = 0u; }
    for (var i = run.begin; i < run.end; i++) { tally[digit_of(keys[i]) * GROUP + local]++; }
}
