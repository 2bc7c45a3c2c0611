//! The photon map of one scene on the device, and how an edit is applied to it.
//!
//! [`PhotonFrame::edit`] takes an edited scene and notes what that changes;
//! [`PhotonFrame::update`] then computes again what the change touches, and leaves every
//! slot, the light field, the segments and the image as a rebuild from nothing would,
//! bit for bit. A rebuild is an update of which everything was never computed.
//!
//! An edit may change settings, too: what does not depend on them is kept ([`Anew`]).
//!
//! What an edit changes stays noted until an update has come to its end. An update may be
//! abandoned at any boundary of its stages, and another edit made: the next one asks for
//! what either changed, and that is all there is to clean up.

mod anew;
mod edit;
mod memory;
mod outlook;
mod stages;
mod warm;

use std::time::{Duration, Instant};

use self::anew::Parts;
use self::memory::Making;
use self::outlook::Took;
use self::stages::{ELSEWHERE, Going, LIGHT_FIELD, Next, PHOTONS, SEGMENTS};
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::field::dirty::Dirty;
use crate::field::{self, LightField};
use crate::gpu::counter::{Choice, CounterBuffer, Counters};
use crate::gpu::groups::Groups;
use crate::gpu::queue::Play;
use crate::gpu::read::others_first;
use crate::gpu::{Gpu, Progress};
use crate::history::Query;
use crate::photon::PhotonMap;
use crate::scene::Scene;
use crate::segment::SegmentMap;
use crate::split::Split;

pub use anew::Anew;
pub use outlook::Outlook;
pub use warm::warm;

/// What an edit can reach.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub enum Scope {
    /// Nothing that anybody could see, beside what an update that was abandoned left over.
    Nothing,
    /// What its query finds.
    Part,
    /// Settings changed: some stages are done anew as a whole, beside what its query finds.
    Anew(Anew),
    /// Everything, and why.
    Everything(&'static str),
}

/// Bytes that updates need beside slots and segments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ListBytes {
    /// Tasks and work lists of photons.
    pub photons: u64,
    /// What bringing points up to date takes while an update runs, at most.
    pub points: u64,
    /// Old slots of the photons that are worked on.
    pub journal: u64,
    /// Work lists of segments, and marks of changed light.
    pub segments: u64,
}

/// Time in the kernels of an update, ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Phases {
    /// Finding, tracing and weighing photons, and moving their flights in the fluence.
    pub photons: f64,
    /// Bringing the light field up to date.
    pub light_field: f64,
    /// Finding and computing segments, and the image.
    pub segments: f64,
}

impl Phases {
    /// What the last update took on this device, all work being done.
    ///
    /// # Errors
    /// The device failed.
    pub fn of_last(gpu: &Gpu) -> Result<Self> {
        let took = gpu.phase_ms()?;
        Ok(Self {
            photons: took[PHOTONS],
            light_field: took[LIGHT_FIELD],
            segments: took[SEGMENTS],
        })
    }
}

/// What an update did.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Updated {
    /// Whether it came to its end; else it was abandoned.
    pub finished: bool,
    /// Photons in all.
    pub photons: u64,
    /// Photons that were traced or weighed again.
    pub listed: u64,
    /// Points whose light changed, those that went and those that came among them; 0 where
    /// segments do not ask for light.
    pub points: u64,
    /// Means, lights and places in the table that points were given, each on its own; those found
    /// again and the same count, too.
    pub points_built: u64,
    /// Segments computed again.
    pub recomputed: u64,
    /// Of them, those whose light alone was corrected by the points that changed.
    pub corrected: u64,
    /// Segments in all.
    pub segments: u64,
    /// What the stages counted, from the edit on. A rebuild compares nothing: all its photons
    /// count as invalid and as changed.
    pub counts: Counters,
}

impl Updated {
    /// Photons with a flight that was traced again, of all, in percent.
    pub fn retraced_percent(&self) -> f64 {
        100.0 * self.counts.invalid as f64 / self.photons.max(1) as f64
    }

    /// Segments computed again, of all, in percent.
    pub fn recomputed_percent(&self) -> f64 {
        100.0 * self.recomputed as f64 / self.segments.max(1) as f64
    }
}

/// Everything that the photon map of one scene keeps on the device.
pub struct PhotonFrame {
    /// The scene.
    pub scene: DeviceScene,
    /// Its photons.
    pub map: PhotonMap,
    /// Its light field.
    pub field: Box<dyn LightField>,
    /// Its view-ray segments.
    pub segments: SegmentMap,
    source: Scene,
    dirty: Dirty,
    counters: CounterBuffer,
    /// What changed since the last update that came to its end.
    query: Query,
    /// Something changed that the query does not tell.
    pending: bool,
    /// Nothing was ever computed, or an error left it in pieces.
    fresh: bool,
    /// What settings have changed and memory is still to be had for.
    missing: Parts,
    /// An update that is under way.
    going: Option<Going>,
    /// What the last update took, and the last rebuild.
    took: [Option<Took>; 2],
    /// What kernels are given, for as long as it is there.
    groups: Groups,
}

/// What came of a step of an update.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// The device is at work, or there is more to do.
    Pending,
    /// The update has come to its end, or was abandoned.
    Done(Box<Updated>),
}

