// Weighing photons again after an edit that changes what interactions leave of their power,
// and no flight. Nothing moves: of a slot only the power is another.
//
// A photon that had no power left and now has some goes on where it never flew. That is
// left to `trace`; the host hears of it as of a loop that did not come to its end.

import package::shared::counter::{INTERACTIONS, UNFINISHED, count, expect, cut_short};
import package::shared::item::item_index;
import package::shared::photon::{PhotonParams, unpack_task, identify, weigh};
import package::shared::slot::{EMPTY, INTERACTION, slot_kind, slot_entry, slot_power};
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PhotonParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read> tasks: array<u32>;
@group(0) @binding(11) var<storage, read_write> places: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read_write> states: array<vec4<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    if item >= params.items { return; }
    let photon = work[params.first_item + item];
    let id = identify(params, photon);
    // At least 1, since the light shines as before.
    var event = unpack_task(tasks[photon]).touched;
    var before = states[(event - 1u) * params.photons + photon];
    var interactions = 0u;
    var over = false;
    for (; !over; event++) {
        over = event >= params.max_events || slot_kind(before) != INTERACTION;
        if over { break; }
        let power = weigh(id, event - 1u, slot_power(before), slot_entry(before), params);
        over = all(power == vec2<u32>(0u));
        if over { break; }
        let at = event * params.photons + photon;
        var state = states[at];
        if slot_kind(state) == EMPTY { break; }
        state.x = power.x;
        state.y = power.y | (state.y & ~0x3ffffu);
        states[at] = state;
        before = state;
        interactions += u32(slot_kind(state) == INTERACTION);
    }
    expect(over);
    // Beyond a photon's end every slot is zero.
    for (; over; event++) {
        if event >= params.max_events { break; }
        let at = event * params.photons + photon;
        if all(states[at] == vec4<u32>(0u)) { break; }
        places[at] = vec4<u32>(0u);
        states[at] = vec4<u32>(0u);
    }
    count(INTERACTIONS, interactions);
    count(UNFINISHED, u32(cut_short));
}
