// Words of a repeating pattern, that may rise from one to the next: a list of all then, its length first.

import package::shared::item::item_index;
import package::constants::GROUP;

struct FillParams {
    low: vec4<u32>,
    high: vec4<u32>,
    period: u32,   // words of the pattern, at most 8
    count: u32,    // words to fill
    rise: u32,     // added to a word for each before it, 0 or 1
    pad: u32,
}

@group(0) @binding(8) var<uniform> params: FillParams;
@group(0) @binding(9) var<storage, read_write> data: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let word = item_index(group, groups, local);
    if word >= params.count { return; }
    let at = word % params.period;
    let pattern = select(params.high[at & 3u], params.low[at & 3u], at < 4u);
    data[word] = select(pattern + params.rise * word, params.count - 1u, word == 0u && params.rise == 1u);
}
