// Which item a thread works on. Dispatches are two-dimensional where one row of
// 65 535 groups does not suffice.

import package::constants::GROUP;

fn group_index(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    return group.y * groups.x + group.x;
}

fn item_index(group: vec3<u32>, groups: vec3<u32>, local: u32) -> u32 {
    return group_index(group, groups) * GROUP + local;
}
