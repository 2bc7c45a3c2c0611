// Sums of light are integers: each contribution is scaled, rounded once, and added to
// a wrapping 64-bit sum of two words. Integer addition has no order and an exact
// inverse. A contribution that does not fit 32 bits is clamped, and that is counted.

struct Rounded {
    value: u32,
    clamped: bool,
}

const LARGEST: f32 = 4294967040.0;  // the greatest f32 below 2^32

// To the nearest integer, without an addition: a contribution is a product, and a compiler may
// contract product and sum in one place where a kernel asks for it, and not in another.
fn rounded(contribution: f32) -> Rounded {
    return Rounded(u32(clamp(round(contribution), 0.0, LARGEST)), !(contribution < LARGEST));
}

fn added(sum: vec2<u32>, value: u32) -> vec2<u32> {
    let low = sum.x + value;
    return vec2<u32>(low, sum.y + select(0u, 1u, low < value));
}

fn taken_out(sum: vec2<u32>, value: u32) -> vec2<u32> {
    return vec2<u32>(sum.x - value, sum.y - select(0u, 1u, sum.x < value));
}

fn total(sum: vec2<u32>, more: vec2<u32>) -> vec2<u32> {
    let low = sum.x + more.x;
    return vec2<u32>(low, sum.y + more.y + select(0u, 1u, low < more.x));
}

// A contribution that may be larger than 32 bits, rounded once. What is beyond 2^63 stays
// above all that a sum may be.
fn rounded_wide(contribution: f32) -> vec2<u32> {
    if contribution < LARGEST { return vec2<u32>(rounded(contribution).value, 0u); }
    let high = floor(min(contribution, 9223372036854775808.0) / 4294967296.0);
    return vec2<u32>(u32(contribution - high * 4294967296.0), u32(high));
}

fn sum_to_float(sum: vec2<u32>) -> f32 {
    return f32(sum.y) * 4294967296.0 + f32(sum.x);
}
