//! The photon map: slots of an implicit linked list, filled by tracing.
//!
//! Event k of photon p lives at slot `k * photons + p` of its batch, in two arrays of
//! 16 bytes. A batch has the photons of several lights side by side, as many as fit a binding: they
//! are worked on together, and an edit of a light leaves those of the others where they are. Tracing works over a list of photons; each one's task
//! says from which event on its slots may no longer hold. A full rebuild lists all of them,
//! from event 0.
//!
//! An update lists the photons that a query meets, keeps their old slots in a journal of
//! fixed size, part of the list after part, and hands on what tracing again has changed. A
//! slot's history is that of its own flight, so that each is judged by itself; and a flight
//! that is judged invalid is flown again only in the macro-cells and layers of marks in
//! which the edit can have made a tentative collision real.

mod batch;
mod journal;
pub mod probe;

use std::ops::Range;
use std::sync::Arc;

pub use self::batch::{Batch, ForgetParams, Quota, QuotaRecord, Quotas};
use self::journal::Journal;
pub use self::journal::SLOTS as JOURNAL_SLOTS;
use crate::bits::words;
use crate::device_scene::lights::{Light, Lights};
use crate::device_scene::{Context, DeviceScene};
use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::pace::Pace;
use crate::gpu::queue::Total;
use crate::gpu::resource::{Bindings, Bytes};
use crate::gpu::run::Stage;
use crate::gpu::turns::{Told, When};
use crate::scene::Settings;
use crate::split::Split;

/// Bytes of a photon slot.
pub const SLOT_BYTES: u64 = 32;

/// Events that one dispatch traces: few, so that no thread runs for long.
const EVENTS_AT_ONCE: u32 = 4;

shared_struct! {
    /// What the kernels that work on photons are told.
    pub struct PhotonParams {
        /// Photons in the batch.
        pub photons: u32,
        /// Slots of a photon.
        pub max_events: u32,
        /// First item of this dispatch.
        pub first_item: u32,
        /// Items of this dispatch.
        pub items: u32,
        /// First of the part of the work list that is worked on.
        pub first_listed: u32,
        /// Photons in that part, at most.
        pub listed: u32,
        /// First event after which the roulette runs.
        pub roulette_from: u32,
        /// Probability to survive it.
        pub roulette_survival: f32,
        /// Bins where a flight may be stopped that was not.
        pub risen: [u32; 2],
        /// First event of the window that a dispatch traces, from where each photon resumes.
        pub first_event: u32,
        /// The event before which it stops, from there.
        pub stop_event: u32,
        /// 1 / `roulette_survival`: this / 2^18 * 2^`roulette_doublings`.
        pub roulette_gain: u32,
        /// See `roulette_gain`.
        pub roulette_doublings: i32,
        /// Blocks of marks of photons that changed.
        pub blocks: u32,
        /// Keeps the size a multiple of 16.
        pub pad: u32,
    }
}

shared_struct! {
    /// What the light field does not know of 32 slots yet, a bit each.
    pub struct SlotMarks {
        /// Those that came, went or are elsewhere.
        pub moved: u32,
        /// Those that may give other light where they are: of another power, or of a material that
        /// scatters otherwise.
        pub altered: u32,
    }
}

/// Half of a slot as the device holds it (`kernels/shared/slot.wgsl`): power, entry, kind
/// and the history of the flight that ends there.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct State([u32; 4]);

impl State {
    /// Whether no flight ends here.
    pub fn is_empty(self) -> bool {
        self.0[1] >> 30 == 0
    }

    /// Whether the flight ends in an interaction.
    pub fn interacts(self) -> bool {
        self.0[1] >> 30 == 1
    }

    /// The table entry that decided the interaction.
    pub fn entry(self) -> usize {
        (self.0[1] >> 18 & 0xfff) as usize
    }

    /// The flight's historygram.
    pub fn history(self) -> u64 {
        u64::from(self.0[2]) | u64::from(self.0[3]) << 32
    }
}

/// What a light field wants to be told of photons that change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Follows {
    /// Photons, of which it takes all flights from the first that changed on.
    Photons,
    /// Slots, each as it moved or gives other light.
    Slots,
}

/// A part of a batch's work list, as much as the journal holds.
#[derive(Clone, Debug)]
pub struct Part {
    /// Place of the batch in the map.
    pub batch: usize,
    /// Of its work list, which may end before.
    pub listed: Range<u32>,
}

