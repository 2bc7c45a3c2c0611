// Counters that the host reads back: 64-bit sums, low word first. The order is that
// of `Counters` in src/photon.rs.

const TENTATIVE: u32 = 0u;     // tentative collisions
const INTERACTIONS: u32 = 1u;  // photon interactions stored
const CLAMPED: u32 = 2u;       // contributions clamped
const DEPOSITS: u32 = 3u;      // cells that flights were added to
const GATHERED: u32 = 4u;      // photons that a gather tested
const SAMPLES: u32 = 5u;       // march samples of view rays
