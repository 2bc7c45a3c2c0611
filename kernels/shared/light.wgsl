// Lights, and how photons leave them.
//
// A photon's emission is a pure function of its light and its index there, aimed at
// the volume's bounds and nothing else: no edit of a material, and no other light,
// reaches it. Power is in the scene's unit of radiant flux.

import package::constants::{
    MAX_LIGHTS, LIGHT_POINT, LIGHT_DIRECTIONAL, LIGHT_RECTANGLE, LIGHT_SURROUNDINGS
};
import package::shared::phase::{PI, cosine_around, uniform_direction};
import package::shared::random::{draw, unit4, FOR_EMISSION, FOR_EMISSION_AIM};
import package::shared::scene::scene;

struct Light {
    radiance: vec3<f32>,   // W/sr (point), W/mm2 (directional), W/sr/mm2 (the others)
    kind: u32,
    position: vec3<f32>,   // point; corner of the rectangle
    stream: u32,           // hash of seed and stable id
    direction: vec3<f32>,  // of travel (directional); normal of the rectangle
    pad: u32,
    edge_u: vec3<f32>,
    photons: u32,          // its quota
    edge_v: vec3<f32>,
    area: f32,             // of the rectangle, mm2
}

struct Lights {
    count: u32,
    photons: u32,
    pad0: u32,
    pad1: u32,
    all: array<Light, MAX_LIGHTS>,
}

@group(0) @binding(6) var<uniform> lights: Lights;

struct Emission {
    position: vec3<f32>,
    direction: vec3<f32>,
    power: vec3<f32>,
}

// Area of the bounds' faces across each axis.
fn face_areas() -> vec3<f32> {
    return scene.extent.yzx * scene.extent.zxy;
}

// Chooses an axis with the given weights; returns it with its probability.
struct Choice {
    axis: u32,
    probability: f32,
}

fn choose(weights: vec3<f32>, u: f32) -> Choice {
    let total = weights.x + weights.y + weights.z;
    let at = u * total;
    var axis = 0u;
    if at >= weights.x { axis = select(1u, 2u, at >= weights.x + weights.y); }
    // Rounding must not choose what has no weight.
    if weights[axis] <= 0.0 {
        axis = select(select(2u, 1u, weights.y > 0.0), 0u, weights.x > 0.0);
    }
    return Choice(axis, weights[axis] / total);
}

fn on_face(axis: u32, level: f32, u: vec2<f32>) -> vec3<f32> {
    let a = (axis + 1u) % 3u;
    let b = (axis + 2u) % 3u;
    var point = vec3<f32>(0.0);
    point[axis] = level;
    point[a] = u.x * scene.extent[a];
    point[b] = u.y * scene.extent[b];
    return point;
}

struct Aim {
    point: vec3<f32>,      // on the bounds, or the source itself where it is inside
    direction: vec3<f32>,
    per_density: f32,      // solid angle over probability, sr
    inside: bool,
}

// A direction from `source` to a point of the bounds' visible faces. Faces are chosen
// by about their solid angle, points uniformly by area: exact at any distance.
fn aim_at_bounds(source: vec3<f32>, u: vec3<f32>) -> Aim {
    let below = source < vec3<f32>(0.0);
    let above = source > scene.extent;
    if !any(below | above) {
        return Aim(source, uniform_direction(u.xy), 4.0 * PI, true);
    }
    let level = select(vec3<f32>(0.0), scene.extent, above);
    let height = select(vec3<f32>(0.0), abs(source - level), below | above);
    let areas = face_areas();
    var weights = vec3<f32>(0.0);
    for (var axis = 0u; axis < 3u; axis++) {
        if height[axis] > 0.0 {
            let away = distance(source, on_face(axis, level[axis], vec2<f32>(0.5)));
            weights[axis] = areas[axis] * height[axis] / (away * away * away);
        }
    }
    let face = choose(weights, u.z);
    let point = on_face(face.axis, level[face.axis], u.xy);
    let away = distance(source, point);
    let per_area = height[face.axis] / (away * away * away);
    let per_density = areas[face.axis] * per_area / face.probability;
    return Aim(point, (point - source) / away, per_density, false);
}

// The emission of photon `index` of a light: where it enters the bounds, which way it
// travels, and its share of the light's radiant flux.
fn emit(which: u32, index: u32) -> Emission {
    let light = lights.all[which];
    let u = unit4(draw(light.stream, index, 0u, FOR_EMISSION));
    let v = unit4(draw(light.stream, index, 0u, FOR_EMISSION_AIM));
    let share = light.radiance / f32(light.photons);
    switch light.kind {
        case LIGHT_POINT: {
            let aim = aim_at_bounds(light.position, v.xyz);
            return Emission(aim.point, aim.direction, share * aim.per_density);
        }
        case LIGHT_RECTANGLE: {
            let source = light.position + u.x * light.edge_u + u.y * light.edge_v;
            var aim = aim_at_bounds(source, v.xyz);
            if aim.inside {
                aim.direction = cosine_around(light.direction, v.xy);
                return Emission(source, aim.direction, share * light.area * PI);
            }
            let cosine = max(dot(light.direction, aim.direction), 0.0);
            return Emission(aim.point, aim.direction, share * light.area * cosine * aim.per_density);
        }
        case LIGHT_DIRECTIONAL: {
            let weights = face_areas() * abs(light.direction);
            let face = choose(weights, v.z);
            let level = select(scene.extent[face.axis], 0.0, light.direction[face.axis] > 0.0);
            let across = weights.x + weights.y + weights.z;
            return Emission(on_face(face.axis, level, v.xy), light.direction, share * across);
        }
        default: {
            let areas = face_areas();
            let face = choose(areas, v.z);
            let high = v.w >= 0.5;
            var inward = vec3<f32>(0.0);
            inward[face.axis] = select(1.0, -1.0, high);
            let level = select(0.0, scene.extent[face.axis], high);
            let all_faces = 2.0 * (areas.x + areas.y + areas.z);
            let direction = cosine_around(inward, u.xy);
            return Emission(on_face(face.axis, level, v.xy), direction, share * PI * all_faces);
        }
    }
}
