// Copies the slots of the listed photons to the journal before they are traced anew, or
// back (sign -1). The journal is laid out as a batch of as many photons as it holds.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::photon::PhotonParams;

@group(0) @binding(8) var<uniform> params: PhotonParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read_write> places: array<vec4<u32>>;
@group(0) @binding(11) var<storage, read_write> states: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read_write> old_places: array<vec4<u32>>;
@group(0) @binding(13) var<storage, read_write> old_states: array<vec4<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    if item >= params.listed * params.max_events { return; }
    let event = item / params.listed;
    let listed = item % params.listed;
    let live = event * params.photons + work[params.first_listed + listed];
    let old = event * params.journal + listed;
    if params.sign > 0 {
        old_places[old] = places[live];
        old_states[old] = states[live];
    } else {
        places[live] = old_places[old];
        states[live] = old_states[old];
    }
}
