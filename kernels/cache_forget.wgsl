// After an edit that may change the light, cells that have learned from many samples count as having it from
// few: they soon learn the new light, and are better than nothing meanwhile. (As few as a mean is used
// from: with half of that nothing is known at first, and the first frames gain nothing.) A thread for
// each slot.

import package::constants::GROUP;
import package::shared::cache::CacheParams;
import package::shared::cells::{SLOT_WORDS, LEAST};
import package::shared::item::item_index;
import package::shared::sum64::{rounded_wide, sum_to_float};

// Samples that remain of any.
const KEPT: u32 = 8u;

@group(0) @binding(8) var<uniform> params: CacheParams;
@group(0) @binding(9) var<storage, read_write> table: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let slot = item_index(group, groups, local);
    if slot >= params.slots { return; }
    let word = SLOT_WORDS * slot;
    let samples = table[word + 1u];
    if samples <= KEPT { return; }
    table[word + 1u] = KEPT;
    for (var channel = 0u; channel < 3u; channel++) {
        let at = word + 2u + 2u * channel;
        let sum = sum_to_float(vec2(table[at], table[at + 1u])) * f32(KEPT) / f32(samples);
        let kept = rounded_wide(sum);
        table[at] = kept.x;
        table[at + 1u] = kept.y;
    }
}