/// Flights to be added to a light field or taken out of it: of photons of a batch that lie side by
/// side, or of those of a part that changed.
#[derive(Clone)]
pub struct Flights {
    /// Slots, and the photons that are chosen, by the names that kernels give them.
    pub bindings: Bindings,
    /// Slots of a photon.
    pub max_events: u32,
    /// Photons that are summed, where none are chosen.
    pub photons: Range<u32>,
    /// Photons in the batch.
    pub stride: u32,
    /// Of those that are chosen: how many, as the device has it.
    pub chosen: Option<Told>,
    /// Whether the slots are those that the journal keeps.
    pub in_journal: bool,
}

impl Flights {
    /// These, where choices were made.
    pub fn when(self, when: When) -> Self {
        let chosen = self.chosen.map(|told| Told { when: Some(when), ..told });
        Self { chosen, ..self }
    }
}

/// All photons, in batches.
pub struct PhotonMap {
    /// The batches.
    pub batches: Vec<Batch>,
    /// Slots of each photon.
    pub max_events: u32,
    most: u32,
    /// Batches that were ever made.
    made: u32,
    journal: Journal,
    /// What is told of every batch; `risen` is that of the query that listed last.
    params: PhotonParams,
    trace: Arc<Kernel>,
    /// Photons that go on after a window of events: of every other window.
    going: [wgpu::Buffer; 2],
    list_going: Arc<Kernel>,
    query: ByFollower,
    pace: Pace,
    /// Events that one dispatch traces: one where the driver ended the loops of more.
    events_at_once: u32,
}

/// A kernel for each of what light fields may follow.
struct ByFollower {
    photons: Arc<Kernel>,
    slots: Arc<Kernel>,
}

impl ByFollower {
    fn new(gpu: &Gpu, name: &'static str) -> Result<Self> {
        Ok(Self { photons: gpu.kernel(name, &[])?, slots: gpu.kernel(name, &["points"])? })
    }

    fn of(&self, follows: Follows) -> &Kernel {
        match follows {
            Follows::Photons => &self.photons,
            Follows::Slots => &self.slots,
        }
    }
}

impl PhotonMap {
    /// Room for the photons of the scene's lights, `ids` in their order.
    ///
    /// # Errors
    /// Not even one photon fits, or the device refuses the memory.
    pub fn new(
        gpu: &Gpu,
        scene: &DeviceScene,
        ids: &[u32],
        settings: &Settings,
        split: &Split,
    ) -> Result<Self> {
        let max_events = settings.max_events;
        let fit = gpu.max_binding() / (SLOT_BYTES / 2) / u64::from(max_events);
        let most = fit.min(split.batch_photons.unwrap_or(u32::MAX).into()) as u32;
        if most == 0 {
            return Err(Error::capacity(
                "photons",
                format!("{max_events} events do not fit a binding"),
            ));
        }
        let gain = EighteenBits::of(settings.roulette_survival.recip());
        let mut map = Self {
            batches: Vec::new(),
            max_events,
            most,
            made: 0,
            journal: Journal::new(gpu, max_events, split)?,
            params: PhotonParams {
                max_events,
                roulette_from: settings.roulette_from,
                roulette_survival: settings.roulette_survival as f32,
                roulette_gain: gain.share,
                roulette_doublings: gain.doublings,
                ..Default::default()
            },
            trace: gpu.kernel("trace", &scene.flags())?,
            going: [gpu.buffer::<u32>("going", 1)?, gpu.buffer::<u32>("going", 1)?],
            list_going: gpu.kernel("going", &[])?,
            query: ByFollower::new(gpu, "photon_query")?,
            pace: Pace::new(gpu, 1 << 14),
            events_at_once: EVENTS_AT_ONCE,
        };
        map.arrange(gpu, &scene.lights, ids, false)?;
        Ok(map)
    }

    /// Takes the kernels that suit an edited scene.
    ///
    /// # Errors
    /// The device refuses them.
    pub fn respecialise(&mut self, gpu: &Gpu, scene: &DeviceScene) -> Result<()> {
        self.trace = gpu.kernel("trace", &scene.flags())?;
        Ok(())
    }

