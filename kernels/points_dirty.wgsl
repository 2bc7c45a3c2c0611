// Marks where light changed: around every listed point.

import package::constants::GROUP;
import package::shared::counter::{UNFINISHED_LIGHT, count, cut_short};
import package::shared::dirty::mark_dirty;
import package::shared::item::item_index;
import package::shared::points::PointsParams;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read> point_places: array<vec4<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = params.first + item_index(group, groups, local);
    if i >= params.count { return; }
    let position = bitcast<vec3<f32>>(point_places[work[1u + i]].xyz);
    mark_dirty(position, position);
    count(UNFINISHED_LIGHT, u32(cut_short));
}
