// The image: each pixel's samples, with as much of what cached light is more as its block and the blocks
// around it trust.

import package::constants::GROUP;
import package::shared::cache::{CacheParams, Film, BLOCK_WIDTH, BLOCK_HEIGHT};
import package::shared::item::item_index;

@group(0) @binding(8) var<uniform> params: CacheParams;
@group(0) @binding(10) var<storage, read> film: array<Film>;
@group(0) @binding(11) var<storage, read> shares: array<f32>;
@group(0) @binding(12) var<storage, read_write> image: array<vec4<f32>>;

fn share_at(place: vec2<f32>) -> f32 {
    let block = vec2<f32>(f32(BLOCK_WIDTH), f32(BLOCK_HEIGHT));
    let size = vec2(params.width, params.height);
    let blocks = (size + vec2(BLOCK_WIDTH, BLOCK_HEIGHT) - 1u) / vec2(BLOCK_WIDTH, BLOCK_HEIGHT);
    let at = clamp(place / block - 0.5, vec2<f32>(0.0), vec2<f32>(blocks - 1u));
    let low = vec2<u32>(at);
    let high = min(low + 1u, blocks - 1u);
    let f = at - vec2<f32>(low);
    let upper = mix(shares[low.y * blocks.x + low.x], shares[low.y * blocks.x + high.x], f.x);
    let lower = mix(shares[high.y * blocks.x + low.x], shares[high.y * blocks.x + high.x], f.x);
    return mix(upper, lower, f.y);
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = item_index(group, groups, local);
    if pixel >= params.items { return; }
    let record = film[pixel];
    let at = vec2<f32>(vec2(pixel % params.width, pixel / params.width)) + 0.5;
    image[pixel] = vec4(record.mean + share_at(at) * record.more, f32(record.passes));
}
