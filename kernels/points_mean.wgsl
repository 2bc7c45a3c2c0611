// The mean extinction in the kernel's ball around each point, by which `even` divides, and the
// historygram of the values that it is of. A point that is where it was keeps its mean if it
// read no value whose extinction changed; one that is not needs none.

import package::shared::counter::{REFRESHED, count};
import package::shared::item::{group_index, thread};
import package::shared::kept::is_kept;
import package::shared::points::{Origin, PointsParams};
import package::shared::scene::{scene, optics_of, entry_at, bin_of, bin_bit};
import package::constants::{GROUP, MEAN_BLOCK};

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(11) var<storage, read> point_places: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read_write> origins: array<Origin>;
@if(history) @group(0) @binding(13) var<storage, read_write> mean_histories: array<vec2<u32>>;
// Points whose mean changed are marked here.
@group(0) @binding(16) var<storage, read_write> changed: array<atomic<u32>>;

// Taps of the mean: two shells of a Fibonacci lattice over the ball, of equal volume
// each, and its centre.
const SHELL: u32 = 16u;

// Those of a group's points that need a mean, side by side, so that no thread waits for others.
var<workgroup> listed: array<u32, MEAN_BLOCK>;
var<workgroup> length: atomic<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    thread = group_index(group, groups);
    let first = thread * MEAN_BLOCK;
    for (var i = local; i < MEAN_BLOCK; i += GROUP) {
        let point = first + i;
        if is_needed(point) { listed[atomicAdd(&length, 1u)] = point; }
    }
    workgroupBarrier();
    if params.fresh == 0u && local == 0u { count(REFRESHED, atomicLoad(&length)); }
    for (var i = local; i < atomicLoad(&length); i += GROUP) { find_mean(listed[i]); }
}

fn is_needed(point: u32) -> bool {
    if point >= params.count { return false; }
    if params.fresh == 1u { return true; }
    let stays = params.all == 1u || is_kept(point);
    @if(history) return stays && any((mean_histories[point] & params.changed) != vec2<u32>(0u));
    @if(!history) return stays;
}

fn find_mean(point: u32) {
    let position = bitcast<vec3<f32>>(point_places[point].xyz);
    let own = entry_at(position);
    var total = optics_of(own).extinction;
    var history = bin_bit(bin_of(own));
    for (var i = 0u; i < 2u * SHELL; i++) {
        // Radii at the volume medians of the inner and the outer half of the ball.
        let radius = params.radius * select(0.9086, 0.63, i < SHELL);
        let z = 1.0 - (2.0 * f32(i % SHELL) + 1.0) / f32(SHELL);
        let angle = 2.399963 * f32(i);
        let across = sqrt(1.0 - z * z);
        let tap = position + radius * vec3(across * cos(angle), across * sin(angle), z);
        if all(tap >= vec3<f32>(0.0)) && all(tap <= scene.extent) {
            let entry = entry_at(tap);
            total += optics_of(entry).extinction;
            @if(history) { history |= bin_bit(bin_of(entry)); }
        }
    }
    let mean = total / f32(2u * SHELL + 1u);
    if params.fresh == 0u && bitcast<u32>(mean) != bitcast<u32>(origins[point].mean) {
        atomicOr(&changed[point / 32u], 1u << (point % 32u));
    }
    origins[point].mean = mean;
    @if(history) { mean_histories[point] = history; }
}
