//! The journal: what a part of a work list held before it is worked on anew.
//!
//! Tracing compares with it, and goes back to it where a driver ends loops; weighing writes into
//! it what it is about to change. Either marks the photons that changed, and the light field is
//! told of those only: their flights in the journal are what it has seen.

use std::ops::Range;
use std::sync::Arc;

use super::{Batch, PhotonMap, PhotonParams, SLOT_BYTES};
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::gpu::counter::CounterBuffer;
use crate::gpu::kernel::Kernel;
use crate::gpu::run::{Bindings, Pace, Stage};
use crate::gpu::work::WorkList;
use crate::split::Split;

/// Slots of the journal, at most: 64 MiB.
const SLOTS: u32 = 1 << 21;

/// Old slots of as many photons as a part may have, and the kernels that compare with them.
pub(super) struct Journal {
    /// Photons that it may hold, and those that it has room for.
    most: u32,
    photons: u32,
    max_events: u32,
    places: wgpu::Buffer,
    states: wgpu::Buffer,
    /// Photons of a part that changed, as their first slots that did.
    chosen: WorkList,
    ranks: wgpu::Buffer,
    copy: Arc<Kernel>,
    weigh: Arc<Kernel>,
    /// For the fluence, and for points.
    weighed: [Arc<Kernel>; 2],
    /// For the fluence, and for points.
    compare: [Arc<Kernel>; 2],
    choose: Arc<Kernel>,
    pace: Pace,
}

impl Journal {
    /// An empty one.
    pub fn new(gpu: &Gpu, max_events: u32, split: &Split) -> Result<Self> {
        let most = (SLOTS / max_events).min(split.journal.unwrap_or(u32::MAX));
        let chosen = WorkList::new(gpu, 0)?;
        Ok(Self {
            most: most.max(1),
            photons: 0,
            max_events,
            places: gpu.buffer::<[u32; 4]>("journal", 0)?,
            states: gpu.buffer::<[u32; 4]>("journal", 0)?,
            ranks: chosen.ranks(gpu)?,
            chosen,
            copy: gpu.kernel("journal", &[])?,
            weigh: gpu.kernel("weigh", &[])?,
            weighed: [gpu.kernel("weighed", &[])?, gpu.kernel("weighed", &["points"])?],
            compare: [gpu.kernel("compare", &[])?, gpu.kernel("compare", &["points"])?],
            choose: gpu.kernel("chosen", &[])?,
            pace: Pace::new(1 << 14),
        })
    }

    /// Makes room for so many photons, or for a part of them.
    pub fn reserve(&mut self, gpu: &Gpu, photons: u32) -> Result<()> {
        let photons = photons.min(self.most);
        if photons > self.photons {
            let slots = photons as usize * self.max_events as usize;
            self.places = gpu.buffer::<[u32; 4]>("journal", slots)?;
            self.states = gpu.buffer::<[u32; 4]>("journal", slots)?;
            self.chosen = WorkList::new(gpu, photons)?;
            self.ranks = self.chosen.ranks(gpu)?;
            self.photons = photons;
        }
        Ok(())
    }

    /// Empties it for a part.
    fn clear(&self, stage: &mut Stage, part: &PhotonParams) {
        let slots = u64::from(part.listed) * u64::from(self.max_events);
        stage.clear_first(&self.states, slots * SLOT_BYTES / 2);
    }
}

impl PhotonMap {
    /// What they are told about a part of its work list that the journal holds.
    pub fn journal_params(&self, batch: &Batch, part: &Range<u32>) -> PhotonParams {
        PhotonParams {
            first_listed: part.start,
            listed: part.end - part.start,
            journal: part.end - part.start,
            ..self.params(batch)
        }
    }

    /// The parts of a batch's work list that the journal can hold.
    pub fn parts(&self, batch: &Batch) -> Vec<Range<u32>> {
        let count = batch.list.count;
        let starts = (0..count).step_by(self.journal.photons as usize);
        starts.map(|start| start..(start + self.journal.photons).min(count)).collect()
    }

    /// The live slots, for kernels that read those of the journal, too.
    pub fn live_bindings<'a>(&'a self, batch: &'a Batch) -> Bindings<'a> {
        vec![
            ("places", (&batch.places).into()),
            ("states", (&batch.states).into()),
            ("chosen", (&self.journal.chosen.items).into()),
            ("work", (&batch.list.items).into()),
        ]
    }

    /// The journal in their place.
    pub fn journal_bindings<'a>(&'a self, batch: &'a Batch) -> Bindings<'a> {
        vec![
            ("places", (&self.journal.places).into()),
            ("states", (&self.journal.states).into()),
            ("chosen", (&self.journal.chosen.items).into()),
            ("work", (&batch.list.items).into()),
        ]
    }

