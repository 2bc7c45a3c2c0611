// The photons of a list that go on after a window of events, side by side: their threads need not share
// groups with those of photons that have ended. In which order they come is left open.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::photon::{PhotonParams, listed_of, goes_on};

@group(0) @binding(8) var<uniform> params: PhotonParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read> tasks: array<u32>;
// How many, and then which.
@group(0) @binding(11) var<storage, read_write> going: array<atomic<u32>>;

var<workgroup> own: atomic<u32>;
var<workgroup> first: u32;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    var photon = 0u;
    var is_going = false;
    if item < listed_of(work[0], params) {
        photon = work[1u + params.first_listed + item];
        is_going = goes_on(tasks[photon]);
    }
    // One of a group asks for room.
    var place = 0u;
    if is_going { place = atomicAdd(&own, 1u); }
    workgroupBarrier();
    if local == 0u { first = atomicAdd(&going[0], atomicLoad(&own)); }
    workgroupBarrier();
    if is_going { atomicStore(&going[1u + first + place], photon); }
}
