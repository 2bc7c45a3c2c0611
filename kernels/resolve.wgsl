// The mean fluence of every cell of the light field, from its integer sums; cells that
// are not what they were are marked.

import package::shared::counter::{UNFINISHED_LIGHT, count, cut_short};
import package::shared::dirty::mark_dirty;
import package::shared::item::item_index;
import package::shared::sum64::sum_to_float;
import package::constants::GROUP;

struct ResolveParams {
    grid: vec3<u32>,
    per_sum: f32,  // fluence for each unit of a sum: 1 / (scale * cell volume)
    edge: vec3<f32>,  // of a cell, mm
    marks: u32,       // 1: cells that differ are marked
}

@group(0) @binding(8) var<uniform> params: ResolveParams;
@group(0) @binding(9) var<storage, read> red: array<vec2<u32>>;
@group(0) @binding(10) var<storage, read> green: array<vec2<u32>>;
@group(0) @binding(11) var<storage, read> blue: array<vec2<u32>>;
@group(0) @binding(12) var before: texture_3d<f32>;
@group(0) @binding(13) var fluence: texture_storage_3d<rgba32float, write>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let cell = item_index(group, groups, local);
    let layer = params.grid.x * params.grid.y;
    if cell >= layer * params.grid.z { return; }
    let sums = vec3(sum_to_float(red[cell]), sum_to_float(green[cell]), sum_to_float(blue[cell]));
    let at = vec3<u32>(cell % params.grid.x, (cell % layer) / params.grid.x, cell / layer);
    let now = sums * params.per_sum;
    textureStore(fluence, at, vec4<f32>(now, 0.0));
    // An interpolated fetch reads the cell from half a cell around it.
    let low = (vec3<f32>(at) - 0.5) * params.edge;
    if params.marks == 1u && any(now != textureLoad(before, at, 0).rgb) {
        mark_dirty(low, low + 2.0 * params.edge);
    }
    count(UNFINISHED_LIGHT, u32(cut_short));
}
