// What updates ask for, of points that come together in a new order.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::points::{NOWHERE, Origin, PointsParams};

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> order: array<u32>;
@group(0) @binding(10) var<storage, read> seen_origins: array<Origin>;
@group(0) @binding(11) var<storage, read_write> origins: array<Origin>;
@if(even) @group(0) @binding(14) var<storage, read> seen_histories: array<vec2<u32>>;
@if(even) @group(0) @binding(15) var<storage, read_write> mean_histories: array<vec2<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    let place = order[i];
    if place == NOWHERE { return; }
    origins[place] = seen_origins[i];
    @if(even) { mean_histories[place] = seen_histories[i]; }
}
