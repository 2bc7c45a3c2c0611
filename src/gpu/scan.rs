//! Exclusive prefix sums of 32-bit words, in place, in blocks of [`SCAN_BLOCK`].

use std::sync::Arc;

use super::kernel::Kernel;
use super::layout::shared_struct;
use super::pool::Pooled;
use super::run::Stage;
use super::{GROUP, Gpu};
use crate::error::Result;

/// Words that one work group scans.
pub const SCAN_BLOCK: u32 = 1024;

shared_struct! {
    /// What a scan kernel is told.
    pub struct ScanParams {
        /// Words to scan.
        pub count: u32,
    }
}

/// Scans up to a fixed number of words.
pub struct Scanner {
    blocks: Arc<Kernel>,
    totals: Arc<Kernel>,
    /// Block totals of each level, and of the levels above.
    sums: Vec<Pooled>,
}

impl Scanner {
    /// Room for `capacity` words.
    ///
    /// # Errors
    /// The allocation is refused.
    pub fn new(gpu: &Gpu, capacity: u32) -> Result<Self> {
        let mut sums = Vec::new();
        let mut count = capacity.max(1);
        loop {
            count = count.div_ceil(SCAN_BLOCK);
            sums.push(gpu.lend::<u32>("scan sums", count as usize)?);
            if count == 1 {
                break;
            }
        }
        let (blocks, totals) = (gpu.kernel("scan_blocks", &[])?, gpu.kernel("scan_sums", &[])?);
        Ok(Self { blocks, totals, sums })
    }

    /// Records the scan of the first `count` words of `data`.
    ///
    /// # Errors
    /// The device refuses.
    pub fn record(&self, stage: &mut Stage, data: &wgpu::Buffer, count: u32) -> Result<()> {
        self.level(stage, data, count, 0)
    }

    fn level(&self, stage: &mut Stage, data: &wgpu::Buffer, count: u32, at: usize) -> Result<()> {
        let (params, sums) = (ScanParams { count }, &self.sums[at]);
        let bindings = [("data", data.into()), ("sums", sums.into())];
        let blocks = count.div_ceil(SCAN_BLOCK).max(1);
        let threads = u64::from(blocks * GROUP);
        if blocks > 1 {
            stage.dispatch(&self.totals, threads, &bindings, &params)?;
            self.level(stage, sums, blocks, at + 1)?;
        }
        stage.dispatch(&self.blocks, threads, &bindings, &params)
    }
}
