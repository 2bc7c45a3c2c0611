// Which slots of a batch enter the light field: interactions, and nothing else; of `all` slots, or of
// those that moved. They are marked as slots of the table. A thread for each word of marks.

import package::shared::item::item_index;
import package::shared::marks::marks;
import package::shared::points::PointsParams;
import package::shared::slot::INTERACTION;
import package::shared::slot_marks::slot_marks;
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> states: array<vec4<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let word = item_index(group, groups, local);
    let first = 32u * word;
    if first >= params.count { return; }
    var open = 0xffffffffu >> (32u - min(params.count - first, 32u));
    if params.all == 0u { open &= atomicLoad(&slot_marks[word].moved); }
    var bits = 0u;
    while open != 0u {
        let i = firstTrailingBit(open);
        open &= open - 1u;
        bits |= u32(states[first + i].y >> 30u == INTERACTION) << i;
    }
    atomicStore(&marks[params.first_slot / 32u + word], bits);
}
