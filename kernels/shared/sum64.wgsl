// Sums of light are integers: each contribution is scaled, rounded once, and added to
// a wrapping 64-bit sum of two words. Integer addition has no order and an exact
// inverse. A contribution that does not fit 32 bits, one of them for the sign where it has one, is
// clamped, and that is counted.

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

struct RoundedSigned {
    value: i32,
    clamped: bool,
}

const LARGEST_SIGNED: f32 = 2147483520.0;  // the greatest f32 below 2^31

// The same of light that may be taken out: what is less than zero has the opposite value.
fn rounded_signed(contribution: f32) -> RoundedSigned {
    let value = i32(clamp(round(contribution), -LARGEST_SIGNED, LARGEST_SIGNED));
    return RoundedSigned(value, !(abs(contribution) < LARGEST_SIGNED));
}

fn added_signed(sum: vec2<u32>, value: i32) -> vec2<u32> {
    return total(sum, vec2<u32>(u32(value), u32(value >> 31u)));
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
