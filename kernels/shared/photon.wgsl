// What a photon does between two slots: it leaves its light, or the interaction before.

import package::shared::light::{lights, light_of, emit};
import package::shared::phase::{uniform_direction, sample_phase};
import package::shared::random::{draw, unit, unit4, FOR_SCATTER};
import package::shared::scene::scattering;
import package::shared::slot::{Slot, INTERACTION, unpack_direction, pack_direction, unpack_power, pack_power};

struct PhotonParams {
    first_photon: u32,     // number of the batch's first photon
    photons: u32,          // in the batch
    first_item: u32,       // of this dispatch
    items: u32,            // of this dispatch
    max_events: u32,
    roulette_from: u32,    // first event after which the roulette runs
    roulette_survival: f32,
    scale: f32,            // of integer sums
    grid: vec3<u32>,       // cells of the light field
    sign: i32,             // 1 adds, -1 takes out
    first_event: u32,      // the window of events that this dispatch traces
    stop_event: u32,
    pad: vec2<u32>,
}

// A photon on its way: packed, as the next slot will store it.
struct Departure {
    position: vec3<f32>,
    direction: u32,
    power: vec2<u32>,      // zero: the photon has ended
    history: vec2<u32>,
}

// A photon's own random stream and index, known by its light, whatever the batch.
struct Identity {
    light: u32,
    stream: u32,
    index: u32,
}

fn identify(photon: u32) -> Identity {
    let light = light_of(photon);
    return Identity(light, lights.all[light].stream, photon - lights.all[light].first);
}

fn depart_from_light(id: Identity) -> Departure {
    let e = emit(id.light, id.index);
    return Departure(e.position, pack_direction(e.direction), pack_power(e.power), vec2<u32>(0u));
}

// Implicit capture: the weight takes the albedo; past a given event a roulette with a
// fixed probability may end the photon. Neither moves it.
fn depart_from_slot(id: Identity, event: u32, slot: Slot, params: PhotonParams) -> Departure {
    let words = draw(id.stream, id.index, event, FOR_SCATTER);
    let material = scattering[slot.entry];
    var power = unpack_power(slot.power) * material.rgb;
    if event >= params.roulette_from {
        let survives = unit(words.z) < params.roulette_survival;
        power = select(vec3<f32>(0.0), power / params.roulette_survival, survives);
    }
    let u = unit4(words).xy;
    @if(anisotropic) let direction = sample_phase(material.a, unpack_direction(slot.direction), u);
    @if(!anisotropic) let direction = uniform_direction(u);
    return Departure(slot.position, pack_direction(direction), pack_power(power), slot.history);
}
