// What tracing anew has changed: a photon's task then begins at its first slot that
// differs from the journal, histories aside, and only what follows is handed on.

import package::constants::GROUP;
import package::shared::counter::{CHANGED, count};
import package::shared::item::item_index;
import package::shared::photon::{PhotonParams, Task, NOTHING, pack_task, unpack_task};

@group(0) @binding(8) var<uniform> params: PhotonParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read_write> tasks: array<u32>;
@group(0) @binding(11) var<storage, read> places: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read> states: array<vec4<u32>>;
@group(0) @binding(13) var<storage, read> old_places: array<vec4<u32>>;
@group(0) @binding(14) var<storage, read> old_states: array<vec4<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    if item >= params.listed { return; }
    let photon = work[params.first_listed + item];
    var first = NOTHING;
    for (var event = unpack_task(tasks[photon]).touched; event < params.max_events; event++) {
        let live = event * params.photons + photon;
        let old = event * params.journal + item;
        if any(places[live] != old_places[old]) || any(states[live].xy != old_states[old].xy) {
            first = event;
            break;
        }
    }
    tasks[photon] = pack_task(Task(first, NOTHING));
    count(CHANGED, u32(first != NOTHING));
}
