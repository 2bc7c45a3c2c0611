// In-scattered light at a march sample from the fluence light field: one interpolated
// fetch of the fluence, times what scatters there.

import package::shared::phase::PI;
import package::shared::scene::scene;

struct FluenceParams {
    grid: vec3<u32>,
    pad: u32,
}

@group(0) @binding(11) var<uniform> field: FluenceParams;
@group(0) @binding(12) var fluence: texture_3d<f32>;

struct Gathered {
    radiance: vec3<f32>,
    clamped: u32,
    tested: u32,
}

fn fluence_cell(cell: vec3<i32>) -> vec3<f32> {
    let inside = clamp(cell, vec3<i32>(0), vec3<i32>(field.grid) - 1);
    return textureLoad(fluence, inside, 0).rgb;
}

fn fluence_at(point: vec3<f32>) -> vec3<f32> {
    let at = point / scene.extent * vec3<f32>(field.grid) - 0.5;
    let base = floor(at);
    let f = at - base;
    let i = vec3<i32>(base);
    let x00 = mix(fluence_cell(i), fluence_cell(i + vec3(1, 0, 0)), f.x);
    let x10 = mix(fluence_cell(i + vec3(0, 1, 0)), fluence_cell(i + vec3(1, 1, 0)), f.x);
    let x01 = mix(fluence_cell(i + vec3(0, 0, 1)), fluence_cell(i + vec3(1, 0, 1)), f.x);
    let x11 = mix(fluence_cell(i + vec3(0, 1, 1)), fluence_cell(i + vec3(1, 1, 1)), f.x);
    return mix(mix(x00, x10, f.y), mix(x01, x11, f.y), f.z);
}

// `scattering` is seen over a length, and over all directions alike.
fn gather(point: vec3<f32>, scattering: vec3<f32>, so_far: Gathered) -> Gathered {
    let light = scattering / (4.0 * PI) * fluence_at(point);
    return Gathered(so_far.radiance + light, so_far.clamped, so_far.tested + 1u);
}
