// Photon tracing. A work item is a photon of the batch and the event from which it is
// to be traced (photon | event << 24). A full rebuild lists every photon with event 0;
// an update resumes each at its first invalid slot, from the last valid one. A dispatch
// traces a window of events, so that no thread runs for long; the next resumes after it.

import package::shared::counter::{
    TENTATIVE, INTERACTIONS, UNFINISHED, count, expect, cut_short
};
import package::shared::flight::fly;
import package::shared::item::item_index;
import package::shared::photon::{
    PhotonParams, Departure, identify, depart_from_light, depart_from_slot
};
import package::shared::random::{draw, FOR_FLIGHT};
import package::shared::slot::{
    Slot, INTERACTION, EXIT, slot_place, slot_state, slot_of, unpack_direction
};
import package::constants::GROUP;

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
    if item >= params.items { return; }
    let task = work[params.first_item + item];
    let photon = task & 0xffffffu;
    var event = max(task >> 24u, params.first_event);
    if event >= params.stop_event { return; }
    let id = identify(params.first_photon + photon);

    var photon_state: Departure;
    if event == 0u {
        photon_state = depart_from_light(id);
    } else {
        let before = (event - 1u) * params.photons + photon;
        let slot = slot_of(places[before], states[before]);
        photon_state = depart_from_slot(id, event - 1u, slot, params);
        if slot.kind != INTERACTION { photon_state.power = vec2<u32>(0u); }
    }

    var tentative = 0u;
    var interactions = 0u;
    var over = false;
    loop {
        over = event >= params.stop_event || all(photon_state.power == vec2<u32>(0u));
        if over { break; }
        let key = draw(id.stream, id.index, event, FOR_FLIGHT).xy;
        let direction = unpack_direction(photon_state.direction);
        let flight = fly(photon_state.position, direction, key);
        tentative += flight.tentative;
        let slot = Slot(
            select(EXIT, INTERACTION, flight.collided),
            photon_state.position + direction * flight.distance,
            photon_state.direction,
            photon_state.power,
            flight.entry,
            photon_state.history | flight.history
        );
        let at = event * params.photons + photon;
        places[at] = slot_place(slot);
        states[at] = slot_state(slot);
        event++;
        over = !flight.collided;
        if over { break; }
        interactions++;
        photon_state = depart_from_slot(id, event - 1u, slot, params);
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
