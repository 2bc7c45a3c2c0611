// Items in another order: words or, with `fours`, four of them each. The highest bit of `order`
// tells which of two arrays an item is from.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::points::{PointsParams, OTHER};

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> order: array<u32>;
@if(fours) @group(0) @binding(10) var<storage, read> before: array<vec4<u32>>;
@if(fours) @group(0) @binding(11) var<storage, read> others: array<vec4<u32>>;
@if(fours) @group(0) @binding(12) var<storage, read_write> after: array<vec4<u32>>;
@if(!fours) @group(0) @binding(10) var<storage, read> before: array<u32>;
@if(!fours) @group(0) @binding(11) var<storage, read> others: array<u32>;
@if(!fours) @group(0) @binding(12) var<storage, read_write> after: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    let item = order[i];
    if (item & OTHER) == 0u { after[i] = before[item]; } else { after[i] = others[item - OTHER]; }
}