impl PhotonFrame {
    /// Room for everything; nothing is computed yet.
    ///
    /// # Errors
    /// Memory does not suffice, or the estimator does not suit the scene.
    pub fn new(gpu: &Gpu, scene: &Scene, device: DeviceScene, split: &Split) -> Result<Self> {
        let settings = &scene.settings;
        let estimator = field::estimator(settings, &device.table)?;
        let photons = device.lights.photons.into();
        let making = Making { photons, estimator, parts: Parts::all() };
        memory::check(gpu, &memory::needs(scene, &device, making))?;
        let field = field::new(gpu, &device, settings, split)?;
        Ok(Self {
            dirty: Dirty::new(gpu, &device, field.reach(), settings.spatial)?,
            map: PhotonMap::new(gpu, &device, &light_ids(scene), settings, split)?,
            segments: SegmentMap::new(gpu, scene, &device, &*field, split)?,
            counters: CounterBuffer::new(gpu)?,
            source: scene.clone(),
            query: Query::default(),
            pending: true,
            fresh: true,
            missing: Parts::default(),
            going: None,
            took: [None; 2],
            groups: Groups::default(),
            scene: device,
            field,
        })
    }

    /// The scene that was taken last.
    pub fn source(&self) -> &Scene {
        &self.source
    }

    /// Computes everything: an edit that touches everything.
    ///
    /// # Errors
    /// The device failed.
    pub fn rebuild(
        &mut self,
        gpu: &Gpu,
        split: &Split,
        progress: &mut Progress,
    ) -> Result<Updated> {
        self.abandon(gpu, split)?;
        (self.fresh, self.pending) = (true, true);
        self.update(gpu, split, progress)
    }

    /// Ends an update that is under way, soon and not at its end: what it was about stays noted for
    /// the next.
    ///
    /// # Errors
    /// The device failed.
    pub fn abandon(&mut self, gpu: &Gpu, split: &Split) -> Result<()> {
        match self.going.as_ref().map(|going| &going.next) {
            None => return Ok(()),
            Some(Next::Segments(_) | Next::Count | Next::End(_)) => gpu.discard(),
            // A light field that is half built is of no use.
            Some(_) => {
                let mut stop = |_: &str| true;
                self.update(gpu, split, &mut Progress::until(&mut stop))?;
            }
        }
        self.going = None;
        Ok(())
    }

    /// Begins to count, as an edit or a rebuild begins.
    fn count_anew(&mut self, gpu: &Gpu) -> Result<()> {
        self.field.count_anew();
        self.counters.clear(gpu)
    }

    /// What the stages counted since the last edit or rebuild began.
    ///
    /// # Errors
    /// The device failed.
    pub fn counts(&self, gpu: &Gpu) -> Result<Counters> {
        self.counters.read(gpu)
    }

    /// Whether the device has made a choice, and nobody has taken it back.
    ///
    /// # Errors
    /// The device failed.
    pub fn is_chosen(&self, gpu: &Gpu, choice: Choice) -> Result<bool> {
        self.counters.is_chosen(gpu, choice)
    }

    /// Computes what edits have touched since the last update that came to its end, unless
    /// `progress` has it abandoned on the way.
    ///
    /// # Errors
    /// The device failed; the next update rebuilds everything.
    pub fn update(&mut self, gpu: &Gpu, split: &Split, progress: &mut Progress) -> Result<Updated> {
        loop {
            if let Step::Done(done) = self.advanced(gpu, split, Play::Encode, progress)? {
                return Ok(*done);
            }
        }
    }

    /// Goes on with an update, or begins one, for about `budget`, and as far as the device has room for
    /// slices that take as long each; never waits for it. A window calls this once a frame. (The paper's
    /// axis historygrams alone, `spatial = "axes"`, are found on the host, which waits for the marks.)
    ///
    /// # Errors
    /// As [`Self::update`].
    pub fn step(
        &mut self,
        gpu: &Gpu,
        split: &Split,
        budget: Duration,
        progress: &mut Progress,
    ) -> Result<Step> {
        let before = gpu.slice_budget();
        gpu.set_slice_budget(budget);
        gpu.set_stepped(true);
        let result = self.advanced(gpu, split, Play::Until(Instant::now() + budget), progress);
        gpu.set_stepped(false);
        gpu.set_slice_budget(before);
        result
    }

    /// An update in steps, each of about `budget`, that lets others on between them and blocks nobody.
    ///
    /// # Errors
    /// As [`Self::update`].
    pub async fn updated(
        &mut self,
        gpu: &Gpu,
        split: &Split,
        budget: Duration,
        progress: &mut Progress<'_>,
    ) -> Result<Updated> {
        loop {
            if let Step::Done(done) = self.step(gpu, split, budget, progress)? {
                return Ok(*done);
            }
            others_first().await;
        }
    }

    /// Whether steps of an update are to come.
    pub fn is_going(&self) -> bool {
        self.going.is_some()
    }

    /// How far an update is that is under way.
    pub fn outlook(&self) -> Option<Outlook> {
        let going = self.going.as_ref()?;
        Some(going.watch.outlook(going.share(), self.took[usize::from(going.is_rebuild)].as_ref()))
    }

    fn advanced(
        &mut self,
        gpu: &Gpu,
        split: &Split,
        play: Play,
        progress: &mut Progress,
    ) -> Result<Step> {
        gpu.keep_groups(&self.groups);
        let result = self.advance(gpu, split, play, progress);
        gpu.keep_groups(&Groups::default());
        if result.is_err() {
            (self.fresh, self.pending, self.going) = (true, true, None);
        }
        if !matches!(result, Ok(Step::Pending)) {
            gpu.enter(ELSEWHERE);
        }
        result
    }

    /// What updates need beside slots and segments.
    pub fn list_bytes(&self) -> ListBytes {
        ListBytes {
            photons: self.map.list_bytes(),
            points: self.field.update_bytes(),
            journal: self.map.journal_bytes(),
            segments: self.segments.list_bytes() + self.dirty.bytes(),
        }
    }
}

fn light_ids(scene: &Scene) -> Vec<u32> {
    scene.lights.iter().map(|light| light.id).collect()
}
