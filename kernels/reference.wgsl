// The reference: an unbiased Monte-Carlo path tracer, delta tracking with local
// majorants and next-event estimation for every light. It shares no estimator with the
// photon map. Stopped at one event it is plain Monte-Carlo ray casting (`mcvr`).
//
// Each pixel keeps the mean of its samples and the sum of squared deviations (Welford),
// hence a standard error.

import package::constants::{
    GROUP, LIGHT_POINT, LIGHT_DIRECTIONAL, LIGHT_RECTANGLE
};
import package::shared::counter::{UNFINISHED, count, expect, cut_short};
import package::shared::item::item_index;
import package::shared::light::lights;
import package::shared::phase::{phase, sample_phase};
import package::shared::random::{pcg4d, draw, unit, unit4, exponential, FOR_PATH};
import package::shared::scene::{scene, optics_of, shading, entry_at, cell_index};
import package::shared::segment::SegmentParams;
import package::shared::walk::{line, inside, walk_begin, walk_leave, walk_step};

struct ReferenceParams {
    background: vec3<f32>,
    first_sample: u32,
    samples: u32,          // this dispatch adds to each pixel
    max_events: u32,
    roulette_from: u32,
    pad: u32,
}

@group(0) @binding(8) var<uniform> params: SegmentParams;
@group(0) @binding(9) var<uniform> path: ReferenceParams;
// greatest extinction in each macro-cell, or what emission there needs to be found
@group(0) @binding(10) var<storage, read> majorants: array<f32>;
@group(0) @binding(11) var<storage, read_write> means: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> deviations: array<vec4<f32>>;

// Carried state is fine here: nothing in the reference is ever resumed.
var<private> stream: vec4<u32>;

fn next_words() -> vec4<u32> {
    stream.w++;
    return pcg4d(stream);
}

struct Tracked {
    t: f32,
    entry: u32,
    collided: bool,
    glow: vec3<f32>,
}

// Delta tracking to the first real collision before `end`.
fn track(origin: vec3<f32>, direction: vec3<f32>, end: f32) -> Tracked {
    let l = line(origin, direction);
    let reach = inside(l, scene.extent);
    let stop = min(reach.y, end);
    var result = Tracked(0.0, 0u, false, vec3<f32>(0.0));
    if reach.y <= reach.x { return result; }
    var w = walk_begin(l, reach.x, scene.cell_mm, scene.cells);
    var t_in = reach.x;
    var arrived = false;
    loop {
        let t_out = min(walk_leave(w), stop);
        let majorant = majorants[cell_index(w.cell)];
        if majorant > 0.0 {
            var t = t_in;
            var over = false;
            loop {
                let words = next_words();
                t += exponential(unit(words.x)) / majorant;
                over = t >= t_out;
                if over { break; }
                let entry = entry_at(origin + direction * t);
                @if(emission) { result.glow += shading[entry].emission / majorant; }
                if unit(words.y) * majorant < optics_of(entry).extinction {
                    result.t = t;
                    result.entry = entry;
                    result.collided = true;
                    return result;
                }
            }
            expect(over);
        }
        t_in = max(t_out, t_in);
        arrived = t_out >= stop || !walk_step(&w, l, scene.cell_mm, scene.cells);
        if arrived { break; }
    }
    expect(arrived);
    return result;
}

// Ratio tracking: an unbiased estimate of the transmittance to distance `end`.
fn transmittance(origin: vec3<f32>, direction: vec3<f32>, end: f32) -> f32 {
    let l = line(origin, direction);
    let reach = inside(l, scene.extent);
    let stop = min(reach.y, end);
    if reach.y <= reach.x { return 1.0; }
    var w = walk_begin(l, reach.x, scene.cell_mm, scene.cells);
    var t_in = reach.x;
    var arrived = false;
    var passed = 1.0;
    loop {
        let t_out = min(walk_leave(w), stop);
        let majorant = majorants[cell_index(w.cell)];
        if majorant > 0.0 {
            var t = t_in;
            var over = false;
            loop {
                let words = next_words();
                t += exponential(unit(words.x)) / majorant;
                over = t >= t_out;
                if over { break; }
                let extinction = optics_of(entry_at(origin + direction * t)).extinction;
                passed *= 1.0 - extinction / majorant;
                // A roulette keeps the estimate unbiased and ends hopeless walks.
                if passed < 0.1 {
                    if unit(words.y) * 0.5 >= passed { return 0.0; }
                    passed = 0.5;
                }
            }
            expect(over);
        }
        t_in = max(t_out, t_in);
        arrived = t_out >= stop || !walk_step(&w, l, scene.cell_mm, scene.cells);
        if arrived { break; }
    }
    expect(arrived);
    return passed;
}

