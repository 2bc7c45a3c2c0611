// The listed points, whose light changed, each in its bucket: with the light that segments have
// seen, less than zero, for that is taken out (`sign` -1), or with what it is now (1). In which order
// they come there is left open: sums of integers do not depend on it.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::buckets::{starts, bucket_for};
import package::shared::points::{PointsParams, points_cell, points_key};

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(11) var<storage, read> from_places: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read> from_lights: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read_write> point_places: array<vec4<u32>>;
@group(0) @binding(16) var<storage, read_write> point_lights: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    let point = work[1u + i];
    let place = from_places[point];
    let cell = points_cell(bitcast<vec3<f32>>(place.xyz), params);
    let at = atomicAdd(&starts[bucket_for(points_key(cell, params), params) + 1u], 1u);
    let light = from_lights[point];
    point_places[at] = place;
    point_lights[at] = vec4<f32>(params.sign * light.rgb, light.a);
}
