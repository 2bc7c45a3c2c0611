// How far each block of pixels trusts the cache: the share of D that makes S + share * D least wrong, where
// D is noisy and C biased. A thread for each block.

import package::constants::GROUP;
import package::shared::cache::{CacheParams, Film, BLOCK_WIDTH, BLOCK_HEIGHT, pixel_of};
import package::shared::item::item_index;

@group(0) @binding(8) var<uniform> params: CacheParams;
@group(0) @binding(10) var<storage, read> film: array<Film>;
@group(0) @binding(11) var<storage, read_write> shares: array<f32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = item_index(group, groups, local);
    if block >= params.items { return; }
    var variance = 0.0;    // of the means of D
    var covariance = 0.0;  // of those with the means of S
    var squares = 0.0;     // of the means of D
    for (var i = 0u; i < BLOCK_WIDTH * BLOCK_HEIGHT; i++) {
        let at = pixel_of(block * BLOCK_WIDTH * BLOCK_HEIGHT + i, params);
        if any(at >= vec2(params.width, params.height)) { continue; }
        let record = film[at.y * params.width + at.x];
        let n = f32(record.passes);
        if n < 2.0 { continue; }
        variance += record.spread / (n * (n - 1.0));
        covariance += record.covariance / (n * (n - 1.0));
        squares += dot(record.more, record.more);
    }
    // bias^2 = mean(D^2) - Var D, where that is not below nothing.
    let below = max(squares, variance);
    shares[block] = select(1.0, clamp(-covariance / below, 0.0, 1.0), below > 0.0);
}
