// How many items are marked, and then they side by side. `sums` has how many are before each block of
// SCAN_BLOCK words of marks, and in all.

import package::constants::{GROUP, SCAN_BLOCK};
import package::shared::item::group_index;
import package::shared::marks::{ListParams, marked};
import package::shared::sums::{EACH, sum_before};

@group(0) @binding(8) var<uniform> params: ListParams;
@group(0) @binding(9) var<storage, read> sums: array<u32>;
@group(0) @binding(10) var<storage, read_write> work: array<u32>;

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
    if block == 0u && local == 0u { work[0] = sums[params.blocks]; }
    var at = 1u + sums[block] + sum_before(local, own);
    for (var i = 0u; i < EACH; i++) {
        var bits = marked(begin + i, params.count);
        while bits != 0u {
            work[at] = 32u * (begin + i) + firstTrailingBit(bits);
            bits &= bits - 1u;
            at++;
        }
    }
}
