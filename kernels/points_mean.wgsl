// The mean extinction in the kernel's ball around each point, by which `even` divides. A point
// that is where it was keeps its mean if no extinction changed that the ball can hold.

import package::shared::item::item_index;
import package::shared::points::PointsParams;
import package::shared::scene::{frame, optics, cell_masks, cell_index, entry_at};
import package::shared::slot::slot_entry;
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> states: array<vec4<u32>>;
@group(0) @binding(10) var<storage, read> slots: array<u32>;
@group(0) @binding(11) var<storage, read> point_places: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read> kept: array<u32>;
@group(0) @binding(13) var<storage, read_write> means: array<f32>;

// Taps of the mean: two shells of a Fibonacci lattice over the ball, of equal volume
// each, and the photon's own entry.
const SHELL: u32 = 16u;

fn mean_extinction(position: vec3<f32>, own: u32) -> f32 {
    var total = optics[own].extinction;
    for (var i = 0u; i < 2u * SHELL; i++) {
        // Radii at the volume medians of the inner and the outer half of the ball.
        let radius = params.radius * select(0.9086, 0.63, i < SHELL);
        let z = 1.0 - (2.0 * f32(i % SHELL) + 1.0) / f32(SHELL);
        let angle = 2.399963 * f32(i);
        let across = sqrt(1.0 - z * z);
        let tap = position + radius * vec3(across * cos(angle), across * sin(angle), z);
        if all(tap >= vec3<f32>(0.0)) && all(tap <= frame.extent) {
            total += optics[entry_at(tap)].extinction;
        }
    }
    return total / f32(2u * SHELL + 1u);
}

fn cell_at(point: vec3<f32>) -> vec3<i32> {
    return clamp(vec3<i32>(floor(point / frame.cell_mm)), vec3<i32>(0), vec3<i32>(frame.cells) - 1);
}

// Whether a macro-cell that the ball may reach into can have a value whose extinction changed.
fn is_changed(position: vec3<f32>) -> bool {
    let reach = 1.01 * params.radius + 0.01 * frame.cell_mm;
    let low = cell_at(position - reach);
    let size = cell_at(position + reach) - low + 1;
    let count = size.x * size.y * size.z;
    // To look into many cells takes longer than the mean.
    if count > 27 { return true; }
    var bits = vec2<u32>(0u);
    for (var i = 0; i < count; i++) {
        let at = vec3<i32>(i % size.x, i / size.x % size.y, i / (size.x * size.y));
        bits |= cell_masks[cell_index(low + at)];
    }
    return any((bits & params.changed) != vec2<u32>(0u));
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let point = item_index(group, groups, local);
    if point >= params.count { return; }
    let is_new = params.fresh == 1u;
    if !is_new && extractBits(kept[point / 32u], point % 32u, 1u) == 0u { return; }
    let position = bitcast<vec3<f32>>(point_places[point].xyz);
    if is_new || is_changed(position) {
        means[point] = mean_extinction(position, slot_entry(states[slots[point]]));
    }
}
