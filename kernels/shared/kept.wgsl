// Which points are kept: a bit each, and how many are kept before each word of them.

@group(0) @binding(17) var<storage, read> kept: array<u32>;
@group(0) @binding(18) var<storage, read> ranks: array<u32>;

fn is_kept(point: u32) -> bool {
    return extractBits(kept[point / 32u], point % 32u, 1u) == 1u;
}

// How many are kept before a point, or before the end.
fn kept_before(point: u32) -> u32 {
    let below = (1u << (point % 32u)) - 1u;
    return ranks[point / 32u] + countOneBits(kept[point / 32u] & below);
}
