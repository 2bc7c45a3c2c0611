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
    CLAMPED, GATHERED, SAMPLES, UNFINISHED_SEGMENTS, count, expect, cut_short
};
import package::shared::item::item_index;
import package::shared::scene::{
    scene, shading, columns, vacancy, entry_at, entry_of, stand_at, bin_of, bin_bit, bins_between
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

// What an interval is made of: means.
struct Matter {
    scattering: vec3<f32>,  // extinction * albedo, 1/mm
    extinction: f32,        // 1/mm
    emission: vec3<f32>,    // radiance per mm
}

// One interval about a place on the ray: its in-scattered light and emission, then its loss.
fn interval(ray: Line, t: f32, length: f32, matter: Matter, march: ptr<function, March>) {
    let depth = matter.extinction * length;
    // 1 - exp(-depth), where that would lose thin matter's digits by its series.
    let series = depth * (1.0 - depth * (0.5 - depth / 6.0));
    let stopped = select(1.0 - exp(-depth), series, depth < 0.02);
    let lost = (*march).transmittance * stopped;
    var along = (*march).transmittance * length;
    if depth > 0.0 { along *= stopped / depth; }
    @if(emission) { (*march).glow += along * matter.emission; }
    // Where nothing scatters no light is gathered: sigma_s = 0 in H(1).
    if depth > 0.0 {
        let seen = ray.origin + ray.direction * (t + lean(depth, 1.0 - stopped) * length);
        @if(fluence) let light = gather(seen, along * matter.scattering, (*march).light);
        @if(!fluence && even) let light = gather(params, seen, lost * params.scale, -ray.direction, (*march).light);
        @if(!fluence && !even) let light = gather(params, seen, along * params.scale, -ray.direction, (*march).light);
        (*march).light = light;
    }
    (*march).transmittance -= lost;
    if (*march).transmittance < OPAQUE { (*march).transmittance = 0.0; }
}

@if(nearest)
fn matter_at(point: vec3<f32>, march: ptr<function, March>) -> Matter {
    let entry = entry_at(point);
    (*march).samples++;
    @if(history) { (*march).history |= bin_bit(bin_of(entry)); }
    let here = shading[entry];
    return Matter(here.extinction * here.albedo, here.extinction, here.emission);
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
                    let middle = t + i * h;
                    let point = span.ray.origin + span.ray.direction * middle;
                    interval(span.ray, middle, h, matter_at(point, march), march);
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

// A value's column of the table, or its sums over the entries below.
struct Column {
    value: vec4<f32>,
    low: vec4<u32>,
    high: vec4<u32>,
}

// A place of the lattice.
struct Sample {
    stand: f32,          // of its value in the table
    entry: u32,
    is_read: bool,       // the following are known
    scattering: Column,  // extinction * albedo, extinction
    glow: Column,        // emission, nothing
}

// Beyond the table by more than this is as good as this: numbers of outliers may be huge.
const FARTHEST: f32 = 1e6;

@if(!nearest)
fn column(entry: u32, row: u32) -> Column {
    let value = textureLoad(columns, vec2(entry, row), 0);
    let low = textureLoad(columns, vec2(entry, row + 1u), 0);
    let high = textureLoad(columns, vec2(entry, row + 2u), 0);
    return Column(bitcast<vec4<f32>>(value), low, high);
}

@if(!nearest)
fn sample_at(ray: Line, t: f32) -> Sample {
    var here: Sample;
    here.stand = clamp(stand_at(ray.origin + ray.direction * t), -FARTHEST, FARTHEST);
    here.entry = entry_of(here.stand);
    return here;
}

@if(!nearest)
fn look_up(sample: ptr<function, Sample>) {
    if (*sample).is_read { return; }
    (*sample).is_read = true;
    (*sample).scattering = column((*sample).entry, 0u);
    @if(emission) { (*sample).glow = column((*sample).entry, 3u); }
}

// The mean of a column between two values that are of different entries: what of the lower entry is
// above the lower value, the entries between, what of the upper entry is below the upper value.
fn mean(lower: Column, upper: Column, unit: f32, above: f32, below: f32) -> vec4<f32> {
    let borrow = select(vec4<u32>(0u), vec4<u32>(1u), upper.low < lower.low);
    let high = vec4<f32>(upper.high - lower.high - borrow) * 4294967296.0;
    // From the lower entry on, to below the upper.
    let sum = (high + vec4<f32>(upper.low - lower.low)) * unit;
    let between = max(sum - lower.value, vec4<f32>(0.0));
    return above * lower.value + between + below * upper.value;
}

// What lies between two samples, the value being linear there: pre-integration (Engel et al. 2001)
// from sums over table entries, with one value a sample carried on to the next.
@if(!nearest)
fn matter_between(a: Sample, b: Sample) -> Matter {
    if a.entry == b.entry {
        return Matter(a.scattering.value.rgb, a.scattering.value.a, a.glow.value.rgb);
    }
    let rises = b.entry > a.entry;
    let from_to = select(vec2(b.stand, a.stand), vec2(a.stand, b.stand), rises);
    let above = f32(min(a.entry, b.entry) + 1u) - from_to.x;
    let below = from_to.y - f32(max(a.entry, b.entry));
    let per_stand = 1.0 / (from_to.y - from_to.x);
    let scattered = mean(
        lower(a.scattering, b.scattering, rises), lower(b.scattering, a.scattering, rises),
        scene.unit, above, below
    ) * per_stand;
    var matter: Matter;
    matter.extinction = scattered.a;
    matter.scattering = min(scattered.rgb, vec3<f32>(scattered.a));
    @if(emission) {
        let glow = mean(lower(a.glow, b.glow, rises), lower(b.glow, a.glow, rises), scene.glow_unit, above, below);
        matter.emission = glow.rgb * per_stand;
    }
    return matter;
}

// One interval between two samples. That nothing is seen between them is told by their bins alone.
@if(!nearest)
fn step_over(
    ray: Line, t: f32, length: f32,
    a: ptr<function, Sample>, b: ptr<function, Sample>, march: ptr<function, March>,
) {
    (*march).samples++;
    let low = bin_of(min((*a).entry, (*b).entry));
    let high = bin_of(max((*a).entry, (*b).entry));
    let bins = bins_between(low, high);
    @if(history) { (*march).history |= bins; }
    if all((bins & scene.visible_bins) == vec2<u32>(0u)) { return; }
    look_up(a);
    look_up(b);
    interval(ray, t, length, matter_between(*a, *b), march);
}

fn lower(a: Column, b: Column, rises: bool) -> Column {
    return Column(select(b.value, a.value, rises), select(b.low, a.low, rises), select(b.high, a.high, rises));
}

// samples * segment / segments, where the product need not fit.
fn first_sample(samples: u32, segment: u32) -> u32 {
    let each = samples / params.segments;
    let rest = samples % params.segments;
    return each * segment + rest * segment / params.segments;
}

// Intervals lie between neighbouring samples. One is empty if both its ends are in vacant
// macro-cells: where those meet they have a value in common, so all that lies between is vacant.
@if(!nearest)
fn march_span(span: Span, march: ptr<function, March>) {
    let length = span.leave - span.enter;
    if !(length > 0.0) { return; }
    let samples = u32(ceil(length / scene.step));
    let h = length / f32(samples);
    let begin = first_sample(samples, span.index);
    let end = first_sample(samples, span.index + 1u);
    var before: Sample;
    var is_known = false;   // the sample before
    var was_vacant = false; // its macro-cell, and what that may have
    var relied_on = vec2<u32>(0u);
    var is_vacant = false;  // that of this sample
    var mask = vec2<u32>(0u);
    var known = begin;      // samples before are in the macro-cell that was looked at last
    var i = begin;
    while i <= end && begin < end && (*march).transmittance != 0.0 {
        let t = span.enter + f32(i) * h;
        @if(skip) {
            was_vacant = is_vacant;
            @if(history) { relied_on = mask; }
            if i >= known {
                let at = vec3<i32>((span.ray.origin + span.ray.direction * t) / scene.cell_mm);
                let cell = clamp(at, vec3<i32>(0), vec3<i32>(scene.cells) - 1);
                // Rounding does not matter: a cell also knows what is half a voxel beyond it.
                let next = walk_next(span.ray, cell, scene.cell_mm);
                let beyond = (min(next.x, min(next.y, next.z)) - span.enter) / h;
                known = max(i + 1u, u32(clamp(ceil(beyond), 0.0, f32(end + 1u))));
                let here = vacancy(cell);
                is_vacant = here.is_vacant;
                @if(history) { mask = here.mask; }
            }
            if is_vacant && (was_vacant || i == begin) {
                @if(history) { (*march).history |= relied_on | mask; }
                is_known = false;
                i = known;
                continue;
            }
        }
        if !is_known && i > begin { before = sample_at(span.ray, span.enter + f32(i - 1u) * h); }
        var here = sample_at(span.ray, t);
        if i > begin {
            let middle = span.enter + (f32(i) - 0.5) * h;
            step_over(span.ray, middle, h, &before, &here, march);
        }
        before = here;
        is_known = true;
        i++;
    }
    expect(i > end || begin >= end || (*march).transmittance == 0.0);
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    let place = params.first_item + item;
    if item >= params.items || place >= work[0] { return; }
    let task = work[1u + place];

    var march: March;
    march.transmittance = 1.0;
    march_span(span_of(params, task), &march);
    count(CLAMPED, march.light.clamped);
    count(GATHERED, march.light.tested);
    count(SAMPLES, march.samples);
    count(UNFINISHED_SEGMENTS, u32(cut_short));
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
