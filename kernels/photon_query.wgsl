// Which photons an edit touches, and from which event on, H(10). A work item is a photon
// of the batch; its task says what is to be done, its mark whether anything is.
//
// From its first invalid flight on a photon may take another path. Another phase function
// turns what follows; another albedo only weighs it anew. Either changes what the interaction
// gives where it is: for `points` its slot is marked, whatever becomes of the photon.

import package::constants::{CHANGE_PHASE, CHANGE_ALBEDO, CHOICE_INVALID, GROUP};
import package::shared::counter::{INVALID, REWEIGHED, choose, count};
import package::shared::item::item_index;
import package::shared::marks::mark;
import package::shared::photon::{PhotonParams, Task, NOTHING, pack_task, is_invalid};
import package::shared::quota::{NOBODY, identify};
import package::shared::scene::optics_of;
import package::shared::slot::{EMPTY, INTERACTION, slot_kind, slot_entry};
@if(points) import package::shared::slot_marks::mark_altered;

@group(0) @binding(8) var<uniform> params: PhotonParams;
@group(0) @binding(9) var<storage, read> states: array<vec4<u32>>;
@group(0) @binding(10) var<storage, read_write> tasks: array<u32>;

struct Found {
    touched: u32,  // the first event whose power or flight may be another
    invalid: u32,  // the first whose flight may be
}

fn find(photon: u32) -> Found {
    let id = identify(photon);
    if id.light == NOBODY { return Found(NOTHING, NOTHING); }
    var found = Found(select(NOTHING, 0u, id.relit), NOTHING);
    for (var event = 0u; event < params.max_events; event++) {
        let slot = event * params.photons + photon;
        let state = states[slot];
        let kind = slot_kind(state);
        if kind == EMPTY {
            // What was never computed carries a history of all ones.
            if event == 0u && all(state.zw == vec2<u32>(0xffffffffu)) { return Found(0u, 0u); }
            break;
        }
        if is_invalid(state, params.risen) { found = earlier(found, Found(event, event)); }
        if kind != INTERACTION { break; }
        let changes = optics_of(slot_entry(state)).changes;
        let next = event + 1u;
        if next < params.max_events {
            if (changes & CHANGE_ALBEDO) != 0u { found = earlier(found, Found(next, NOTHING)); }
            if (changes & CHANGE_PHASE) != 0u { found = earlier(found, Found(next, next)); }
        }
        @if(points) {
            if (changes & (CHANGE_ALBEDO | CHANGE_PHASE)) != 0u { mark_altered(slot); }
        }
        @if(!points) { if found.invalid != NOTHING { break; } }
    }
    return found;
}

fn earlier(a: Found, b: Found) -> Found {
    return Found(min(a.touched, b.touched), min(a.invalid, b.invalid));
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let photon = item_index(group, groups, local);
    if photon >= params.photons { return; }
    let found = find(photon);
    tasks[photon] = pack_task(Task(found.touched, NOTHING));
    if found.touched != NOTHING { mark(photon); }
    if found.invalid != NOTHING { choose(CHOICE_INVALID); }
    count(INVALID, u32(found.invalid != NOTHING));
    count(REWEIGHED, u32(found.touched < found.invalid));
}
