// Puts keys, and which they are, where those begin that are as they are; in which order equal ones
// come is left open.

import package::constants::GROUP;
import package::shared::item::item_index;

struct CountParams {
    count: u32,
}

@group(0) @binding(8) var<uniform> params: CountParams;
@group(0) @binding(9) var<storage, read> keys: array<u32>;
@group(0) @binding(10) var<storage, read_write> starts: array<atomic<u32>>;
@group(0) @binding(11) var<storage, read_write> sorted: array<u32>;
@group(0) @binding(12) var<storage, read_write> order: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    let key = keys[i];
    let at = atomicAdd(&starts[key + 1u], 1u);
    sorted[at] = key;
    order[at] = i;
}
