// Exclusive prefix sum of each block of SCAN_BLOCK words, in place, from what `sums` has for
// it: the sum of all blocks before it.

import package::constants::{GROUP, SCAN_BLOCK};
import package::shared::item::group_index;
import package::shared::sums::{EACH, sum_before};

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
    let block = group_index(group, groups);
    let begin = block * SCAN_BLOCK + local * EACH;
    let end = min(begin + EACH, params.count);
    var own = 0u;
    for (var i = begin; i < end; i++) { own += data[i]; }
    var running = sum_before(local, own);
    // The first block has none before it, and a single one no sums.
    if block > 0u { running += sums[block]; }
    for (var i = begin; i < end; i++) {
        let value = data[i];
        data[i] = running;
        running += value;
    }
}
