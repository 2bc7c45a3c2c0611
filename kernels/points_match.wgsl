// Which points' light went and which came: of those whose light is not what segments have
// seen.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::points::PointsParams;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> seen_lights: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> point_lights: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> went: array<atomic<u32>>;
@group(0) @binding(12) var<storage, read_write> came: array<atomic<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let point = item_index(group, groups, local);
    if point >= params.count { return; }
    let seen = seen_lights[point];
    let now = point_lights[point];
    if all(bitcast<vec4<u32>>(seen) == bitcast<vec4<u32>>(now)) { return; }
    let bit = 1u << (point % 32u);
    if any(seen.rgb > vec3<f32>(0.0)) { atomicOr(&went[point / 32u], bit); }
    if any(now.rgb > vec3<f32>(0.0)) { atomicOr(&came[point / 32u], bit); }
}
