//! How work is cut into parts that fit the device, or as a test wants them.

/// How the work is cut up. No choice here changes a bit of the result.
#[derive(Clone, Copy, Debug, Default)]
pub struct Split {
    /// Photons in a batch, at most; `None`: as many as a binding holds.
    pub batch_photons: Option<u32>,
    /// Rows of a screen band, at most; `None`: as many as a binding holds.
    pub band_rows: Option<u32>,
    /// Photons that the journal of an update holds, at most; `None`: 64 MiB of slots.
    pub journal: Option<u32>,
    /// Slots whose points share a table, at most, unless they are of one batch; `None`: as many as
    /// a binding holds.
    pub table_slots: Option<u32>,
    /// Cells of the grid of points that each have a bucket, at most: more are hashed; `None`: as many
    /// as was measured to be faster.
    pub buckets: Option<u32>,
    /// Another hash of those cells.
    pub salt: Option<u32>,
    /// Whether updates take all points anew, and do not merge those that moved with the others;
    /// `None`: where that was measured to be faster.
    pub anew: Option<bool>,
    /// Shuffles the work lists with this seed, to show that order does not matter.
    pub shuffle: Option<u64>,
}
