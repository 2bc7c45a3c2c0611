// Single scattering: how far a ray flies, and how much light reaches an event.
//
// Delta tracking in the macro-cells' own majorants; lights by area, direction, or both of them by multiple
// importance sampling. Shares nothing with the reference, which it is judged by.

import package::constants::{LIGHT_POINT, LIGHT_DIRECTIONAL, LIGHT_RECTANGLE};
import package::shared::counter::expect;
import package::shared::light::lights;
import package::shared::phase::{PI, uniform_direction};
import package::shared::random::{pcg4d, unit, unit4, exponential};
import package::shared::scene::{scene, optics_of, entry_at, cell_masks};
import package::shared::walk::{FAR, line, inside, walk_begin, walk_leave, walk_step};

// The greatest extinction in each macro-cell, or what emission there needs to be found.
@group(0) @binding(23) var majorants: texture_3d<f32>;

var<private> stream: vec4<u32>;

fn next_words() -> vec4<u32> {
    stream.w++;
    return pcg4d(stream);
}

struct Reached {
    passed: f32,       // 0 or 1 by delta tracking; an estimate of the transmittance by ratio tracking
    cells: vec2<u32>,  // historygram of the cells that were crossed
}

// Whether light passes from a point to what is so far away.
fn reach(origin: vec3<f32>, direction: vec3<f32>, away: f32) -> Reached {
    var result = Reached(1.0, vec2<u32>(0u));
    let l = line(origin, direction);
    let within = inside(l, scene.extent);
    let stop = min(within.y, away);
    if stop <= within.x { return result; }
    var w = walk_begin(l, within.x, scene.cell_mm, scene.cells);
    var t_in = within.x;
    var arrived = false;
    loop {
        let t_out = min(walk_leave(w), stop);
        @if(history) { result.cells |= textureLoad(cell_masks, w.cell, 0).xy; }
        let majorant = textureLoad(majorants, w.cell, 0).r;
        if majorant > 0.0 {
            var t = t_in;
            var over = false;
            loop {
                let words = next_words();
                t += exponential(unit(words.x)) / majorant;
                over = t >= t_out;
                if over { break; }
                let extinction = optics_of(entry_at(origin + direction * t)).extinction;
                @if(!evenly) {
                    result.passed *= 1.0 - extinction / majorant;
                    // A roulette ends what hardly counts.
                    if result.passed < 0.1 {
                        if unit(words.y) * 0.5 >= result.passed { result.passed = 0.0; }
                        else { result.passed = 0.5; }
                    }
                }
                @if(evenly) {
                    if unit(words.y) * majorant < extinction { result.passed = 0.0; }
                }
                over = result.passed == 0.0;
                if over { break; }
            }
            expect(over);
        }
        t_in = max(t_out, t_in);
        arrived = result.passed == 0.0 || t_out >= stop
            || !walk_step(&w, l, scene.cell_mm, scene.cells);
        if arrived { break; }
    }
    expect(arrived);
    return result;
}

// Light that is on its way to a point: the mean radiance over all directions that it would give, if
// nothing stood in its way.
struct Ray {
    toward: vec3<f32>,
    away: f32,
    light: vec3<f32>,
}

// Light of a rectangle. By area where it is far. Where it is near that has no bound: then half of the
// samples take a direction, and each strategy counts by the power heuristic.
fn ray_to_rectangle(which: u32, point: vec3<f32>, u: vec4<f32>) -> Ray {
    let light = lights.all[which];
    let centre = light.position + 0.5 * (light.edge_u + light.edge_v) - point;
    let is_near = dot(centre, centre) < 4.0 * light.area;
    var to = light.position + u.x * light.edge_u + u.y * light.edge_v - point;
    let by_direction = is_near && u.z < 0.5;
    if by_direction {
        let toward = uniform_direction(u.xy);
        let height = dot(light.position - point, light.direction);
        let slope = dot(toward, light.direction);
        if height * slope <= 0.0 { return Ray(toward, 0.0, vec3<f32>(0.0)); }
        to = toward * (height / slope);
        let on = point + to - light.position;
        // Its edges need not be at right angles.
        let normal = light.direction;
        let across = cross(light.edge_v, normal);
        let down = cross(normal, light.edge_u);
        let place = vec2(dot(on, across) / dot(light.edge_u, across),
            dot(on, down) / dot(light.edge_v, down));
        if any(place < vec2<f32>(0.0)) || any(place > vec2<f32>(1.0)) {
            return Ray(toward, 0.0, vec3<f32>(0.0));
        }
    }
    let away = length(to);
    let toward = to / max(away, 1e-20);
    let cosine = -dot(toward, light.direction);
    if cosine <= 0.0 { return Ray(toward, 0.0, vec3<f32>(0.0)); }
    // Densities over the sphere, of an area's and of a direction's sample.
    let of_area = away * away / (cosine * light.area);
    let of_direction = 1.0 / (4.0 * PI);
    var weight = 1.0 / of_area;
    if is_near {
        let own = select(of_area, of_direction, by_direction);
        let both = of_area * of_area + of_direction * of_direction;
        weight = 2.0 * own / both;
    }
    return Ray(toward, away, light.radiance * weight / (4.0 * PI));
}

