// The light of each point, its contribution: scatter * colour of its own entry * power *
// kernel. One that is not where it was is dark.
//
// `even` also divides by the mean extinction around it, so that what is blurred is
// fluence, which is smooth, and not collision density, which is not.

import package::shared::item::item_index;
import package::shared::phase::PI;
import package::shared::points::PointsParams;
import package::shared::scene::scattering;
import package::shared::slot::{slot_of, unpack_power};
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> states: array<vec4<u32>>;
@group(0) @binding(10) var<storage, read> slots: array<u32>;
@group(0) @binding(11) var<storage, read> kept: array<u32>;
@group(0) @binding(12) var<storage, read_write> point_lights: array<vec4<f32>>;
@if(even) @group(0) @binding(13) var<storage, read> means: array<f32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let point = item_index(group, groups, local);
    if point >= params.count { return; }
    if params.fresh == 0u && extractBits(kept[point / 32u], point % 32u, 1u) == 0u {
        point_lights[point] = vec4<f32>(0.0);
        return;
    }
    let slot = slot_of(vec4<u32>(0u), states[slots[point]]);
    let material = scattering[slot.entry];
    var light = unpack_power(slot.power) * material.rgb * params.kernel;
    @if(!anisotropic) { light /= 4.0 * PI; }
    @if(even) { light /= means[point]; }
    point_lights[point] = vec4<f32>(light, material.a);
}
