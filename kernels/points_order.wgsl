// Which kept point comes at each place of merged ones: the next, but where a new one is marked.
// `ranks` is the prefix sum of how many each word of marks has.

import package::shared::item::item_index;
import package::shared::marks::marks;
import package::shared::points::PointsParams;
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> kept: array<u32>;
@group(0) @binding(10) var<storage, read> ranks: array<u32>;
@group(0) @binding(11) var<storage, read_write> order: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let place = item_index(group, groups, local);
    if place >= params.count { return; }
    let bits = atomicLoad(&marks[place / 32u]);
    let bit = 1u << (place % 32u);
    let new_before = ranks[place / 32u] + countOneBits(bits & (bit - 1u));
    order[place] = 0u;
    if (bits & bit) == 0u { order[place] = kept[place - new_before]; }
}
