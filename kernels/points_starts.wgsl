// Where buckets of keys begin in the sorted list: the first key not below each. First those
// BUCKET_STEP apart are looked for among all points (`step` is BUCKET_STEP), then each other
// between the two around it: most are empty, and there is nothing between.

import package::shared::item::item_index;
import package::shared::points::PointsParams;
import package::constants::{GROUP, BUCKET_STEP};

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> keys: array<u32>;
@group(0) @binding(10) var<storage, read_write> starts: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let bucket = item_index(group, groups, local) * params.step;
    if bucket > params.buckets { return; }
    var low = 0u;
    var high = params.count;
    if params.step < BUCKET_STEP {
        let before = bucket - bucket % BUCKET_STEP;
        if bucket == before { return; }
        low = starts[before];
        if before + BUCKET_STEP <= params.buckets { high = starts[before + BUCKET_STEP]; }
    }
    while low < high {
        let middle = (low + high) / 2u;
        if (keys[middle] >> params.shift) < bucket { low = middle + 1u; } else { high = middle; }
    }
    starts[bucket] = low;
}
