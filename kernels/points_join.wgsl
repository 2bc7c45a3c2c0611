// Joins lists of points, each in the order of its keys, into one. A point's place is its own
// in its list and, of each other list, how many come before it: of a list before its own those
// of the same key, too.

import package::shared::item::item_index;
import package::shared::points::{Change, PointsParams};
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PointsParams;
// Where each list begins, and the last one ends.
@group(0) @binding(9) var<storage, read> lists: array<u32>;
@group(0) @binding(10) var<storage, read> taken_keys: array<u32>;
@group(0) @binding(11) var<storage, read> taken_places: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read> taken_lights: array<Change>;
@group(0) @binding(13) var<storage, read_write> keys: array<u32>;
@group(0) @binding(14) var<storage, read_write> point_places: array<vec4<u32>>;
@group(0) @binding(15) var<storage, read_write> point_lights: array<Change>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    let key = taken_keys[i];
    var place = 0u;
    for (var list = 0u; list + 1u < arrayLength(&lists); list++) {
        let begin = lists[list];
        let end = lists[list + 1u];
        var low = begin;
        var high = end;
        if begin <= i && i < end {
            low = i;
            high = i;
        }
        while low < high {
            let middle = (low + high) / 2u;
            let other = taken_keys[middle];
            let precedes = other < key || (other == key && end <= i);
            if precedes { low = middle + 1u; } else { high = middle; }
        }
        place += low - begin;
    }
    keys[place] = key;
    point_places[place] = taken_places[i];
    point_lights[place] = taken_lights[i];
}
