// The journal: what a part of the work list held before it is worked on anew, laid out as a batch
// of these photons alone. First all places, then all states, so that the kernel that adds flights up
// can take either for those of a batch.

@group(0) @binding(13) var<storage, read_write> journal: array<vec4<u32>>;

fn state_in_journal(slot: u32) -> u32 {
    return arrayLength(&journal) / 2u + slot;
}
