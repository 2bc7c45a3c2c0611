//! The ways of adapters: what one of software needs, and those of hardware do not.

use std::num::NonZero;

use super::{AdapterReport, SOFTWARE};

/// How work is shaped for an adapter. No choice here changes a bit of the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ways {
    /// Turns that the loops of one thread may take in a dispatch. Mesa's software adapter ends all
    /// loops of a thread after 65 535; other drivers lose patience after a second or two.
    pub turns: u32,
    /// How much larger the first slices of work are than on an adapter of software.
    pub first_slices: u64,
    /// Parts in which the adapter deals the groups of a dispatch: Mesa's software adapter gives
    /// each of its threads as many in a row, and those of a picture's empty side soon rest.
    pub parts: u32,
}

impl Ways {
    /// Those of an adapter.
    pub fn of(adapter: &AdapterReport) -> Self {
        if adapter.kind != SOFTWARE {
            return Self { turns: 1 << 20, first_slices: 16, parts: 1 };
        }
        let cores = std::thread::available_parallelism().map_or(1, NonZero::get);
        Self { turns: 65_535, first_slices: 1, parts: cores as u32 }
    }
}
