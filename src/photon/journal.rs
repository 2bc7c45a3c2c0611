//! The journal: what a part of a work list held before it is worked on anew.
//!
//! Tracing compares with it, and goes back to it where a driver ends loops; weighing writes into
//! it what it is about to change. Either marks the photons that changed, and the light field is
//! told of those only: their flights in the journal are what it has seen.

use std::ops::Range;
use std::sync::Arc;

use super::{Batch, ByFollower, Flights, Follows, Part, PhotonMap, PhotonParams};
use crate::device_scene::Context;
use crate::error::Result;
use crate::gpu::kernel::Kernel;
use crate::gpu::run::{Bindings, Bytes, Pace, Stage};
use crate::gpu::work::WorkList;
use crate::gpu::{Gpu, Progress};
use crate::split::Split;

/// Slots of the journal, at most: 64 MiB. A fast GPU may want more: there a part of this size takes as
/// long as a smaller one.
pub const SLOTS: u32 = 1 << 21;

/// Bytes of half a slot.
const HALF: u64 = 16;

/// Old slots of as many photons as a part may have, and the kernels that compare with them.
pub(super) struct Journal {
    /// Photons that it may hold, and those that it has room for.
    most: u32,
    photons: u32,
    max_events: u32,
    /// All places, then all states.
    slots: wgpu::Buffer,
    /// Photons of a part that changed, each with its first slot that did: two words.
    chosen: wgpu::Buffer,
    /// Which they are.
    changed: WorkList,
    ranks: wgpu::Buffer,
    copy: Arc<Kernel>,
    weigh: Arc<Kernel>,
    weighed: ByFollower,
    compare: ByFollower,
    choose: Arc<Kernel>,
    pace: Pace,
}

impl Journal {
    /// An empty one.
    pub fn new(gpu: &Gpu, max_events: u32, split: &Split) -> Result<Self> {
        let most = (SLOTS / max_events).min(split.journal.unwrap_or(u32::MAX));
        let changed = WorkList::new(gpu, 0)?;
        Ok(Self {
            most: most.max(1),
            photons: 0,
            max_events,
            slots: gpu.buffer::<[u32; 4]>("journal", 0)?,
            chosen: gpu.buffer::<[u32; 2]>("journal", 0)?,
            ranks: changed.ranks(gpu)?,
            changed,
            copy: gpu.kernel("journal", &[])?,
            weigh: gpu.kernel("weigh", &[])?,
            weighed: ByFollower::new(gpu, "weighed")?,
            compare: ByFollower::new(gpu, "compare")?,
            choose: gpu.kernel("chosen", &[])?,
            pace: Pace::new(1 << 14),
        })
    }

    /// Makes room for so many photons, or for a part of them.
    pub fn reserve(&mut self, gpu: &Gpu, photons: u32) -> Result<()> {
        let photons = photons.min(self.most);
        if photons > self.photons {
            // The states must begin where a binding may.
            let slots = (photons as usize * self.max_events as usize).next_multiple_of(16);
            self.slots = gpu.buffer::<[u32; 4]>("journal", 2 * slots)?;
            self.chosen = gpu.buffer::<[u32; 2]>("journal", photons as usize)?;
            self.changed = WorkList::new(gpu, photons)?;
            self.ranks = self.changed.ranks(gpu)?;
            self.photons = photons;
        }
        Ok(())
    }

    fn places(&self) -> Bytes<'_> {
        Bytes { size: self.slots.size() / 2, ..Bytes::all(&self.slots) }
    }

    fn states(&self) -> Bytes<'_> {
        let size = self.slots.size() / 2;
        Bytes { buffer: &self.slots, offset: size, size }
    }

    /// Empties it for so many photons.
    fn clear(&self, stage: &mut Stage, photons: u32) {
        let size = u64::from(photons) * u64::from(self.max_events) * HALF;
        stage.clear_bytes(Bytes { size, ..self.states() });
    }
}

impl PhotonMap {
    /// What kernels are told about a part.
    fn part_params(&self, part: &Part) -> PhotonParams {
        let listed = part.listed.len() as u32;
        PhotonParams {
            first_listed: part.listed.start,
            listed,
            journal_photons: listed,
            ..self.params(&self.batches[part.batch])
        }
    }

    /// The parts of a batch's work list that the journal can hold.
    pub fn parts(&self, batch: usize) -> Vec<Part> {
        let count = self.batches[batch].list.count;
        let each = self.journal.photons;
        let starts = (0..count).step_by(each as usize);
        starts.map(|from| Part { batch, listed: from..(from + each).min(count) }).collect()
    }

    /// Copies the slots of a part to the journal.
    ///
    /// # Errors
    /// The device failed.
    pub fn keep(&self, gpu: &Gpu, part: &Part) -> Result<()> {
        self.copy(gpu, part, 0)
    }

    /// Copies the slots of a part back from the journal.
    pub(super) fn restore(&self, gpu: &Gpu, part: &Part) -> Result<()> {
        self.copy(gpu, part, 1)
    }

    fn copy(&self, gpu: &Gpu, part: &Part, restores: u32) -> Result<()> {
        let params = PhotonParams { restores, ..self.part_params(part) };
        let mut stage = gpu.stage("journal");
        if restores == 0 {
            self.journal.clear(&mut stage, params.listed);
        }
        let bindings = self.journaled_bindings(&self.batches[part.batch]);
        stage.dispatch(&self.journal.copy, params.listed.into(), &bindings, &params)?;
        stage.finish()
    }

