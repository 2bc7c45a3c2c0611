// Which points are still where they were: those keep their order. A thread for each word
// of marks, the one that the end is in among them.

import package::shared::item::item_index;
import package::shared::marks::marks;
import package::shared::points::{Origin, PointsParams};
import package::shared::slot_marks::slot_marks;
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(10) var<storage, read> origins: array<Origin>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let word = item_index(group, groups, local);
    let first = 32u * word;
    if first > params.count { return; }
    let count = min(params.count - first, 32u);
    var bits = 0u;
    for (var i = 0u; i < count; i++) {
        let slot = origins[first + i].slot;
        let moved = atomicLoad(&slot_marks[slot / 32u].moved);
        bits |= (extractBits(moved, slot % 32u, 1u) ^ 1u) << i;
    }
    atomicStore(&marks[word], bits);
}
