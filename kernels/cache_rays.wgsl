// A pass over the pixels: one ray each, to one scatter event, and what the cache knows of the light there.
// Events are listed, for `cache_light` to take samples. The cache stands still meanwhile, so that what is
// read is what it was when the pass began.

import package::constants::{GROUP, COUNTER_WORDS, CHOICE_CELLS};
import package::shared::cache::{CacheParams, Film, Event, pixel_of, with_sample};
@if(grid) import package::shared::cells::{
    SLOT_WORDS, PROBES, LEAST, ENOUGH, LEARNED, key_of, first_slot
};
import package::shared::counter::{TENTATIVE, UNFINISHED, counters, count, expect, cut_short};
import package::shared::item::item_index;
import package::shared::random::{
    pcg4d, draw, unit, unit4, exponential, FOR_CACHE_RAY, FOR_CACHE_CELL
};
import package::shared::scene::{
    scene, optics_of, shading, entry_at, cell_masks, bin_bit, bin_of
};
import package::shared::single::{stream, next_words, majorants};
@if(grid) import package::shared::sum64::sum_to_float;
import package::shared::walk::{line, inside, walk_begin, walk_leave, walk_step};

@group(0) @binding(8) var<uniform> params: CacheParams;
@if(grid) @group(0) @binding(9) var<storage, read> table: array<u32>;
@group(0) @binding(10) var<storage, read_write> film: array<Film>;
@group(0) @binding(11) var<storage, read_write> events: array<Event>;
// How many, and then which pixels have one.
@group(0) @binding(12) var<storage, read_write> found: array<atomic<u32>>;

var<workgroup> own: atomic<u32>;
var<workgroup> first: u32;

// What the cache knows of the light at a point.
struct Seen {
    light: vec3<f32>,
    is_known: bool,
    adds: u32,     // a bit for each level that is to learn a sample
    chance: f32,   // that a sample is worth taking
}

// The slot of a key, and 1 more; 0: there is none.
@if(grid)
fn find(key: u32) -> u32 {
    var slot = first_slot(key, params);
    for (var i = 0u; i < PROBES; i++) {
        let held = table[SLOT_WORDS * slot];
        if held == key { return slot + 1u; }
        if held == 0u { return 0u; }
        slot = (slot + 1u) & (params.slots - 1u);
    }
    return 0u;
}

// From coarse to fine, until a cell has few samples; the finest counts that has enough of them. Each level
// is asked at a place of its own, so that no edges show.
@if(grid)
fn look(point: vec3<f32>, key: vec4<u32>) -> Seen {
    var seen = Seen(vec3<f32>(0.0), false, 0u, 1.0);
    let has_room = atomicLoad(&counters[COUNTER_WORDS + CHOICE_CELLS]) < params.room;
    for (var level = 0u; level < params.levels; level++) {
        let jitter = unit4(pcg4d(vec4(key.xyz, key.w + level))).xyz - 0.5;
        let slot = find(key_of(point, level, jitter, params));
        var samples = 0u;
        if slot > 0u {
            let at = SLOT_WORDS * (slot - 1u);
            samples = table[at + 1u];
            if samples >= LEAST {
                let sums = vec3(
                    sum_to_float(vec2(table[at + 2u], table[at + 3u])),
                    sum_to_float(vec2(table[at + 4u], table[at + 5u])),
                    sum_to_float(vec2(table[at + 6u], table[at + 7u]))
                );
                seen.light = sums * params.per_sum / f32(samples);
                seen.is_known = true;
            }
        }
        let is_welcome = slot > 0u || level == 0u || has_room;
        if samples < LEARNED && is_welcome { seen.adds |= 1u << level; }
        if level + 1u == params.levels {
            seen.chance = clamp(16.0 / f32(max(samples, 1u)), params.least_chance, 1.0);
        }
        if samples <= ENOUGH { break; }
    }
    if !seen.is_known { seen.chance = 1.0; }
    return seen;
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    let at = pixel_of(params.first_item + item, params);
    let is_pixel = item < params.items && all(at < vec2(params.width, params.height));
    let pixel = at.y * params.width + at.x;
    var collided = false;
    if is_pixel { collided = look_along(pixel, at); }
    // One of a group asks for room.
    var place = 0u;
    if collided { place = atomicAdd(&own, 1u); }
    workgroupBarrier();
    if local == 0u { first = atomicAdd(&found[0], atomicLoad(&own)); }
    workgroupBarrier();
    if collided { atomicStore(&found[1u + first + place], pixel); }
}

