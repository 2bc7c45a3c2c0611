//! The journal: what a part of a work list held before it is worked on anew.
//!
//! Tracing compares with it; weighing writes into it what it is about to change. Either marks the
//! photons that changed, and the light field is told of those only: their flights in the journal are
//! what it has seen.
//!
//! How many photons a part has, whether they need but be weighed, and which of them changed, the
//! device alone knows.

use std::ops::Range;
use std::sync::Arc;

use super::{Batch, ByFollower, Flights, Follows, Part, PhotonMap, PhotonParams};
use crate::device_scene::Context;
use crate::error::Result;
use crate::gpu::counter::Choice;
use crate::gpu::kernel::Kernel;
use crate::gpu::pace::Pace;
use crate::gpu::pool::Pooled;
use crate::gpu::queue::Total;
use crate::gpu::resource::{Bindings, Bytes};
use crate::gpu::run::Stage;
use crate::gpu::turns::{Told, When};
use crate::gpu::work::WorkList;
use crate::gpu::{Gpu, Progress};
use crate::split::Split;

/// Slots of the journal, at most: 64 MiB. A fast GPU may want more: there a part of this size takes as
/// long as a smaller one.
pub const SLOTS: u32 = 1 << 21;

/// Old slots of as many photons as a part may have, and the kernels that compare with them.
pub(super) struct Journal {
    /// Photons that it may hold, and those that it has room for.
    most: u32,
    photons: u32,
    max_events: u32,
    /// All places, then all states.
    slots: wgpu::Buffer,
    /// How many photons of a part changed, how many it has, and two words for each that did.
    chosen: wgpu::Buffer,
    /// Which they are.
    changed: WorkList,
    ranks: Pooled,
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
            chosen: gpu.buffer::<[u32; 2]>("journal", 1)?,
            ranks: changed.ranks(gpu)?,
            changed,
            copy: gpu.kernel("journal", &[])?,
            weigh: gpu.kernel("weigh", &[])?,
            weighed: ByFollower::new(gpu, "weighed")?,
            compare: ByFollower::new(gpu, "compare")?,
            choose: gpu.kernel("chosen", &[])?,
            pace: Pace::new(gpu, 1 << 17),
        })
    }

    /// Makes room for so many photons, or for a part of them.
    pub fn reserve(&mut self, gpu: &Gpu, photons: u32) -> Result<()> {
        let photons = photons.min(self.most);
        if photons > self.photons {
            // The states must begin where a binding may.
            let slots = (photons as usize * self.max_events as usize).next_multiple_of(16);
            self.slots = gpu.buffer::<[u32; 4]>("journal", 2 * slots)?;
            self.chosen = gpu.buffer::<[u32; 2]>("journal", photons as usize + 1)?;
            self.changed = WorkList::new(gpu, photons)?;
            self.ranks = self.changed.ranks(gpu)?;
            self.photons = photons;
        }
        Ok(())
    }

    fn places(&self) -> Bytes {
        Bytes { size: self.slots.size() / 2, ..Bytes::all(&self.slots) }
    }

    fn states(&self) -> Bytes {
        let size = self.slots.size() / 2;
        Bytes { offset: size, size, ..Bytes::all(&self.slots) }
    }

    /// The chosen photons.
    pub fn chosen(&self) -> &wgpu::Buffer {
        &self.chosen
    }
}

impl PhotonMap {
    /// What kernels are told about a part.
    fn part_params(&self, part: &Part) -> PhotonParams {
        PhotonParams {
            first_listed: part.listed.start,
            listed: part.listed.len() as u32,
            ..self.params(&self.batches[part.batch])
        }
    }

    /// How many photons a part has.
    fn told(&self, part: &Part, when: Option<When>) -> Told {
        let told = self.batches[part.batch].list.told();
        Told { first: part.listed.start, most: part.listed.len() as u32, when, ..told }
    }

    /// The parts of a batch's work list that the journal can hold: those beyond its end are empty.
    pub fn parts(&self, batch: usize) -> Vec<Part> {
        let (photons, each) = (self.batches[batch].photons, self.journal.photons);
        let starts = (0..photons).step_by(each as usize);
        starts.map(|from| Part { batch, listed: from..(from + each).min(photons) }).collect()
    }

