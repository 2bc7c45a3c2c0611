// Which item a thread works on. Dispatches are two-dimensional where one row of
// 65 535 groups does not suffice.

import package::constants::GROUP;

// Parts that the adapter deals the groups of a dispatch in: some of software give each core as
// many in a row. 1 where groups go to whoever is free.
override parts: u32 = 1u;

// Each part gets groups from everywhere, as many of the left of a picture as of the right: its
// own of every `parts` neighbours, and after the sequence of Thue and Morse another each time.
fn group_index(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    let dealt = group.y * groups.x + group.x;
    if parts == 1u { return dealt; }
    let each = groups.x * groups.y / parts;
    if dealt >= each * parts { return dealt; }
    let turn = dealt % each;
    return turn * parts + (dealt / each + countOneBits(turn)) % parts;
}

// This thread's place in its dispatch, once it has asked for its item.
var<private> thread: u32 = 0u;

fn item_index(group: vec3<u32>, groups: vec3<u32>, local: u32) -> u32 {
    thread = group_index(group, groups) * GROUP + local;
    return thread;
}
