// The listed points, whose light changed, of one batch behind those of the batches before.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::points::{Change, PointsParams};

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read> keys: array<u32>;
@group(0) @binding(11) var<storage, read> point_places: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read> seen_lights: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read> point_lights: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read_write> taken_keys: array<u32>;
@group(0) @binding(15) var<storage, read_write> taken_places: array<vec4<u32>>;
@group(0) @binding(16) var<storage, read_write> taken_lights: array<Change>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    let point = work[i];
    let at = params.first + i;
    var light: Change;
    if params.had == 1u { light.seen = seen_lights[point]; }
    if params.has == 1u { light.now = point_lights[point]; }
    taken_keys[at] = keys[point];
    taken_places[at] = point_places[point];
    taken_lights[at] = light;
}
