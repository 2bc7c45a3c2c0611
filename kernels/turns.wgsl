// The work groups of dispatches whose length the device alone knows: slices of a list, of which those
// beyond its end have none. A thread for each.

import package::constants::{GROUP, MAX_GROUPS, ARGUMENTS};
import package::shared::item::item_index;

struct TurnParams {
    slice: u32,     // items of a slice
    turns: u32,     // slices
    each: u32,      // items for each that is listed
    first: u32,     // of the listed, that counts
    most: u32,      // that count
    is_known: u32,  // 1: so many do
    choices: u32,   // where they begin
    some: u32,      // choices of which one must be made, if there are any
    none: u32,      // choices of which none may be
    at: u32,        // the first of the arguments
}

@group(0) @binding(8) var<uniform> params: TurnParams;
@group(0) @binding(9) var<storage, read> lengths: array<u32>;
@group(0) @binding(10) var<storage, read> choices: array<u32>;
@group(0) @binding(11) var<storage, read_write> arguments: array<u32>;

fn is_any_made(which: u32) -> bool {
    var made = false;
    for (var rest = which; rest != 0u; rest &= rest - 1u) {
        made |= choices[params.choices + firstTrailingBit(rest)] != 0u;
    }
    return made;
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let turn = item_index(group, groups, local);
    if turn >= params.turns { return; }
    var listed = params.most;
    if params.is_known == 0u {
        let all = lengths[0];
        listed = min(all - min(params.first, all), params.most);
    }
    if params.some != 0u && !is_any_made(params.some) { listed = 0u; }
    if is_any_made(params.none) { listed = 0u; }
    let items = listed * params.each;
    let begin = min(turn * params.slice, items);
    let wanted = (min(items - begin, params.slice) + GROUP - 1u) / GROUP;
    let rows = max((wanted + MAX_GROUPS - 1u) / MAX_GROUPS, 1u);
    let at = 3u * ((params.at + turn) % ARGUMENTS);
    arguments[at] = (wanted + rows - 1u) / rows;
    arguments[at + 1u] = rows;
    arguments[at + 2u] = 1u;
}
