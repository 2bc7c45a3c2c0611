// The marked items side by side, a thread for each word of marks. `ranks` is the prefix sum
// of how many each word lists.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::marks::{ListParams, marked};

@group(0) @binding(8) var<uniform> params: ListParams;
@group(0) @binding(9) var<storage, read> ranks: array<u32>;
@group(0) @binding(10) var<storage, read_write> work: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let word = item_index(group, groups, local);
    if 32u * word >= params.count { return; }
    var bits = marked(word, params.count);
    for (var at = ranks[word]; bits != 0u; at++) {
        work[at] = 32u * word + firstTrailingBit(bits);
        bits &= bits - 1u;
    }
}
