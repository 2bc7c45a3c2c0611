// Where buckets of keys begin in the sorted list: the first key not below each. First some far
// apart are looked for among all points (`step` is 0), then all others: BUCKET_STEP - 1 between
// two that are known, `step` apart, by a thread. Most are empty, and there is nothing between.

import package::shared::item::item_index;
import package::shared::points::PointsParams;
import package::constants::{GROUP, BUCKET_STEP};

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> keys: array<u32>;
@group(0) @binding(10) var<storage, read_write> starts: array<u32>;

fn begin_of(bucket: u32, from_point: u32, end: u32) -> u32 {
    var low = from_point;
    var high = end;
    while low < high {
        let middle = (low + high) / 2u;
        if (keys[middle] >> params.shift) < bucket { low = middle + 1u; } else { high = middle; }
    }
    return low;
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let thread = item_index(group, groups, local);
    if params.step == 0u {
        let bucket = thread * BUCKET_STEP * BUCKET_STEP;
        if bucket <= params.buckets { starts[bucket] = begin_of(bucket, 0u, params.count); }
        return;
    }
    let known = thread * BUCKET_STEP * params.step;
    if known > params.buckets { return; }
    let next = known + BUCKET_STEP * params.step;
    var end = params.count;
    if next <= params.buckets { end = starts[next]; }
    var begin = starts[known];
    for (var bucket = known + params.step; bucket < next; bucket += params.step) {
        if bucket > params.buckets { break; }
        begin = begin_of(bucket, begin, end);
        starts[bucket] = begin;
    }
}
