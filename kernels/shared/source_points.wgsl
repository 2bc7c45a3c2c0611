// In-scattered light at a march sample from the points light field: every photon in
// the sphere of the gather radius, H(8), as rounded integers. The light of a photon that
// has gone counts negative, and is taken out.

import package::shared::counter::expect;
import package::shared::phase::phase;
import package::shared::points::{PointsParams, points_cell, points_key};
import package::shared::segment::SegmentParams;
import package::shared::segment_sums::Sums;
import package::shared::slot::unpack_direction;
import package::shared::sum64::{rounded, merged};

@group(0) @binding(11) var<uniform> field: PointsParams;
@group(0) @binding(12) var<storage, read> point_places: array<vec4<u32>>;
@group(0) @binding(13) var<storage, read> point_lights: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read> starts: array<u32>;

// Light gathered so far, in the units of the sums.
struct Gathered {
    sums: Sums,
    clamped: u32,
    tested: u32,
}

// Points that one turn of the innermost loop looks at: turns are what some drivers count.
const AT_ONCE: u32 = 4u;

struct Query {
    point: vec3<f32>,
    weight: f32,
    toward: vec3<f32>,
    end: u32,        // of the run of points
}

fn with_point(i: u32, q: Query, so_far: Gathered) -> Gathered {
    if i >= q.end { return so_far; }
    let place = point_places[i];
    let away = bitcast<vec3<f32>>(place.xyz) - q.point;
    if dot(away, away) >= field.radius * field.radius { return so_far; }
    let light = point_lights[i];
    var share = light.rgb * q.weight;
    @if(anisotropic) {
        share *= phase(light.a, dot(unpack_direction(place.w), q.toward));
    }
    let r = rounded(abs(share.r));
    let g = rounded(abs(share.g));
    let b = rounded(abs(share.b));
    let gone = any(light.rgb < vec3<f32>(0.0));
    return Gathered(
        Sums(
            merged(so_far.sums.red, r.value, gone),
            merged(so_far.sums.green, g.value, gone),
            merged(so_far.sums.blue, b.value, gone)
        ),
        so_far.clamped + u32(r.clamped) + u32(g.clamped) + u32(b.clamped),
        so_far.tested
    );
}

fn gather(
    params: SegmentParams, point: vec3<f32>, entry: u32, weight: f32, toward: vec3<f32>, so_far: Gathered,
) -> Gathered {
    var sum = so_far;
    let cell = points_cell(point, field);
    let low = max(cell - 1, vec3<i32>(0));
    let high = min(cell + 1, vec3<i32>(field.grid) - 1);
    var z = low.z;
    for (; z <= high.z; z++) {
        var y = low.y;
        for (; y <= high.y; y++) {
            let first = points_key(vec3<i32>(low.x, y, z), field) >> field.shift;
            let last = points_key(vec3<i32>(high.x, y, z), field) >> field.shift;
            let q = Query(point, weight, toward, min(starts[last + 1u], params.points_end));
            var i = max(starts[first], params.points_begin);
            sum.tested += max(q.end, i) - i;
            for (; i < q.end; i += AT_ONCE) {
                sum = with_point(i, q, sum);
                sum = with_point(i + 1u, q, sum);
                sum = with_point(i + 2u, q, sum);
                sum = with_point(i + 3u, q, sum);
            }
            expect(i >= q.end);
        }
        expect(y > high.y);
    }
    expect(z > high.z);
    return sum;
}
