// Gives the slots of a part that was weighed anew the power that the journal has for them, and
// finds what that has changed, as `compare` does: a slot without power is none, and beyond a
// photon's end every slot is zero.

import package::constants::GROUP;
import package::shared::counter::{CHANGED, INTERACTIONS, MOVED, REPOWERED, count};
import package::shared::item::item_index;
import package::shared::journal::{journal, state_in_journal};
@if(!points) import package::shared::marks::mark;
import package::shared::photon::{PhotonParams, Task, NOTHING, listed_of, pack_task, unpack_task};
import package::shared::slot::{EMPTY, INTERACTION, slot_kind, slot_power};
@if(points) import package::shared::slot_marks::{mark_altered, mark_moved};

@group(0) @binding(8) var<uniform> params: PhotonParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read_write> tasks: array<u32>;
@group(0) @binding(11) var<storage, read_write> places: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read_write> states: array<vec4<u32>>;

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
    var first = NOTHING;
    var interactions = 0u;
    var repowered = 0u;
    var gone = 0u;
    for (var event = unpack_task(tasks[photon]).touched; event < params.max_events; event++) {
        let old = journal[state_in_journal(event * listed + item)];
        if slot_kind(old) == EMPTY { break; }
        let at = event * params.photons + photon;
        if all(old.zw == slot_power(old)) {
            interactions += u32(slot_kind(old) == INTERACTION);
            continue;
        }
        first = min(first, event);
        if all(old.zw == vec2<u32>(0u)) {
            places[at] = vec4<u32>(0u);
            states[at] = vec4<u32>(0u);
            gone++;
            @if(points) mark_moved(at);
        } else {
            states[at].x = old.z;
            states[at].y = old.w | (old.y & ~0x3ffffu);
            interactions += u32(slot_kind(old) == INTERACTION);
            repowered++;
            @if(points) mark_altered(at);
        }
    }
    tasks[photon] = pack_task(Task(first, NOTHING));
    count(INTERACTIONS, interactions);
    count(CHANGED, u32(first != NOTHING));
    @if(points) count(MOVED, gone);
    @if(points) count(REPOWERED, repowered);
    @if(!points) { if first != NOTHING { mark(item); } }
}
