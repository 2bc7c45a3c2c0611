// Puts a pixel's segments together, front to back, H(4), and adds the ray to the film.

import package::shared::item::item_index;
@if(points) import package::shared::segment_sums::unpack_sums;
@if(points) import package::shared::sum64::sum_to_float;
import package::constants::GROUP;

struct CompositeParams {
    background: vec3<f32>,
    pixels: u32,        // of the band
    first_pixel: u32,   // of the band in the film
    segments: u32,
    weight: f32,        // of this ray in the film
    fresh: u32,         // 1: the film begins with this ray
    scale: f32,         // of integer sums
    all: u32,           // 1: all pixels, not only those that were touched
    pad0: u32,
    pad1: u32,
}

@group(0) @binding(8) var<uniform> params: CompositeParams;
@if(points) @group(0) @binding(9) var<storage, read> segments: array<vec4<u32>>;
@if(!points) @group(0) @binding(9) var<storage, read> segments: array<vec2<u32>>;
@group(0) @binding(10) var<storage, read_write> film: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> touched: array<u32>; // a bit for each pixel

struct Seen {
    light: vec3<f32>,
    transmittance: f32,
}

@if(points)
fn segment(at: u32) -> Seen {
    let low = segments[2u * at];
    let sums = unpack_sums(low.xyz, segments[2u * at + 1u].zw);
    let light = vec3(sum_to_float(sums.red), sum_to_float(sums.green), sum_to_float(sums.blue));
    return Seen(light / params.scale, bitcast<f32>(low.w));
}

@if(!points)
fn segment(at: u32) -> Seen {
    let words = bitcast<vec4<f32>>(vec4(segments[3u * at], segments[3u * at + 1u]));
    return Seen(words.xyz, words.w);
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = item_index(group, groups, local);
    if pixel >= params.pixels { return; }
    if params.all == 0u && extractBits(touched[pixel / 32u], pixel % 32u, 1u) == 0u { return; }
    var colour = vec3<f32>(0.0);
    var through = 1.0;
    for (var s = 0u; s < params.segments; s++) {
        let seen = segment(s * params.pixels + pixel);
        colour += through * seen.light;
        through *= seen.transmittance;
    }
    colour += through * params.background;
    let at = params.first_pixel + pixel;
    let before = select(film[at], vec4<f32>(0.0), params.fresh == 1u);
    film[at] = before + params.weight * vec4<f32>(colour, 1.0 - through);
}
