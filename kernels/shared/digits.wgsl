// The digit that a pass of the radix sort looks at, of a block of SORT_BLOCK keys. Each thread has EACH
// in a row, so that equal ones stay in their order.

import package::constants::{GROUP, SORT_BLOCK, DIGIT_BITS};

struct DigitParams {
    count: u32,   // keys
    blocks: u32,
    shift: u32,   // bits below the digit
    is_first: u32 // 1: nothing was put in another order yet
}

const EACH: u32 = SORT_BLOCK / GROUP;
const DIGITS: u32 = 1u << DIGIT_BITS;

// How many keys of each thread have each digit: all threads' of the first one, and so on. Or how many
// come before those.
var<workgroup> counts: array<u32, DIGITS * GROUP>;

@group(0) @binding(8) var<uniform> params: DigitParams;
@group(0) @binding(9) var<storage, read> keys: array<u32>;

fn digit_of(key: u32) -> u32 {
    return (key >> params.shift) & (DIGITS - 1u);
}

// A thread's keys are from the first of these on, and end before the second.
fn own_keys(block: u32, local: u32) -> vec2<u32> {
    let begin = min(block * SORT_BLOCK + local * EACH, params.count);
    return vec2(begin, min(begin + EACH, params.count));
}

// Counts the thread's keys.
fn count_own(own: vec2<u32>, local: u32) {
    for (var d = 0u; d < DIGITS; d++) { counts[d * GROUP + local] = 0u; }
    for (var i = own.x; i < own.y; i++) { counts[digit_of(keys[i]) * GROUP + local]++; }
    workgroupBarrier();
}
