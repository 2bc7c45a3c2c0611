// What a gather asks for, of points that come together in a new order.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::points::{NOWHERE, PointsParams};

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> order: array<u32>;
@group(0) @binding(10) var<storage, read> seen_buckets: array<u32>;
@group(0) @binding(11) var<storage, read> seen_places: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read> seen_lights: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read_write> buckets: array<u32>;
@group(0) @binding(14) var<storage, read_write> point_places: array<vec4<u32>>;
@group(0) @binding(15) var<storage, read_write> point_lights: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    let place = order[i];
    if place == NOWHERE { return; }
    buckets[place] = seen_buckets[i];
    point_places[place] = seen_places[i];
    point_lights[place] = seen_lights[i];
}
