// How many keys of each block have each digit: those of all blocks that have the first, and so on.
// Summed up, that is where they go (`sort_scatter`).

import package::constants::GROUP;
import package::shared::digits::{params, counts, DIGITS, own_keys, count_own};
import package::shared::item::group_index;

@group(0) @binding(10) var<storage, read_write> places: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group_index(group, groups);
    count_own(own_keys(block, local), local);
    if local >= DIGITS || block >= params.blocks { return; }
    var all = 0u;
    for (var i = 0u; i < GROUP; i++) { all += counts[local * GROUP + i]; }
    places[local * params.blocks + block] = all;
}
