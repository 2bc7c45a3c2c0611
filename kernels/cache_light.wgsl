// Light samples for the events of a pass, which pixels and cache learn from.
//
// A sample is taken with a chance, and makes up for those that are not: what the cache has, S = cached +
// (light - cached) / chance, is right on average whatever the cache has.

import package::constants::{GROUP, COUNTER_WORDS, CHOICE_CELLS, CHOICE_REFUSED};
import package::shared::cache::{CacheParams, Film, Event, with_sample};
@if(grid) import package::shared::cells::{SLOT_WORDS, PROBES, key_of, first_slot};
import package::shared::counter::{CLAMPED, SAMPLES, UNFINISHED, counters, count, cut_short};
import package::shared::item::item_index;
import package::shared::random::{
    pcg4d, draw, unit, unit4, FOR_CACHE_CELL, FOR_CACHE_LIGHT
};
import package::shared::scene::{scene, shading};
import package::shared::single::{stream, next_words, light_at};
@if(grid) import package::shared::sum64::rounded;

@group(0) @binding(8) var<uniform> params: CacheParams;
@if(grid) @group(0) @binding(9) var<storage, read_write> table: array<atomic<u32>>;
@group(0) @binding(10) var<storage, read_write> film: array<Film>;
@group(0) @binding(11) var<storage, read> events: array<Event>;
@group(0) @binding(12) var<storage, read> found: array<u32>;

// The slot of a key, made if need be, and 1 more; 0: there is no room. Nobody waits for anybody.
@if(grid)
fn find_or_make(key: u32) -> u32 {
    var slot = first_slot(key, params);
    var probes = 0u;
    // A weak exchange may fail for nothing.
    for (var turn = 0u; turn < 4u * PROBES && probes < PROBES; turn++) {
        let word = SLOT_WORDS * slot;
        var held = atomicLoad(&table[word]);
        if held == 0u {
            let taken = atomicCompareExchangeWeak(&table[word], 0u, key);
            if taken.exchanged {
                atomicAdd(&counters[COUNTER_WORDS + CHOICE_CELLS], 1u);
                return slot + 1u;
            }
            held = taken.old_value;
        }
        if held == key { return slot + 1u; }
        if held == 0u { continue; }
        slot = (slot + 1u) & (params.slots - 1u);
        probes++;
    }
    atomicAdd(&counters[COUNTER_WORDS + CHOICE_REFUSED], 1u);
    return 0u;
}

@if(grid)
fn add(word: u32, value: u32) {
    if value == 0u { return; }
    let low = atomicAdd(&table[word], value);
    if low + value < low { atomicAdd(&table[word + 1u], 1u); }
}

@if(grid)
fn learn(pixel: u32, event: Event, light: vec3<f32>) {
    let key = draw(scene.seed, pixel, params.pass_number, FOR_CACHE_CELL);
    let red = rounded(light.r * params.scale);
    let green = rounded(light.g * params.scale);
    let blue = rounded(light.b * params.scale);
    for (var level = 0u; level < params.levels; level++) {
        if ((event.adds >> level) & 1u) == 0u { continue; }
        let jitter = unit4(pcg4d(vec4(key.xyz, key.w + level))).xyz - 0.5;
        let slot = find_or_make(key_of(event.place, level, jitter, params));
        if slot == 0u { continue; }
        let word = SLOT_WORDS * (slot - 1u);
        atomicAdd(&table[word + 1u], 1u);
        add(word + 2u, red.value);
        add(word + 4u, green.value);
        add(word + 6u, blue.value);
    }
    count(CLAMPED, u32(red.clamped) + u32(green.clamped) + u32(blue.clamped));
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    if item >= params.items || params.first_item + item >= found[0] { return; }
    let pixel = found[1u + params.first_item + item];
    let event = events[pixel];
    let key = draw(scene.seed, pixel, params.pass_number, FOR_CACHE_LIGHT);
    stream = vec4<u32>(key.xyz, 0u);
    var record = film[pixel];
    var sample = event.seen;
    var more = vec3<f32>(0.0);
    let is_taken = unit(next_words().x) < event.chance;
    if is_taken {
        let lit = light_at(event.place);
        let light = lit.light * shading[event.entry].albedo;
        let off = (light - event.cached) / event.chance;
        sample += off;
        @if(history) { record.shadow |= lit.cells; }
        @if(grid) {
            if (event.adds & 0x80000000u) != 0u { more = -off; }
            learn(pixel, event, lit.light);
        }
        count(SAMPLES, 1u);
    }
    film[pixel] = with_sample(record, sample, more);
    count(UNFINISHED, u32(cut_short));
}
