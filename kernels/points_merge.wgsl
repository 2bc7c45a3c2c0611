// Where new points, sorted by themselves, come among those that are kept, in their old order:
// each marks its place, and notes it. Equal keys stand in the order of their slots, as a sort of
// all would have them.

import package::shared::item::item_index;
import package::shared::marks::mark;
import package::shared::points::PointsParams;
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> kept: array<u32>;
@group(0) @binding(10) var<storage, read> seen_keys: array<u32>;
@group(0) @binding(11) var<storage, read> seen_slots: array<u32>;
@group(0) @binding(12) var<storage, read> new_keys: array<u32>;
@group(0) @binding(13) var<storage, read> new_slots: array<u32>;
@group(0) @binding(14) var<storage, read_write> new_places: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    let key = new_keys[i];
    let slot = new_slots[i];
    var low = 0u;
    var high = params.first;
    while low < high {
        let middle = (low + high) / 2u;
        let other = kept[middle];
        let other_key = seen_keys[other];
        let precedes = other_key < key || (other_key == key && seen_slots[other] < slot);
        if precedes { low = middle + 1u; } else { high = middle; }
    }
    mark(low + i);
    new_places[i] = low + i;
}
