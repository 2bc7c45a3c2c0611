// Merges the points that are kept, in their old order, with new ones, sorted by themselves.
// A thread takes one point of either and finds how many of the other come before it; equal
// keys stand in the order of their slots, as a sort of all would have them.

import package::shared::item::item_index;
import package::shared::points::{PointsParams, OTHER};
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> kept: array<u32>;
@group(0) @binding(10) var<storage, read> seen_keys: array<u32>;
@group(0) @binding(11) var<storage, read> seen_slots: array<u32>;
@group(0) @binding(12) var<storage, read> new_keys: array<u32>;
@group(0) @binding(13) var<storage, read> new_slots: array<u32>;
@group(0) @binding(14) var<storage, read_write> order: array<u32>;

struct Point {
    key: u32,
    slot: u32,
}

fn kept_point(i: u32) -> Point {
    return Point(seen_keys[kept[i]], seen_slots[kept[i]]);
}

fn new_point(i: u32) -> Point {
    return Point(new_keys[i], new_slots[i]);
}

fn precedes(a: Point, b: Point) -> bool {
    return a.key < b.key || (a.key == b.key && a.slot < b.slot);
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    // `first` kept points, then the new ones.
    let is_new = i >= params.first;
    var own: Point;
    if is_new { own = new_point(i - params.first); } else { own = kept_point(i); }
    var low = 0u;
    var high = select(params.count - params.first, params.first, is_new);
    while low < high {
        let middle = (low + high) / 2u;
        var other: Point;
        if is_new { other = kept_point(middle); } else { other = new_point(middle); }
        if precedes(other, own) { low = middle + 1u; } else { high = middle; }
    }
    let place = low + select(i, i - params.first, is_new);
    order[place] = i - params.first + OTHER;
    if !is_new { order[place] = kept[i]; }
}
