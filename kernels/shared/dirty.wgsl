// Where light changed: a bit for each block of the bounds in which a sample may read
// something of the light field that is not what it was. A macro-cell is DIRTY_SPLIT
// blocks along each axis.

import package::shared::counter::expect;

struct DirtyGrid {
    blocks: vec3<u32>,
    spatial: u32,          // which test: exact, SPATIAL_AXES, or off
    edge: vec3<f32>,       // of a block, mm
    reach: f32,            // how far from a point its light is read, mm
    // which 64ths of the bounds along each axis hold dirty blocks
    along_x: vec2<u32>,
    along_y: vec2<u32>,
    along_z: vec2<u32>,
    pad: vec2<u32>,
}

@group(0) @binding(16) var<uniform> dirty_grid: DirtyGrid;
@group(0) @binding(17) var<storage, read_write> dirty: array<atomic<u32>>;

fn block_index(block: vec3<u32>) -> u32 {
    return (block.z * dirty_grid.blocks.y + block.y) * dirty_grid.blocks.x + block.x;
}

fn block_at(point: vec3<f32>) -> vec3<u32> {
    let at = clamp(floor(point / dirty_grid.edge), vec3<f32>(0.0), vec3<f32>(dirty_grid.blocks - 1u));
    return vec3<u32>(at);
}

// All blocks within reach of the box from `low` to `high`.
fn mark_dirty(low: vec3<f32>, high: vec3<f32>) {
    let first = block_at(low - dirty_grid.reach);
    let last = block_at(high + dirty_grid.reach);
    var z = first.z;
    for (; z <= last.z; z++) {
        var y = first.y;
        for (; y <= last.y; y++) {
            var x = first.x;
            for (; x <= last.x; x++) {
                let block = block_index(vec3<u32>(x, y, z));
                let bit = 1u << (block & 31u);
                if (atomicLoad(&dirty[block >> 5u]) & bit) == 0u {
                    atomicOr(&dirty[block >> 5u], bit);
                }
            }
            expect(x > last.x);
        }
        expect(y > last.y);
    }
    expect(z > last.z);
}

fn is_dirty(block: vec3<i32>) -> bool {
    let index = block_index(vec3<u32>(block));
    return (atomicLoad(&dirty[index >> 5u]) & (1u << (index & 31u))) != 0u;
}

// The 64ths of the bounds that an interval of one axis touches.
fn slabs(low: f32, high: f32, extent: f32) -> vec2<u32> {
    let a = u32(clamp(floor(low / extent * 64.0), 0.0, 63.0));
    let b = u32(clamp(floor(high / extent * 64.0), 0.0, 63.0));
    var mask = vec2<u32>(0u);
    for (var i = a; i <= b; i++) { mask[i >> 5u] |= 1u << (i & 31u); }
    return mask;
}

// The paper's spatial historygrams, section 4.3.2: an axis each, so what they know is a
// box or more around what changed.
fn axes_meet(low: vec3<f32>, high: vec3<f32>, extent: vec3<f32>) -> bool {
    return any((slabs(low.x, high.x, extent.x) & dirty_grid.along_x) != vec2<u32>(0u))
        && any((slabs(low.y, high.y, extent.y) & dirty_grid.along_y) != vec2<u32>(0u))
        && any((slabs(low.z, high.z, extent.z) & dirty_grid.along_z) != vec2<u32>(0u));
}
