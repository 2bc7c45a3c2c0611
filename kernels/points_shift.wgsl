// Where buckets begin when points that are kept and new ones have come together. Which rows have
// any is to be told anew (`points_rows`).

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::kept::kept_before;
import package::shared::points::PointsParams;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> added: array<u32>; // before each bucket
@group(0) @binding(10) var<storage, read_write> starts: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let bucket = item_index(group, groups, local);
    if bucket > params.buckets { return; }
    starts[bucket] = kept_before(starts[bucket]) + added[bucket];
    @if(!hashed) { if bucket < params.buckets { starts[params.buckets + 1u + bucket] = 0u; } }
}
