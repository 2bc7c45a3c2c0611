// The marked items side by side. `ranks` is the prefix sum of the marks.

import package::shared::item::item_index;
import package::constants::GROUP;

struct ListParams {
    count: u32,
}

@group(0) @binding(8) var<uniform> params: ListParams;
@group(0) @binding(9) var<storage, read> ranks: array<u32>;
@group(0) @binding(10) var<storage, read_write> work: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    if item >= params.count || ranks[item] == ranks[item + 1u] { return; }
    work[ranks[item]] = item;
}
