// How many points each bucket has: of `all`, or of those listed how many lights, `lights_each`
// (`points_take`). Noted one bucket further: summed up, that is where the bucket begins, and
// when all have come (`points_take`, `points_merge`), where it ends.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::points::PointsParams;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read> keys: array<u32>;
@group(0) @binding(11) var<storage, read_write> starts: array<atomic<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    let point = select(work[i], i, params.all == 1u);
    atomicAdd(&starts[(keys[point] >> params.shift) + 1u], params.lights_each);
}
