// Photons of a batch that were never computed: their slots are empty, and the history of the first is all
// ones. What the light field knows of their slots no longer holds. A thread for each slot.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::slot_marks::mark_moved;

struct ForgetParams {
    first: u32,    // of the photons that are forgotten
    photons: u32,
    stride: u32,   // photons in the batch
    events: u32,
}

@group(0) @binding(8) var<uniform> params: ForgetParams;
@group(0) @binding(11) var<storage, read_write> places: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read_write> states: array<vec4<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    if item >= params.photons * params.events { return; }
    let event = item / params.photons;
    let slot = event * params.stride + params.first + item % params.photons;
    let history = select(0u, 0xffffffffu, event == 0u);
    places[slot] = vec4<u32>(0u);
    states[slot] = vec4<u32>(0u, 0u, history, history);
    mark_moved(slot);
}
