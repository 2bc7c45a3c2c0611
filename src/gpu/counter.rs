//! What kernels count: the work that they did, and what went wrong; and what they choose, for those
//! that come after them.

use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::gpu::read::Words;
use crate::gpu::resource::Bytes;
use crate::gpu::run::Stage;
use crate::gpu::turns::When;

/// Parts in which each counter is summed on the device.
pub const COUNTER_STRIPES: u32 = 256;

/// Words of all counters there; what is chosen comes after them.
pub const COUNTER_WORDS: usize = size_of::<Counters>() / 4 * COUNTER_STRIPES as usize;

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
    /// Photons whose loops the driver ended; nothing is returned unless it is 0.
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
    /// The same of flights, cells and points of the light field.
    #[serde(skip)]
    pub unfinished_light: u64,
    /// The same of segments.
    #[serde(skip)]
    pub unfinished_segments: u64,
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

    /// The error where the driver ended loops of so many items of `stage` before their time.
    pub fn unfinished_error(items: u64, stage: &str, remedy: &str) -> Error {
        Error::capacity(
            stage,
            format!(
                "the driver ended the loops of {items} items before they were done (Mesa's software \
                 adapter allows 65535 iterations); {remedy}, or use another adapter"
            ),
        )
    }
}

/// What the device chooses on its way: a word each, 0 until it is chosen. The first are bits of
/// [`When`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Choice {
    /// A photon may take another path.
    Invalid,
    /// A photon that had ended would go on, or was not weighed to its end.
    Woken,
    /// All flights are summed anew.
    Anew,
    /// No choice, but a sum that one depends on: photons that are listed.
    Listed,
    /// Those of them that were worked on.
    Seen,
    /// Those of them that changed.
    Moved,
    /// Cells of the irradiance cache.
    Cells,
    /// Samples that it had no room for.
    Refused,
}

/// Words of choices.
const CHOICES: usize = 8;

impl Choice {
    /// Its bit.
    pub const fn bit(self) -> u32 {
        1 << self as u32
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
        let counters = || gpu.buffer::<u32>("counters", COUNTER_WORDS + CHOICES);
        Ok(Self { counters: counters()?, saved: counters()? })
    }

    /// The buffer that the kernels count in.
    pub fn buffer(&self) -> &wgpu::Buffer {
        &self.counters
    }

    fn counted(buffer: &wgpu::Buffer) -> Bytes {
        Bytes { size: 4 * COUNTER_WORDS as u64, ..Bytes::all(buffer) }
    }

    /// Sets them to zero; what is chosen stays.
    ///
    /// # Errors
    /// The device failed.
    pub fn clear(&self, gpu: &Gpu) -> Result<()> {
        let mut stage = gpu.stage("counters");
        stage.clear_bytes(Self::counted(&self.counters));
        stage.finish()
    }

    /// Takes choices back.
    pub fn unchoose(&self, stage: &mut Stage, choices: &[Choice]) {
        for choice in choices {
            let offset = 4 * (COUNTER_WORDS as u64 + *choice as u64);
            stage.clear_bytes(Bytes { buffer: self.counters.clone(), offset, size: 4 });
        }
    }

    /// That of some choices one was made (if any are told), and of others none.
    pub fn when(&self, some: &[Choice], none: &[Choice]) -> When {
        let bits = |choices: &[Choice]| choices.iter().fold(0, |bits, choice| bits | choice.bit());
        let choices = self.counters.clone();
        When { choices, at: COUNTER_WORDS as u32, some: bits(some), none: bits(none) }
    }

    /// Whether a choice was made.
    ///
    /// # Errors
    /// The device failed.
    pub fn is_chosen(&self, gpu: &Gpu, choice: Choice) -> Result<bool> {
        Ok(self.sum(gpu, choice)? != 0)
    }

    /// A sum among the choices.
    ///
    /// # Errors
    /// The device failed.
    pub fn sum(&self, gpu: &Gpu, choice: Choice) -> Result<u64> {
        let at = COUNTER_WORDS as u64 + choice as u64;
        let word = Words { buffer: self.counters.clone(), range: at..at + 1 };
        Ok(gpu.read_words("choices", &[word])?.iter().map(|&word| u64::from(word)).sum())
    }

    /// Notes what they are, before work that may have to be done again.
    ///
    /// # Errors
    /// The device failed.
    pub fn save(&self, gpu: &Gpu) -> Result<()> {
        let mut stage = gpu.stage("counters");
        stage.copy(Self::counted(&self.counters), &self.saved, 0);
        stage.finish()
    }

    /// Sets them to what they were when they were saved.
    ///
    /// # Errors
    /// The device failed.
    pub fn restore(&self, gpu: &Gpu) -> Result<()> {
        let mut stage = gpu.stage("counters");
        stage.copy(Self::counted(&self.saved), &self.counters, 0);
        stage.finish()
    }

    /// Reads them.
    ///
    /// # Errors
    /// The device failed.
    pub fn read(&self, gpu: &Gpu) -> Result<Counters> {
        Ok(Counters::of(&gpu.read_words("counters", &[self.words()])?))
    }

    /// Where the device has them, for [`Counters::of`].
    pub fn words(&self) -> Words {
        Words { buffer: self.counters.clone(), range: 0..COUNTER_WORDS as u64 }
    }
}

impl Counters {
    /// From the words that the device has: [`COUNTER_WORDS`] of them.
    pub fn of(words: &[u32]) -> Self {
        let sum = |part: &[u32]| part.iter().map(|&word| u64::from(word)).sum::<u64>();
        let sums = words.chunks_exact(2 * COUNTER_STRIPES as usize).map(|counter| {
            let (low, high) = counter.split_at(COUNTER_STRIPES as usize);
            sum(low).wrapping_add(sum(high) << 32)
        });
        let mut counters = Self::default();
        let all = bytemuck::cast_slice_mut::<_, u64>(std::slice::from_mut(&mut counters));
        all.iter_mut().zip(sums).for_each(|(counter, sum)| *counter = sum);
        counters
    }
}
