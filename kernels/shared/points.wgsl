// The points light field: photons in buckets of 2^shift consecutive cells of a grid whose
// edge is the gather radius, H(8). The key is the cell's index, x fastest, so the three
// cells of a row are one run of points. `starts` says where each bucket begins; a bucket
// may hold more than the cells asked for, even of the next row, and the distance test tells.
// Where each cell is a bucket, it also says which rows around a cell have any.

struct PointsParams {
    grid: vec3<u32>,       // cells
    count: u32,            // slots to look at, or points
    radius: f32,           // mm
    shift: u32,
    buckets: u32,
    per_ball: f32,         // 1 / (4/3 pi r^3)
    sign: f32,             // -1: light that segments have seen is taken out; 1: light is added
    lights_each: u32,      // lights that a point counts for
    all: u32,              // 1: of all slots or points, not of those that moved, stay or are listed
    fresh: u32,            // 1: nobody has seen these points
    changed: vec2<u32>,    // bins whose extinction changed since
    first: u32,            // of the points that are looked at
    first_slot: u32,       // of the table's slots that are a batch's
    slots: u32,            // how many those are
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

// What an update needs to know of a point.
struct Origin {
    slot: u32,  // among those of all members of its table
    mean: f32,  // extinction around it, 1/mm, where `even` divides by it
}

// Rows of cells around a cell.
const ROWS: u32 = 9u;

// The place of a point that goes.
const NOWHERE: u32 = 0xffffffffu;

fn points_cell(position: vec3<f32>, params: PointsParams) -> vec3<i32> {
    let cell = vec3<i32>(floor(position / params.radius));
    return clamp(cell, vec3<i32>(0), vec3<i32>(params.grid) - 1);
}

fn points_key(cell: vec3<i32>, params: PointsParams) -> u32 {
    let c = vec3<u32>(cell);
    return (c.z * params.grid.y + c.y) * params.grid.x + c.x;
}

// A row of the nine: y and z.
fn row_beside(cell: vec3<i32>, n: u32) -> vec2<i32> {
    return cell.yz + vec2<i32>(vec2<u32>(n % 3u, n / 3u)) - 1;
}

// Where `starts` says which rows around a cell have points: a bit each.
fn rows_at(cell: vec3<i32>, params: PointsParams) -> u32 {
    return params.buckets + 1u + points_key(cell, params);
}
