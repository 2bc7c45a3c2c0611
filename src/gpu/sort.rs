//! Sorting 32-bit keys, each with which it is: by counting where keys are small, by digits where not.

use std::sync::Arc;

use super::kernel::Kernel;
use super::layout::shared_struct;
use super::run::Stage;
use super::scan::Scanner;
use super::{GROUP, Gpu};
use crate::error::Result;

/// Bits of a digit.
pub const DIGIT_BITS: u32 = 4;
/// Keys that one work group puts in order.
pub const SORT_BLOCK: u32 = 1024;

shared_struct! {
    /// What the kernels of the counting sort are told.
    pub struct CountParams {
        /// Keys.
        pub count: u32,
    }
}

shared_struct! {
    /// What the kernels of the radix sort are told.
    pub struct DigitParams {
        /// Keys.
        pub count: u32,
        /// Blocks of them.
        pub blocks: u32,
        /// Bits below the digit.
        pub shift: u32,
        /// 1 where nothing was put in another order yet.
        pub is_first: u32,
    }
}

/// How keys are sorted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sort {
    /// How many there are of each is counted, and they are put side by side. Equal keys come in any
    /// order.
    Counting,
    /// Digit after digit, from the last. Equal keys stay in their order.
    Radix,
}

impl Sort {
    /// The one that was measured to be faster, for so many keys `below` a bound: counting, unless it
    /// has to look at many times more keys than there are.
    pub fn fastest(count: u32, below: u32) -> Self {
        if u64::from(below) <= MOST_BELOW * u64::from(count).max(1 << 16) {
            Self::Counting
        } else {
            Self::Radix
        }
    }
}

/// The bound of keys, over how many there are, up to which they are counted: at 4 that was measured to
/// be faster, at 32 the digits were (`cargo bench --bench sort`).
const MOST_BELOW: u64 = 8;

/// Sorts up to a fixed number of keys.
pub struct Sorter {
    below: u32,
    scanner: Scanner,
    how: How,
}

enum How {
    Counting { count: Arc<Kernel>, place: Arc<Kernel>, starts: wgpu::Buffer, sorted: Pairs },
    Radix { digits: Arc<Kernel>, scatter: Arc<Kernel>, places: wgpu::Buffer, passes: [Pairs; 2] },
}

/// Keys in another order, with which they are.
pub struct Pairs {
    /// The keys.
    pub keys: wgpu::Buffer,
    /// The place of each among those that were sorted.
    pub order: wgpu::Buffer,
}

impl Pairs {
    fn new(gpu: &Gpu, capacity: u32) -> Result<Self> {
        let words = || gpu.buffer::<u32>("sorted", capacity as usize);
        Ok(Self { keys: words()?, order: words()? })
    }
}

impl Sorter {
    /// Room for `capacity` keys `below` a bound.
    ///
    /// # Errors
    /// The memory is refused.
    pub fn new(gpu: &Gpu, capacity: u32, below: u32, sort: Sort) -> Result<Self> {
        let pairs = || Pairs::new(gpu, capacity);
        let (words, how) = match sort {
            Sort::Counting => {
                let words = below + 1;
                let how = How::Counting {
                    count: gpu.kernel("sort_count", &[])?,
                    place: gpu.kernel("sort_place", &[])?,
                    starts: gpu.buffer::<u32>("sort starts", words as usize)?,
                    sorted: pairs()?,
                };
                (words, how)
            }
            Sort::Radix => {
                let words = capacity.div_ceil(SORT_BLOCK) << DIGIT_BITS;
                let how = How::Radix {
                    digits: gpu.kernel("sort_digits", &[])?,
                    scatter: gpu.kernel("sort_scatter", &[])?,
                    places: gpu.buffer::<u32>("sort places", words as usize)?,
                    passes: [pairs()?, pairs()?],
                };
                (words, how)
            }
        };
        Ok(Self { below, scanner: Scanner::new(gpu, words)?, how })
    }

    /// Records the sort of the first `count` of the keys.
    ///
    /// # Errors
    /// The device refuses.
    pub fn record(&self, stage: &mut Stage, keys: &wgpu::Buffer, count: u32) -> Result<()> {
        match &self.how {
            How::Counting { count: tally, place, starts, sorted } => {
                stage.clear(starts);
                let bindings = [
                    ("keys", keys.into()),
                    ("starts", starts.into()),
                    ("sorted", (&sorted.keys).into()),
                    ("order", (&sorted.order).into()),
                ];
                let params = CountParams { count };
                stage.dispatch(tally, count.into(), &bindings, &params)?;
                self.scanner.record(stage, starts, self.below + 1)?;
                stage.dispatch(place, count.into(), &bindings, &params)
            }
            How::Radix { digits, scatter, places, passes } => {
                let blocks = count.div_ceil(SORT_BLOCK);
                let threads = u64::from(blocks) * u64::from(GROUP);
                let mut seen = keys;
                for (i, shift) in self.shifts().enumerate() {
                    let [to, before] = [&passes[i % 2], &passes[(i + 1) % 2]];
                    let bindings = [
                        ("keys", seen.into()),
                        ("places", places.into()),
                        ("order", (&before.order).into()),
                        ("sorted", (&to.keys).into()),
                        ("ordered", (&to.order).into()),
                    ];
                    let params = DigitParams { count, blocks, shift, is_first: (i == 0).into() };
                    stage.dispatch(digits, threads, &bindings, &params)?;
                    self.scanner.record(stage, places, blocks << DIGIT_BITS)?;
                    stage.dispatch(scatter, threads, &bindings, &params)?;
                    seen = &to.keys;
                }
                Ok(())
            }
        }
    }

    /// Bits below each digit that keys may have.
    fn shifts(&self) -> impl ExactSizeIterator<Item = u32> {
        let bits = u32::BITS - self.below.saturating_sub(1).leading_zeros();
        (0..bits.max(1)).step_by(DIGIT_BITS as usize)
    }

    /// What was sorted.
    pub fn sorted(&self) -> &Pairs {
        match &self.how {
            How::Counting { sorted, .. } => sorted,
            How::Radix { passes, .. } => &passes[(self.shifts().len() - 1) % 2],
        }
    }
}