    /// Works on the photons of a part again, which an edit touches, and finds what that changes. They
    /// are weighed, or traced where a flight may be another, a light has changed, or a photon that had
    /// ended would go on.
    ///
    /// # Errors
    /// The device failed.
    pub fn work_on(
        &self,
        cx: Context,
        part: &Part,
        follows: Follows,
        progress: &mut Progress,
    ) -> Result<()> {
        let Context { gpu, counters, .. } = cx;
        let relit = self.batches[part.batch].is_relit();
        let mut stage = gpu.stage("weigh");
        self.journal.changed.unmark(&mut stage);
        counters.unchoose(&mut stage, &[Choice::Woken]);
        stage.finish()?;
        let is_lost = [Choice::Invalid, Choice::Woken];
        if !relit {
            self.weigh(cx, part, progress)?;
            let when = counters.when(&[], &is_lost);
            let kernel = self.journal.weighed.of(follows);
            self.over_part(cx, part, kernel, Some(when))?;
        }
        let when = (!relit).then(|| counters.when(&is_lost, &[]));
        self.over_part(cx, part, &self.journal.copy, when.clone())?;
        self.trace(cx, part, Total::Told(self.told(part, when.clone())), progress)?;
        self.over_part(cx, part, self.journal.compare.of(follows), when)
    }

    /// What photons weigh now, where no flight is another: the journal has their flights with the
    /// power that they had and the power that they have.
    fn weigh(&self, cx: Context, part: &Part, progress: &mut Progress) -> Result<()> {
        let all = self.part_params(part);
        let own = self.journaled_bindings(&self.batches[part.batch]);
        let mut bindings = [cx.scene.bindings(), own].concat();
        bindings.push(("counters", cx.counters.buffer().into()));
        let kernel = self.journal.weigh.clone();
        let work = move |stage: &mut Stage, range: Range<u64>| {
            let params = PhotonParams {
                first_item: all.first_listed + range.start as u32,
                items: (range.end - range.start) as u32,
                ..all
            };
            stage.dispatch(&kernel, range.end - range.start, &bindings, &params)
        };
        let when = cx.counters.when(&[], &[Choice::Invalid]);
        let total = Total::Told(self.told(part, Some(when)));
        cx.gpu.sliced("weigh", total, &self.journal.pace, work, progress)
    }

    /// A kernel over the photons of a part.
    fn over_part(
        &self,
        cx: Context,
        part: &Part,
        kernel: &Kernel,
        when: Option<When>,
    ) -> Result<()> {
        let mut bindings = self.journaled_bindings(&self.batches[part.batch]);
        bindings.push(("counters", cx.counters.buffer().into()));
        let mut stage = cx.gpu.stage(kernel.name);
        stage.dispatch_told(kernel, &self.told(part, when), &bindings, &self.part_params(part))?;
        stage.finish()
    }

    /// Chooses the photons of a part that changed.
    ///
    /// # Errors
    /// The device failed.
    pub fn choose(&self, gpu: &Gpu, part: &Part) -> Result<()> {
        let blocks = self.journal.changed.blocks();
        let params = PhotonParams { blocks, ..self.part_params(part) };
        let batch = &self.batches[part.batch];
        let Journal { changed, ranks, chosen, choose, .. } = &self.journal;
        let bindings = [
            ("work", (&batch.list.items).into()),
            ("tasks", (&batch.tasks).into()),
            ("marks", (&changed.marks).into()),
            ("ranks", ranks.into()),
            ("chosen", chosen.into()),
            ("sums", (&changed.sums).into()),
        ];
        let mut stage = gpu.stage("chosen");
        changed.rank(&mut stage, ranks)?;
        stage.dispatch(choose, params.listed.div_ceil(32).into(), &bindings, &params)?;
        stage.finish()
    }

    /// How many photons of a part are chosen, how many it has, and which they are.
    pub fn chosen(&self) -> &wgpu::Buffer {
        &self.journal.chosen
    }

    /// The flights that the chosen photons of a part have.
    pub fn chosen_flights(&self, part: &Part) -> Flights {
        let most = part.listed.len() as u32;
        let told = Told { each: self.max_events, ..Told::of(&self.journal.chosen, most) };
        let batch = &self.batches[part.batch];
        Flights { chosen: Some(told), ..self.flights(batch, 0..batch.photons) }
    }

    /// The flights that they had, as the journal has them.
    pub fn journaled_flights(&self, part: &Part) -> Flights {
        let bindings = vec![
            ("places", self.journal.places().into()),
            ("states", self.journal.states().into()),
            ("chosen", (&self.journal.chosen).into()),
            ("quotas", (&self.batches[part.batch].told).into()),
        ];
        Flights { bindings, in_journal: true, ..self.chosen_flights(part) }
    }

    /// A batch's slots, the journal, and marks of what changes.
    fn journaled_bindings(&self, batch: &Batch) -> Bindings {
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