// A ray to a light.
fn ray_to(which: u32, point: vec3<f32>) -> Ray {
    let light = lights.all[which];
    let u = unit4(next_words());
    switch light.kind {
        case LIGHT_POINT: {
            let to = light.position - point;
            let away = max(length(to), 1e-20);
            return Ray(to / away, away, light.radiance / (away * away) / (4.0 * PI));
        }
        case LIGHT_DIRECTIONAL: { return Ray(-light.direction, FAR, light.radiance / (4.0 * PI)); }
        case LIGHT_RECTANGLE: { return ray_to_rectangle(which, point, u); }
        default: { return Ray(uniform_direction(u.xy), FAR, light.radiance); }
    }
}

// How much a light may count at a point; never 0 where it counts.
fn importance(which: u32, point: vec3<f32>) -> f32 {
    let light = lights.all[which];
    let power = dot(light.radiance, vec3<f32>(1.0));
    switch light.kind {
        case LIGHT_POINT: {
            let to = light.position - point;
            return power / max(dot(to, to), 1e-20);
        }
        case LIGHT_DIRECTIONAL: { return power; }
        case LIGHT_RECTANGLE: {
            let to = light.position + 0.5 * (light.edge_u + light.edge_v) - point;
            if dot(light.position - point, light.direction) >= 0.0 { return 0.0; }
            return power * light.area / (dot(to, to) + light.area);
        }
        default: { return power * 4.0 * PI; }
    }
}

struct Lit {
    light: vec3<f32>,  // mean radiance over all directions
    cells: vec2<u32>,
}

// The light at a point: of all lights.
@if(all_lights)
fn light_at(point: vec3<f32>) -> Lit {
    var lit = Lit(vec3<f32>(0.0), vec2<u32>(0u));
    for (var which = 0u; which < lights.count; which++) {
        let ray = ray_to(which, point);
        if all(ray.light <= vec3<f32>(0.0)) { continue; }
        let reached = reach(point, ray.toward, ray.away);
        lit.light += ray.light * reached.passed;
        lit.cells |= reached.cells;
    }
    return lit;
}

// The same of one of them: of each as often, or by how much it may count.
@if(!all_lights)
fn light_at(point: vec3<f32>) -> Lit {
    let u = unit(next_words().x);
    var which = 0u;
    var chance = 1.0;
    @if(evenly) {
        if lights.count == 0u { return Lit(vec3<f32>(0.0), vec2<u32>(0u)); }
        which = min(u32(u * f32(lights.count)), lights.count - 1u);
        chance = 1.0 / f32(lights.count);
    }
    @if(!evenly) {
        var all = 0.0;
        for (var i = 0u; i < lights.count; i++) { all += importance(i, point); }
        if !(all > 0.0) { return Lit(vec3<f32>(0.0), vec2<u32>(0u)); }
        var left = u * all;
        for (var i = 0u; i < lights.count; i++) {
            let own = importance(i, point);
            if own <= 0.0 { continue; }
            which = i;
            chance = own / all;
            if left < own { break; }
            left -= own;
        }
    }
    let ray = ray_to(which, point);
    if all(ray.light <= vec3<f32>(0.0)) { return Lit(vec3<f32>(0.0), vec2<u32>(0u)); }
    let reached = reach(point, ray.toward, ray.away);
    return Lit(ray.light * reached.passed / chance, reached.cells);
}
