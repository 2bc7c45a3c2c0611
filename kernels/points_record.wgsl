// The light of each point of a batch, its contribution: scatter * colour of its own entry *
// power * kernel. One that is not where it was is dark. Where the light is not what it was, that
// is noted: segments have seen it.
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
@group(0) @binding(11) var<storage, read_write> point_lights: array<vec4<f32>>;
@if(even) @group(0) @binding(12) var<storage, read> means: array<f32>;
@group(0) @binding(13) var<storage, read> kept: array<u32>;
@group(0) @binding(14) var<storage, read_write> seen_lights: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read_write> changed: array<atomic<u32>>;

fn light_of(point: u32) -> vec4<f32> {
    let slot = slot_of(vec4<u32>(0u), states[slots[point] - params.first_slot]);
    let material = scattering[slot.entry];
    var light = unpack_power(slot.power) * material.rgb * params.kernel;
    @if(!anisotropic) { light /= 4.0 * PI; }
    @if(even) { light /= means[point]; }
    return vec4<f32>(light, material.a);
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    let is_fresh = params.fresh == 1u;
    let point = select(i, params.first + i, is_fresh);
    let word = point / 32u;
    let bit = 1u << (point % 32u);
    let is_kept = is_fresh || params.all == 1u || extractBits(kept[word], point % 32u, 1u) == 1u;
    // A mean that changed has marked its point.
    let may_stay = !is_fresh && params.stay == 1u && is_kept;
    if may_stay && (atomicLoad(&changed[word]) & bit) == 0u { return; }
    // Those of other batches are not looked at: this wraps where they come before.
    if slots[point] - params.first_slot >= params.slots { return; }
    var light = vec4<f32>(0.0);
    if is_kept { light = light_of(point); }
    if is_fresh {
        point_lights[point] = light;
        return;
    }
    let seen = point_lights[point];
    let differs = any(bitcast<vec4<u32>>(seen) != bitcast<vec4<u32>>(light));
    if differs && any(max(seen.rgb, light.rgb) > vec3<f32>(0.0)) {
        atomicOr(&changed[word], bit);
    } else {
        atomicAnd(&changed[word], ~bit);
    }
    if !differs { return; }
    seen_lights[point] = seen;
    point_lights[point] = light;
}
