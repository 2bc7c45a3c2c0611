// How many items each word of marks lists. Beyond the last word stands a zero, where the
// scan leaves the total; bits beyond the last item list nothing, and are taken away.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::marks::marks;

struct ListParams {
    count: u32,
}

@group(0) @binding(8) var<uniform> params: ListParams;
@group(0) @binding(9) var<storage, read_write> ranks: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let word = item_index(group, groups, local);
    let words = (params.count + 31u) / 32u;
    if word > words { return; }
    var bits = 0u;
    if word < words {
        bits = atomicLoad(&marks[word]);
        let beyond = 32u * (word + 1u);
        if beyond > params.count { bits &= 0xffffffffu >> (beyond - params.count); }
        atomicStore(&marks[word], bits);
    }
    ranks[word] = countOneBits(bits);
}
