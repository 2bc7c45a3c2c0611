//! What kernels count: the work that they did, and what went wrong.

use crate::error::{Error, Result};
use crate::gpu::run::Bytes;
use crate::gpu::work::WorkList;
use crate::gpu::{Gpu, Words};

/// Parts in which each counter is summed on the device.
pub const COUNTER_STRIPES: u32 = 256;

/// Words of all counters there.
const WORDS: usize = size_of::<Counters>() / 4 * COUNTER_STRIPES as usize;

/// Counts of one pass, read back from the device: 64-bit, so that none wraps unseen.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, bytemuck::Pod, bytemuck::Zeroable,
)]
#[repr(C)]
pub struct Counters {
    /// Tentative collisions of photons.
    pub tentative: u64,
    /// Photon interactions stored.
    pub interactions: u64,
    /// Contributions that did not fit 32 bits and were clamped.
    pub clamped: u64,
    /// Light-field cells that flights were added to.
    pub deposits: u64,
    /// Photons tested by gathers, or fetches of the fluence.
    pub gathered: u64,
    /// March samples of view rays.
    pub samples: u64,
    /// Blocks that view rays looked for changed light in.
    pub checked: u64,
    /// Photons with a flight to be traced again.
    pub invalid: u64,
    /// Photons with a slot whose power alone is found again.
    pub reweighed: u64,
    /// Photons that tracing or weighing again has changed.
    pub changed: u64,
    /// Items whose loops the driver ended; nothing is returned unless it is 0.
    #[serde(skip)]
    pub unfinished: u64,
    /// Segments whose sums of light did not fit; nothing is returned unless it is 0.
    #[serde(skip)]
    pub overflown: u64,
    /// March steps of photons: macro-cells that their flights entered.
    pub steps: u64,
    /// Slots of photons that came, went or are elsewhere after tracing or weighing again.
    pub moved: u64,
    /// Slots of photons that are where they were, of another power.
    pub repowered: u64,
    /// Means and lights that an update found again for points that its table had.
    pub refreshed: u64,
    /// Photons that had ended and would go on.
    #[serde(skip)]
    pub woken: u64,
}

impl Counters {
    /// March steps, tentative collisions, gather tests and deposits: what the work is
    /// in proportion to.
    pub fn visits(&self) -> u64 {
        self.steps + self.tentative + self.samples + self.gathered + self.deposits
    }

    /// Fails where a segment's sums of light did not fit.
    ///
    /// # Errors
    /// One did not.
    pub fn all_fitted(&self) -> Result<()> {
        match self.overflown {
            0 => Ok(()),
            _ => Err(Error::capacity(
                "segment",
                "sums of light do not fit 52 bits; raise `flux_unit`, or lower `radius` and the \
                 lights' power",
            )),
        }
    }

    /// Fails where the driver ended a loop before its time.
    ///
    /// # Errors
    /// It did, in `stage`.
    pub fn all_finished(&self, stage: &str, remedy: &str) -> Result<()> {
        if self.unfinished == 0 {
            return Ok(());
        }
        Err(Error::capacity(
            stage,
            format!(
                "the driver ended the loops of {} items before they were done (Mesa's software \
                 adapter allows 65535 iterations); {remedy}, or use another adapter",
                self.unfinished
            ),
        ))
    }
}

/// The counters on the device.
pub struct CounterBuffer {
    counters: wgpu::Buffer,
    saved: wgpu::Buffer,
}

impl CounterBuffer {
    /// Counters at zero.
    ///
    /// # Errors
    /// The device refuses.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        let counters = || gpu.buffer::<u32>("counters", WORDS);
        Ok(Self { counters: counters()?, saved: counters()? })
    }

    /// The buffer that the kernels count in.
    pub fn buffer(&self) -> &wgpu::Buffer {
        &self.counters
    }

    /// Sets them to zero.
    ///
    /// # Errors
    /// The device failed.
    pub fn clear(&self, gpu: &Gpu) -> Result<()> {
        let mut stage = gpu.stage("counters");
        stage.clear(&self.counters);
        stage.finish()
    }

    /// Notes what they are, before work that may have to be done again.
    ///
    /// # Errors
    /// The device failed.
    pub fn save(&self, gpu: &Gpu) -> Result<()> {
        let mut stage = gpu.stage("counters");
        stage.copy(Bytes::all(&self.counters), &self.saved, 0);
        stage.finish()
    }

    /// Sets them to what they were when they were saved.
    ///
    /// # Errors
    /// The device failed.
    pub fn restore(&self, gpu: &Gpu) -> Result<()> {
        let mut stage = gpu.stage("counters");
        stage.copy(Bytes::all(&self.saved), &self.counters, 0);
        stage.finish()
    }

    /// Reads them.
    ///
    /// # Errors
    /// The device failed.
    pub fn read(&self, gpu: &Gpu) -> Result<Counters> {
        self.read_with(gpu, &mut [])
    }

    /// Reads them, and how many items lists have that were recorded.
    ///
    /// # Errors
    /// The device failed.
    pub fn read_with(&self, gpu: &Gpu, lists: &mut [&mut WorkList]) -> Result<Counters> {
        let mut parts = vec![Words { buffer: &self.counters, range: 0..WORDS as u64 }];
        parts.extend(lists.iter().map(|list| list.length()));
        let mut words = gpu.read_words("counters", &parts)?;
        let counts = words.split_off(WORDS);
        lists.iter_mut().zip(counts).for_each(|(list, count)| list.count = count);
        let sum = |part: &[u32]| part.iter().map(|&word| u64::from(word)).sum::<u64>();
        let sums = words.chunks_exact(2 * COUNTER_STRIPES as usize).map(|counter| {
            let (low, high) = counter.split_at(COUNTER_STRIPES as usize);
            sum(low).wrapping_add(sum(high) << 32)
        });
        let mut counters = Counters::default();
        let all = bytemuck::cast_slice_mut::<_, u64>(std::slice::from_mut(&mut counters));
        all.iter_mut().zip(sums).for_each(|(counter, sum)| *counter = sum);
        Ok(counters)
    }
}
