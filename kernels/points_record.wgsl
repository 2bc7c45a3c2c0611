// The light of each point of a batch, its contribution: scatter * colour of its own entry *
// power * kernel. One that is not where it was is dark. Where the light is not what it was, that
// is noted; the host keeps what segments have seen.
//
// `even` also divides by the mean extinction around it, so that what is blurred is
// fluence, which is smooth, and not collision density, which is not.

import package::shared::counter::{REFRESHED, count};
import package::shared::item::item_index;
import package::shared::phase::PI;
import package::shared::points::{Origin, PointsParams};
import package::shared::scene::shading;
import package::shared::slot::{slot_of, unpack_power};
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> states: array<vec4<u32>>;
@group(0) @binding(10) var<storage, read> origins: array<Origin>;
@group(0) @binding(11) var<storage, read_write> point_lights: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read> kept: array<u32>;
@group(0) @binding(15) var<storage, read_write> changed: array<atomic<u32>>;

fn light_of(point: u32) -> vec4<f32> {
    let slot = slot_of(vec4<u32>(0u), states[origins[point].slot - params.first_slot]);
    let material = shading[slot.entry];
    var light = unpack_power(slot.power) * material.albedo * params.per_ball;
    @if(!anisotropic) { light /= 4.0 * PI; }
    @if(even) {
        // Rounding may look beside a tissue a voxel wide, and find nothing around.
        let mean = origins[point].mean;
        light = select(vec3<f32>(0.0), light / mean, mean > 0.0);
    }
    return vec4<f32>(light, material.phase_g);
}

// Returns whether it is the batch's: others are not looked at.
fn record(point: u32, is_kept: bool) -> bool {
    // This wraps where they come before.
    if origins[point].slot - params.first_slot >= params.slots { return false; }
    var light = vec4<f32>(0.0);
    if is_kept { light = light_of(point); }
    if params.fresh == 1u {
        point_lights[point] = light;
        return true;
    }
    let seen = point_lights[point];
    let differs = any(bitcast<vec4<u32>>(seen) != bitcast<vec4<u32>>(light));
    let bit = 1u << (point % 32u);
    if differs && any(max(seen.rgb, light.rgb) > vec3<f32>(0.0)) {
        atomicOr(&changed[point / 32u], bit);
    } else {
        atomicAnd(&changed[point / 32u], ~bit);
    }
    if differs { point_lights[point] = light; }
    return true;
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    // A thread for each point; or for each word of them, where those that may have other light
    // are marked.
    let is_fresh = params.fresh == 1u;
    let i = item_index(group, groups, local) * select(32u, 1u, is_fresh);
    if i >= params.count { return; }
    let begin = params.first + i;
    let word = begin / 32u;
    var staying = 0xffffffffu;
    if !is_fresh && params.all == 0u { staying = kept[word]; }
    var open = 1u << (begin % 32u);
    if !is_fresh {
        let beyond = max(begin + 32u, params.count) - params.count;
        open = (0xffffffffu >> beyond) & (atomicLoad(&changed[word]) | ~staying);
    }
    var recorded = 0u;
    while open != 0u {
        let at = firstTrailingBit(open);
        open &= open - 1u;
        recorded += u32(record(32u * word + at, extractBits(staying, at, 1u) == 1u));
    }
    if !is_fresh { count(REFRESHED, recorded); }
}
