// What every stage may look at: the volume, the transfer function, the macro-cells.
//
// Kernels work in the volume's own frame: millimetres along its axes from the outer
// corner of voxel 0. The host brings lights and camera there.

import package::constants::{TABLE_ENTRIES, CELL_EDGE};

struct SceneParams {
    size: vec3<u32>,          // voxels
    seed: u32,                // hashed
    extent: vec3<f32>,        // mm
    gain: f32,                // table entries for each unit of a voxel's number
    per_voxel: vec3<f32>,     // voxels per mm
    majorant: f32,            // 1/mm, the scene's fixed rate of tentative collisions
    cells: vec3<u32>,         // macro-cells along each axis
    mark_classes: u32,        // of a photon's history (see flight.wgsl)
    cell_mm: vec3<f32>,       // edge of a macro-cell
    step: f32,                // mm between march samples under the linear filter
    visible_bins: vec2<u32>,  // bins with any extinction or emission
    shift: f32,               // table entry of the least number, and a half
    bin_scale: u32,           // see `bin_of`
    bin_after: i32,
    bin_low: i32,
    bin_high: i32,
    unit: f32,                // of sums of extinction (see `columns`)
    glow_unit: f32,           // of sums of emission
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

// What decides a collision, and what the edit in progress changes of a table entry.
struct Optics {
    extinction: f32,  // 1/mm
    changes: u32,
}

// Layers of marks in a macro-cell (see flight.wgsl).
struct CellLayers {
    first: u32,          // the first that can be real; LAYERS where none can
    opened: u32,         // a bit for each in which the edit in progress may have made something real
    skipped: vec2<u32>,  // bits of all values with the marks of those before the first
}

// What a table entry looks like.
struct Shading {
    albedo: vec3<f32>,    // scatter * colour
    phase_g: f32,         // of Henyey and Greenstein
    emission: vec3<f32>,  // radiance per mm
    extinction: f32,      // as in `Optics`, for who reads both
}

@group(0) @binding(0) var<uniform> scene: SceneParams;
@if(float_voxels) @group(0) @binding(1) var volume: texture_3d<f32>;
@if(!float_voxels) @group(0) @binding(1) var volume: texture_3d<u32>;
// All that a flight reads, side by side: `Optics` of each table entry, then `CellLayers`, two words
// after two.
@group(0) @binding(2) var<storage, read> tracking: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> shading: array<Shading>;
// Of each table entry, a texel in each row: extinction * albedo and extinction; their sums over the
// entries below, 64-bit integers in `unit`, low words and high words; and the same three of emission, in
// `glow_unit`. Differences of integers know nothing of what lies below both.
@group(0) @binding(4) var columns: texture_2d<u32>;
// bins that a macro-cell can produce under the volume filter
@group(0) @binding(5) var cell_masks: texture_3d<u32>;

fn optics_of(entry: u32) -> Optics {
    let words = tracking[entry];
    return Optics(bitcast<f32>(words.x), words.y);
}

fn layers_of(cell: u32) -> CellLayers {
    let at = TABLE_ENTRIES + 2u * cell;
    return CellLayers(tracking[at].x, tracking[at].y, tracking[at + 1u]);
}

// Whether a macro-cell holds nothing that could be seen, and the bins that this relies on.
struct Vacancy {
    is_vacant: bool,
    mask: vec2<u32>,
}

fn vacancy(cell: vec3<i32>) -> Vacancy {
    let mask = textureLoad(cell_masks, cell, 0).xy;
    return Vacancy(all((mask & scene.visible_bins) == vec2<u32>(0u)), mask);
}

fn voxel(at: vec3<i32>) -> f32 {
    let inside = clamp(at, vec3<i32>(0), vec3<i32>(scene.size) - 1);
    return f32(textureLoad(volume, inside, 0).r);
}

// Four voxels in a square of one slice: the one at (x, y), and those at x + 1, at y + 1 and at
// both. A texel has all of them, where there is memory for that.
@if(squares)
fn square(at: vec3<i32>) -> vec4<f32> {
    return vec4<f32>(textureLoad(volume, at, 0));
}

@if(!squares)
fn square(at: vec3<i32>) -> vec4<f32> {
    let beyond = at + 1;
    return vec4(
        voxel(at), voxel(vec3(beyond.x, at.yz)), voxel(vec3(at.x, beyond.y, at.z)),
        voxel(vec3(beyond.xy, at.z))
    );
}

// Where a voxel's number, or one between, stands in the table: the map is affine.
fn stand_of(number: f32) -> f32 {
    return number * scene.gain + scene.shift;
}

// The entry there; what lies outside of the table goes to the first or last.
fn entry_of(stand: f32) -> u32 {
    return min(u32(max(stand, 0.0)), TABLE_ENTRIES - 1u);
}

@if(nearest)
fn entry_at(point: vec3<f32>) -> u32 {
    return entry_of(stand_of(voxel(vec3<i32>(floor(point * scene.per_voxel)))));
}

@if(!nearest)
fn entry_at(point: vec3<f32>) -> u32 {
    return entry_of(stand_at(point));
}

@if(!nearest)
fn stand_at(point: vec3<f32>) -> f32 {
    let last = vec3<f32>(scene.size - 1u);
    let at = clamp(point * scene.per_voxel - 0.5, vec3<f32>(0.0), last);
    let base = floor(at);
    let f = at - base;
    let near = square(vec3<i32>(base));
    let far = square(vec3<i32>(vec3(base.xy, min(base.z + 1.0, last.z))));
    let here = mix(near.xz, near.yw, f.x);
    let beyond = mix(far.xz, far.yw, f.x);
    return stand_of(mix(mix(here.x, here.y, f.y), mix(beyond.x, beyond.y, f.y), f.z));
}

// The bin of a table entry: equal bins over the entries in use (`Bins` in src/history/bins.rs).
fn bin_of(entry: u32) -> u32 {
    let bin = i32((entry * scene.bin_scale) >> 16u) + scene.bin_after;
    return u32(clamp(bin, scene.bin_low, scene.bin_high));
}

// The historygram of one bin, H(11) with the top bin mended.
fn bin_bit(bin: u32) -> vec2<u32> {
    return select(vec2<u32>(0u, 1u << (bin & 31u)), vec2<u32>(1u << bin, 0u), bin < 32u);
}

// The historygram of the bins from one to another, both among them.
fn bins_between(low: u32, high: u32) -> vec2<u32> {
    let above = vec2(0xffffffffu << min(low, 31u), 0xffffffffu << (max(low, 32u) - 32u));
    let below = vec2(0xffffffffu >> (31u - min(high, 31u)), 0xffffffffu >> (63u - max(high, 32u)));
    let is_apart = vec2(low >= 32u, high < 32u);
    return select(above & below, vec2<u32>(0u), is_apart);
}

fn cell_index(cell: vec3<i32>) -> u32 {
    let c = vec3<u32>(cell);
    return (c.z * scene.cells.y + c.y) * scene.cells.x + c.x;
}
