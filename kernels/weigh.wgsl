// Weighing photons again after an edit that changes what interactions leave of their power,
// and no flight: first what they weigh now, beside what they did, in the journal; slots stay as
// they are (see `weighed`).
//
// A photon that had no power left and now has some goes on where it never flew. That is
// left to `trace`.

import package::shared::counter::{choose, expect, cut_short};
import package::shared::item::item_index;
import package::shared::journal::{journal, state_in_journal};
import package::shared::photon::{PhotonParams, listed_of, unpack_task, weigh};
import package::shared::quota::identify;
import package::shared::slot::{EMPTY, INTERACTION, slot_kind, slot_entry, slot_power};
import package::constants::{GROUP, CHOICE_WOKEN};

@group(0) @binding(8) var<uniform> params: PhotonParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read> tasks: array<u32>;
@group(0) @binding(11) var<storage, read> places: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read> states: array<vec4<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    let all = listed_of(work[0], params);
    let listed = params.first_item + item - params.first_listed;
    if item >= params.items || listed >= all { return; }
    let photon = work[1u + params.first_item + item];
    let id = identify(photon);
    // At least 1, since the light shines as before.
    var event = unpack_task(tasks[photon]).touched;
    var before = (event - 1u) * params.photons + photon;
    var state = states[before];
    var power = slot_power(state);
    // Where the first of its flights begins.
    journal[(event - 1u) * all + listed] = places[before];
    var over = false;
    var wakes = false;
    for (; !over; event++) {
        over = event >= params.max_events || slot_kind(state) != INTERACTION;
        if over { break; }
        if any(power != vec2<u32>(0u)) {
            power = weigh(id, event - 1u, power, slot_entry(state), params);
        }
        let at = event * params.photons + photon;
        state = states[at];
        if slot_kind(state) == EMPTY {
            over = true;
            wakes = any(power != vec2<u32>(0u));
            break;
        }
        let old = event * all + listed;
        journal[old] = places[at];
        journal[state_in_journal(old)] = vec4<u32>(state.xy, power);
    }
    expect(over);
    // Beyond its end there is nothing.
    for (; event < params.max_events; event++) {
        journal[state_in_journal(event * all + listed)] = vec4<u32>(0u);
    }
    if wakes || cut_short { choose(CHOICE_WOKEN); }
}
