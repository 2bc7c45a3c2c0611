//! Work lists: the items that an update works on, compacted by a prefix sum.

use std::sync::Arc;

use crate::error::Result;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::run::Stage;
use crate::gpu::scan::Scanner;
use crate::gpu::{Gpu, Words};
use crate::light::hash;

shared_struct! {
    /// What the compaction kernel is told.
    pub struct ListParams {
        /// Items that may be marked.
        pub count: u32,
    }
}

shared_struct! {
    /// What the fill kernel is told.
    pub struct FillParams {
        /// The pattern's first four words.
        pub low: [u32; 4],
        /// The pattern's other words.
        pub high: [u32; 4],
        /// Words of the pattern.
        pub period: u32,
        /// Words to fill.
        pub count: u32,
        /// Added to a word for each before it.
        pub rise: u32,
        /// Keeps the size a multiple of 16.
        pub pad: u32,
    }
}

/// Some of `capacity` items, each once.
pub struct WorkList {
    /// The listed items: the first `count` words.
    pub items: wgpu::Buffer,
    /// A bit for each item: whether it is to be listed.
    pub marks: wgpu::Buffer,
    /// How many are listed.
    pub count: u32,
    capacity: u32,
    /// How many are marked in the words before each.
    pub ranks: wgpu::Buffer,
    scanner: Scanner,
    rank: Arc<Kernel>,
    list: Arc<Kernel>,
    fill: Arc<Kernel>,
}

impl WorkList {
    /// An empty list.
    ///
    /// # Errors
    /// The device refuses the memory.
    pub fn new(gpu: &Gpu, capacity: u32) -> Result<Self> {
        let words = capacity.div_ceil(32);
        Ok(Self {
            items: gpu.buffer::<u32>("work list", capacity as usize)?,
            marks: gpu.buffer::<u32>("work list marks", words as usize)?,
            count: 0,
            capacity,
            ranks: gpu.buffer::<u32>("work list ranks", words as usize + 1)?,
            scanner: Scanner::new(gpu, words + 1)?,
            rank: gpu.kernel("list_rank", &[])?,
            list: gpu.kernel("list", &[])?,
            fill: gpu.kernel("fill", &[])?,
        })
    }

    /// Lists all items, as the end of a stage; `shuffle` puts them in another order.
    ///
    /// # Errors
    /// The device failed.
    pub fn fill(&mut self, mut stage: Stage, shuffle: Option<u64>) -> Result<()> {
        self.count = self.capacity;
        if shuffle.is_some() {
            stage.gpu().write(&self.items, &shuffled((0..self.capacity).collect(), shuffle));
        } else {
            let params =
                FillParams { period: 1, count: self.capacity, rise: 1, ..Default::default() };
            let data = [("data", (&self.items).into())];
            stage.dispatch(&self.fill, self.capacity.into(), &data, &params)?;
        }
        stage.finish()
    }

    /// Marks no item.
    pub fn unmark(&self, stage: &mut Stage) {
        stage.clear(&self.marks);
    }

    /// Marks every item.
    ///
    /// # Errors
    /// The device failed.
    pub fn mark_all(&self, gpu: &Gpu) -> Result<()> {
        fill(gpu, "list", &self.marks, &[u32::MAX])
    }

    /// Where the device has how many are listed.
    pub fn length(&self) -> Words<'_> {
        let words = u64::from(self.capacity.div_ceil(32));
        (&self.ranks, words..words + 1)
    }

    /// Reads how many items lists have that were recorded.
    ///
    /// # Errors
    /// The device failed.
    pub fn learn(gpu: &Gpu, lists: &mut [&mut Self]) -> Result<()> {
        if lists.is_empty() {
            return Ok(());
        }
        let parts = lists.iter().map(|list| list.length()).collect::<Vec<_>>();
        let counts = gpu.read_words("list", &parts)?;
        lists.iter_mut().zip(counts).for_each(|(list, count)| list.count = count);
        Ok(())
    }

    /// Ranks the words of marks.
    ///
    /// # Errors
    /// The device refuses.
    pub fn rank(&self, stage: &mut Stage) -> Result<()> {
        let words = self.capacity.div_ceil(32);
        let bindings = [("marks", (&self.marks).into()), ("ranks", (&self.ranks).into())];
        let params = ListParams { count: self.capacity };
        stage.dispatch(&self.rank, u64::from(words) + 1, &bindings, &params)?;
        self.scanner.record(stage, &self.ranks, words + 1)
    }

    /// Lists the marked items, in their order, as the end of the stage that marks them. How many
    /// they are is to be learned yet.
    ///
    /// # Errors
    /// The device failed.
    pub fn record(&self, mut stage: Stage) -> Result<()> {
        self.rank(&mut stage)?;
        let bindings = [
            ("marks", (&self.marks).into()),
            ("ranks", (&self.ranks).into()),
            ("work", (&self.items).into()),
        ];
        let words = self.capacity.div_ceil(32);
        let params = ListParams { count: self.capacity };
        stage.dispatch(&self.list, words.into(), &bindings, &params)?;
        stage.finish()
    }

    /// Puts the items in another order, if there is a seed for it.
    ///
    /// # Errors
    /// The device failed.
    pub fn shuffle(&self, gpu: &Gpu, seed: Option<u64>) -> Result<()> {
        if seed.is_some() {
            let mut items = gpu.read::<u32>("list", &self.items)?;
            items.truncate(self.count as usize);
            gpu.write(&self.items, &shuffled(items, seed));
        }
        Ok(())
    }

    /// Bytes of items, marks and ranks.
    pub fn bytes(&self) -> u64 {
        self.items.size() + self.marks.size() + self.ranks.size()
    }
}

fn shuffled(mut items: Vec<u32>, seed: Option<u64>) -> Vec<u32> {
    if let Some(seed) = seed {
        for i in (1..items.len()).rev() {
            let other = hash(seed ^ (i as u64) << 20) as usize % (i + 1);
            items.swap(i, other);
        }
    }
    items
}

/// Fills a buffer of words with a repeating pattern of at most eight.
///
/// # Errors
/// The device failed.
pub fn fill(gpu: &Gpu, stage: &'static str, buffer: &wgpu::Buffer, pattern: &[u32]) -> Result<()> {
    let mut words = [0; 8];
    words[..pattern.len()].copy_from_slice(pattern);
    let [a, b, c, d, e, f, g, h] = words;
    let count = (buffer.size() / 4) as u32;
    let period = pattern.len() as u32;
    let params =
        FillParams { low: [a, b, c, d], high: [e, f, g, h], period, count, ..Default::default() };
    let kernel = gpu.kernel("fill", &[])?;
    let mut stage = gpu.stage(stage);
    stage.dispatch(&kernel, count.into(), &[("data", buffer.into())], &params)?;
    stage.finish()
}
