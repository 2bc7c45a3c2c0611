// Takes the marks off blocks of macro-cells where all is empty: no light is looked up there, whatever
// changed. A thread for each word of marks.

import package::constants::{DIRTY_SPLIT, GROUP};
import package::shared::dirty::{dirty, dirty_grid};
import package::shared::item::item_index;
import package::shared::scene::vacancy;

fn is_vacant(index: u32) -> bool {
    let n = dirty_grid.blocks;
    let block = vec3(index % n.x, index / n.x % n.y, index / n.x / n.y);
    return vacancy(vec3<i32>(block / DIRTY_SPLIT)).is_vacant;
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let word = item_index(group, groups, local);
    let n = dirty_grid.blocks;
    let first = 32u * word;
    if first >= n.x * n.y * n.z { return; }
    var open = atomicLoad(&dirty[word]) & (0xffffffffu >> (32u - min(n.x * n.y * n.z - first, 32u)));
    var seen = open;
    while open != 0u {
        let bit = firstTrailingBit(open);
        open &= open - 1u;
        if is_vacant(first + bit) { seen ^= 1u << bit; }
    }
    atomicStore(&dirty[word], seen);
}
