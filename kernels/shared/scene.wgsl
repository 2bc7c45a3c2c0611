// What every stage may look at: the volume, the transfer function, the macro-cells.
//
// Kernels work in the volume's own frame: millimetres along its axes from the outer
// corner of voxel 0. The host brings lights and camera there.

import package::constants::{TABLE_ENTRIES, CELL_EDGE};

struct Frame {
    size: vec3<u32>,          // voxels
    seed: u32,                // hashed
    extent: vec3<f32>,        // mm
    gain: f32,                // a voxel's number times this is in [0, 1]
    per_voxel: vec3<f32>,     // voxels per mm
    majorant: f32,            // 1/mm, the scene's fixed rate of tentative collisions
    cells: vec3<u32>,         // macro-cells along each axis
    mark_classes: u32,        // of a photon's history (see flight.wgsl)
    cell_mm: vec3<f32>,       // edge of a macro-cell
    step: f32,                // mm between march samples under the linear filter
    visible_bins: vec2<u32>,  // bins with any extinction or emission
    pad: vec2<u32>,
}

// What decides a collision, the historygram bin of a table entry, and what the edit in
// progress changes of it.
struct Optics {
    extinction: f32,  // 1/mm
    bin: u32,         // see `bin_of`
    changes: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@if(float_voxels) @group(0) @binding(1) var volume: texture_3d<f32>;
@if(!float_voxels) @group(0) @binding(1) var volume: texture_3d<u32>;
@group(0) @binding(2) var<storage, read> optics: array<Optics>;
// scatter * colour, and g of Henyey and Greenstein, of each entry
@group(0) @binding(3) var<uniform> scattering: array<vec4<f32>, TABLE_ENTRIES>;
// emitted radiance per mm of each entry
@group(0) @binding(4) var<uniform> emission: array<vec4<f32>, TABLE_ENTRIES>;
// bins that a macro-cell can produce under the volume filter
@group(0) @binding(5) var<storage, read> cell_masks: array<vec2<u32>>;

fn voxel(at: vec3<i32>) -> f32 {
    let inside = clamp(at, vec3<i32>(0), vec3<i32>(frame.size) - 1);
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

// Table entry of the value at a point: min(floor(v * 4096), 4095).
fn entry_of(number: f32) -> u32 {
    let v = number * frame.gain;
    return min(u32(max(v, 0.0) * f32(TABLE_ENTRIES)), TABLE_ENTRIES - 1u);
}

@if(nearest)
fn entry_at(point: vec3<f32>) -> u32 {
    return entry_of(voxel(vec3<i32>(floor(point * frame.per_voxel))));
}

@if(!nearest)
fn entry_at(point: vec3<f32>) -> u32 {
    let last = vec3<f32>(frame.size - 1u);
    let at = clamp(point * frame.per_voxel - 0.5, vec3<f32>(0.0), last);
    let base = floor(at);
    let f = at - base;
    let near = square(vec3<i32>(base));
    let far = square(vec3<i32>(vec3(base.xy, min(base.z + 1.0, last.z))));
    let here = mix(near.xz, near.yw, f.x);
    let beyond = mix(far.xz, far.yw, f.x);
    return entry_of(mix(mix(here.x, here.y, f.y), mix(beyond.x, beyond.y, f.y), f.z));
}

// The bin of a table entry: equal bins are not looked up, which is what most of the time
// that histories take would go to.
fn bin_of(entry: u32) -> u32 {
    @if(listed_bins) return optics[entry].bin;
    @if(!listed_bins) return entry / (TABLE_ENTRIES / 64u);
}

// The historygram of one bin, H(11) with the top bin mended.
fn bin_bit(bin: u32) -> vec2<u32> {
    return select(vec2<u32>(0u, 1u << (bin & 31u)), vec2<u32>(1u << bin, 0u), bin < 32u);
}

fn cell_index(cell: vec3<i32>) -> u32 {
    let c = vec3<u32>(cell);
    return (c.z * frame.cells.y + c.y) * frame.cells.x + c.x;
}

// Layers of marks in a macro-cell (see flight.wgsl).
struct CellLayers {
    first: u32,          // the first that can be real; LAYERS where none can
    opened: u32,         // a bit for each in which the edit in progress may have made something real
    skipped: vec2<u32>,  // bits of all values with the marks of those before the first
}

@group(0) @binding(15) var<storage, read> cell_layers: array<CellLayers>;
