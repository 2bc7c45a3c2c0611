// View-ray segments: colour, transmittance and history of each, H(2) and H(3), from
// the light field. A work item is a segment of the band.
//
// Under nearest filtering the ray is walked voxel by voxel, and each is integrated in
// closed form; under linear filtering it is sampled on a lattice anchored to the
// volume's bounds. The fluence gives a segment its colour at once; points are added to
// its integer sums, batch after batch.

@if(nearest && skip) import package::constants::CELL_EDGE;
import package::constants::GROUP;
import package::shared::counter::{
    CLAMPED, GATHERED, SAMPLES, UNFINISHED, count, expect, cut_short
};
import package::shared::item::item_index;
import package::shared::scene::{
    scene, shading, vacancy, entry_at, bin_of, bin_bit
};
import package::shared::segment::{SegmentParams, Span, span_of};
@if(!fluence) import package::shared::segment_sums::{Sums, unpack_sums, pack_high};
@if(!fluence) import package::shared::sum64::{total, rounded_wide};
@if(fluence) import package::shared::source_fluence::{Gathered, gather};
@if(!fluence) import package::shared::source_points::{Gathered, gather};
import package::shared::walk::{Line, walk_begin, walk_leave, walk_next, walk_step};

@group(0) @binding(8) var<uniform> params: SegmentParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@if(fluence) @group(0) @binding(10) var<storage, read_write> segments: array<vec2<u32>>;
@if(!fluence) @group(0) @binding(10) var<storage, read_write> segments: array<vec4<u32>>;

// A segment that lets less through counts as opaque, and is not looked into any further:
// what lies behind cannot change it.
const OPAQUE: f32 = 2.3283064e-10;  // 2^-32

struct March {
    light: Gathered,
    glow: vec3<f32>,         // emission seen
    transmittance: f32,
    history: vec2<u32>,
    samples: u32,
}

// How far before the middle of an interval, in lengths, the mean of what is seen of it
// lies: light is looked up there, which is exact where it varies linearly. `passed` is exp(-depth).
fn lean(depth: f32, passed: f32) -> f32 {
    if depth < 0.1 { return -depth / 12.0; }
    return 1.0 / depth - passed / (1.0 - passed) - 0.5;
}

// One interval of constant value: its in-scattered light and emission, then its loss.
fn interval(ray: Line, t: f32, length: f32, march: ptr<function, March>) {
    let point = ray.origin + ray.direction * t;
    let entry = entry_at(point);
    let extinction = shading[entry].extinction;
    @if(history) { (*march).history |= bin_bit(bin_of(entry)); }
    (*march).samples++;
    let depth = extinction * length;
    let passed = exp(-depth);
    let lost = (*march).transmittance * (1.0 - passed);
    var along = (*march).transmittance * length;
    if extinction > 0.0 { along = lost / extinction; }
    @if(emission) { (*march).glow += along * shading[entry].emission; }
    @if(fluence || even) let weight = lost;
    @if(!fluence && !even) let weight = along;
    // Where nothing scatters no light is gathered: sigma_s = 0 in H(1).
    if extinction > 0.0 {
        let seen = ray.origin + ray.direction * (t + lean(depth, passed) * length);
        let scaled = weight * params.scale;
        (*march).light = gather(params, seen, entry, scaled, -ray.direction, (*march).light);
    }
    (*march).transmittance *= passed;
    if (*march).transmittance < OPAQUE { (*march).transmittance = 0.0; }
}

