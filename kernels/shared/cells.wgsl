// The learned grid of irradiance: cells of several levels in a hash table. A cell's key is its place
// among all cells of all levels, and 1 more, so that the whole of it is compared.
//
// A slot has eight words: key, samples, and the sums of red, green and blue, low word and high word each.

import package::shared::cache::CacheParams;

const SLOT_WORDS: u32 = 8u;
// Slots that are tried for a key.
const PROBES: u32 = 64u;
// Samples from which on a cell's mean is used; up to which finer cells are not asked for; and from which
// on a cell has learned enough.
const LEAST: u32 = 8u;
const ENOUGH: u32 = 24u;
const LEARNED: u32 = 4096u;

// The key of the cell of a level where a point lies, moved by less than half of an edge along each axis.
fn key_of(point: vec3<f32>, level: u32, jitter: vec3<f32>, params: CacheParams) -> u32 {
    let cells = vec3<f32>(params.grid << vec3<u32>(level));
    let at = clamp(point * params.per_edge * f32(1u << level) + jitter, vec3<f32>(0.0), cells - 1.0);
    let cell = vec3<u32>(at);
    let size = params.grid << vec3<u32>(level);
    let coarse = params.grid.x * params.grid.y * params.grid.z;
    // Cells of the levels before: coarse * (8^level - 1) / 7.
    let before = coarse * (((1u << (3u * level)) - 1u) / 7u);
    return before + (cell.z * size.y + cell.y) * size.x + cell.x + 1u;
}

fn first_slot(key: u32, params: CacheParams) -> u32 {
    var h = key * 0x9e3779b1u;
    h = (h ^ (h >> 15u)) * 0x85ebca77u;
    return (h ^ (h >> 13u)) & (params.slots - 1u);
}
