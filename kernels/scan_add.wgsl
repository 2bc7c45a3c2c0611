// Adds to each block of SCAN_BLOCK words the sum of all blocks before it.

import package::constants::{GROUP, SCAN_BLOCK};
import package::shared::item::item_index;

struct ScanParams {
    count: u32,
}

@group(0) @binding(8) var<uniform> params: ScanParams;
@group(0) @binding(9) var<storage, read_write> data: array<u32>;
@group(0) @binding(10) var<storage, read> sums: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i < params.count { data[i] += sums[i / SCAN_BLOCK]; }
}