// Radiance that one light sends through a point toward the viewer, over the albedo.
fn direct(which: u32, point: vec3<f32>, travel: vec3<f32>, g: f32) -> vec3<f32> {
    let light = lights.all[which];
    let u = unit4(next_words());
    var toward: vec3<f32>;
    var away = 1e30;
    var arriving = light.radiance;
    switch light.kind {
        case LIGHT_POINT: {
            let to = light.position - point;
            away = length(to);
            toward = to / away;
            arriving /= away * away;
        }
        case LIGHT_DIRECTIONAL: { toward = -light.direction; }
        case LIGHT_RECTANGLE: {
            let to = light.position + u.x * light.edge_u + u.y * light.edge_v - point;
            away = length(to);
            toward = to / away;
            arriving *= max(-dot(toward, light.direction), 0.0) * light.area / (away * away);
        }
        default: {
            // Sampling the phase function itself leaves no weight.
            toward = sample_phase(g, travel, u.xy);
            return arriving * transmittance(point, toward, away);
        }
    }
    if all(arriving <= vec3<f32>(0.0)) { return vec3<f32>(0.0); }
    return arriving * phase(g, dot(travel, toward)) * transmittance(point, toward, away);
}

fn radiance(origin: vec3<f32>, toward: vec3<f32>) -> vec3<f32> {
    var point = origin;
    var travel = toward;
    var weight = vec3<f32>(1.0);
    var total = vec3<f32>(0.0);
    var over = false;
    for (var event = 0u; !over; event++) {
        let found = track(point, travel, 1e30);
        if event == 0u {
            total += found.glow;
            if !found.collided { total += path.background; }
        }
        over = !found.collided;
        if over { break; }
        point += travel * found.t;
        let material = shading[found.entry];
        @if(anisotropic) let g = material.phase_g;
        @if(!anisotropic) let g = 0.0;
        weight *= material.albedo;
        if event >= path.roulette_from {
            let survival = clamp(max(weight.r, max(weight.g, weight.b)), 0.05, 1.0);
            over = unit(next_words().x) >= survival;
            if over { break; }
            weight /= survival;
        }
        over = all(weight <= vec3<f32>(0.0));
        if over { break; }
        for (var i = 0u; i < lights.count; i++) {
            total += weight * direct(i, point, travel, g);
        }
        travel = sample_phase(g, travel, unit4(next_words()).xy);
        over = event + 1u >= path.max_events;
    }
    expect(over);
    return total;
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    if item >= params.items { return; }
    let pixel = params.first_item + item;
    let at = vec2<u32>(pixel % params.width, pixel / params.width);
    var mean = means[pixel].rgb;
    var deviation = deviations[pixel].rgb;
    var s = 0u;
    for (; s < path.samples; s++) {
        let sample = path.first_sample + s;
        let key = draw(scene.seed, pixel, sample, FOR_PATH);
        stream = vec4<u32>(key.xyz, 0u);
        let u = unit4(key.wzyx).xy;
        let place = (vec2<f32>(at) + u) / vec2<f32>(f32(params.width), f32(params.height));
        let aim = params.corner + place.x * params.right + place.y * params.down;
        let x = radiance(params.origin, normalize(aim));
        let off = x - mean;
        mean += off / f32(sample + 1u);
        deviation += off * (x - mean);
    }
    expect(s == path.samples);
    count(UNFINISHED, u32(cut_short));
    means[pixel] = vec4<f32>(mean, f32(path.first_sample + path.samples));
    deviations[pixel] = vec4<f32>(deviation, 0.0);
}
