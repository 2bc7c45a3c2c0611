//! Bits that host and kernels agree on: hashes, masks as two words, the scale of integer sums.

/// What a typical contribution to an integer sum is scaled to: 22 bits of precision,
/// and room for one five hundred times as large before 31 bits clamp it.
pub const CONTRIBUTION: f64 = (1 << 22) as f64;

/// Mixes all bits of a word: the finaliser of SplitMix64.
pub fn hash_wide(word: u64) -> u64 {
    let word = word.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let word = (word ^ word >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let word = (word ^ word >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    word ^ word >> 31
}

/// A seed as the kernels take it: 32 well-mixed bits.
pub fn hash(seed: u64) -> u32 {
    (hash_wide(seed) >> 32) as u32
}

/// The two words that a kernel sees of a 64-bit mask, low one first.
pub fn words(mask: u64) -> [u32; 2] {
    [mask as u32, (mask >> 32) as u32]
}
