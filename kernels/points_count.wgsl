// How many points each bucket has, of `all`; of those listed, how many lights, which they `had` and
// have (`points_take`). Noted one bucket further: summed up, that is where the bucket begins, and
// when all have come (`points_take`, `points_merge`), where it ends. Behind that, of those listed,
// is told which rows have any (`points`).

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::points::{ROWS, PointsParams, row_beside, rows_at};

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> work: array<u32>;
@group(0) @binding(10) var<storage, read> keys: array<u32>;
@group(0) @binding(11) var<storage, read_write> starts: array<atomic<u32>>;

// Tells the cells around a cell in which of their rows it is.
fn tell_rows(key: u32) {
    let grid = params.grid;
    let cell = vec3<i32>(vec3(key % grid.x, key / grid.x % grid.y, key / grid.x / grid.y));
    for (var n = 0u; n < ROWS; n++) {
        let row = row_beside(cell, n);
        if any(row < vec2<i32>(0)) || any(row >= vec2<i32>(grid.yz)) { continue; }
        // Seen from there, the row of this cell is on the other side.
        let bit = 1u << (ROWS - 1u - n);
        for (var x = max(cell.x - 1, 0); x <= min(cell.x + 1, i32(grid.x) - 1); x++) {
            atomicOr(&starts[rows_at(vec3(x, row), params)], bit);
        }
    }
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    let point = select(work[i], i, params.all == 1u);
    let key = keys[point];
    let lights = select(params.had + params.has, 1u, params.all == 1u);
    let before = atomicAdd(&starts[(key >> params.shift) + 1u], lights);
    // All points of a cell would tell the same.
    if params.all == 0u && params.shift == 0u && before == 0u { tell_rows(key); }
}
