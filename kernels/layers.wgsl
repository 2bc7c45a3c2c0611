// The layers of marks that matter in each macro-cell, for the transfer function as it is (see
// flight.wgsl).

import package::constants::{GROUP, LAYERS, TABLE_ENTRIES};
import package::shared::item::item_index;
import package::shared::scene::scene;

// What a macro-cell can have, whatever the materials.
struct CellRange {
    low: u32,            // least table entry
    high: u32,           // greatest
    values: vec2<u32>,   // history bits of all of them, with marks of the first layer
}

@group(0) @binding(8) var<storage, read> cell_ranges: array<CellRange>;
// What 2^k neighbouring table entries have, from each on, for all k: `first` of their layers, and
// above 8 bits what is `opened`.
@group(0) @binding(9) var<storage, read> spans: array<u32>;
// As `tracking` of scene.wgsl.
@group(0) @binding(10) var<storage, read_write> tracked: array<vec2<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let cell = item_index(group, groups, local);
    if cell >= arrayLength(&cell_ranges) { return; }
    let range = cell_ranges[cell];
    // Two spans cover the range; an entry in both does not matter.
    let k = firstLeadingBit(range.high - range.low + 1u);
    let a = spans[k * TABLE_ENTRIES + range.low];
    let b = spans[k * TABLE_ENTRIES + range.high + 1u - (1u << k)];
    let first = min(a & 255u, b & 255u);
    var skipped = vec2<u32>(0u);
    for (var layer = 0u; layer < first; layer++) {
        let mark_class = layer * scene.mark_classes / LAYERS;
        // The bits of a bin's classes lie in one word.
        skipped |= range.values << vec2(mark_class);
    }
    let at = TABLE_ENTRIES + 2u * cell;
    tracked[at] = vec2(first, (a | b) >> 8u);
    tracked[at + 1u] = skipped;
}
