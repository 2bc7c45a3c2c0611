// Which segments an edit touches: those that read an entry that changed, H(10), and
// those that may look up light that changed. A work item is a segment of the band.

import package::constants::{GROUP, DIRTY_SPLIT, SPATIAL_AXES, LIST_READ, LIST_LIT};
import package::shared::counter::{CHECKED, UNFINISHED, count, expect, cut_short};
import package::shared::dirty::{dirty_grid, is_dirty, axes_meet};
import package::shared::item::item_index;
import package::shared::marks::mark;
import package::shared::scene::{frame, cell_masks, cell_index};
import package::shared::segment::{SegmentParams, span_of, HISTORY};
import package::shared::walk::{walk_begin, walk_leave, walk_step};

@group(0) @binding(8) var<uniform> params: SegmentParams;
@group(0) @binding(9) var<storage, read> segment_words: array<u32>;

// Where all is empty no light is looked up, whatever changed there.
fn is_vacant(block: vec3<i32>) -> bool {
    let cell = vec3<i32>(vec3<u32>(block) / DIRTY_SPLIT);
    return all((cell_masks[cell_index(cell)] & frame.visible_bins) == vec2<u32>(0u));
}

fn sees_change(segment: u32) -> bool {
    if dirty_grid.spatial > SPATIAL_AXES { return false; }
    let span = span_of(params, segment);
    let ray = span.ray;
    let length = span.leave - span.enter;
    if !(length > 0.0) { return false; }
    // Samples may lie a little outside their segment, by rounding or by their lattice.
    let slack = frame.step;
    let begin = max(span.enter, span.enter + length * (f32(span.index) / f32(params.segments)) - slack);
    let end = min(span.leave, span.enter + length * (f32(span.index + 1u) / f32(params.segments)) + slack);
    if dirty_grid.spatial == SPATIAL_AXES {
        let a = ray.origin + ray.direction * begin;
        let b = ray.origin + ray.direction * end;
        return axes_meet(min(a, b), max(a, b), frame.extent);
    }
    var w = walk_begin(ray, begin, dirty_grid.edge, dirty_grid.blocks);
    var checked = 0u;
    var found = false;
    var arrived = false;
    loop {
        checked++;
        found = is_dirty(w.cell) && !is_vacant(w.cell);
        arrived = found || walk_leave(w) >= end || !walk_step(&w, ray, dirty_grid.edge, dirty_grid.blocks);
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
    let segment = item_index(group, groups, local);
    if segment >= params.items { return; }
    let at = params.stride * segment + HISTORY;
    let history = vec2<u32>(segment_words[at], segment_words[at + 1u]);
    let read = any((history & params.query) != vec2<u32>(0u));
    var touched = read && (params.which & LIST_READ) != 0u;
    if !read && (params.which & LIST_LIT) != 0u { touched = sees_change(segment); }
    if touched { mark(segment); }
    count(UNFINISHED, u32(cut_short));
}
