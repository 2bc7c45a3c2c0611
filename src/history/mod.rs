//! Historygrams: which data values a result relied on, a bit each, and what an edit asks of them.
//!
//! A flight or a segment keeps a 64-bit mask of the bins of all values that could have changed it.
//! An edit of the materials becomes a query mask over the same bins; what the two share must be
//! computed again, H(10).

mod bins;
mod query;

pub use bins::{BINS, Bins};
pub use query::{
    CHANGE_ALBEDO, CHANGE_EMISSION, CHANGE_FALLEN, CHANGE_PHASE, CHANGE_RISEN, CHANGE_SCATTERING,
    Query,
};

/// Layers of a flight's marks: octaves below the majorant.
pub const LAYERS: u32 = 8;

/// Classes of marks that photon histories tell apart, in as many of their 64 bits.
pub const MARK_CLASSES: u32 = 4;
