// The points light field: photons in buckets, one for each cell of a grid whose edge is the gather
// radius, H(8). `starts` says where each bucket begins, and the last ends.
//
// Where there are few cells, each is a bucket, by its key: its index, x fastest, so that the three
// cells of a row are one run of points. Behind where buckets begin `starts` then says which rows around
// a cell have any points.
//
// Where there are many (`hashed`), `starts` has a hash table there: a slot for each run of four cells
// along x that has points, and four buckets for each slot. Slots are found by probing, and hold the
// whole run, so that a look-up reads the points of its cells and no others. Behind it is a bit for each
// run of the grid that may have points, for most have none.

struct PointsParams {
    grid: vec3<u32>,       // cells
    count: u32,            // slots to look at, or points
    radius: f32,           // mm
    runs: u32,             // slots for runs of cells, a power of two
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
    salt: u32,             // of the hash
    mask_shift: u32,       // runs that share a bit, as a power of two
    pad0: u32,
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

// Cells of a run.
const RUN: u32 = 4u;

// What a slot of the hash table holds that has a cell's run; 0 where it has none.
fn run_of(key: u32) -> u32 {
    return key / RUN + 1u;
}

// Where to begin to look for a run.
fn first_slot(run: u32, params: PointsParams) -> u32 {
    var h = (run ^ params.salt) * 0x9e3779b1u;
    h = (h ^ (h >> 15u)) * 0x85ebca6bu;
    return (h ^ (h >> 13u)) & (params.runs - 1u);
}

fn next_slot(slot: u32, params: PointsParams) -> u32 {
    return (slot + 1u) & (params.runs - 1u);
}

// Where `starts` has the bit of a run that may have points, and which it is.
struct RunBit {
    word: u32,
    bit: u32,
}

fn bit_of(run: u32, params: PointsParams) -> RunBit {
    let at = run >> params.mask_shift;
    return RunBit(params.buckets + 1u + params.runs + at / 32u, 1u << (at % 32u));
}

// Where `starts` has what a slot holds.
fn slot_at(slot: u32, params: PointsParams) -> u32 {
    return params.buckets + 1u + slot;
}
