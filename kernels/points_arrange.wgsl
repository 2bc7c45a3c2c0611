// Puts the points that came and went in the order of their keys.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::points::PointsParams;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> taken_order: array<u32>;
@group(0) @binding(10) var<storage, read> taken_places: array<vec4<u32>>;
@group(0) @binding(11) var<storage, read> taken_lights: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> point_places: array<vec4<u32>>;
@group(0) @binding(13) var<storage, read_write> point_lights: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let point = item_index(group, groups, local);
    if point >= params.count { return; }
    point_places[point] = taken_places[taken_order[point]];
    point_lights[point] = taken_lights[taken_order[point]];
}
