// How many items each block of SCAN_BLOCK words of marks lists. The scan leaves the total beyond
// the last.

import package::constants::{GROUP, SCAN_BLOCK};
import package::shared::item::group_index;
import package::shared::marks::{ListParams, marked};
import package::shared::sums::{EACH, sum_of_all};

@group(0) @binding(8) var<uniform> params: ListParams;
@group(0) @binding(9) var<storage, read_write> sums: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group_index(group, groups);
    let begin = block * SCAN_BLOCK + local * EACH;
    var own = 0u;
    for (var i = 0u; i < EACH; i++) { own += countOneBits(marked(begin + i, params.count)); }
    let all = sum_of_all(own);
    if local == 0u && block < params.blocks { sums[block] = all; }
}
