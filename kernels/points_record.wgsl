// What a gather needs of each photon, in sorted order: place and direction, and its
// contribution: scatter * colour of its own entry * power * kernel.
//
// `even` also divides by the mean extinction in the kernel's ball, so that what is
// blurred is fluence, which is smooth, and not collision density, which is not.

import package::shared::item::item_index;
import package::shared::phase::PI;
import package::shared::points::PointsParams;
import package::shared::scene::{optics, scattering, entry_at, frame};
import package::shared::slot::{slot_of, unpack_power};
import package::constants::GROUP;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> places: array<vec4<u32>>;
@group(0) @binding(10) var<storage, read> states: array<vec4<u32>>;
@group(0) @binding(11) var<storage, read> slots: array<u32>;
@group(0) @binding(12) var<storage, read_write> point_places: array<vec4<u32>>;
@group(0) @binding(13) var<storage, read_write> point_lights: array<vec4<f32>>;

// Taps of the mean: two shells of a Fibonacci lattice over the ball, of equal volume
// each, and the photon's own entry.
const SHELL: u32 = 16u;

@if(even)
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

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let point = item_index(group, groups, local);
    if point >= params.count { return; }
    let at = slots[point];
    let slot = slot_of(places[at], states[at]);
    let material = scattering[slot.entry];
    var light = unpack_power(slot.power) * material.rgb * params.kernel;
    @if(!anisotropic) { light /= 4.0 * PI; }
    @if(even) { light /= mean_extinction(slot.position, slot.entry); }
    point_places[point] = places[at];
    point_lights[point] = vec4<f32>(light, material.a);
}
