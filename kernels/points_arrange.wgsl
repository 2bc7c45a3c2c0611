// Items in another order: words or, with `twos` or `fours`, two or four of them each. The highest bit of `order`
// tells which of two arrays an item is from.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::points::{PointsParams, OTHER};

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> order: array<u32>;
@group(0) @binding(10) var<storage, read> before: array<Item>;
@group(0) @binding(11) var<storage, read> others: array<Item>;
@group(0) @binding(12) var<storage, read_write> after: array<Item>;

@if(twos && !fours) alias Item = vec2<u32>;
@if(fours) alias Item = vec4<u32>;
@if(!twos && !fours) alias Item = u32;

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
