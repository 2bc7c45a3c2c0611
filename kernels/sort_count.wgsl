// First half of a radix-sort pass: how often each digit occurs in each block, laid
// out digit by digit, so that one prefix sum gives every block its places.

import package::constants::{GROUP, SORT_BLOCK, RADIX};
import package::shared::item::group_index;
import package::shared::tally::{SortParams, EACH, tally, digit_of};

@group(0) @binding(8) var<uniform> params: SortParams;
@group(0) @binding(9) var<storage, read> keys: array<u32>;
@group(0) @binding(10) var<storage, read_write> counts: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group_index(group, groups);
    for (var d = 0u; d < RADIX; d++) { tally[d * GROUP + local] = 0u; }
    let begin = block * SORT_BLOCK + local * EACH;
    for (var i = begin; i < min(begin + EACH, params.count); i++) {
        tally[digit_of(keys[i], params) * GROUP + local]++;
    }
    workgroupBarrier();
    if local < RADIX && block < params.blocks {
        var total = 0u;
        for (var t = 0u; t < GROUP; t++) { total += tally[local * GROUP + t]; }
        counts[local * params.blocks + block] = total;
    }
}
