// How many keys are as each. Noted one further: summed up, that is where those begin that are as it
// is, and when all have come (`sort_place`), where they end.

import package::constants::GROUP;
import package::shared::item::item_index;

struct CountParams {
    count: u32,  // keys
}

@group(0) @binding(8) var<uniform> params: CountParams;
@group(0) @binding(9) var<storage, read> keys: array<u32>;
@group(0) @binding(10) var<storage, read_write> starts: array<atomic<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    atomicAdd(&starts[keys[i] + 1u], 1u);
}
