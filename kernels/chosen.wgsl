// The photons of a part that changed, side by side, two words each: the photon, and its place in the
// part times `max_events` plus the event from which on it did. Before them, how many they are, and how
// many the part has. A thread for each word of marks; `ranks` is the prefix sum of how many each has,
// and the last of `sums` what all have.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::marks::marked;
import package::shared::photon::{PhotonParams, listed_of, unpack_task};

@group(0) @binding(8) var<uniform> params: PhotonParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read> tasks: array<u32>;
@group(0) @binding(11) var<storage, read> ranks: array<u32>;
@group(0) @binding(12) var<storage, read_write> chosen: array<u32>;
@group(0) @binding(13) var<storage, read> sums: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let word = item_index(group, groups, local);
    if 32u * word >= params.listed { return; }
    if word == 0u {
        chosen[0] = sums[params.blocks];
        chosen[1] = listed_of(work[0], params);
    }
    var bits = marked(word, params.listed);
    for (var at = ranks[word]; bits != 0u; at++) {
        let item = 32u * word + firstTrailingBit(bits);
        let photon = work[1u + params.first_listed + item];
        chosen[2u + 2u * at] = photon;
        chosen[3u + 2u * at] = item * params.max_events + unpack_task(tasks[photon]).touched;
        bits &= bits - 1u;
    }
}
