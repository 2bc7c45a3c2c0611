// Photon tracing. A work item is a photon of the batch. A full rebuild lists every one and
// flies all of it; an update resumes at its first slot that an edit touches. As long as a
// photon begins its flights where its slots say, only invalid ones are flown again, and of
// those only what an edit can have changed. A dispatch covers a window of events, so that no
// thread runs for long; the next resumes after it, with those photons alone that go on. The first begins
// where each photon resumes, so that no thread waits for its turn.
//
// Photons continue from what their slots hold, packed, so that resumed and full traces
// see the same numbers; both go through the same lines of this one pipeline.

import package::shared::counter::{
    TENTATIVE, STEPS, INTERACTIONS, UNFINISHED, count, expect, cut_short
};
import package::shared::flight::{Known, nothing_known, fly};
import package::shared::item::item_index;
import package::shared::photon::{
    PhotonParams, Task, GOES_ON, listed_of, pack_task, unpack_task, is_invalid, weigh, turn
};
import package::shared::light::emit;
import package::shared::quota::{NOBODY, identify};
import package::shared::random::{draw, FOR_FLIGHT};
import package::shared::scene::{scene, optics_of};
import package::shared::slot::{
    Slot, EMPTY, INTERACTION, EXIT, slot_place, slot_state, slot_of, pack_direction,
    unpack_direction, pack_power
};
import package::shared::walk::FAR;
import package::constants::{GROUP, CHANGE_FALLEN, CHANGE_PHASE};

@group(0) @binding(8) var<uniform> params: PhotonParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read_write> tasks: array<u32>;
@group(0) @binding(11) var<storage, read_write> places: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read_write> states: array<vec4<u32>>;

// What a slot tells of a flight that begins as it did.
fn known_of(slot: Slot, origin: vec3<f32>, direction: vec3<f32>) -> Known {
    var known = Known(FAR, FAR, slot.history);
    if slot.kind == INTERACTION {
        // More than rounding can hide.
        let edge = min(scene.cell_mm.x, min(scene.cell_mm.y, scene.cell_mm.z));
        let went = dot(slot.position - origin, direction);
        let extent = max(scene.extent.x, max(scene.extent.y, scene.extent.z));
        let slack = 4e-6 * extent + 1e-3 * edge;
        known.passed = went - slack;
        let fallen = optics_of(slot.entry).changes & CHANGE_FALLEN;
        if fallen == 0u { known.ended = went + slack; }
    }
    return known;
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    let place = params.first_item + item;
    if item >= params.items || place >= params.first_listed + listed_of(work[0], params) { return; }
    let photon = work[1u + place];
    let task = unpack_task(tasks[photon]);
    var event = task.touched + params.first_event;
    let stop = min(task.touched + params.stop_event, params.max_events);
    if event >= stop { return; }
    let id = identify(photon);
    if id.light == NOBODY { return; }

    var slot: Slot;
    if event > 0u {
        let before = (event - 1u) * params.photons + photon;
        slot = slot_of(places[before], states[before]);
    }
    var astray = task.astray;
    var tentative = 0u;
    var steps = 0u;
    var interactions = 0u;
    var over = false;
    loop {
        over = event >= stop || (event > 0u && slot.kind != INTERACTION);
        if over { break; }
        var origin = slot.position;
        var heading = 0u;
        var power: vec2<u32>;
        var turned = false;
        if event == 0u {
            let e = emit(id.light, id.index);
            origin = e.position;
            heading = pack_direction(e.direction);
            power = pack_power(e.power);
        } else {
            power = weigh(id, event - 1u, slot.power, slot.entry, params);
            turned = (optics_of(slot.entry).changes & CHANGE_PHASE) != 0u;
        }
        over = all(power == vec2<u32>(0u));
        if over { break; }
        let at = event * params.photons + photon;
        let before = slot_of(places[at], states[at]);
        // What ended before and goes on now was never flown.
        let begun = event < astray && before.kind != EMPTY && !turned;
        if begun && !is_invalid(states[at], params.risen) {
            slot = before;
            slot.power = power;
        } else {
            if event > 0u { heading = turn(id, event - 1u, slot); }
            let key = draw(id.stream, id.index, event, FOR_FLIGHT).xy;
            let direction = unpack_direction(heading);
            var known = nothing_known();
            if begun { known = known_of(before, origin, direction); }
            let flight = fly(origin, direction, key, known);
            tentative += flight.tentative;
            steps += flight.steps;
            if flight.stands {
                slot = before;
                slot.power = power;
                slot.history = flight.history;
            } else {
                slot = Slot(
                    select(EXIT, INTERACTION, flight.collided),
                    origin + direction * flight.distance,
                    heading,
                    power,
                    flight.entry,
                    flight.history
                );
                let same = slot.kind == before.kind && slot.entry == before.entry
                    && all(slot_place(slot) == places[at]);
                if !same { astray = min(astray, event + 1u); }
                places[at] = slot_place(slot);
            }
        }
        states[at] = slot_state(slot);
        interactions += u32(slot.kind == INTERACTION);
        event++;
    }
    expect(over);
    let is_cut = event >= stop && stop < params.max_events && slot.kind == INTERACTION;
    // Beyond a photon's end every slot is zero, so that equal photons are equal bits.
    over = is_cut;
    for (; !over; event++) {
        over = event >= params.max_events;
        if over { break; }
        let at = event * params.photons + photon;
        over = all(states[at] == vec4<u32>(0u));
        places[at] = vec4<u32>(0u);
        states[at] = vec4<u32>(0u);
    }
    expect(over);
    let next = pack_task(Task(task.touched, astray)) | select(0u, GOES_ON, is_cut);
    if next != tasks[photon] { tasks[photon] = next; }
    count(TENTATIVE, tentative);
    count(STEPS, steps);
    count(INTERACTIONS, interactions);
    count(UNFINISHED, u32(cut_short));
}
