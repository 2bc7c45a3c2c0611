// Whose photons a batch has: those of several lights, side by side.

import package::constants::MAX_LIGHTS;
import package::shared::light::lights;

struct QuotaRecord {
    first: u32,        // the batch's photon that is the first of these
    photons: u32,
    light: u32,        // its place in the scene; NOBODY: the light is gone
    first_index: u32,  // the light's photon that is the first of these
}

struct Quotas {
    count: u32,
    relit: u32,  // a bit for each whose light has another power now
    pad0: u32,
    pad1: u32,
    all: array<QuotaRecord, MAX_LIGHTS>,
}

@group(0) @binding(22) var<uniform> quotas: Quotas;

const NOBODY: u32 = 0xffffffffu;

// A photon's light, its own random stream and its index among those of its light, whatever the batch.
struct Identity {
    light: u32,
    stream: u32,
    index: u32,
    relit: bool,
}

fn identify(photon: u32) -> Identity {
    for (var i = 0u; i < quotas.count; i++) {
        let quota = quotas.all[i];
        let within = photon - quota.first;
        if within >= quota.photons || quota.light == NOBODY { continue; }
        let relit = ((quotas.relit >> i) & 1u) == 1u;
        return Identity(quota.light, lights.all[quota.light].stream, quota.first_index + within, relit);
    }
    return Identity(NOBODY, 0u, 0u, false);
}
