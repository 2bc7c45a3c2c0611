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

fn digit_of(key: u32, params: SortParams) -> u32 {
    return (key >> params.shift) & params.mask;
}