    /// Copies the slots of a part to the journal, or with `sign` -1 back.
    ///
    /// # Errors
    /// The device failed.
    pub fn copy(&self, gpu: &Gpu, batch: &Batch, part: &Range<u32>, sign: i32) -> Result<()> {
        let params = PhotonParams { sign, ..self.journal_params(batch, part) };
        let mut stage = gpu.stage("journal");
        if sign > 0 {
            self.journal.clear(&mut stage, &params);
        }
        let bindings = self.journaled_bindings(batch);
        stage.dispatch(&self.journal.copy, params.listed.into(), &bindings, &params)?;
        stage.finish()
    }

    /// Finds what differs from the journal: tasks then begin there. For `points` slots that
    /// moved are marked, for the fluence photons that changed.
    ///
    /// # Errors
    /// The device failed.
    pub fn compare(
        &self,
        gpu: &Gpu,
        batch: &Batch,
        (part, points): (&Range<u32>, bool),
        counters: &CounterBuffer,
    ) -> Result<()> {
        let params = self.journal_params(batch, part);
        let mut bindings = self.journaled_bindings(batch);
        bindings.push(("counters", counters.buffer().into()));
        let mut stage = gpu.stage("compare");
        self.journal.chosen.unmark(&mut stage);
        let kernel = &self.journal.compare[usize::from(points)];
        stage.dispatch(kernel, params.listed.into(), &bindings, &params)?;
        stage.finish()
    }

    /// Chooses the photons of a part that changed; returns what kernels are told about them,
    /// in the journal.
    ///
    /// # Errors
    /// The device failed.
    pub fn choose(&mut self, gpu: &Gpu, batch: usize, part: &Range<u32>) -> Result<PhotonParams> {
        let batch = &self.batches[batch];
        let params = self.journal_params(batch, part);
        let (chosen, ranks) = (&mut self.journal.chosen, &self.journal.ranks);
        let bindings = [
            ("work", (&batch.list.items).into()),
            ("tasks", (&batch.tasks).into()),
            ("marks", (&chosen.marks).into()),
            ("ranks", ranks.into()),
            ("chosen", (&chosen.items).into()),
        ];
        let mut stage = gpu.stage("chosen");
        chosen.rank(&mut stage, ranks)?;
        stage.dispatch(
            &self.journal.choose,
            params.listed.div_ceil(32).into(),
            &bindings,
            &params,
        )?;
        stage.finish()?;
        WorkList::learn(gpu, &mut [&mut *chosen])?;
        Ok(PhotonParams { listed: chosen.count, chosen: 1, ..params })
    }

    /// Weighs again a part of a batch's work list in which no flight is invalid and no light
    /// has changed, and finds what that has changed, as `compare` does; the journal then has
    /// their flights with the power that they had and the power that they have. Returns false
    /// where a photon that had ended would go on: nothing is done then, and the part is to be
    /// traced.
    ///
    /// # Errors
    /// The device failed.
    pub fn weigh(
        &self,
        gpu: &Gpu,
        scene: &DeviceScene,
        counters: &CounterBuffer,
        (batch, part, points): (&Batch, &Range<u32>, bool),
        progress: &mut Progress,
    ) -> Result<bool> {
        counters.save(gpu)?;
        let all = self.journal_params(batch, part);
        let mut bindings = [scene.bindings(), self.journaled_bindings(batch)].concat();
        bindings.push(("counters", counters.buffer().into()));
        let mut stage = gpu.stage("weigh");
        self.journal.clear(&mut stage, &all);
        self.journal.chosen.unmark(&mut stage);
        stage.finish()?;
        let total = u64::from(all.listed);
        let work = |stage: &mut Stage, range: Range<u64>| {
            let params = PhotonParams {
                first_item: part.start + range.start as u32,
                items: (range.end - range.start) as u32,
                ..all
            };
            stage.dispatch(&self.journal.weigh, range.end - range.start, &bindings, &params)
        };
        let pace = &self.journal.pace;
        gpu.sliced("weigh", total, pace, work, &mut |n| progress.at("weigh", n, total))?;
        if counters.read(gpu)?.unfinished > 0 {
            counters.restore(gpu)?;
            return Ok(false);
        }
        let mut stage = gpu.stage("weighed");
        stage.dispatch(&self.journal.weighed[usize::from(points)], total, &bindings, &all)?;
        stage.finish()?;
        Ok(true)
    }

    /// A batch's slots, the journal, and marks of what changes.
    fn journaled_bindings<'a>(&'a self, batch: &'a Batch) -> Bindings<'a> {
        let mut bindings = batch.bindings();
        bindings.retain(|(name, _)| *name != "marks");
        bindings.extend([
            ("old_places", (&self.journal.places).into()),
            ("old_states", (&self.journal.states).into()),
            ("marks", (&self.journal.chosen.marks).into()),
            ("moved", (&batch.moved).into()),
        ]);
        bindings
    }

    /// Bytes of the journal.
    pub fn journal_bytes(&self) -> u64 {
        let Journal { places, states, chosen, ranks, .. } = &self.journal;
        places.size() + states.size() + chosen.bytes() + ranks.size()
    }
}
