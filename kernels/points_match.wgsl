// Which points came and which went: a point that segments have seen and that is still
// there, bit for bit, has neither gone nor come. `numbers` says for each slot which
// sorted point it is now, plus one; 0 where it is none.

import package::constants::GROUP;
import package::shared::item::item_index;
import package::shared::points::PointsParams;

@group(0) @binding(8) var<uniform> params: PointsParams;
@group(0) @binding(9) var<storage, read> seen_slots: array<u32>;
@group(0) @binding(10) var<storage, read> seen_places: array<vec4<u32>>;
@group(0) @binding(11) var<storage, read> seen_lights: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read> numbers: array<u32>;
@group(0) @binding(13) var<storage, read> point_places: array<vec4<u32>>;
@group(0) @binding(14) var<storage, read> point_lights: array<vec4<u32>>;
@group(0) @binding(15) var<storage, read_write> went: array<atomic<u32>>;
@group(0) @binding(16) var<storage, read_write> came: array<atomic<u32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let point = item_index(group, groups, local);
    if point >= params.count { return; }
    let number = numbers[seen_slots[point]];
    if number == 0u { return; }
    let now = number - 1u;
    let same = all(seen_places[point] == point_places[now])
        && all(seen_lights[point] == point_lights[now]);
    if same {
        atomicAnd(&went[point / 32u], ~(1u << (point % 32u)));
        atomicAnd(&came[now / 32u], ~(1u << (now % 32u)));
    }
}
