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

/// Classes of marks that photon histories tell apart: 64 bits are 16 values times 4 classes. Against 64
/// values without classes, fewer flights are found invalid where thin tissue becomes denser, and more
/// where dense tissue does. Bins equalised by the histogram find more by far, and 128 bits save too
/// little for their memory (`bench bins`).
pub const MARK_CLASSES: u32 = 4;
