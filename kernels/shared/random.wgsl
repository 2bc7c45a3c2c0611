// Randomness as a pure function of what it is for. No state is carried, so work
// resumed in the middle draws what it would have drawn in a full run.

// What a draw is for: the last argument of `draw`.
const FOR_EMISSION: u32 = 0x10u;
const FOR_EMISSION_AIM: u32 = 0x11u;
const FOR_FLIGHT: u32 = 0x20u;
const FOR_SCATTER: u32 = 0x30u;
const FOR_CAMERA: u32 = 0x40u;
const FOR_PATH: u32 = 0x50u;
const FOR_LIGHT: u32 = 0x60u;
const FOR_CACHE_RAY: u32 = 0x70u;
const FOR_CACHE_LIGHT: u32 = 0x71u;
const FOR_CACHE_CELL: u32 = 0x80u;

// Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.
fn pcg4d(key: vec4<u32>) -> vec4<u32> {
    var v = key * 1664525u + 1013904223u;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    v ^= v >> vec4<u32>(16u);
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    return v;
}

// Four words for (stream, index, event, purpose); the stream is a hashed seed.
fn draw(stream: u32, index: u32, event: u32, purpose: u32) -> vec4<u32> {
    return pcg4d(vec4<u32>(stream, index, event, purpose));
}

// 2^-24
const PER_UNIT: f32 = 5.9604644775390625e-8;

// A word as a number in [0, 1): its upper 24 bits, all of which f32 can hold.
fn unit(word: u32) -> f32 {
    return f32(word >> 8u) * PER_UNIT;
}

fn unit4(words: vec4<u32>) -> vec4<f32> {
    return vec4<f32>(words >> vec4<u32>(8u)) * PER_UNIT;
}

// Distance between points of a Poisson process of unit rate.
fn exponential(u: f32) -> f32 {
    return -log(1.0 - u);
}
