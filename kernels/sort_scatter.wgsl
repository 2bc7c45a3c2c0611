// Second half of a radix-sort pass: every item to its place. `counts` holds, after
// the prefix sum, where each block's items of each digit begin.

import package::constants::{GROUP, RADIX};
import package::shared::item::group_index;
import package::shared::tally::{params, keys, tally, run_of, count_digits, digit_of};

@group(0) @binding(10) var<storage, read> values: array<u32>;
@group(0) @binding(11) var<storage, read> counts: array<u32>;
@group(0) @binding(12) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(13) var<storage, read_write> sorted_values: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group_index(group, groups);
    let run = run_of(block, local);
    count_digits(run, local);
    workgroupBarrier();
    if local < RADIX && block < params.blocks {
        var running = counts[local * params.blocks + block];
        for (var t = 0u; t < GROUP; t++) {
            let own = tally[local * GROUP + t];
            tally[local * GROUP + t] = running;
            running += own;
        }
    }
    workgroupBarrier();
    for (var i = run.begin; i < run.end; i++) {
        let key = keys[i];
        let column = digit_of(key) * GROUP + local;
        let place = tally[column];
        tally[column] = place + 1u;
        sorted_keys[place] = key;
        sorted_values[place] = values[i];
    }
}
