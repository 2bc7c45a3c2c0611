// Sums over the threads of a group. A group has SCAN_BLOCK words; each thread, EACH in a row.

import package::constants::{GROUP, SCAN_BLOCK};

const EACH: u32 = SCAN_BLOCK / GROUP;

var<workgroup> total: atomic<u32>;
// Threads of a row, of which a group has as many.
const ROW: u32 = 8u;
const_assert GROUP == ROW * ROW;

var<workgroup> totals: array<u32, GROUP>;
var<workgroup> rows: array<u32, ROW>;

// What all threads have.
fn sum_of_all(own: u32) -> u32 {
    atomicAdd(&total, own);
    workgroupBarrier();
    return atomicLoad(&total);
}

// What the threads before this one have: those of its row, and the rows before. Few barriers: a
// software adapter takes longer for one than for all that is added.
fn sum_before(local: u32, own: u32) -> u32 {
    let row = local / ROW;
    totals[local] = own;
    workgroupBarrier();
    var before = 0u;
    for (var i = row * ROW; i < local; i++) { before += totals[i]; }
    if local % ROW == ROW - 1u { rows[row] = before + own; }
    workgroupBarrier();
    for (var i = 0u; i < row; i++) { before += rows[i]; }
    return before;
}
