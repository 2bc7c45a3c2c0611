// Where points come that are kept, and where new ones (`fresh`): bucket by bucket, those that are
// kept first, in their old order. In which order new ones come there is left open: sums of
// integers do not depend on it. `starts` has where buckets began; `added`, one bucket further, how
// many new ones come before each, and when all have come, with its own.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::kept::{is_kept, kept_before};
import package::shared::points::{NOWHERE, PointsParams};

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> buckets: array<u32>;
@group(0) @binding(10) var<storage, read> starts: array<u32>;
@group(0) @binding(11) var<storage, read_write> added: array<atomic<u32>>;
@group(0) @binding(12) var<storage, read_write> order: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    let next = buckets[i] + 1u;
    if params.fresh == 1u {
        order[i] = kept_before(starts[next]) + atomicAdd(&added[next], 1u);
        return;
    }
    order[i] = NOWHERE;
    if is_kept(i) { order[i] = kept_before(i) + atomicLoad(&added[next]); }
}
