// What the light field does not know of a batch's slots yet: two bits for each, in words of 32 slots.

struct SlotMarks {
    moved: atomic<u32>,    // came, went or is elsewhere
    altered: atomic<u32>,  // may give other light where it is: of another power, or of a material that
                           // scatters otherwise
}

@group(0) @binding(21) var<storage, read_write> slot_marks: array<SlotMarks>;

fn mark_moved(slot: u32) {
    atomicOr(&slot_marks[slot / 32u].moved, 1u << (slot % 32u));
}

fn mark_altered(slot: u32) {
    atomicOr(&slot_marks[slot / 32u].altered, 1u << (slot % 32u));
}
