//! How much of long work fits a slice of time.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::clock::milliseconds;
use super::{GROUP, Gpu, lock};

/// How many items of one kind of work a slice takes, as its past slices tell.
#[derive(Clone, Debug)]
pub struct Pace(Arc<Mutex<Known>>);

#[derive(Clone, Copy, Debug)]
struct Known {
    slice: u64,
    /// So many fitted the budget.
    proven: u64,
}

/// One slice, that its time may teach.
#[derive(Clone, Debug)]
pub(super) struct Slice {
    /// The same for all dispatches of it, and for no other slice.
    pub number: u64,
    pub items: u64,
    pub pace: Pace,
}

impl Slice {
    pub fn learn(&self, ms: f64, budget: Duration) {
        self.pace.learn(self.items, ms / milliseconds(budget));
    }
}

impl Pace {
    /// Nothing is known yet but a slice to begin with: so many items on the slowest of adapters.
    pub fn new(gpu: &Gpu, items: u64) -> Self {
        let slice = items * gpu.ways().first_slices;
        Self(Arc::new(Mutex::new(Known { slice, proven: 0 })))
    }

    /// Items of the next slice.
    pub fn slice(&self) -> u64 {
        lock(&self.0).slice
    }

    /// Whether so many items fitted the budget before.
    pub(super) fn has_proven(&self, items: u64) -> bool {
        items <= lock(&self.0).proven
    }

    /// Whether anything was learned.
    pub fn is_learned(&self) -> bool {
        lock(&self.0).proven > 0
    }

    /// Learns from a slice of `items` that took `share` of the budget.
    fn learn(&self, items: u64, share: f64) {
        let mut known = lock(&self.0);
        // The last slice is short, and tells no more than that it did not take too long.
        if items >= known.slice || share > 1.0 {
            let next = items as f64 * share.recip().clamp(0.25, 4.0);
            known.slice = (next as u64).max(GROUP.into());
        }
        known.proven = if share <= 1.0 {
            known.proven.max(items)
        } else {
            known.proven.min(items.saturating_sub(1))
        };
    }
}
