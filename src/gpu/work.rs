//! Work lists: the items that an update works on, compacted by a prefix sum.
//!
//! The device has their lengths, in their first words: dispatches over them are indirect
//! ([`Told`]). The host learns them where memory is to be had by them.

use std::sync::Arc;

use crate::bits::hash;
use crate::error::Result;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::pool::Pooled;
use crate::gpu::read::Words;
use crate::gpu::resource::Resource;
use crate::gpu::run::Stage;
use crate::gpu::scan::{SCAN_BLOCK, Scanner};
use crate::gpu::turns::{Told, When};
use crate::gpu::{GROUP, Gpu};

shared_struct! {
    /// What the compaction kernel is told.
    pub struct ListParams {
        /// Items that may be marked.
        pub count: u32,
        /// Blocks of words of marks.
        pub blocks: u32,
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
        /// Added to a word for each before it: a list of all then, whose first word is its length.
        pub rise: u32,
        /// Keeps the size a multiple of 16.
        pub pad: u32,
    }
}

/// Some of `capacity` items, each once.
pub struct WorkList {
    /// How many are listed, and then which.
    pub items: Pooled,
    /// A bit for each item: whether it is to be listed.
    pub marks: Pooled,
    /// How many are listed, if the host has learned it.
    pub count: u32,
    /// How many there are.
    pub capacity: u32,
    /// How many are marked in the blocks before each, and in all.
    pub sums: Pooled,
    scanner: Scanner,
    total: Arc<Kernel>,
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
        let blocks = words.div_ceil(SCAN_BLOCK);
        Ok(Self {
            items: gpu.lend::<u32>("work list", capacity as usize + 1)?,
            marks: gpu.lend::<u32>("work list marks", words as usize)?,
            count: 0,
            capacity,
            sums: gpu.lend::<u32>("work list sums", blocks as usize + 1)?,
            scanner: Scanner::new(gpu, blocks + 1)?,
            total: gpu.kernel("list_sums", &[])?,
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
            let items = shuffled((0..self.capacity).collect(), shuffle);
            stage.gpu().write(&self.items, &[&[self.capacity], items.as_slice()].concat())?;
        } else {
            let count = self.capacity + 1;
            let low = [u32::MAX, 0, 0, 0];
            let params = FillParams { low, period: 1, count, rise: 1, ..Default::default() };
            let data = [("data", (&self.items).into())];
            stage.dispatch(&self.fill, count.into(), &data, &params)?;
        }
        stage.finish()
    }

    /// Its length, for dispatches over it.
    pub fn told(&self) -> Told {
        Told::of(&self.items, self.capacity)
    }

    /// Marks no item.
    pub fn unmark(&self, stage: &mut Stage) {
        stage.clear(&self.marks);
    }

    fn params(&self) -> ListParams {
        ListParams { count: self.capacity, blocks: self.blocks() }
    }

    /// Blocks of words of its marks; the sum of all is behind that of the last.
    pub fn blocks(&self) -> u32 {
        self.capacity.div_ceil(32).div_ceil(SCAN_BLOCK)
    }

    /// Where the device has how many are listed.
    pub fn length(&self) -> Words {
        let blocks = u64::from(self.params().blocks);
        Words { buffer: (*self.sums).clone(), range: blocks..blocks + 1 }
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

    /// Room for the ranks of its words of marks.
    ///
    /// # Errors
    /// The device refuses the memory.
    pub fn ranks(&self, gpu: &Gpu) -> Result<Pooled> {
        gpu.lend::<u32>("work list ranks", self.capacity.div_ceil(32) as usize)
    }

    /// Ranks its words of marks: how many items are marked in those before each.
    ///
    /// # Errors
    /// The device refuses.
    pub fn rank(&self, stage: &mut Stage, ranks: &wgpu::Buffer) -> Result<()> {
        self.compact(stage, &self.rank, ("ranks", ranks.into()))
    }

    /// Lists the marked items, in their order, as the end of the stage that marks them.
    ///
    /// # Errors
    /// The device failed.
    pub fn record(&self, mut stage: Stage) -> Result<()> {
        self.compact(&mut stage, &self.list, ("work", (&self.items).into()))?;
        stage.finish()
    }

    /// Sums the blocks of marks up, and runs a kernel that wants that.
    fn compact(
        &self,
        stage: &mut Stage,
        kernel: &Kernel,
        to: (&'static str, Resource),
    ) -> Result<()> {
        let params = self.params();
        let bindings = [("marks", (&self.marks).into()), ("sums", (&self.sums).into()), to];
        let threads = u64::from(params.blocks) * u64::from(GROUP);
        stage.dispatch(&self.total, threads, &bindings, &params)?;
        self.scanner.record(stage, &self.sums, params.blocks + 1)?;
        stage.dispatch(kernel, threads, &bindings, &params)
    }

    /// Puts the listed items in another order, if there is a seed for it.
    ///
    /// # Errors
    /// The device failed.
    pub fn shuffle(&self, gpu: &Gpu, seed: Option<u64>) -> Result<()> {
        if seed.is_some() {
            let mut items = gpu.read::<u32>("list", &self.items)?;
            let count = items.remove(0);
            items.truncate(count as usize);
            gpu.write(&self.items, &[&[count], shuffled(items, seed).as_slice()].concat())?;
        }
        Ok(())
    }

    /// Bytes of items, marks and sums.
    pub fn bytes(&self) -> u64 {
        self.items.size() + self.marks.size() + self.sums.size()
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
    fill_first(gpu, stage, buffer, (buffer.size() / 4) as u32, pattern)
}

/// Fills the first `count` words of a buffer with a repeating pattern of at most eight.
///
/// # Errors
/// The device failed.
pub fn fill_first(
    gpu: &Gpu,
    stage: &'static str,
    buffer: &wgpu::Buffer,
    count: u32,
    pattern: &[u32],
) -> Result<()> {
    let params = FillParams::of(count, pattern);
    let kernel = gpu.kernel("fill", &[])?;
    let mut stage = gpu.stage(stage);
    stage.dispatch(&kernel, count.into(), &[("data", buffer.into())], &params)?;
    stage.finish()
}

/// Clears a buffer of words to zero where choices were made.
///
/// # Errors
/// The device refuses.
pub fn clear_when(stage: &mut Stage, buffer: &wgpu::Buffer, when: &When) -> Result<()> {
    let count = (buffer.size() / 4) as u32;
    let kernel = stage.gpu().kernel("fill", &[])?;
    let told = Told::known(count, when.clone());
    stage.dispatch_told(&kernel, &told, &[("data", buffer.into())], &FillParams::of(count, &[0]))
}

impl FillParams {
    fn of(count: u32, pattern: &[u32]) -> Self {
        let mut words = [0; 8];
        words[..pattern.len()].copy_from_slice(pattern);
        let [a, b, c, d, e, f, g, h] = words;
        let period = pattern.len() as u32;
        Self { low: [a, b, c, d], high: [e, f, g, h], period, count, ..Default::default() }
    }
}
