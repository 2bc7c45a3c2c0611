// How many items each word of marks lists. Beyond the last word stands a zero, where the
// scan leaves the total.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::marks::{ListParams, marked};

@group(0) @binding(8) var<uniform> params: ListParams;
@group(0) @binding(9) var<storage, read_write> ranks: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let word = item_index(group, groups, local);
    if word > (params.count + 31u) / 32u { return; }
    ranks[word] = countOneBits(marked(word, params.count));
}