    /// Gives every light its photons: those that it had, else new ones, never computed. Those of lights
    /// that are gone stay idle, for as long as others of their batch are in use; `tidies` where nothing
    /// needs to be kept.
    ///
    /// # Errors
    /// The device refuses the memory.
    pub fn arrange(&mut self, gpu: &Gpu, lights: &Lights, ids: &[u32], tidies: bool) -> Result<()> {
        let wanted = || (0..).zip(ids.iter().zip(&lights.all));
        for Batch { quotas, stale, .. } in &mut self.batches {
            for quota in quotas {
                let is_its = |(_, (id, record)): &(u32, (&u32, &Light))| {
                    (**id, record.photons) == (quota.light_id, quota.of)
                };
                let light = wanted().find(is_its).map(|(light, _)| light);
                // Those that are in use again are to be listed.
                *stale |= quota.light.is_none() && light.is_some();
                quota.light = light;
            }
        }
        let is_idle = |batch: &Batch| batch.quotas.iter().all(|quota| quota.light.is_none());
        self.batches.retain(|batch| !is_idle(batch));
        self.forfeit();
        let fewest = lights.photons.div_ceil(self.most) as usize;
        let has_idle = self.batches.iter().flat_map(|b| &b.quotas).any(|q| q.light.is_none());
        if tidies && (has_idle || self.batches.len() > fewest) {
            self.batches.clear();
        }
        let missing = wanted().filter(|(_, (id, record))| !self.has(**id, record.photons));
        let missing = missing.map(|(light, (&id, record))| (light, id, record.photons));
        for quotas in batch::dealt(&missing.collect::<Vec<_>>(), self.most) {
            self.made += 1;
            self.batches.push(Batch::new(gpu, self.made, quotas, self.max_events)?);
        }
        self.batches.iter_mut().try_for_each(|batch| batch.tell(gpu))?;
        let largest = self.batches.iter().map(|b| b.photons).max().unwrap_or(0);
        for going in &mut self.going {
            if going.size() < 4 * (u64::from(largest) + 1) {
                *going = gpu.buffer::<u32>("going", largest as usize + 1)?;
            }
        }
        self.journal.reserve(gpu, largest)
    }

    /// Photons of a light of which others went with their batch will never be in use again.
    fn forfeit(&mut self) {
        let quotas = || self.batches.iter().flat_map(|batch| &batch.quotas);
        let key = |quota: &Quota| (quota.light_id, quota.of);
        let whole = |of: &Quota| {
            let own = quotas().filter(|quota| key(quota) == key(of));
            own.map(|quota| quota.photons.len() as u32).sum::<u32>() == of.of
        };
        let whole = quotas().map(whole).collect::<Vec<_>>();
        let quotas = self.batches.iter_mut().flat_map(|batch| &mut batch.quotas);
        quotas.zip(whole).filter(|(_, whole)| !whole).for_each(|(quota, _)| quota.of = 0);
    }

    /// Whether a light of so many photons has slots for them.
    pub fn has(&self, light_id: u32, photons: u32) -> bool {
        let mut all = self.batches.iter().flat_map(|batch| &batch.quotas);
        all.any(|quota| (quota.light_id, quota.of) == (light_id, photons))
    }

    /// Where the photons of all lights are, light by light and in their order there: batches, and the
    /// quotas in them.
    pub fn in_order(&self) -> Vec<(&Batch, &Quota)> {
        let of = |batch| move |quota| (batch, quota);
        let all = self.batches.iter().flat_map(|batch| batch.quotas.iter().map(of(batch)));
        let mut all = all.filter(|(_, quota)| quota.light.is_some()).collect::<Vec<_>>();
        all.sort_by_key(|(_, quota)| (quota.light, quota.first_index));
        all
    }

    /// Lists the photons of a batch that an edit touches. Where a
    /// light field follows slots, those whose material scatters otherwise are marked.
    ///
    /// # Errors
    /// The device failed.
    pub fn list(&mut self, cx: Context, batch: usize, risen: u64, follows: Follows) -> Result<()> {
        self.params.risen = words(risen);
        let batch = &self.batches[batch];
        let params = self.params(batch);
        let mut bindings = [cx.scene.bindings(), batch.bindings()].concat();
        bindings.extend([
            ("counters", cx.counters.buffer().into()),
            ("slot_marks", (&batch.slot_marks).into()),
        ]);
        let mut stage = cx.gpu.stage("photon_query");
        batch.list.unmark(&mut stage);
        stage.dispatch(self.query.of(follows), batch.photons.into(), &bindings, &params)?;
        batch.list.record(stage)
    }

    /// What the kernels are told about a batch.
    pub fn params(&self, batch: &Batch) -> PhotonParams {
        PhotonParams { photons: batch.photons, listed: batch.photons, ..self.params }
    }

    /// Whether a driver that ended loops may not do so where fewer events are traced at once; has
    /// them be so from here on.
    pub fn slow_down(&mut self) -> bool {
        let was_fast = self.events_at_once > 1;
        self.events_at_once = 1;
        was_fast
    }

    /// Traces all photons that a batch lists.
    ///
    /// # Errors
    /// The device failed.
    pub fn trace_all(&self, cx: Context, batch: usize, progress: &mut Progress) -> Result<()> {
        let listed = 0..self.batches[batch].photons;
        let total = Total::Known(listed.len() as u64);
        self.trace(cx, &Part { batch, listed }, total, progress)
    }

