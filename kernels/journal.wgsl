// Copies the slots of the listed photons to the journal before they are traced anew. The journal is
// laid out as a batch of these photons alone; beyond a photon's end its states are zero.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::journal::{journal, state_in_journal};
import package::shared::photon::{PhotonParams, listed_of};
import package::shared::slot::{EMPTY, slot_kind};

@group(0) @binding(8) var<uniform> params: PhotonParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read> places: array<vec4<u32>>;
@group(0) @binding(11) var<storage, read> states: array<vec4<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    let listed = listed_of(work[0], params);
    if item >= listed { return; }
    let photon = work[1u + params.first_listed + item];
    var ended = false;
    for (var event = 0u; event < params.max_events; event++) {
        let live = event * params.photons + photon;
        let old = event * listed + item;
        var state = vec4<u32>(0u);
        if !ended {
            state = states[live];
            journal[old] = places[live];
        }
        journal[state_in_journal(old)] = state;
        ended = slot_kind(state) == EMPTY;
    }
}
