// Photon tracing. A work item is a photon of the batch; its task says from which event
// its power, and from which its flights are found again. A full rebuild lists every
// photon with both at zero; an update resumes each at its first invalid slot. A dispatch
// covers a window of events, so that no thread runs for long; the next resumes after it.
//
// Photons continue from what their slots hold, packed, so that resumed and full traces
// see the same numbers; both go through the same lines of this one pipeline.

import package::shared::counter::{
    TENTATIVE, INTERACTIONS, UNFINISHED, count, expect, cut_short
};
import package::shared::flight::fly;
import package::shared::item::item_index;
import package::shared::photon::{
    PhotonParams, Departure, unpack_task, identify, depart_from_light, depart_from_slot
};
import package::shared::random::{draw, FOR_FLIGHT};
import package::shared::slot::{
    Slot, EMPTY, INTERACTION, EXIT, slot_place, slot_state, slot_of, unpack_direction
};
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
    let task = unpack_task(tasks[photon]);
    var event = max(task.touched, params.first_event);
    if event >= params.stop_event { return; }
    let id = identify(params, photon);

    var slot: Slot;
    if event > 0u {
        let before = (event - 1u) * params.photons + photon;
        slot = slot_of(places[before], states[before]);
    }
    var retraced = task.retraced;
    var tentative = 0u;
    var interactions = 0u;
    var over = false;
    loop {
        over = event >= params.stop_event || (event > 0u && slot.kind != INTERACTION);
        if over { break; }
        var photon_state: Departure;
        if event == 0u {
            photon_state = depart_from_light(id);
        } else {
            photon_state = depart_from_slot(id, event - 1u, slot, params);
        }
        over = all(photon_state.power == vec2<u32>(0u));
        if over { break; }
        let at = event * params.photons + photon;
        slot = slot_of(places[at], states[at]);
        // What ended before and goes on now was never flown.
        if slot.kind == EMPTY { retraced = min(retraced, event); }
        if event < retraced {
            slot.power = photon_state.power;
        } else {
            let key = draw(id.stream, id.index, event, FOR_FLIGHT).xy;
            let direction = unpack_direction(photon_state.direction);
            let flight = fly(photon_state.position, direction, key);
            tentative += flight.tentative;
            slot = Slot(
                select(EXIT, INTERACTION, flight.collided),
                photon_state.position + direction * flight.distance,
                photon_state.direction,
                photon_state.power,
                flight.entry,
                photon_state.history | flight.history
            );
        }
        places[at] = slot_place(slot);
        states[at] = slot_state(slot);
        interactions += u32(slot.kind == INTERACTION);
        event++;
    }
    // Beyond a photon's end every slot is zero, so that equal photons are equal bits.
    expect(over);
    for (; event < params.stop_event; event++) {
        let at = event * params.photons + photon;
        places[at] = vec4<u32>(0u);
        states[at] = vec4<u32>(0u);
    }
    count(TENTATIVE, tentative);
    count(INTERACTIONS, interactions);
    count(UNFINISHED, u32(cut_short));
}
