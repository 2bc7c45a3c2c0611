//! The photon map: slots of an implicit linked list, filled by tracing.
//!
//! Event k of photon p lives at slot `k * photons + p` of its batch, in two arrays of
//! 16 bytes. Tracing works over a list of photons, each with the event from which it is
//! to be traced; a full rebuild lists all of them from event 0.

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::frame::DeviceScene;
use crate::gpu::Gpu;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::run::Bindings;
use crate::render::{Progress, Split};
use crate::scene::Settings;

/// Bytes of a photon slot.
pub const SLOT_BYTES: u64 = 32;

/// Events that one dispatch traces: few, so that no thread runs for long.
const EVENTS_AT_ONCE: u32 = 4;

/// Photons in a batch: a work item keeps the event in its upper eight bits.
const MAX_BATCH: u64 = 1 << 24;

shared_struct! {
    /// What the kernels that work on photons are told.
    pub struct PhotonParams {
        /// Number of the batch's first photon.
        pub first_photon: u32,
        /// Photons in the batch.
        pub photons: u32,
        /// First item of this dispatch.
        pub first_item: u32,
        /// Items of this dispatch.
        pub items: u32,
        /// Slots of a photon.
        pub max_events: u32,
        /// First event after which the roulette runs.
        pub roulette_from: u32,
        /// Probability to survive it.
        pub roulette_survival: f32,
        /// Scale of the integer sums.
        pub scale: f32,
        /// Cells of the fluence grid.
        pub grid: [u32; 3],
        /// 1 adds to the light field, -1 takes out.
        pub sign: i32,
        /// First event of the window that a dispatch traces.
        pub first_event: u32,
        /// The event before which it stops.
        pub stop_event: u32,
        /// Keeps the size a multiple of 16.
        pub pad: [u32; 2],
    }
}

/// Counts of one pass, read back from the device: 64-bit, so that none wraps unseen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
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
    /// Items whose loops the driver ended; nothing is returned unless it is 0.
    #[serde(skip)]
    pub unfinished: u64,
}

const COUNTERS: usize = 7;

impl Counters {
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
pub struct CounterBuffer(wgpu::Buffer);

impl CounterBuffer {
    /// Counters at zero.
    ///
    /// # Errors
    /// The device refuses.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        gpu.buffer::<u64>("counters", COUNTERS).map(Self)
    }

    /// The buffer that the kernels count in.
    pub fn buffer(&self) -> &wgpu::Buffer {
        &self.0
    }

    /// Sets them to zero.
    pub fn clear(&self, gpu: &Gpu) {
        self.restore(gpu, &Counters::default());
    }

    /// Sets them back to what they were, before work that must be done again.
    pub fn restore(&self, gpu: &Gpu, c: &Counters) {
        let words: [u64; COUNTERS] = [
            c.tentative,
            c.interactions,
            c.clamped,
            c.deposits,
            c.gathered,
            c.samples,
            c.unfinished,
        ];
        gpu.write(&self.0, &words);
    }

    /// Reads them.
    ///
    /// # Errors
    /// The device failed.
    pub fn read(&self, gpu: &Gpu) -> Result<Counters> {
        let c = gpu.read::<u64>("counters", &self.0)?;
        Ok(Counters {
            tentative: c[0],
            interactions: c[1],
            clamped: c[2],
            deposits: c[3],
            gathered: c[4],
            samples: c[5],
            unfinished: c[6],
        })
    }
}

/// A share of the photons that fits one binding.
pub struct Batch {
    /// Number of its first photon.
    pub first: u32,
    /// How many.
    pub photons: u32,
    /// Position and direction of each slot.
    pub places: wgpu::Buffer,
    /// Power, entry, kind and history of each slot.
    pub states: wgpu::Buffer,
}

impl Batch {
    /// Its resources, by the names that the kernels give them.
    pub fn bindings(&self) -> Bindings<'_> {
        vec![("places", (&self.places).into()), ("states", (&self.states).into())]
    }
}

/// All photons, in batches.
pub struct PhotonMap {
    /// The batches, in the order of their photons.
    pub batches: Vec<Batch>,
    /// Slots of each photon.
    pub max_events: u32,
    params: PhotonParams,
    trace: Arc<Kernel>,
}

