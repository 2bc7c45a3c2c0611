// Which slots enter the light field: interactions, and nothing else.

import package::shared::item::item_index;
import package::shared::marks::mark;
import package::shared::points::PointsParams;
import package::shared::slot::{INTERACTION, slot_kind};
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> states: array<vec4<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let slot = item_index(group, groups, local);
    if slot < params.count && slot_kind(states[slot]) == INTERACTION { mark(slot); }
}
