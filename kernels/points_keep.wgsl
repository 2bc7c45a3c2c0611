// Which sorted points are still where they were: those keep their order, and their slots
// need not be sorted again.

import package::shared::item::item_index;
import package::shared::marks::mark;
import package::shared::points::PointsParams;
import package::shared::slot::{INTERACTION, slot_kind};
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> places: array<vec4<u32>>;
@group(0) @binding(10) var<storage, read> states: array<vec4<u32>>;
@group(0) @binding(11) var<storage, read> slots: array<u32>;
@group(0) @binding(12) var<storage, read> point_places: array<vec4<u32>>;
@group(0) @binding(13) var<storage, read_write> new_slots: array<atomic<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let point = item_index(group, groups, local);
    if point >= params.count { return; }
    let slot = slots[point];
    if slot_kind(states[slot]) != INTERACTION || any(places[slot] != point_places[point]) { return; }
    mark(point);
    atomicAnd(&new_slots[slot / 32u], ~(1u << (slot % 32u)));
}
