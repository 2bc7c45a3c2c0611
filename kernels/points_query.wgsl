// Which points may have other light where they are: those of marked slots.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::points::{Origin, PointsParams};
import package::shared::slot_marks::slot_marks;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> origins: array<Origin>;
@group(0) @binding(11) var<storage, read_write> changed: array<atomic<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let point = item_index(group, groups, local);
    if point >= params.count { return; }
    let slot = origins[point].slot;
    let altered = atomicLoad(&slot_marks[slot / 32u].altered);
    if extractBits(altered, slot % 32u, 1u) == 0u { return; }
    atomicOr(&changed[point / 32u], 1u << (point % 32u));
}
