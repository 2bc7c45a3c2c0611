//! A stable radix sort of 32-bit keys with 32-bit values, least digit first.
//!
//! Four bits a pass: each thread counts a run of consecutive items in its own column
//! of work-group memory, so that equal keys keep their order without atomics.
//! `radsort` on the host is the oracle.

use std::sync::Arc;

use super::kernel::Kernel;
use super::layout::shared_struct;
use super::scan::Scanner;
use super::{GROUP, Gpu};
use crate::error::Result;

/// Items that one work group sorts.
pub const SORT_BLOCK: u32 = 1024;
/// Bits of a digit.
pub const RADIX_BITS: u32 = 4;
/// Values of a digit.
pub const RADIX: u32 = 1 << RADIX_BITS;

shared_struct! {
    /// What a sort kernel is told.
    pub struct SortParams {
        /// Items to sort.
        pub count: u32,
        /// Work groups.
        pub blocks: u32,
        /// The digit's place, in bits.
        pub shift: u32,
        /// The digit's bits, before they are shifted there.
        pub mask: u32,
    }
}

/// Sorts up to a fixed number of pairs.
pub struct Sorter {
    count: Arc<Kernel>,
    scatter: Arc<Kernel>,
    scanner: Scanner,
    counts: wgpu::Buffer,
    keys: wgpu::Buffer,
    values: wgpu::Buffer,
}

impl Sorter {
    /// Room for `capacity` pairs.
    ///
    /// # Errors
    /// The allocation is refused.
    pub fn new(gpu: &Gpu, capacity: u32) -> Result<Self> {
        let counts = capacity.div_ceil(SORT_BLOCK).max(1) * RADIX;
        Ok(Self {
            count: gpu.kernel("sort_count", &[])?,
            scatter: gpu.kernel("sort_scatter", &[])?,
            scanner: Scanner::new(gpu, counts)?,
            counts: gpu.buffer::<u32>("sort counts", counts as usize)?,
            keys: gpu.buffer::<u32>("sort keys", capacity as usize)?,
            values: gpu.buffer::<u32>("sort values", capacity as usize)?,
        })
    }

    /// Sorts the first `count` pairs by the low `bits` of their keys.
    ///
    /// # Errors
    /// The device fails.
    pub fn sort(
        &self,
        gpu: &Gpu,
        keys: &wgpu::Buffer,
        values: &wgpu::Buffer,
        count: u32,
        bits: u32,
    ) -> Result<()> {
        if count < 2 {
            return Ok(());
        }
        let mut stage = gpu.stage("sort");
        let blocks = count.div_ceil(SORT_BLOCK);
        let threads = u64::from(blocks * GROUP);
        let mut from = (keys, values);
        let mut to = (&self.keys, &self.values);
        for shift in (0..bits).step_by(RADIX_BITS as usize) {
            let mask = (1 << RADIX_BITS.min(bits - shift)) - 1;
            let params = SortParams { count, blocks, shift, mask };
            let bindings = [
                ("keys", from.0.into()),
                ("values", from.1.into()),
                ("counts", (&self.counts).into()),
                ("sorted_keys", to.0.into()),
                ("sorted_values", to.1.into()),
            ];
            stage.dispatch(&self.count, threads, &bindings, &params)?;
            self.scanner.record(&mut stage, &self.counts, blocks * RADIX)?;
            stage.dispatch(&self.scatter, threads, &bindings, &params)?;
            std::mem::swap(&mut from, &mut to);
        }
        if !std::ptr::eq(from.0, keys) {
            let bytes = u64::from(count) * 4;
            stage.copy(from.0, keys, bytes);
            stage.copy(from.1, values, bytes);
        }
        stage.finish()
    }

    /// Bytes of its buffers.
    pub fn bytes(&self) -> u64 {
        self.counts.size() + self.keys.size() + self.values.size()
    }
}
