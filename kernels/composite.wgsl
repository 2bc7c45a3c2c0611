// Puts a pixel's segments together, front to back, H(4), and adds the ray to the film.

import package::shared::item::item_index;
import package::shared::segment::Segment;
import package::constants::GROUP;

struct CompositeParams {
    background: vec3<f32>,
    pixels: u32,        // of the band
    first_pixel: u32,   // of the band in the film
    segments: u32,
    weight: f32,        // of this ray in the film
    fresh: u32,         // 1: the film begins with this ray
}

@group(0) @binding(8) var<uniform> params: CompositeParams;
@group(0) @binding(9) var<storage, read> segments: array<Segment>;
@group(0) @binding(10) var<storage, read_write> film: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = item_index(group, groups, local);
    if pixel >= params.pixels { return; }
    var colour = vec3<f32>(0.0);
    var through = 1.0;
    for (var s = 0u; s < params.segments; s++) {
        let segment = segments[pixel * params.segments + s];
        colour += through * vec3(segment.red, segment.green, segment.blue);
        through *= segment.transmittance;
    }
    colour += through * params.background;
    let at = params.first_pixel + pixel;
    let before = select(film[at], vec4<f32>(0.0), params.fresh == 1u);
    film[at] = before + params.weight * vec4<f32>(colour, 1.0 - through);
}
