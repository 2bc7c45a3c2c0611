// Which item a thread works on. Dispatches are two-dimensional where one row of
// 65 535 groups does not suffice.

import package::constants::GROUP;

fn group_index(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    return group.y * groups.x + group.x;
}

// This thread's place in its dispatch, once it has asked for its item.
var<private> thread: u32 = 0u;

fn item_index(group: vec3<u32>, groups: vec3<u32>, local: u32) -> u32 {
    thread = group_index(group, groups) * GROUP + local;
    return thread;
}
