// The light of a segment as the points light field leaves it: integer sums, so that
// light that was seen can be taken out with nothing left over. Three sums of 52 bits, eight
// words with transmittance and history.

import package::shared::counter::{OVERFLOWN, count};
import package::shared::sum64::added_signed;

const HIGH: u32 = 0xfffffu;  // bits of a sum above its low word

struct Sums {
    red: vec2<u32>,
    green: vec2<u32>,
    blue: vec2<u32>,
}

fn sums_with(s: Sums, value: vec3<i32>) -> Sums {
    return Sums(
        added_signed(s.red, value.r),
        added_signed(s.green, value.g),
        added_signed(s.blue, value.b)
    );
}

// `low` are words 0 to 2 of a segment, `high` words 6 and 7.
fn unpack_sums(low: vec3<u32>, high: vec2<u32>) -> Sums {
    return Sums(
        vec2<u32>(low.x, high.x & HIGH),
        vec2<u32>(low.y, (high.x >> 20u) | ((high.y & 0xffu) << 12u)),
        vec2<u32>(low.z, (high.y >> 8u) & HIGH)
    );
}

fn pack_high(sums: Sums) -> vec2<u32> {
    count(OVERFLOWN, u32(max(sums.red.y, max(sums.green.y, sums.blue.y)) > HIGH));
    return vec2<u32>(
        (sums.red.y & HIGH) | (sums.green.y << 20u),
        ((sums.green.y & HIGH) >> 12u) | (sums.blue.y << 8u)
    );
}
