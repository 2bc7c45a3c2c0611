// Samplers laid open for their tests: free flight, phase function, and emission, each
// just as the stages draw them.

import package::constants::GROUP;
import package::shared::flight::{nothing_known, fly};
import package::shared::item::item_index;
import package::shared::light::emit;
import package::shared::phase::sample_phase;
import package::shared::random::{draw, unit4, FOR_FLIGHT, FOR_SCATTER};
import package::shared::scene::scene;
import package::shared::slot::{
    pack_direction, unpack_direction, pack_power, unpack_power, scaled_power
};

struct ProbeParams {
    origin: vec3<f32>,
    what: u32,          // 0 flight, 1 phase function, 2 emission, 3 packing, 4 weighing
    direction: vec3<f32>,
    count: u32,
    g: f32,
    light: u32,
    pad0: u32,
    pad1: u32,
}

@group(0) @binding(8) var<uniform> params: ProbeParams;
@group(0) @binding(9) var<storage, read_write> first: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> second: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> third: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = item_index(group, groups, local);
    if i >= params.count { return; }
    switch params.what {
        case 0u: {
            let key = draw(scene.seed, i, 0u, FOR_FLIGHT).xy;
            let f = fly(params.origin, params.direction, key, nothing_known());
            first[i] = vec4<f32>(f.distance, f32(f.entry), f32(f.collided), f32(f.tentative));
            second[i] = vec4<f32>(bitcast<vec2<f32>>(f.history), 0.0, 0.0);
        }
        case 1u: {
            let u = unit4(draw(scene.seed, i, 0u, FOR_SCATTER)).xy;
            first[i] = vec4<f32>(sample_phase(params.g, params.direction, u), 0.0);
        }
        case 2u: {
            let e = emit(params.light, i);
            first[i] = vec4<f32>(e.position, 0.0);
            second[i] = vec4<f32>(e.direction, 0.0);
            third[i] = vec4<f32>(e.power, 0.0);
        }
        case 3u: {
            let u = unit4(draw(scene.seed, i, 0u, FOR_SCATTER));
            let d = sample_phase(0.0, params.direction, u.xy);
            first[i] = vec4<f32>(d, 0.0);
            second[i] = vec4<f32>(unpack_direction(pack_direction(d)), 0.0);
            third[i] = vec4<f32>(unpack_power(pack_power(u.xyz * exp2(40.0 * (u.w - 0.5)))), u.w);
        }
        default: {
            let u = unit4(draw(scene.seed, i, 0u, FOR_SCATTER));
            let power = pack_power(u.xyz * exp2(150.0 * (u.w - 0.5)));
            // From white to black, among them 1 and 0.
            let share = vec3<u32>(u.zxy * exp2(-f32(i % 20u)) * 262145.0);
            first[i] = vec4<f32>(unpack_power(power), 0.0);
            second[i] = vec4<f32>(vec3<f32>(share), 0.0);
            third[i] = vec4<f32>(unpack_power(scaled_power(power, share, i32(i % 7u))), 0.0);
        }
    }
}
