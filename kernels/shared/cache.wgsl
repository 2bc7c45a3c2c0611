// What the kernels of the irradiance cache share: what they are told, and what they keep of a pixel.

// Pixels are taken in blocks of BLOCK_WIDTH x BLOCK_HEIGHT.
const BLOCK_WIDTH: u32 = 16u;
const BLOCK_HEIGHT: u32 = 8u;

struct CacheParams {
    origin: vec3<f32>,      // of the camera
    width: u32,             // pixels
    corner: vec3<f32>,      // direction of the image's upper left corner
    height: u32,
    right: vec3<f32>,       // across the whole image
    first_item: u32,        // of this dispatch
    down: vec3<f32>,        // down the whole image
    items: u32,
    background: vec3<f32>,
    pass_number: u32,
    grid: vec3<u32>,        // cells of the coarsest level
    levels: u32,
    per_edge: vec3<f32>,    // cells of the coarsest level for each mm
    slots: u32,             // of the hash table, a power of two
    scale: f32,             // of its sums
    per_sum: f32,           // 1 / scale
    room: u32,              // cells beyond which no fine ones are made
    least_chance: f32,      // of a light sample
    risen: vec2<u32>,       // bins that an edit changed: where they may meet another collision,
    altered: vec2<u32>,     // or where they give other light
    restart: u32,           // 1: all pixels begin anew
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

// Of each pixel: its mean of samples, its mean of what cached light is more, sums of squares, and the
// bins that it has met.
struct Film {
    mean: vec3<f32>,       // of samples S
    passes: u32,
    more: vec3<f32>,       // of D = C - S
    spread: f32,           // sum of squared deviations of D, all channels
    covariance: f32,       // the same of S times D
    deviation: f32,        // and of S
    own: vec2<u32>,        // historygram of the cells that its rays have crossed
    events: vec2<u32>,     // of the values that gave light
    shadow: vec2<u32>,     // of the cells that its shadow rays have crossed
}

// A scatter event that a pass has found.
struct Event {
    place: vec3<f32>,
    entry: u32,
    seen: vec3<f32>,    // what the ray has gathered of cached and emitted light
    chance: f32,        // that a light sample is taken
    cached: vec3<f32>,  // what the cache has for the event
    adds: u32,          // a bit for each level that learns the sample
}

fn pixels_of(params: CacheParams) -> u32 {
    return params.width * params.height;
}

// The pixel of an item; `pixels_of` where the block is beyond the image.
fn pixel_of(item: u32, params: CacheParams) -> vec2<u32> {
    let blocks = (params.width + BLOCK_WIDTH - 1u) / BLOCK_WIDTH;
    let block = item / (BLOCK_WIDTH * BLOCK_HEIGHT);
    let within = item % (BLOCK_WIDTH * BLOCK_HEIGHT);
    let corner = vec2(block % blocks * BLOCK_WIDTH, block / blocks * BLOCK_HEIGHT);
    return corner + vec2(within % BLOCK_WIDTH, within / BLOCK_WIDTH);
}

// A pixel's record with one more sample (Welford), and what cached light is more.
fn with_sample(before: Film, sample: vec3<f32>, more: vec3<f32>) -> Film {
    var film = before;
    film.passes++;
    let off = sample - film.mean;
    let off_more = more - film.more;
    film.mean += off / f32(film.passes);
    film.more += off_more / f32(film.passes);
    film.spread += dot(off_more, more - film.more);
    film.covariance += dot(off, more - film.more);
    film.deviation += dot(off, sample - film.mean);
    return film;
}
