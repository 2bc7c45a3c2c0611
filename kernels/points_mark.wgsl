// Which slots enter the light field: interactions, and nothing else.

import package::shared::item::item_index;
import package::shared::points::PointsParams;
import package::shared::slot::{INTERACTION, slot_kind};
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> states: array<vec4<u32>>;
@group(0) @binding(10) var<storage, read_write> marks: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let slot = item_index(group, groups, local);
    if slot < params.count {
        marks[slot] = u32(slot_kind(states[slot]) == INTERACTION);
    } else if slot == params.count {
        marks[slot] = 0u;  // the scan leaves the total here
    }
}
