//! The photon map: slots of an implicit linked list, filled by tracing.
//!
//! Event k of photon p lives at slot `k * photons + p` of its batch, in two arrays of
//! 16 bytes. A batch belongs to one light, so that an edit of a light leaves the photons
//! of the others where they are. Tracing works over a list of photons; each one's task
//! says from which event on its slots may no longer hold. A full rebuild lists all of them,
//! from event 0.
//!
//! An update lists the photons that a query meets, keeps their old slots in a journal of
//! fixed size, part of the list after part, and hands on what tracing again has changed. A
//! slot's history is that of its own flight, so that each is judged by itself; and a flight
//! that is judged invalid is flown again only in the macro-cells and layers of marks in
//! which the edit can have made a tentative collision real.

mod journal;
pub mod probe;

use std::ops::Range;
use std::sync::Arc;

use self::journal::Journal;
pub use self::journal::SLOTS as JOURNAL_SLOTS;
use crate::bits::words;
use crate::device_scene::lights::Lights;
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
use crate::gpu::work::{WorkList, fill, fill_first};
use crate::scene::Settings;
use crate::split::Split;

/// Bytes of a photon slot.
pub const SLOT_BYTES: u64 = 32;

/// Events that one dispatch traces: few, so that no thread runs for long.
const EVENTS_AT_ONCE: u32 = 4;

/// A state that was never computed: empty, with a history of all ones.
const NEVER: [u32; 4] = [0, 0, u32::MAX, u32::MAX];

