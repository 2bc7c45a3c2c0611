// Counters that the host reads back, in the order of `Counters` in src/counter.rs: 64-bit
// sums, each in COUNTER_STRIPES parts, all low words first. Threads side by side count in
// parts side by side: where all count in one word, a GPU has them wait for each other.
//
// After them is what kernels choose for those that come later: a word each, 0 until then.

import package::constants::{COUNTER_STRIPES, COUNTER_WORDS};
import package::shared::item::thread;

const TENTATIVE: u32 = 0u;     // tentative collisions
const INTERACTIONS: u32 = 1u;  // photon interactions stored
const CLAMPED: u32 = 2u;       // contributions clamped
const DEPOSITS: u32 = 3u;      // cells that flights were added to
const GATHERED: u32 = 4u;      // photons that a gather tested
const SAMPLES: u32 = 5u;       // march samples of view rays
const CHECKED: u32 = 6u;       // blocks that view rays looked for changed light in
const INVALID: u32 = 7u;       // photons with a flight to be traced again
const REWEIGHED: u32 = 8u;     // photons with a slot whose power alone is found again
const CHANGED: u32 = 9u;       // photons that tracing again has changed
const UNFINISHED: u32 = 10u;   // photons whose loops the driver ended
const OVERFLOWN: u32 = 11u;    // segments whose sums do not fit
const STEPS: u32 = 12u;        // macro-cells that flights entered
const MOVED: u32 = 13u;        // slots that came, went or are elsewhere
const REPOWERED: u32 = 14u;    // slots where they were, of another power
const REFRESHED: u32 = 15u;    // means and lights found again for points that the table had
const UNFINISHED_LIGHT: u32 = 16u;     // flights, cells and points whose loops it ended
const UNFINISHED_SEGMENTS: u32 = 17u;

@group(0) @binding(7) var<storage, read_write> counters: array<atomic<u32>>;

fn count(which: u32, amount: u32) {
    if amount == 0u { return; }
    let part = 2u * which * COUNTER_STRIPES + thread % COUNTER_STRIPES;
    let low = atomicAdd(&counters[part], amount);
    if low + amount < low { atomicAdd(&counters[part + COUNTER_STRIPES], 1u); }
}

// Makes a choice.
fn choose(which: u32) {
    let at = COUNTER_WORDS + which;
    if atomicLoad(&counters[at]) == 0u { atomicStore(&counters[at], 1u); }
}

// Some drivers end a thread's loops without a word (Mesa's software adapter after 65 535
// iterations of all of them together). Every loop whose length depends on the data says
// afterwards whether it came to its own end; the host splits the work, or refuses.
var<private> cut_short: bool = false;

fn expect(finished: bool) {
    if !finished { cut_short = true; }
}
