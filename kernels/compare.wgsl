// What tracing anew has changed: a photon's task then begins at its first slot that
// differs from the journal, histories aside, and only what follows is handed on. For the
// fluence photons that changed are marked; for `points`, which have an order, slots that came,
// went or are elsewhere, and those of another power.

import package::constants::GROUP;
import package::shared::counter::{CHANGED, MOVED, REPOWERED, count};
import package::shared::item::item_index;
import package::shared::journal::{journal, state_in_journal};
@if(!points) import package::shared::marks::mark;
import package::shared::photon::{PhotonParams, Task, NOTHING, listed_of, pack_task, unpack_task};
import package::shared::slot::{EMPTY, slot_kind};
@if(points) import package::shared::slot_marks::{mark_altered, mark_moved};

@group(0) @binding(8) var<uniform> params: PhotonParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read_write> tasks: array<u32>;
@group(0) @binding(11) var<storage, read> places: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read> states: array<vec4<u32>>;

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
    @if(points) var elsewhere = 0u;
    @if(points) var repowered = 0u;
    for (var event = unpack_task(tasks[photon]).touched; event < params.max_events; event++) {
        let live = event * params.photons + photon;
        let old = event * listed + item;
        let now = states[live];
        let before = journal[state_in_journal(old)];
        // Beyond a photon's end every slot is empty.
        if slot_kind(now) == EMPTY && slot_kind(before) == EMPTY { break; }
        let is_elsewhere = any(places[live] != journal[old]) || slot_kind(now) != slot_kind(before);
        let differs = is_elsewhere || any(now.xy != before.xy);
        if differs { first = min(first, event); }
        @if(points) {
            if is_elsewhere { mark_moved(live); } else if differs { mark_altered(live); }
            elsewhere += u32(is_elsewhere);
            repowered += u32(differs && !is_elsewhere);
        }
        @if(!points) { if first != NOTHING { break; } }
    }
    tasks[photon] = pack_task(Task(first, NOTHING));
    count(CHANGED, u32(first != NOTHING));
    @if(points) count(MOVED, elsewhere);
    @if(points) count(REPOWERED, repowered);
    @if(!points) { if first != NOTHING { mark(item); } }
}
