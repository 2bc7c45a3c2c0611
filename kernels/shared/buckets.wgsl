// The bucket of a cell, for who puts points there: a run of cells that has none yet is given the slot
// where its search ends.

import package::shared::points::{PointsParams, RUN, run_of, bit_of, first_slot, next_slot, slot_at};

@group(0) @binding(19) var<storage, read_write> starts: array<atomic<u32>>;

@if(!hashed)
fn bucket_for(key: u32, params: PointsParams) -> u32 {
    return key;
}

// There are more slots than runs that ever come (`Buckets` in src/field/points/buckets.rs), so it
// is found.
@if(hashed)
fn bucket_for(key: u32, params: PointsParams) -> u32 {
    let run = run_of(key);
    let own = bit_of(run, params);
    if (atomicLoad(&starts[own.word]) & own.bit) == 0u { atomicOr(&starts[own.word], own.bit); }
    var slot = first_slot(run, params);
    loop {
        let at = slot_at(slot, params);
        var held = atomicLoad(&starts[at]);
        if held == 0u { held = max(atomicCompareExchangeWeak(&starts[at], 0u, run).old_value, held); }
        if held == 0u { held = atomicLoad(&starts[at]); }
        if held == run { break; }
        // An exchange may fail for no reason: then it is tried again.
        if held != 0u { slot = next_slot(slot, params); }
    }
    return RUN * slot + key % RUN;
}