shared_struct! {
    /// What the kernels that work on photons are told.
    pub struct PhotonParams {
        /// Which light the batch belongs to.
        pub light: u32,
        /// The light's photon that is the batch's first.
        pub first_index: u32,
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
        /// 1 where the light's power changed.
        pub relit: u32,
        /// 1 / `roulette_survival`: this / 2^18 * 2^`roulette_doublings`.
        pub roulette_gain: u32,
        /// See `roulette_gain`.
        pub roulette_doublings: i32,
        /// Blocks of marks of photons that changed.
        pub blocks: u32,
        /// Keeps the size a multiple of 16.
        pub pad0: u32,
        /// The same.
        pub pad1: u32,
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

/// Photons of one light that fit one binding.
pub struct Batch {
    /// The light's stable id.
    pub light_id: u32,
    /// The light's place in the scene.
    pub light: u32,
    /// The light's photon that is the first here.
    pub first_index: u32,
    /// How many.
    pub photons: u32,
    /// Position and direction of each slot.
    pub places: wgpu::Buffer,
    /// Power, entry, kind and history of each slot.
    pub states: wgpu::Buffer,
    /// What is to be done with each photon.
    pub tasks: wgpu::Buffer,
    /// The photons to work on.
    pub list: WorkList,
    /// Whether it has listed any, that anybody knows of.
    pub is_listed: bool,
    /// The light's power changed, and an update has not finished since.
    pub relit: bool,
    /// Slots may have changed that the light field does not know of yet.
    pub stale: bool,
    /// [`SlotMarks`] of its slots.
    pub slot_marks: wgpu::Buffer,
}

impl Batch {
    fn new(gpu: &Gpu, id: u32, first_index: u32, photons: u32, max_events: u32) -> Result<Self> {
        let slots = photons as usize * max_events as usize;
        let batch = Self {
            light_id: id,
            light: 0,
            first_index,
            photons,
            places: gpu.buffer::<[u32; 4]>("photon places", slots)?,
            states: gpu.buffer::<[u32; 4]>("photon states", slots)?,
            tasks: gpu.buffer::<u32>("photon tasks", photons as usize)?,
            list: WorkList::new(gpu, photons)?,
            is_listed: false,
            relit: false,
            stale: true,
            slot_marks: gpu.buffer::<SlotMarks>("slot marks", slots.div_ceil(32))?,
        };
        batch.forget(gpu)?;
        Ok(batch)
    }

    /// Its resources, by the names that the kernels give them.
    pub fn bindings(&self) -> Bindings {
        vec![
            ("places", (&self.places).into()),
            ("states", (&self.states).into()),
            ("tasks", (&self.tasks).into()),
            ("work", (&self.list.items).into()),
            ("marks", (&self.list.marks).into()),
        ]
    }

    /// Marks every photon as never computed, which its first slot tells.
    ///
    /// # Errors
    /// The device failed.
    pub fn forget(&self, gpu: &Gpu) -> Result<()> {
        fill(gpu, "forget", &self.slot_marks, &[u32::MAX])?;
        let mut stage = gpu.stage("forget");
        stage.clear(&self.places);
        stage.clear(&self.states);
        stage.finish()?;
        let first = self.photons * NEVER.len() as u32;
        fill_first(gpu, "forget", &self.states, first, &NEVER)
    }

    /// The light field knows all slots as they are.
    ///
    /// # Errors
    /// The device failed.
    pub fn unmark(&mut self, gpu: &Gpu) -> Result<()> {
        if std::mem::take(&mut self.stale) {
            let mut stage = gpu.stage("slot marks");
            stage.clear(&self.slot_marks);
            stage.finish()?;
        }
        Ok(())
    }

    /// Lists every photon, with a task from event 0.
    ///
    /// # Errors
    /// The device failed.
    pub fn list_all(&mut self, gpu: &Gpu, shuffle: Option<u64>) -> Result<()> {
        let mut stage = gpu.stage("list");
        stage.clear(&self.tasks);
        self.list.fill(stage, shuffle)
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

/// Flights to be added to a light field or taken out of it: of all photons of a batch, or of those
/// of a part that changed.
#[derive(Clone)]
pub struct Flights {
    /// Slots, and the photons that are chosen, by the names that kernels give them.
    pub bindings: Bindings,
    /// Which light the batch belongs to.
    pub light: u32,
    /// The light's photon that is the batch's first.
    pub first_index: u32,
    /// Slots of a photon.
    pub max_events: u32,
    /// Photons in the batch.
    pub photons: u32,
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
    /// The batches, in the order of the scene's lights.
    pub batches: Vec<Batch>,
    /// Slots of each photon.
    pub max_events: u32,
    most: u32,
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
        map.arrange(gpu, &scene.lights, ids)?;
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

    /// Gives every light its batches: those that it had, else new ones, never computed.
    /// Batches of lights that are gone go too.
    ///
    /// # Errors
    /// The device refuses the memory.
    pub fn arrange(&mut self, gpu: &Gpu, lights: &Lights, ids: &[u32]) -> Result<()> {
        let mut before = std::mem::take(&mut self.batches);
        for (light, (&id, record)) in (0..).zip(ids.iter().zip(&lights.all)) {
            let (own, others) = before.into_iter().partition::<Vec<_>, _>(|b| b.light_id == id);
            before = others;
            let held: u32 = own.iter().map(|b| b.photons).sum();
            let mut own = if held == record.photons { own } else { Vec::new() };
            if own.is_empty() {
                // Even batches: the last is no smaller than it must be.
                let each = record.photons.div_ceil(record.photons.div_ceil(self.most).max(1));
                for first in (0..record.photons).step_by(each.max(1) as usize) {
                    let photons = each.min(record.photons - first);
                    own.push(Batch::new(gpu, id, first, photons, self.max_events)?);
                }
            }
            for batch in &mut own {
                batch.light = light;
            }
            self.batches.append(&mut own);
        }
        let largest = self.batches.iter().map(|b| b.photons).max().unwrap_or(0);
        for going in &mut self.going {
            if going.size() < 4 * (u64::from(largest) + 1) {
                *going = gpu.buffer::<u32>("going", largest as usize + 1)?;
            }
        }
        self.journal.reserve(gpu, largest)
    }

    /// Lists the photons of a batch that an edit touches. Where a
    /// light field follows slots, those whose material scatters otherwise are marked.
    ///
    /// # Errors
    /// The device failed.
    pub fn list(&mut self, cx: Context, batch: usize, risen: u64, follows: Follows) -> Result<()> {
        self.params.risen = words(risen);
        let batch = &self.batches[batch];
        let params = PhotonParams { relit: batch.relit.into(), ..self.params(batch) };
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
        PhotonParams {
            light: batch.light,
            first_index: batch.first_index,
            photons: batch.photons,
            listed: batch.photons,
            ..self.params
        }
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

    /// The flights of all photons of a batch.
    pub fn flights(&self, batch: &Batch) -> Flights {
        Flights {
            bindings: vec![
                ("places", (&batch.places).into()),
                ("states", (&batch.states).into()),
                ("chosen", self.journal.chosen().into()),
            ],
            light: batch.light,
            first_index: batch.first_index,
            max_events: self.max_events,
            photons: batch.photons,
            chosen: None,
            in_journal: false,
        }
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