@if(nearest)
fn march_span(span: Span, march: ptr<function, March>) {
    let length = span.leave - span.enter;
    let begin = span.enter + length * (f32(span.index) / f32(params.segments));
    let end = span.enter + length * (f32(span.index + 1u) / f32(params.segments));
    if !(end > begin) { return; }
    let edge = 1.0 / scene.per_voxel;
    var t = begin;
    var w = walk_begin(span.ray, t, edge, scene.size);
    var arrived = false;
    loop {
        let leave = min(walk_leave(w), end);
        if leave > t {
            var vacant = false;
            @if(skip) {
                let here = vacancy(vec3<i32>(vec3<u32>(w.cell) / CELL_EDGE));
                vacant = here.is_vacant;
                @if(history) { if vacant { (*march).history |= here.mask; } }
            }
            if !vacant {
                // A voxel is constant, but the light in it is not.
                let parts = ceil((leave - t) / scene.step);
                let h = (leave - t) / parts;
                var i = 0.5;
                for (; i < parts && (*march).transmittance != 0.0; i += 1.0) {
                    interval(span.ray, t + i * h, h, march);
                }
                expect(i >= parts || (*march).transmittance == 0.0);
            }
            t = leave;
        }
        arrived = leave >= end || (*march).transmittance == 0.0
            || !walk_step(&w, span.ray, edge, scene.size);
        if arrived { break; }
    }
    expect(arrived);
}

// samples * segment / segments, where the product need not fit.
fn first_sample(samples: u32, segment: u32) -> u32 {
    let each = samples / params.segments;
    let rest = samples % params.segments;
    return each * segment + rest * segment / params.segments;
}

@if(!nearest)
fn march_span(span: Span, march: ptr<function, March>) {
    let length = span.leave - span.enter;
    if !(length > 0.0) { return; }
    let samples = u32(ceil(length / scene.step));
    let h = length / f32(samples);
    let end = first_sample(samples, span.index + 1u);
    var i = first_sample(samples, span.index);
    var known = i;    // samples before are in the macro-cell that was looked at last
    while i < end && (*march).transmittance != 0.0 {
        let t = span.enter + (f32(i) + 0.5) * h;
        @if(skip) {
            if i >= known {
                let at = vec3<i32>((span.ray.origin + span.ray.direction * t) / scene.cell_mm);
                let cell = clamp(at, vec3<i32>(0), vec3<i32>(scene.cells) - 1);
                // Rounding does not matter: a cell also knows what is half a voxel beyond it.
                let next = walk_next(span.ray, cell, scene.cell_mm);
                let beyond = (min(next.x, min(next.y, next.z)) - span.enter) / h - 0.5;
                known = max(i + 1u, u32(clamp(ceil(beyond), 0.0, f32(end))));
                let here = vacancy(cell);
                if here.is_vacant {
                    @if(history) { (*march).history |= here.mask; }
                    i = known;
                    continue;
                }
            }
        }
        interval(span.ray, t, h, march);
        i++;
    }
    expect(i >= end || (*march).transmittance == 0.0);
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    if item >= params.items { return; }
    let task = work[params.first_item + item];

    var march: March;
    march.transmittance = 1.0;
    march_span(span_of(params, task), &march);
    count(CLAMPED, march.light.clamped);
    count(GATHERED, march.light.tested);
    count(SAMPLES, march.samples);
    count(UNFINISHED, u32(cut_short));
    let passed = bitcast<u32>(march.transmittance);
    @if(fluence) {
        let colour = bitcast<vec3<u32>>(march.light.radiance + march.glow);
        segments[3u * task] = colour.xy;
        segments[3u * task + 1u] = vec2(colour.z, passed);
        segments[3u * task + 2u] = march.history;
    }
    @if(!fluence) {
        let sums = summed(task, march);
        // Where light alone is added, what was relied on stays: a macro-cell that has become
        // vacant would tell of more.
        var history = march.history;
        if params.begins == 0u { history = segments[2u * task + 1u].xy; }
        segments[2u * task] = vec4(sums.red.x, sums.green.x, sums.blue.x, passed);
        segments[2u * task + 1u] = vec4(history, pack_high(sums));
    }
}

// With the light of points that were gathered before.
@if(!fluence)
fn summed(task: u32, march: March) -> Sums {
    var sums: Sums;
    if params.begins == 0u {
        sums = unpack_sums(segments[2u * task].xyz, segments[2u * task + 1u].zw);
    } else {
        @if(emission) {
            let glow = march.glow * params.scale;
            sums = Sums(rounded_wide(glow.r), rounded_wide(glow.g), rounded_wide(glow.b));
        }
    }
    let light = march.light.sums;
    return Sums(total(sums.red, light.red), total(sums.green, light.green), total(sums.blue, light.blue));
}
