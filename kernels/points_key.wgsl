// Where the listed slots of a batch are, each with its bucket: of all that enter, told as slots of the
// table, those that are the batch's.

import package::shared::item::item_index;
import package::shared::buckets::bucket_for;
import package::shared::points::{Origin, PointsParams, points_cell, points_key};
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> places: array<vec4<u32>>;
@group(0) @binding(10) var<storage, read> work: array<u32>;
@group(0) @binding(11) var<storage, read_write> buckets: array<u32>;
@group(0) @binding(12) var<storage, read_write> origins: array<Origin>;
@group(0) @binding(13) var<storage, read_write> point_places: array<vec4<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    let slot = work[1u + i];
    // This wraps where they come before.
    if slot - params.first_slot >= params.slots { return; }
    let place = places[slot - params.first_slot];
    let position = bitcast<vec3<f32>>(place.xyz);
    buckets[i] = bucket_for(points_key(points_cell(position, params), params), params);
    origins[i].slot = slot;
    point_places[i] = place;
}
