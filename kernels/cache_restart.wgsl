// Which pixels an edit touches: those whose rays or shadow rays have crossed a cell that an edit changes, or
// that have light of a value that it gives another albedo or emission. They begin anew; those of the
// others are what they would be had the edit been there from the start, as far as they are samples.

import package::constants::GROUP;
import package::shared::cache::{CacheParams, Film};
import package::shared::counter::{CHANGED, count};
import package::shared::item::item_index;

@group(0) @binding(8) var<uniform> params: CacheParams;
@group(0) @binding(10) var<storage, read_write> film: array<Film>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = item_index(group, groups, local);
    if pixel >= params.items { return; }
    let record = film[pixel];
    let crossed = ((record.own | record.shadow) & params.risen) | (record.events & params.altered);
    if params.restart == 0u && all(crossed == vec2<u32>(0u)) { return; }
    let none = vec2<u32>(0u);
    film[pixel] = Film(vec3<f32>(0.0), 0u, vec3<f32>(0.0), 0.0, 0.0, 0.0, none, none, none);
    count(CHANGED, 1u);
}