    /// Finds what differs from the journal: tasks then begin there, and the light field's marks are
    /// set.
    ///
    /// # Errors
    /// The device failed.
    pub fn compare(&self, cx: Context, part: &Part, follows: Follows) -> Result<()> {
        let params = self.part_params(part);
        let mut bindings = self.journaled_bindings(&self.batches[part.batch]);
        bindings.push(("counters", cx.counters.buffer().into()));
        let mut stage = cx.gpu.stage("compare");
        self.journal.changed.unmark(&mut stage);
        let kernel = self.journal.compare.of(follows);
        stage.dispatch(kernel, params.listed.into(), &bindings, &params)?;
        stage.finish()
    }

    /// Chooses the photons of a part that changed; returns how many.
    ///
    /// # Errors
    /// The device failed.
    pub fn choose(&mut self, gpu: &Gpu, part: &Part) -> Result<u32> {
        let params = self.part_params(part);
        let batch = &self.batches[part.batch];
        let Journal { changed, ranks, chosen, choose, .. } = &mut self.journal;
        let bindings = [
            ("work", (&batch.list.items).into()),
            ("tasks", (&batch.tasks).into()),
            ("marks", (&changed.marks).into()),
            ("ranks", (&*ranks).into()),
            ("chosen", (&*chosen).into()),
        ];
        let mut stage = gpu.stage("chosen");
        changed.rank(&mut stage, ranks)?;
        stage.dispatch(choose, params.listed.div_ceil(32).into(), &bindings, &params)?;
        stage.finish()?;
        WorkList::learn(gpu, &mut [&mut *changed])?;
        Ok(changed.count)
    }

    /// The flights that the chosen photons of a part have.
    pub fn chosen_flights(&self, part: &Part) -> Flights<'_> {
        let all = self.flights(&self.batches[part.batch]);
        let mut bindings = all.bindings;
        bindings.retain(|(name, _)| *name != "work");
        bindings.push(("work", (&self.journal.chosen).into()));
        Flights { bindings, listed: self.journal.changed.count, is_chosen: true, ..all }
    }

    /// The flights that they had, as the journal has them.
    pub fn journaled_flights(&self, part: &Part) -> Flights<'_> {
        let bindings = vec![
            ("places", self.journal.places().into()),
            ("states", self.journal.states().into()),
            ("work", (&self.journal.chosen).into()),
        ];
        let stride = part.listed.len() as u32;
        Flights { bindings, stride, in_journal: true, ..self.chosen_flights(part) }
    }

    /// Weighs again a part of a batch's work list in which no flight is invalid and no light
    /// has changed, and finds what that has changed, as [`Self::compare`] does; the journal then has
    /// their flights with the power that they had and the power that they have. Returns false
    /// where a photon that had ended would go on: nothing is done then, and the part is to be
    /// traced.
    ///
    /// # Errors
    /// The device failed.
    pub fn weigh(
        &self,
        cx: Context,
        part: &Part,
        follows: Follows,
        progress: &mut Progress,
    ) -> Result<bool> {
        let Context { gpu, counters, .. } = cx;
        counters.save(gpu)?;
        let all = self.part_params(part);
        let own = self.journaled_bindings(&self.batches[part.batch]);
        let mut bindings = [cx.scene.bindings(), own].concat();
        bindings.push(("counters", counters.buffer().into()));
        let mut stage = gpu.stage("weigh");
        self.journal.clear(&mut stage, all.listed);
        self.journal.changed.unmark(&mut stage);
        stage.finish()?;
        let total = u64::from(all.listed);
        let work = |stage: &mut Stage, range: Range<u64>| {
            let params = PhotonParams {
                first_item: all.first_listed + range.start as u32,
                items: (range.end - range.start) as u32,
                ..all
            };
            stage.dispatch(&self.journal.weigh, range.end - range.start, &bindings, &params)
        };
        let pace = &self.journal.pace;
        gpu.sliced("weigh", total, pace, work, &mut |n| progress.at("weigh", n, total))?;
        let after = counters.read(gpu)?;
        if after.woken > 0 || after.unfinished > 0 {
            counters.restore(gpu)?;
            return Ok(false);
        }
        let mut stage = gpu.stage("weighed");
        stage.dispatch(self.journal.weighed.of(follows), total, &bindings, &all)?;
        stage.finish()?;
        Ok(true)
    }

    /// A batch's slots, the journal, and marks of what changes.
    fn journaled_bindings<'a>(&'a self, batch: &'a Batch) -> Bindings<'a> {
        let mut bindings = batch.bindings();
        bindings.retain(|(name, _)| *name != "marks");
        bindings.extend([
            ("journal", (&self.journal.slots).into()),
            ("marks", (&self.journal.changed.marks).into()),
            ("slot_marks", (&batch.slot_marks).into()),
        ]);
        bindings
    }

    /// Bytes of the journal.
    pub fn journal_bytes(&self) -> u64 {
        let Journal { slots, chosen, changed, ranks, .. } = &self.journal;
        slots.size() + chosen.size() + changed.bytes() + ranks.size()
    }
}
