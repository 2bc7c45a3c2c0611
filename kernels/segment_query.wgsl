// Which segments an edit touches: those that read an entry that changed, H(10), and
// those that may look up light that changed. A work item is as many as 32 segments of a view ray,
// a bit each.

import package::constants::{GROUP, SPATIAL_AXES, LIST_READ, LIST_LIT, SEGMENTS_AT_ONCE};
import package::shared::counter::{CHECKED, UNFINISHED_SEGMENTS, count, expect, cut_short};
import package::shared::dirty::{dirty_grid, is_dirty, axes_meet};
import package::shared::item::item_index;
import package::shared::marks::mark;
import package::shared::scene::scene;
import package::shared::segment::{SegmentParams, Span, span_of, HISTORY};
import package::shared::walk::{walk_begin, walk_leave, walk_step};

@group(0) @binding(8) var<uniform> params: SegmentParams;
@group(0) @binding(9) var<storage, read> segments: array<vec2<u32>>;
// A bit for each pixel that has a segment which is listed.
@group(0) @binding(10) var<storage, read_write> pixels: array<atomic<u32>>;

// Bits from `low` to `high`, both among them.
fn bits(low: u32, high: u32) -> u32 {
    return (0xffffffffu >> (31u - high)) & (0xffffffffu << low);
}

// Some segments of a ray, a bit each.
struct Reading {
    asked: u32,    // read an entry of the query
    any: u32,      // read any entry
}

// What those read that are `several` from `first` on.
fn reading(first: u32, several: u32) -> Reading {
    var found: Reading;
    for (var k = 0u; k < several; k++) {
        let history = segments[(params.stride * (first + k * params.pixels) + HISTORY) / 2u];
        found.asked |= select(0u, 1u << k, any((history & params.query) != vec2<u32>(0u)));
        found.any |= select(0u, 1u << k, any(history != vec2<u32>(0u)));
    }
    return found;
}

// The segments of a ray, `several` from `task` on, that see light that changed, as far as
// they are not known to be asked for.
fn seeing_change(task: u32, several: u32, asked: u32) -> u32 {
    let span = span_of(params, task);
    let every = bits(0u, several - 1u);
    let length = span.leave - span.enter;
    if dirty_grid.spatial > SPATIAL_AXES || asked == every { return 0u; }
    // What grazes the bounds may have met them where it was gathered, by rounding.
    if !(length > 0.0) { return reading(task, several).any; }
    let ray = span.ray;
    let each = length / f32(params.segments);
    // Samples may lie a little outside their segment, by rounding or by their lattice.
    let slack = scene.step;
    let first = span.enter + f32(span.index) * each;
    var found = 0u;
    if dirty_grid.spatial == SPATIAL_AXES {
        for (var k = 0u; k < several; k++) {
            let a = ray.origin + ray.direction * max(span.enter, first + f32(k) * each - slack);
            let b = ray.origin + ray.direction * min(span.leave, first + f32(k + 1u) * each + slack);
            found |= select(0u, 1u << k, axes_meet(min(a, b), max(a, b), scene.extent));
        }
        return found;
    }
    var begin = max(span.enter, first - slack);
    let end = min(span.leave, first + f32(several) * each + slack);
    var w = walk_begin(ray, begin, dirty_grid.edge, dirty_grid.blocks);
    var checked = 0u;
    var arrived = false;
    loop {
        checked++;
        let leave = walk_leave(w);
        if is_dirty(w.cell) {
            let from_to = vec2(begin - slack - first, leave + slack - first) / each;
            let seen = vec2<u32>(clamp(floor(from_to), vec2(0.0), vec2(f32(several - 1u))));
            found |= bits(seen.x, seen.y);
        }
        begin = max(begin, leave);
        arrived = (found | asked) == every || leave >= end
            || !walk_step(&w, ray, dirty_grid.edge, dirty_grid.blocks);
        if arrived { break; }
    }
    expect(arrived);
    count(CHECKED, checked);
    return found;
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let item = item_index(group, groups, local);
    if item >= params.items { return; }
    let layer = item / params.pixels * SEGMENTS_AT_ONCE;
    let several = min(params.segments - layer, SEGMENTS_AT_ONCE);
    let pixel = item % params.pixels;
    let first = layer * params.pixels + pixel;
    var asked = 0u;
    if any(params.query != vec2<u32>(0u)) { asked = reading(first, several).asked; }
    var touched = select(0u, asked, (params.which & LIST_READ) != 0u);
    if (params.which & LIST_LIT) != 0u { touched |= seeing_change(first, several, asked) & ~asked; }
    if touched != 0u { atomicOr(&pixels[pixel / 32u], 1u << (pixel % 32u)); }
    while touched != 0u {
        let k = firstTrailingBit(touched);
        touched &= touched - 1u;
        mark(first + k * params.pixels);
    }
    count(UNFINISHED_SEGMENTS, u32(cut_short));
}
