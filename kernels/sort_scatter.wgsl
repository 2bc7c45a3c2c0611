// Puts the keys of each block, and which they are, where those of their digit go, in the order in which
// they are.

import package::constants::GROUP;
import package::shared::digits::{params, keys, counts, DIGITS, digit_of, own_keys, count_own};
import package::shared::item::group_index;
import package::shared::sums::sum_before;

@group(0) @binding(10) var<storage, read> places: array<u32>;
@group(0) @binding(11) var<storage, read> order: array<u32>;
@group(0) @binding(12) var<storage, read_write> sorted: array<u32>;
@group(0) @binding(13) var<storage, read_write> ordered: array<u32>;

// Where the block's keys of each digit go, less how many it has of those before.
var<workgroup> begins: array<u32, DIGITS>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group_index(group, groups);
    let own = own_keys(block, local);
    count_own(own, local);
    var sum = 0u;
    for (var i = 0u; i < DIGITS; i++) { sum += counts[local * DIGITS + i]; }
    var before = sum_before(local, sum);
    for (var i = 0u; i < DIGITS; i++) {
        let here = counts[local * DIGITS + i];
        counts[local * DIGITS + i] = before;
        before += here;
    }
    workgroupBarrier();
    if local < DIGITS && block < params.blocks {
        begins[local] = places[local * params.blocks + block] - counts[local * GROUP];
    }
    workgroupBarrier();
    for (var i = own.x; i < own.y; i++) {
        let key = keys[i];
        let d = digit_of(key);
        let rank = counts[d * GROUP + local];
        counts[d * GROUP + local] = rank + 1u;
        let at = begins[d] + rank;
        sorted[at] = key;
        ordered[at] = select(order[i], i, params.is_first == 1u);
    }
}
