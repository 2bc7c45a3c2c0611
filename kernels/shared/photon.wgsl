// What a photon does between two slots: it leaves its light, or the interaction before.

import package::shared::phase::{uniform_direction, sample_phase};
import package::shared::quota::Identity;
import package::shared::random::{draw, unit, unit4, FOR_SCATTER};
import package::shared::scene::{optics_of, shading};
import package::constants::CHANGE_FALLEN;
import package::shared::slot::{
    Slot, INTERACTION, slot_kind, slot_entry, unpack_direction, pack_direction, scaled_power
};

struct PhotonParams {
    photons: u32,          // in the batch
    max_events: u32,
    first_item: u32,       // of this dispatch
    items: u32,
    first_listed: u32,     // the part of the work list that is worked on
    listed: u32,           // photons in it, at most
    roulette_from: u32,    // first event after which the roulette runs
    roulette_survival: f32,
    risen: vec2<u32>,      // bins where a flight may be stopped that was not
    first_event: u32,      // the window of events that a dispatch traces, from where each photon
    stop_event: u32,       // resumes
    roulette_gain: u32,    // 1 / roulette_survival: this / 2^18 * 2^doublings
    roulette_doublings: i32,
    blocks: u32,           // of marks of photons that changed
    pad: u32,
}

// How many photons a part of the work list has, which has so many in all. The journal has as many
// slots from one event to the next.
fn listed_of(all: u32, params: PhotonParams) -> u32 {
    return min(all - min(params.first_listed, all), params.listed);
}

// What is to be done with a photon: from `touched` on its power is found again; from
// `astray` on its path is no longer that of its slots. A full rebuild has both at zero.
struct Task {
    touched: u32,
    astray: u32,
}

const NOTHING: u32 = 0xffu;  // beyond any event

fn pack_task(task: Task) -> u32 {
    return task.touched | (task.astray << 8u);
}

// Beside its task: that a window of events ended before the photon did.
const GOES_ON: u32 = 0x10000u;

fn goes_on(word: u32) -> bool {
    return (word & GOES_ON) != 0u;
}

fn unpack_task(word: u32) -> Task {
    return Task(word & 0xffu, (word >> 8u) & 0xffu);
}

// Whether an edit may have changed a flight: where extinction rose it may be stopped, its
// history tells; where it fell only those that interacted there fly on, H(10).
fn is_invalid(state: vec4<u32>, risen: vec2<u32>) -> bool {
    let fallen = optics_of(slot_entry(state)).changes & CHANGE_FALLEN;
    return any((state.zw & risen) != vec2<u32>(0u))
        || (slot_kind(state) == INTERACTION && fallen != 0u);
}

// Implicit capture: the weight takes the albedo; past a given event a roulette with a
// fixed probability may end the photon, with no power left. Neither moves it.
fn weigh(
    id: Identity,
    event: u32,
    arriving: vec2<u32>,
    entry: u32,
    params: PhotonParams,
) -> vec2<u32> {
    // Exact products and one rounding each, whatever the compiler makes of them.
    let albedo = vec3<u32>(min(shading[entry].albedo, vec3<f32>(1.0)) * 262144.0 + 0.5);
    let power = scaled_power(arriving, albedo, 0);
    if event < params.roulette_from { return power; }
    let survives = unit(draw(id.stream, id.index, event, FOR_SCATTER).z) < params.roulette_survival;
    if !survives { return vec2<u32>(0u); }
    return scaled_power(power, vec3<u32>(params.roulette_gain), params.roulette_doublings);
}

// Where an interaction sends the photon, packed.
fn turn(id: Identity, event: u32, slot: Slot) -> u32 {
    let u = unit4(draw(id.stream, id.index, event, FOR_SCATTER)).xy;
    let g = shading[slot.entry].phase_g;
    @if(anisotropic) let direction = sample_phase(g, unpack_direction(slot.direction), u);
    @if(!anisotropic) let direction = uniform_direction(u);
    return pack_direction(direction);
}