// Follows the ray of a pixel. Returns whether there is an event.
fn look_along(pixel: u32, at: vec2<u32>) -> bool {
    let key = draw(scene.seed, pixel, params.pass_number, FOR_CACHE_RAY);
    stream = vec4<u32>(key.xyz, 0u);
    let u = unit4(key.wzyx).xy;
    let across = (vec2<f32>(at) + u) / vec2<f32>(f32(params.width), f32(params.height));
    let direction = normalize(params.corner + across.x * params.right + across.y * params.down);
    let l = line(params.origin, direction);
    let within = inside(l, scene.extent);

    var event = Event(vec3<f32>(0.0), 0u, vec3<f32>(0.0), 1.0, vec3<f32>(0.0), 0u);
    var record = film[pixel];
    var collided = false;
    var tentative = 0u;
    @if(gather) var shares = 0.0;
    @if(gather) var picked = vec3<f32>(0.0);
    @if(gather) var picked_entry = 0u;
    if within.y > within.x {
        var w = walk_begin(l, within.x, scene.cell_mm, scene.cells);
        var t_in = within.x;
        var arrived = false;
        loop {
            let t_out = min(walk_leave(w), within.y);
            @if(history) { record.own |= textureLoad(cell_masks, w.cell, 0).xy; }
            let majorant = textureLoad(majorants, w.cell, 0).r;
            if majorant > 0.0 {
                var t = t_in;
                var over = false;
                loop {
                    let words = next_words();
                    t += exponential(unit(words.x)) / majorant;
                    over = t >= t_out;
                    if over { break; }
                    tentative++;
                    let point = params.origin + direction * t;
                    let entry = entry_at(point);
                    let extinction = optics_of(entry).extinction;
                    let material = shading[entry];
                    @if(emission) { event.seen += material.emission / majorant; }
                    collided = unit(words.y) * majorant < extinction;
                    @if(history) {
                        let gives = collided || any(material.emission > vec3<f32>(0.0));
                        if gives { record.events |= bin_bit(bin_of(entry)); }
                    }
                    @if(grid) {
                        @if(gather) {
                            // One of the tentative collisions, by the chance that it had to be real.
                            let share = extinction / majorant;
                            shares += share;
                            if unit(words.z) * shares < share {
                                picked = point;
                                picked_entry = entry;
                            }
                        }
                    }
                    over = collided;
                    if over {
                        event.place = point;
                        event.entry = entry;
                        break;
                    }
                }
                expect(over);
            }
            t_in = max(t_out, t_in);
            arrived = collided || t_out >= within.y
                || !walk_step(&w, l, scene.cell_mm, scene.cells);
            if arrived { break; }
        }
        expect(arrived);
    }
    // The cache is asked here, where threads side by side do so at once: to ask it at every tentative
    // collision took as long as all else. Half of what is seen comes from the event, half from the one
    // tentative collision, which counts for all of them.
    @if(grid) {
        if collided {
            let place = draw(scene.seed, pixel, params.pass_number, FOR_CACHE_CELL);
            let seen = look(event.place, place);
            event.cached = seen.light * shading[event.entry].albedo;
            event.adds = seen.adds | select(0u, 0x80000000u, seen.is_known);
            event.chance = seen.chance;
            @if(!gather) { event.seen += event.cached; }
            @if(gather) { event.seen += 0.5 * event.cached; }
        }
        @if(gather) {
            if shares > 0.0 {
                let seen = look(picked, vec4(stream.xyz ^ stream.zwx, FOR_CACHE_CELL));
                event.seen += (0.5 * shares) * seen.light * shading[picked_entry].albedo;
                @if(history) { record.events |= bin_bit(bin_of(picked_entry)); }
            }
        }
    }
    if collided {
        events[pixel] = event;
        @if(history) {
            film[pixel].own = record.own;
            film[pixel].events = record.events;
        }
    } else {
        film[pixel] = with_sample(record, event.seen + params.background, vec3<f32>(0.0));
    }
    count(TENTATIVE, tentative);
    count(UNFINISHED, u32(cut_short));
    return collided;
}
