// View-ray segments: the part of a pixel's ray between two of its V_n + 1 uniform
// bounds. Each is computed on its own, H(4), and never depends on what lies before it.

import package::shared::random::{draw, unit4, FOR_CAMERA};
import package::shared::scene::scene;
import package::shared::walk::{Line, line, inside};

struct SegmentParams {
    origin: vec3<f32>,      // of the camera
    width: u32,             // pixels
    corner: vec3<f32>,      // direction of the image's upper left corner
    height: u32,
    right: vec3<f32>,       // across the whole image
    segments: u32,          // V_n
    down: vec3<f32>,        // down the whole image
    first_row: u32,         // of the band
    first_item: u32,
    items: u32,
    strata: vec2<u32>,      // rays a pixel, across and down
    ray: u32,               // which of them; one stratum is the pixel's centre
    scale: f32,             // of integer sums
    begins: u32,            // 1: sums begin at zero
    points_begin: u32,      // the part of the points that this dispatch gathers
    points_end: u32,
    which: u32,             // segments that are listed: LIST_READ, LIST_LIT
    query: vec2<u32>,       // bins of the entries that an edit changed
    stride: u32,            // words of a segment
    pixels: u32,            // of the band
    pad0: u32,
    pad1: u32,
}

// Words of a segment: its light, three; its transmittance; its history, two; and where its light is
// integer sums, what they have above 32 bits, two.
const HISTORY: u32 = 4u;

// What one segment covers of its ray.
struct Span {
    ray: Line,
    enter: f32,   // where the ray enters the volume's bounds
    leave: f32,
    index: u32,   // which segment
}

fn camera_ray(params: SegmentParams, pixel: vec2<u32>) -> Line {
    var offset = vec2<f32>(0.5);
    if params.strata.x * params.strata.y > 1u {
        let number = pixel.y * params.width + pixel.x;
        let u = unit4(draw(scene.seed, number, params.ray, FOR_CAMERA)).xy;
        let stratum = vec2<u32>(params.ray % params.strata.x, params.ray / params.strata.x);
        offset = (vec2<f32>(stratum) + u) / vec2<f32>(params.strata);
    }
    let at = (vec2<f32>(pixel) + offset) / vec2<f32>(f32(params.width), f32(params.height));
    return line(params.origin, normalize(params.corner + at.x * params.right + at.y * params.down));
}

// The segments of a band lie layer upon layer: neighbours look at much the same, and threads
// side by side take about as long. Tiles of pixels in place of rows were no faster.
fn span_of(params: SegmentParams, task: u32) -> Span {
    let pixel = task % params.pixels;
    let at = vec2<u32>(pixel % params.width, params.first_row + pixel / params.width);
    let ray = camera_ray(params, at);
    let reach = inside(ray, scene.extent);
    return Span(ray, reach.x, max(reach.y, reach.x), task / params.pixels);
}
