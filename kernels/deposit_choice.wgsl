// Whether to sum all flights anew, rather than to take those that changed out and to add them again: where
// they are many. Of those that are not worked on yet, as many will change as of those that were. One thread.

import package::constants::{
    GROUP, COUNTER_WORDS, CHOICE_INVALID, CHOICE_WOKEN, CHOICE_ANEW, CHOICE_LISTED, CHOICE_SEEN, CHOICE_MOVED
};
import package::shared::counter::{counters, choose};

struct ChoiceParams {
    photons: u32,    // in all
    lists: u32,      // 1: a batch has listed its photons; 0: a part of them was worked on
    is_traced: u32,  // 1: whatever is chosen
    pad: u32,
}

@group(0) @binding(8) var<uniform> params: ChoiceParams;
// How many there are, and, of a part, how many it has.
@group(0) @binding(9) var<storage, read> lengths: array<u32>;

fn add(which: u32, amount: u32) -> f32 {
    return f32(atomicAdd(&counters[COUNTER_WORDS + which], amount) + amount);
}

fn is_made(which: u32) -> bool {
    return atomicLoad(&counters[COUNTER_WORDS + which]) != 0u;
}

@compute @workgroup_size(GROUP)
fn main(@builtin(global_invocation_id) thread: vec3<u32>) {
    if any(thread != vec3<u32>(0u)) { return; }
    if params.lists == 1u {
        _ = add(CHOICE_LISTED, lengths[0]);
        return;
    }
    let changed = add(CHOICE_MOVED, lengths[0]);
    let seen = add(CHOICE_SEEN, lengths[1]);
    let listed = add(CHOICE_LISTED, 0u);
    let is_traced = params.is_traced == 1u || is_made(CHOICE_INVALID) || is_made(CHOICE_WOKEN);
    if is_traced && 2.0 * changed * listed > f32(params.photons) * seen { choose(CHOICE_ANEW); }
}
