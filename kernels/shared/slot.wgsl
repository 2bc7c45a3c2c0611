// Photon slots: event k of photon p lives at slot k * photons + p, an implicit linked
// list. A slot is 32 bytes in two arrays; photons continue from what is stored, so a
// resumed photon and one traced in full see the same numbers.

const EMPTY: u32 = 0u;
const INTERACTION: u32 = 1u;
const EXIT: u32 = 2u;  // the flight ended in nothing, and its history counts

struct Slot {
    kind: u32,
    position: vec3<f32>,   // mm
    direction: u32,        // of travel on arrival, octahedral
    power: vec2<u32>,      // on arrival, before the interaction's albedo
    entry: u32,            // the table entry that decided the collision
    history: vec2<u32>,
}

fn sign_not_zero(v: vec2<f32>) -> vec2<f32> {
    return select(vec2<f32>(-1.0), vec2<f32>(1.0), v >= vec2<f32>(0.0));
}

// Octahedral direction, 2 x 16 bits: Cigolle et al., JCGT 3(2), 2014.
fn pack_direction(d: vec3<f32>) -> u32 {
    let p = d.xy / (abs(d.x) + abs(d.y) + abs(d.z));
    return pack2x16snorm(select(p, (1.0 - abs(p.yx)) * sign_not_zero(p), d.z < 0.0));
}

fn unpack_direction(word: u32) -> vec3<f32> {
    let p = unpack2x16snorm(word);
    let z = 1.0 - abs(p.x) - abs(p.y);
    let xy = select(p, (1.0 - abs(p.yx)) * sign_not_zero(p), z < 0.0);
    return normalize(vec3(xy, z));
}

fn power_of_two(exponent: i32) -> f32 {
    return bitcast<f32>(u32(exponent + 127) << 23u);
}

// Three 14-bit mantissas under one exponent: 3e-5 of the largest channel. Fifty bits;
// the upper 14 of the second word stay free for the entry and the kind.
fn pack_mantissas(m: vec3<u32>, exponent: i32) -> vec2<u32> {
    return vec2<u32>(m.x | (m.y << 14u) | (m.z << 28u), (m.z >> 4u) | (u32(exponent + 128) << 10u));
}

fn mantissas(words: vec2<u32>) -> vec3<u32> {
    return vec3<u32>(
        words.x & 16383u,
        (words.x >> 14u) & 16383u,
        (words.x >> 28u) | ((words.y & 1023u) << 4u)
    );
}

fn power_exponent(words: vec2<u32>) -> i32 {
    return i32((words.y >> 10u) & 255u) - 128;
}

fn pack_power(power: vec3<f32>) -> vec2<u32> {
    let largest = max(power.x, max(power.y, power.z));
    if !(largest > 1e-30) {
        return vec2<u32>(0u);
    }
    let exponent = clamp(i32((bitcast<u32>(largest) >> 23u) & 255u) - 126, -100, 100);
    let scaled = power * power_of_two(14 - exponent) + 0.5;
    let m = min(vec3<u32>(max(scaled, vec3<f32>(0.0))), vec3<u32>(16383u));
    return pack_mantissas(m, exponent);
}

fn unpack_power(words: vec2<u32>) -> vec3<f32> {
    let m = mantissas(words);
    if all(m == vec3<u32>(0u)) {
        return vec3<f32>(0.0);
    }
    return vec3<f32>(m) * power_of_two(power_exponent(words) - 14);
}

// A packed power times `share` / 2^18 * 2^doublings, the share being at most 2^18: in
// integers, so that every kernel and every device finds the same.
fn scaled_power(words: vec2<u32>, share: vec3<u32>, doublings: i32) -> vec2<u32> {
    let product = mantissas(words) * share;  // below 2^32
    let largest = max(product.x, max(product.y, product.z));
    let bits = 32 - i32(countLeadingZeros(largest));
    let exponent = min(power_exponent(words) + bits - 32 + doublings, 100);
    if largest == 0u || exponent < -99 {
        return vec2<u32>(0u);
    }
    var m = product << vec3<u32>(u32(max(14 - bits, 0)));
    if bits > 14 {
        m = ((product >> vec3<u32>(u32(bits - 15))) + 1u) >> vec3<u32>(1u);
    }
    return pack_mantissas(min(m, vec3<u32>(16383u)), exponent);
}

fn slot_place(s: Slot) -> vec4<u32> {
    return vec4<u32>(bitcast<vec3<u32>>(s.position), s.direction);
}

fn slot_state(s: Slot) -> vec4<u32> {
    let tagged = (s.power.y & 0x3ffffu) | (s.entry << 18u) | (s.kind << 30u);
    return vec4<u32>(s.power.x, tagged, s.history);
}

fn slot_kind(state: vec4<u32>) -> u32 {
    return state.y >> 30u;
}

fn slot_entry(state: vec4<u32>) -> u32 {
    return (state.y >> 18u) & 0xfffu;
}

// Packed.
fn slot_power(state: vec4<u32>) -> vec2<u32> {
    return vec2<u32>(state.x, state.y & 0x3ffffu);
}

fn slot_of(place: vec4<u32>, state: vec4<u32>) -> Slot {
    return Slot(
        slot_kind(state),
        bitcast<vec3<f32>>(place.xyz),
        place.w,
        slot_power(state),
        slot_entry(state),
        state.zw
    );
}