    /// Traces the photons of a part, a window of events at a time, each with those that go on after the
    /// one before.
    fn trace(&self, cx: Context, part: &Part, total: Total, progress: &mut Progress) -> Result<()> {
        let batch = &self.batches[part.batch];
        let mut params = PhotonParams {
            first_listed: part.listed.start,
            listed: part.listed.len() as u32,
            ..self.params(batch)
        };
        let mut total = total;
        let mut work: &wgpu::Buffer = &batch.list.items;
        for (i, first_event) in
            (0..self.max_events).step_by(self.events_at_once as usize).enumerate()
        {
            params.first_event = first_event;
            params.stop_event = first_event + self.events_at_once;
            self.trace_window(cx, batch, work, total.clone(), params, progress)?;
            if params.stop_event >= self.max_events {
                break;
            }
            let next = &self.going[i % 2];
            let mut stage = cx.gpu.stage("going");
            stage.clear_bytes(Bytes { size: 4, ..Bytes::all(next) });
            let bindings =
                [("work", work.into()), ("tasks", (&batch.tasks).into()), ("going", next.into())];
            match &total {
                Total::Known(all) => stage.dispatch(&self.list_going, *all, &bindings, &params)?,
                Total::Told(told) => {
                    stage.dispatch_told(&self.list_going, told, &bindings, &params)?;
                }
            }
            stage.finish()?;
            total = Total::Told(Told::of(next, params.listed));
            (params.first_listed, work) = (0, next);
        }
        Ok(())
    }

    fn trace_window(
        &self,
        cx: Context,
        batch: &Batch,
        work: &wgpu::Buffer,
        total: Total,
        all: PhotonParams,
        progress: &mut Progress,
    ) -> Result<()> {
        let mut bindings = batch.bindings();
        bindings.retain(|(name, _)| *name != "work");
        bindings = [cx.scene.bindings(), bindings].concat();
        bindings.push(("work", work.into()));
        bindings.push(("counters", cx.counters.buffer().into()));
        let kernel = self.trace.clone();
        let work = move |stage: &mut Stage, range: Range<u64>| {
            let items = range.end - range.start;
            let first_item = all.first_listed + range.start as u32;
            let params = PhotonParams { first_item, items: items as u32, ..all };
            stage.dispatch(&kernel, items, &bindings, &params)
        };
        cx.gpu.sliced("trace", total, &self.pace, work, progress)
    }

    /// The flights of photons of a batch.
    pub fn flights(&self, batch: &Batch, photons: Range<u32>) -> Flights {
        Flights {
            bindings: vec![
                ("places", (&batch.places).into()),
                ("states", (&batch.states).into()),
                ("chosen", self.journal.chosen().into()),
                ("quotas", (&batch.told).into()),
            ],
            max_events: self.max_events,
            photons,
            stride: batch.photons,
            chosen: None,
            in_journal: false,
        }
    }

    /// The slots of all photons, light by light, photon by photon: place and state of each.
    ///
    /// # Errors
    /// The device failed.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<[[u32; 4]; 2]>> {
        let mut slots = Vec::new();
        let mut held = None;
        for (batch, quota) in self.in_order() {
            let (number, places, states) = match held.take() {
                Some((number, places, states)) if number == batch.number => {
                    (number, places, states)
                }
                _ => {
                    let read = |buffer| gpu.read::<[u32; 4]>("photons", buffer);
                    (batch.number, read(&batch.places)?, read(&batch.states)?)
                }
            };
            let (stride, events) = (batch.photons as usize, self.max_events as usize);
            for photon in quota.photons.clone() {
                let all = (0..events).map(|event| event * stride + photon as usize);
                slots.extend(all.map(|at| [places[at], states[at]]));
            }
            held = Some((number, places, states));
        }
        Ok(slots)
    }

    /// Bytes of all slots.
    pub fn bytes(&self) -> u64 {
        self.batches.iter().map(|b| b.places.size() + b.states.size()).sum()
    }

    /// Bytes of tasks, work lists and marks of slots.
    pub fn list_bytes(&self) -> u64 {
        let going = self.going.iter().map(wgpu::Buffer::size).sum::<u64>();
        let of = |b: &Batch| b.tasks.size() + b.list.bytes() + b.slot_marks.size();
        going + self.batches.iter().map(of).sum::<u64>()
    }
}

/// A factor from 1 on as `share` / 2^18 * 2^`doublings`, the share being at most 2^18.
struct EighteenBits {
    share: u32,
    doublings: i32,
}

impl EighteenBits {
    fn of(factor: f64) -> Self {
        let doublings = factor.log2().ceil();
        let share = (factor * (18.0 - doublings).exp2()).round() as u32;
        Self { share, doublings: doublings as i32 }
    }
}
