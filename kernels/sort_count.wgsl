// First half of a radix-sort pass: how often each digit occurs in each block, laid
// out digit by digit, so that one prefix sum gives every block its places.

import package::constants::{GROUP, RADIX};
import package::shared::item::group_index;
import package::shared::tally::{params, tally, run_of, count_digits};

@group(0) @binding(10) var<storage, read_write> counts: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group_index(group, groups);
    count_digits(run_of(block, local), local);
    workgroupBarrier();
    if local < RADIX && block < params.blocks {
        var total = 0u;
        for (var t = 0u; t < GROUP; t++) { total += tally[local * GROUP + t]; }
        counts[local * params.blocks + block] = total;
    }
}
