// In-scattered light at a march sample from the points light field: every photon in
// the sphere of the gather radius, H(8), as rounded integers. Light that was seen and is to be
// taken out is less than zero, so that the same lines round it as when it was added.

import package::shared::counter::expect;
import package::shared::phase::phase;
import package::shared::points::{
    ROWS, RUN, PointsParams, points_cell, points_key, row_beside, rows_at, run_of, bit_of, first_slot, next_slot, slot_at
};
import package::shared::segment::SegmentParams;
import package::shared::segment_sums::{Sums, sums_with};
import package::shared::slot::unpack_direction;
import package::shared::sum64::rounded_signed;

@group(0) @binding(11) var<uniform> field: PointsParams;
@group(0) @binding(12) var<storage, read> point_places: array<vec4<u32>>;
@group(0) @binding(13) var<storage, read> point_lights: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read> starts: array<u32>;

// Light gathered so far, in the units of the sums.
struct Gathered {
    sums: Sums,
    clamped: u32,
    tested: u32,
}

struct Lookup {
    point: vec3<f32>,
    weight: f32,
    toward: vec3<f32>,
}

fn with_point(i: u32, q: Lookup, so_far: Gathered) -> Gathered {
    let place = point_places[i];
    let away = bitcast<vec3<f32>>(place.xyz) - q.point;
    // Most points of the cells are too far: nothing else is read of them.
    if dot(away, away) >= field.radius * field.radius { return so_far; }
    let share = share_of(point_lights[i], place.w, q);
    return Gathered(sums_with(so_far.sums, share.value), so_far.clamped + share.clamped, so_far.tested);
}

struct Share {
    value: vec3<i32>,
    clamped: u32,    // of its components
}

// What a point of this light and packed direction adds.
fn share_of(light: vec4<f32>, direction: u32, q: Lookup) -> Share {
    var share = light.rgb * q.weight;
    @if(anisotropic) { share *= phase(light.a, dot(unpack_direction(direction), q.toward)); }
    let r = rounded_signed(share.r);
    let g = rounded_signed(share.g);
    let b = rounded_signed(share.b);
    return Share(
        vec3<i32>(r.value, g.value, b.value),
        u32(r.clamped) + u32(g.clamped) + u32(b.clamped)
    );
}

// What rounding may amount to, in cells.
const SLACK: f32 = 1e-3;

// The points of buckets side by side.
fn points_between(params: SegmentParams, first: u32, last: u32) -> vec2<u32> {
    return vec2(max(starts[first], params.points_begin), min(starts[last + 1u], params.points_end));
}

// Points of cells side by side in a row, from one key to another: those of all, or of what is of the
// first cell's run, and the key that comes after.
struct Piece {
    points: vec2<u32>,
    next: u32,
}

@if(!hashed)
fn piece(params: SegmentParams, key: u32, last: u32) -> Piece {
    return Piece(points_between(params, key, last), last + 1u);
}

// Whether cells side by side in a row, of two runs at most, may have points.
@if(hashed)
fn may_have(first: u32, last: u32) -> bool {
    let a = bit_of(run_of(first), field);
    let b = bit_of(run_of(last), field);
    if (starts[a.word] & a.bit) != 0u { return true; }
    return (starts[b.word] & b.bit) != 0u;
}

@if(hashed)
fn piece(params: SegmentParams, key: u32, last: u32) -> Piece {
    let end = min(last, key | (RUN - 1u));
    let run = run_of(key);
    var slot = first_slot(run, field);
    var held = starts[slot_at(slot, field)];
    while held != run && held != 0u {
        slot = next_slot(slot, field);
        held = starts[slot_at(slot, field)];
    }
    expect(held == run || held == 0u);
    var found = Piece(vec2<u32>(0u), end + 1u);
    if held == run { found.points = points_between(params, RUN * slot + key % RUN, RUN * slot + end % RUN); }
    return found;
}

// The rows around a cell that the sphere about a place in it reaches: not all at the corners.
fn rows_reached(place: vec2<f32>) -> u32 {
    let low = max(place - SLACK, vec2<f32>(0.0));
    let high = max(1.0 - place - SLACK, vec2<f32>(0.0));
    let a = low * low;
    let b = high * high;
    let corners = vec4(a.x, b.x, a.x, b.x) + vec4(a.yy, b.yy);
    let beyond = select(vec4<u32>(0u), vec4(1u, 1u << 2u, 1u << 6u, 1u << 8u), corners >= vec4<f32>(1.0));
    return ~(beyond.x | beyond.y | beyond.z | beyond.w);
}

fn gather(
    params: SegmentParams, point: vec3<f32>, weight: f32, toward: vec3<f32>, so_far: Gathered,
) -> Gathered {
    var sum = so_far;
    let cell = points_cell(point, field);
    let at = point / field.radius;
    let widest = vec2(max(cell.x - 1, 0), min(cell.x + 1, i32(field.grid.x) - 1));
    var asked = rows_reached(at.yz - vec2<f32>(cell.yz)) & ((1u << ROWS) - 1u);
    // Only rows that have any are asked, one after the other: to list their points first was slower
    // on a software adapter.
    @if(!hashed) { asked &= starts[rows_at(cell, field)]; }
    let q = Lookup(point, weight, toward);
    while asked != 0u {
        let row = row_beside(cell, firstTrailingBit(asked));
        asked &= asked - 1u;
        if any(row < vec2<i32>(0)) || any(row >= vec2<i32>(field.grid.yz)) { continue; }
        @if(hashed) {
            let begin = points_key(vec3<i32>(widest.x, row), field);
            if !may_have(begin, begin + u32(widest.y - widest.x)) { continue; }
        }
        // Only the cells of the row that the sphere reaches, and a little more for rounding.
        let beside = vec2<f32>(row) - at.yz;
        let apart = max(max(beside, -beside - 1.0) - SLACK, vec2<f32>(0.0));
        let reach = 1.0 - dot(apart, apart);
        let half = sqrt(max(reach, 0.0)) + SLACK;
        let least = i32(floor(at.x - half));
        let most = i32(floor(at.x + half));
        let reached = clamp(vec2(least, most), widest.xx, widest.yy);
        var key = points_key(vec3<i32>(reached.x, row), field);
        let last = points_key(vec3<i32>(reached.y, row), field);
        while key <= last {
            let found = piece(params, key, last);
            key = found.next;
            var i = found.points.x;
            sum.tested += max(found.points.y, i) - i;
            for (; i < found.points.y; i++) { sum = with_point(i, q, sum); }
            expect(i >= found.points.y);
        }
        expect(key > last);
    }
    expect(asked == 0u);
    return sum;
}
