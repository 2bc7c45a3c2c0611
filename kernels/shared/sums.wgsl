// Sums over the threads of a group. A group has SCAN_BLOCK words; each thread, EACH in a row.

import package::constants::{GROUP, SCAN_BLOCK};

const EACH: u32 = SCAN_BLOCK / GROUP;

var<workgroup> total: atomic<u32>;
var<workgroup> totals: array<u32, GROUP>;

// What all threads have.
fn sum_of_all(own: u32) -> u32 {
    atomicAdd(&total, own);
    workgroupBarrier();
    return atomicLoad(&total);
}

// What the threads before this one have.
fn sum_before(local: u32, own: u32) -> u32 {
    totals[local] = own;
    workgroupBarrier();
    for (var reach = 1u; reach < GROUP; reach *= 2u) {
        var before = 0u;
        if local >= reach { before = totals[local - reach]; }
        workgroupBarrier();
        totals[local] += before;
        workgroupBarrier();
    }
    return totals[local] - own;
}
