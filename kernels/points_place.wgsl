// Where the sorted points are: copied from their slots.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::points::PointsParams;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> slots: array<u32>;
@group(0) @binding(10) var<storage, read> places: array<vec4<u32>>;
@group(0) @binding(11) var<storage, read_write> point_places: array<vec4<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    point_places[i] = places[slots[i]];
}
