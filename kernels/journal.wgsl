// Copies the slots of the listed photons, each up to its end, to the journal before they are
// traced anew, or back (`restores`). The journal is laid out as a batch of these photons alone; its
// states were cleared.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::journal::{journal, state_in_journal};
import package::shared::photon::PhotonParams;
import package::shared::slot::{EMPTY, slot_kind};

@group(0) @binding(8) var<uniform> params: PhotonParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read_write> places: array<vec4<u32>>;
@group(0) @binding(11) var<storage, read_write> states: array<vec4<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    if item >= params.listed { return; }
    let photon = work[params.first_listed + item];
    for (var event = 0u; event < params.max_events; event++) {
        let live = event * params.photons + photon;
        let old = event * params.journal_photons + item;
        if params.restores == 0u {
            let state = states[live];
            journal[old] = places[live];
            journal[state_in_journal(old)] = state;
            if slot_kind(state) == EMPTY { break; }
        } else {
            let state = journal[state_in_journal(old)];
            places[live] = select(journal[old], vec4<u32>(0u), slot_kind(state) == EMPTY);
            states[live] = state;
        }
    }
}