impl PhotonMap {
    /// Room for the scene's photons.
    ///
    /// # Errors
    /// Not even one photon fits, or the device refuses the memory.
    pub fn new(gpu: &Gpu, scene: &DeviceScene, settings: &Settings, split: &Split) -> Result<Self> {
        let max_events = settings.max_events;
        let fit = gpu.max_binding() / (SLOT_BYTES / 2) / u64::from(max_events);
        let most = fit.min(MAX_BATCH).min(split.batch_photons.unwrap_or(u32::MAX).into());
        if most == 0 {
            return Err(Error::capacity(
                "photons",
                format!("{max_events} events do not fit a binding"),
            ));
        }
        let total = u64::from(scene.lights.photons);
        // Even batches: the last is no smaller than it must be.
        let each = total.div_ceil(total.div_ceil(most).max(1)).max(1);
        let mut batches = Vec::new();
        // Without a light there is one batch of no photons: later stages need not know.
        for first in (0..total.max(1)).step_by(each as usize) {
            let photons = each.min(total - first);
            let slots = (photons * u64::from(max_events)) as usize;
            batches.push(Batch {
                first: first as u32,
                photons: photons as u32,
                places: gpu.buffer::<[u32; 4]>("photon places", slots)?,
                states: gpu.buffer::<[u32; 4]>("photon states", slots)?,
            });
        }
        let flags = ["nearest", "float_voxels", "anisotropic", "history", "skip"];
        Ok(Self {
            batches,
            max_events,
            params: PhotonParams {
                max_events,
                roulette_from: settings.roulette_from,
                roulette_survival: settings.roulette_survival as f32,
                sign: 1,
                ..Default::default()
            },
            trace: gpu.kernel("trace", &scene.flags(&flags))?,
        })
    }

    /// What the kernels are told about a batch.
    pub fn params(&self, batch: &Batch) -> PhotonParams {
        PhotonParams { first_photon: batch.first, photons: batch.photons, ..self.params }
    }

    /// Traces every photon from its light, a window of events at a time.
    ///
    /// # Errors
    /// The device failed, or ended the loops of even a single flight.
    pub fn trace(
        &self,
        gpu: &Gpu,
        scene: &DeviceScene,
        counters: &CounterBuffer,
        split: &Split,
        progress: &mut Progress,
    ) -> Result<()> {
        let before = counters.read(gpu)?;
        for window in [EVENTS_AT_ONCE, 1] {
            counters.restore(gpu, &before);
            self.trace_windows(gpu, scene, counters, split, window, progress)?;
            if counters.read(gpu)?.unfinished == 0 {
                return Ok(());
            }
        }
        let remedy = "lower `majorant` and the extinctions, or the volume's resolution";
        counters.read(gpu)?.all_finished("trace", remedy)
    }

    fn trace_windows(
        &self,
        gpu: &Gpu,
        scene: &DeviceScene,
        counters: &CounterBuffer,
        split: &Split,
        window: u32,
        progress: &mut Progress,
    ) -> Result<()> {
        let mut done = 0;
        for batch in &self.batches {
            let work = gpu.upload("work list", &split.work_list(batch.photons))?;
            let mut bindings = [scene.bindings(), batch.bindings()].concat();
            bindings.extend([("work", (&work).into()), ("counters", counters.buffer().into())]);
            gpu.sliced(
                "trace",
                batch.photons.into(),
                1 << 14,
                |stage, range| {
                    for first_event in (0..self.max_events).step_by(window as usize) {
                        let params = PhotonParams {
                            first_item: range.start as u32,
                            items: (range.end - range.start) as u32,
                            first_event,
                            stop_event: (first_event + window).min(self.max_events),
                            ..self.params(batch)
                        };
                        let items = range.end - range.start;
                        stage.dispatch(&self.trace, items, &bindings, &params)?;
                    }
                    Ok(())
                },
                &mut |n| progress.at("trace", done + n, scene.lights.photons.into()),
            )?;
            done += u64::from(batch.photons);
        }
        Ok(())
    }

    /// Bytes of all slots.
    pub fn bytes(&self) -> u64 {
        self.batches.iter().map(|b| b.places.size() + b.states.size()).sum()
    }
}
