// Fluence, the track-length estimator: each flight adds power times length to every
// cell of the light field that it crosses, as a rounded integer; or takes exactly that out again;
// or does both at once, where a flight of the journal is flown with another power now. A work item
// is an event of a photon, of the slots of a batch or of the journal: of all photons, or of the chosen
// ones, counted from the slot on that changed.

import package::constants::{GROUP, DEPOSIT_ADD, DEPOSIT_REPLACE};
import package::shared::counter::{DEPOSITS, CLAMPED, UNFINISHED_LIGHT, count, expect, cut_short};
import package::shared::item::item_index;
import package::shared::light::emit;
import package::shared::quota::identify;
import package::shared::scene::scene;
import package::shared::slot::{EMPTY, slot_kind, slot_of, slot_power, unpack_power};
import package::shared::sum64::rounded;
import package::shared::walk::{line, walk_begin, walk_leave, walk_step};

struct DepositParams {
    grid: vec3<u32>,    // cells
    scale: f32,         // of the sums
    max_events: u32,
    mode: u32,          // DEPOSIT_ADD, DEPOSIT_REMOVE or DEPOSIT_REPLACE
    first_item: u32,    // of this dispatch
    items: u32,
    photons: u32,       // that are summed, where none are chosen
    first_photon: u32,  // the first of them
    stride: u32,        // photons in the batch
    is_chosen: u32,     // 1: of a part the chosen photons, two words each (see `chosen`), not all
    in_journal: u32,    // 1: a photon's slots are at its place in the part, not in the batch
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

@group(0) @binding(8) var<uniform> params: DepositParams;
@group(0) @binding(9) var<storage, read> chosen: array<u32>;
@group(0) @binding(11) var<storage, read> places: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read> states: array<vec4<u32>>;
@group(0) @binding(13) var<storage, read_write> red: array<atomic<u32>>;
@group(0) @binding(14) var<storage, read_write> green: array<atomic<u32>>;
@group(0) @binding(15) var<storage, read_write> blue: array<atomic<u32>>;

fn add_word(channel: u32, word: u32, value: u32) -> u32 {
    switch channel {
        case 0u: { return atomicAdd(&red[word], value); }
        case 1u: { return atomicAdd(&green[word], value); }
        default: { return atomicAdd(&blue[word], value); }
    }
}

// Puts a contribution in the place of an old one; returns how many of them were clamped. The
// difference is added in two's complement, so all is one wrapping 64-bit sum.
fn put(channel: u32, cell: u32, old: f32, now: f32) -> u32 {
    let before = rounded(old);
    let after = rounded(now);
    let low = after.value - before.value;
    if low != 0u {
        let sum = add_word(channel, 2u * cell, low);
        let borrow = select(0u, 0xffffffffu, after.value < before.value);
        let high = borrow + u32(sum + low < sum);
        if high != 0u { _ = add_word(channel, 2u * cell + 1u, high); }
    }
    return u32(before.clamped) + u32(after.clamped);
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    // No branches on what the host tells: where those make a kernel much shorter, Mesa's software
    // adapter compiles it anew for each dispatch.
    let is_chosen = params.is_chosen == 1u;
    let photons = select(params.photons, chosen[0], is_chosen);
    let number = params.first_item + item;
    if item >= params.items || number >= photons * params.max_events { return; }
    let place = number % photons;
    let at_chosen = select(0u, 2u + 2u * place, is_chosen);
    let photon = select(params.first_photon + place, chosen[at_chosen], is_chosen);
    let changed = select(0u, chosen[at_chosen + 1u], is_chosen);
    let event = number / photons + changed % params.max_events;
    if event >= params.max_events { return; }
    let in_journal = params.in_journal == 1u;
    let stride = select(params.stride, chosen[1], in_journal);
    let at = event * stride + select(photon, changed / params.max_events, in_journal);
    let state = states[at];
    if slot_kind(state) == EMPTY { return; }
    let slot = slot_of(places[at], state);

    var start: vec3<f32>;
    if event > 0u {
        start = bitcast<vec3<f32>>(places[at - stride].xyz);
    } else {
        let id = identify(photon);
        start = emit(id.light, id.index).position;
    }
    let way = slot.position - start;
    let length = length(way);
    if !(length > 0.0) { return; }
    let l = line(start, way / length);
    let flown = unpack_power(slot.power) * params.scale;
    // What `weigh` has noted in place of the history.
    let weighed = unpack_power(slot_power(state.zwxy)) * params.scale;
    let old = select(flown, vec3<f32>(0.0), params.mode == DEPOSIT_ADD);
    let added = select(vec3<f32>(0.0), flown, params.mode == DEPOSIT_ADD);
    let now = select(added, weighed, params.mode == DEPOSIT_REPLACE);
    let edge = scene.extent / vec3<f32>(params.grid);
    var w = walk_begin(l, 0.0, edge, params.grid);
    var t = 0.0;
    var deposits = 0u;
    var clamped = 0u;
    var arrived = false;
    loop {
        let leave = min(walk_leave(w), length);
        let crossed = max(leave - t, 0.0);
        let c = vec3<u32>(w.cell);
        let cell = (c.z * params.grid.y + c.y) * params.grid.x + c.x;
        clamped += put(0u, cell, old.r * crossed, now.r * crossed);
        clamped += put(1u, cell, old.g * crossed, now.g * crossed);
        clamped += put(2u, cell, old.b * crossed, now.b * crossed);
        deposits++;
        t = max(leave, t);
        arrived = leave >= length || !walk_step(&w, l, edge, params.grid);
        if arrived { break; }
    }
    expect(arrived);
    count(DEPOSITS, deposits);
    count(CLAMPED, clamped);
    count(UNFINISHED_LIGHT, u32(cut_short));
}
