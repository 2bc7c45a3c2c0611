// The sum of each block of SCAN_BLOCK words.

import package::constants::{GROUP, SCAN_BLOCK};
import package::shared::item::group_index;
import package::shared::sums::{EACH, sum_of_all};

struct ScanParams {
    count: u32,
}

@group(0) @binding(8) var<uniform> params: ScanParams;
@group(0) @binding(9) var<storage, read> data: array<u32>;
@group(0) @binding(10) var<storage, read_write> sums: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group_index(group, groups);
    let begin = block * SCAN_BLOCK + local * EACH;
    var own = 0u;
    for (var i = begin; i < min(begin + EACH, params.count); i++) { own += data[i]; }
    let all = sum_of_all(own);
    if local == 0u && block * SCAN_BLOCK < params.count { sums[block] = all; }
}
