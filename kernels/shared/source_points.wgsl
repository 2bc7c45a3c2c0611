// In-scattered light at a march sample from the points light field: every photon in
// the sphere of the gather radius, H(8), as rounded integers.

import package::shared::phase::phase;
import package::shared::points::{PointsParams, points_cell, points_key};
import package::shared::slot::unpack_direction;
import package::shared::sum64::{rounded, add_with_carry, sum_to_float};

@group(0) @binding(11) var<uniform> field: PointsParams;
@group(0) @binding(12) var<storage, read> point_places: array<vec4<u32>>;
@group(0) @binding(13) var<storage, read> point_lights: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read> starts: array<u32>;

// Light gathered so far, in the units of the sums.
struct Gathered {
    red: vec2<u32>,
    green: vec2<u32>,
    blue: vec2<u32>,
    clamped: u32,
    tested: u32,
}

fn gather(
    point: vec3<f32>, entry: u32, weight: f32, toward: vec3<f32>, so_far: Gathered,
) -> Gathered {
    var sum = so_far;
    let cell = points_cell(point, field);
    let low = max(cell - 1, vec3<i32>(0));
    let high = min(cell + 1, vec3<i32>(field.grid) - 1);
    let reach = field.radius * field.radius;
    for (var z = low.z; z <= high.z; z++) {
        for (var y = low.y; y <= high.y; y++) {
            let first = points_key(vec3<i32>(low.x, y, z), field) >> field.shift;
            let last = points_key(vec3<i32>(high.x, y, z), field) >> field.shift;
            let end = starts[last + 1u];
            for (var i = starts[first]; i < end; i++) {
                sum.tested++;
                let place = point_places[i];
                let away = bitcast<vec3<f32>>(place.xyz) - point;
                if dot(away, away) >= reach { continue; }
                let light = point_lights[i];
                var share = light.rgb * weight;
                @if(anisotropic) {
                    share *= phase(light.a, dot(unpack_direction(place.w), toward));
                }
                let r = rounded(share.r);
                let g = rounded(share.g);
                let b = rounded(share.b);
                sum.red = add_with_carry(sum.red, r.value);
                sum.green = add_with_carry(sum.green, g.value);
                sum.blue = add_with_carry(sum.blue, b.value);
                sum.clamped += u32(r.clamped) + u32(g.clamped) + u32(b.clamped);
            }
        }
    }
    return sum;
}

// The radiance that the sums stand for.
fn radiance_of(gathered: Gathered, scale: f32) -> vec3<f32> {
    let sums = vec3(
        sum_to_float(gathered.red), sum_to_float(gathered.green), sum_to_float(gathered.blue)
    );
    return sums / scale;
}
