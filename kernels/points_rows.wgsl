// Tells the cells around those that have points in which of their rows they are, where each cell is
// a bucket: a bit for each row, behind where buckets begin. A thread for each cell, with those
// beside it in its row.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::points::{ROWS, PointsParams, row_beside, rows_at};

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read_write> starts: array<atomic<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let key = item_index(group, groups, local);
    if key >= params.buckets { return; }
    let grid = params.grid;
    let cell = vec3<i32>(vec3(key % grid.x, key / grid.x % grid.y, key / grid.x / grid.y));
    let first = key - u32(cell.x > 0);
    let beyond = key + 1u + u32(cell.x + 1 < i32(grid.x));
    let has_any = atomicLoad(&starts[first]) != atomicLoad(&starts[beyond]);
    var told = select(ROWS, 0u, has_any);
    while told < ROWS {
        let row = row_beside(cell, told);
        if all(row >= vec2<i32>(0)) && all(row < vec2<i32>(grid.yz)) {
            // Seen from there, this row is on the other side.
            atomicOr(&starts[rows_at(vec3(cell.x, row), params)], 1u << (ROWS - 1u - told));
        }
        told++;
    }
}
