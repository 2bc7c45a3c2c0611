// Exclusive prefix sum of each block of SCAN_BLOCK words, in place; the block's total
// goes to `sums`, which the next level scans in turn.

import package::constants::{GROUP, SCAN_BLOCK};
import package::shared::item::group_index;

struct ScanParams {
    count: u32,
}

@group(0) @binding(8) var<uniform> params: ScanParams;
@group(0) @binding(9) var<storage, read_write> data: array<u32>;
@group(0) @binding(10) var<storage, read_write> sums: array<u32>;

const EACH: u32 = SCAN_BLOCK / GROUP;

var<workgroup> totals: array<u32, GROUP>;

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
    totals[local] = own;
    workgroupBarrier();
    for (var reach = 1u; reach < GROUP; reach *= 2u) {
        var before = 0u;
        if local >= reach { before = totals[local - reach]; }
        workgroupBarrier();
        totals[local] += before;
        workgroupBarrier();
    }
    var running = totals[local] - own;
    for (var i = begin; i < end; i++) {
        let value = data[i];
        data[i] = running;
        running += value;
    }
    if local == GROUP - 1u && block * SCAN_BLOCK < params.count { sums[block] = totals[local]; }
}
