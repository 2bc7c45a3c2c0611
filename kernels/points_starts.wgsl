// Where each bucket of keys begins in the sorted list: the first key not below it.

import package::shared::item::item_index;
import package::shared::points::PointsParams;
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> keys: array<u32>;
@group(0) @binding(10) var<storage, read_write> starts: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let bucket = item_index(group, groups, local);
    if bucket > params.buckets { return; }
    var low = 0u;
    var high = params.count;
    while low < high {
        let middle = (low + high) / 2u;
        if (keys[middle] >> params.shift) < bucket { low = middle + 1u; } else { high = middle; }
    }
    starts[bucket] = low;
}
