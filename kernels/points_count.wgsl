// How many lights each bucket has of the listed points, `lights_each`. Noted one bucket further: summed
// up, that is where the bucket begins, and when all have come (`points_take`), where it ends.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::buckets::{starts, bucket_for};
import package::shared::points::{PointsParams, points_cell, points_key};

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read> from_places: array<vec4<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    let position = bitcast<vec3<f32>>(from_places[work[1u + i]].xyz);
    let bucket = bucket_for(points_key(points_cell(position, params), params), params);
    atomicAdd(&starts[bucket + 1u], params.lights_each);
}
