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
mod warm;

use std::time::{Duration, Instant};

use self::anew::Parts;
use self::memory::Making;
use self::outlook::{Took, Watch};
use crate::device_scene::{Context, DeviceScene};
use crate::error::Result;
use crate::field::dirty::Dirty;
use crate::field::{self, LightField, Request};
use crate::gpu::counter::{COUNTER_WORDS, Choice, CounterBuffer, Counters};
use crate::gpu::groups::Groups;
use crate::gpu::queue::Play;
use crate::gpu::read::{Reading, Words};
use crate::gpu::{Gpu, Progress};
use crate::history::{CHANGE_EMISSION, Query};
use crate::photon::{Part, PhotonMap};
use crate::scene::{Scene, Spatial};
use crate::segment::{self, BandRay, SegmentMap, Sources};
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

// What the device's clock sums the times of an update by.
const ELSEWHERE: usize = 0;
const PHOTONS: usize = 1;
const LIGHT_FIELD: usize = 2;
const SEGMENTS: usize = 3;

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

/// How far an update is.
struct Going {
    next: Next,
    is_rebuild: bool,
    /// Parts of the photons, and rays of the bands.
    parts: Vec<Part>,
    rays: Vec<BandRay>,
    done: Updated,
    watch: Watch,
    /// A stage was recorded in this step.
    has_moved: bool,
}

/// What an update does next.
enum Next {
    /// Works on a part of the photons.
    Photons(usize),
    /// Finds out what the light field needs to know.
    Survey,
    /// Brings the light field up to date, when that is known.
    Build(Option<Reading>),
    /// Asks which segments see what changed.
    Look,
    /// Computes the segments of a ray of a band.
    Segments(usize),
    /// Reads what was counted.
    Count,
    /// Has that.
    End(Reading),
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
    /// slices that take as long each; never waits for it. A window calls this once a frame.
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

    /// The frame, one line a stage: each is recorded when all before it is submitted.
    fn advance(
        &mut self,
        gpu: &Gpu,
        split: &Split,
        play: Play,
        progress: &mut Progress,
    ) -> Result<Step> {
        let mut going = match self.going.take() {
            Some(going) => going,
            None => self.begin(gpu, split)?,
        };
        loop {
            going.tell_part(progress);
            let is_played = gpu.play(play, progress)?;
            if !is_played || play.is_over() && going.has_moved {
                going.has_moved = false;
                self.going = Some(going);
                return Ok(Step::Pending);
            }
            if going.stops(progress) {
                return Ok(Step::Done(going.done.into()));
            }
            if matches!(going.next, Next::Survey | Next::Look | Next::Count) {
                going.watch.end_stage();
            }
            going.tell_part(progress);
            going.has_moved = true;
            going.next = match std::mem::replace(&mut going.next, Next::Survey) {
                Next::Photons(at) => self.work_on_photons(gpu, &going, at, progress)?,
                Next::Survey => self.survey_field(gpu, &going, split)?,
                Next::Build(reading) => match answered(gpu, reading, play)? {
                    Answer::Waiting(reading) => {
                        going.next = Next::Build(Some(reading));
                        self.going = Some(going);
                        return Ok(Step::Pending);
                    }
                    Answer::Words(words) => {
                        self.build_field(gpu, &mut going, split, &words, progress)?
                    }
                },
                Next::Look => self.look(gpu)?,
                Next::Segments(at) => self.compute_segments(gpu, &going, at, split, progress)?,
                Next::Count => self.ask_for_counts(gpu)?,
                Next::End(reading) => match answered(gpu, Some(reading), play)? {
                    Answer::Waiting(reading) => {
                        going.next = Next::End(reading);
                        self.going = Some(going);
                        return Ok(Step::Pending);
                    }
                    Answer::Words(words) => match self.end(gpu, &mut going, &words)? {
                        None => return Ok(Step::Done(going.done.into())),
                        Some(next) => next,
                    },
                },
            };
        }
    }

    fn nothing_done(&self) -> Updated {
        Updated {
            photons: self.scene.lights.photons.into(),
            segments: self.segments.count(),
            ..Default::default()
        }
    }

    /// Has memory and kernels that suit the scene, and lists the photons that are to be traced or
    /// weighed again.
    fn begin(&mut self, gpu: &Gpu, split: &Split) -> Result<Going> {
        gpu.restart_phases()?;
        self.make_missing(gpu, split)?;
        let is_rebuild = self.pending && self.fresh;
        if is_rebuild {
            self.count_anew(gpu)?;
            self.map.arrange(gpu, &self.scene.lights, &light_ids(&self.source))?;
            self.segments.look(&self.source, &self.scene)?;
            self.map.respecialise(gpu, &self.scene)?;
            self.field.respecialise(gpu, &self.scene)?;
            self.segments.respecialise(gpu, &self.scene, &*self.field)?;
            self.restart();
        }
        let mut parts = Vec::new();
        let mut next = Next::Count;
        if self.pending {
            gpu.enter(PHOTONS);
            self.find_photons(gpu, split)?;
            for batch in (0..self.map.batches.len()).filter(|&i| self.map.batches[i].is_listed) {
                if is_rebuild {
                    let listed = 0..self.map.batches[batch].photons;
                    parts.push(Part { batch, listed });
                } else {
                    parts.extend(self.map.parts(batch));
                }
            }
            next = if parts.is_empty() { Next::Survey } else { Next::Photons(0) };
        }
        let rays = self.segments.rays();
        let (done, watch) = (self.nothing_done(), Watch::begin());
        Ok(Going { next, is_rebuild, parts, rays, done, watch, has_moved: false })
    }

    /// Lists the photons that are to be traced or weighed again.
    fn find_photons(&mut self, gpu: &Gpu, split: &Split) -> Result<()> {
        let cx = Context { gpu, scene: &self.scene, counters: &self.counters };
        let is_blind = self.query.changes.iter().all(|c| c & !CHANGE_EMISSION == 0);
        let mut stage = gpu.stage("photon_query");
        self.counters.unchoose(&mut stage, &[Choice::Invalid]);
        stage.finish()?;
        for i in 0..self.map.batches.len() {
            let batch = &mut self.map.batches[i];
            batch.is_listed = self.fresh || !is_blind || batch.relit || batch.stale;
            if self.fresh {
                batch.list_all(gpu, split.shuffle)?;
            } else if batch.is_listed {
                batch.stale = true;
                self.map.list(cx, i, self.query.risen, self.field.follows())?;
                self.map.batches[i].list.shuffle(gpu, split.shuffle)?;
            }
        }
        let request = request(&self.query, self.fresh, &self.source, split);
        self.field.begin(cx, &self.map, &request)
    }

    /// Traces and weighs the photons of a part, and tells the light field.
    fn work_on_photons(
        &mut self,
        gpu: &Gpu,
        going: &Going,
        at: usize,
        progress: &mut Progress,
    ) -> Result<Next> {
        let cx = Context { gpu, scene: &self.scene, counters: &self.counters };
        let part = &going.parts[at];
        if going.is_rebuild {
            self.map.trace_all(cx, part.batch, progress)?;
        } else {
            self.map.work_on(cx, part, self.field.follows(), progress)?;
            self.field.take(cx, &self.map, part, progress)?;
        }
        Ok(if at + 1 < going.parts.len() { Next::Photons(at + 1) } else { Next::Survey })
    }

    /// Asks what the light field needs to know.
    fn survey_field(&mut self, gpu: &Gpu, going: &Going, split: &Split) -> Result<Next> {
        gpu.enter(LIGHT_FIELD);
        let cx = Context { gpu, scene: &self.scene, counters: &self.counters };
        let request = request(&self.query, going.is_rebuild, &self.source, split);
        let words = self.field.survey(cx, &self.map, &request)?;
        let reading = if words.is_empty() { None } else { Some(gpu.ask("light field", &words)?) };
        Ok(Next::Build(reading))
    }

    /// Brings the light field up to date, and marks where light changed.
    fn build_field(
        &mut self,
        gpu: &Gpu,
        going: &mut Going,
        split: &Split,
        learned: &[u32],
        progress: &mut Progress,
    ) -> Result<Next> {
        let cx = Context { gpu, scene: &self.scene, counters: &self.counters };
        let request = request(&self.query, going.is_rebuild, &self.source, split);
        going.done.points =
            self.field.build(cx, &mut self.map, &request, &self.dirty, learned, progress)?;
        Ok(Next::Look)
    }

    /// Prepares the test of the segments.
    fn look(&mut self, gpu: &Gpu) -> Result<Next> {
        gpu.enter(SEGMENTS);
        self.dirty.project(gpu, &self.scene)?;
        // Where the driver ends loops of segments, they are computed again and all else is not.
        self.counters.save(gpu)?;
        let cx = Context { gpu, scene: &self.scene, counters: &self.counters };
        self.segments.begin(cx)?;
        Ok(Next::Segments(0))
    }

    /// Computes the segments of a ray of a band that read what changed or see light that did, and
    /// their pixels.
    fn compute_segments(
        &mut self,
        gpu: &Gpu,
        going: &Going,
        at: usize,
        split: &Split,
        progress: &mut Progress,
    ) -> Result<Next> {
        let columns = match self.source.settings.spatial {
            // Without a spatial test a segment stands for the photons of its own values, too.
            Spatial::Off => u32::MAX,
            _ => self.field.columns_read(),
        };
        let cx = Context { gpu, scene: &self.scene, counters: &self.counters };
        let from = Sources { field: &*self.field, dirty: &self.dirty };
        let query = self.query.mask(columns, &self.scene.bins);
        let request = segment::Request { from, query, split };
        self.segments.compute(cx, going.rays[at], request, progress)?;
        Ok(if at + 1 < going.rays.len() { Next::Segments(at + 1) } else { Next::Count })
    }

    /// Asks what was counted, and how many items each list has.
    fn ask_for_counts(&self, gpu: &Gpu) -> Result<Next> {
        let batches = self.map.batches.iter().map(|batch| Words::first(&batch.list.items));
        let words = [self.counters.words(), self.segments.listed()].into_iter().chain(batches);
        Ok(Next::End(gpu.ask("counters", &words.collect::<Vec<_>>())?))
    }

    /// All is as the scene has it, and nothing remains noted; or some of it is to be done again with
    /// shorter loops.
    fn end(&mut self, gpu: &Gpu, going: &mut Going, words: &[u32]) -> Result<Option<Next>> {
        let (counts, words) = words.split_at(COUNTER_WORDS);
        let (segments, batches) = words.split_at(self.segments.listed().range.end as usize);
        let done = &mut going.done;
        done.counts = Counters::of(counts);
        if self.pending {
            if let Some(next) = self.done_again(gpu, &done.counts, going.is_rebuild)? {
                return match next {
                    // From nothing, however it began.
                    Next::Photons(_) => {
                        *going = self.begin(gpu, &Split::default())?;
                        Ok(Some(std::mem::replace(&mut going.next, Next::Count)))
                    }
                    next => Ok(Some(next)),
                };
            }
            done.counts.all_fitted()?;
            let lists = self.map.batches.iter().zip(batches).filter(|(batch, _)| batch.is_listed);
            done.listed = lists.map(|(_, &listed)| u64::from(listed)).sum();
            let computed = self.segments.end(segments);
            done.recomputed = computed.segments;
            done.corrected = computed.corrected;
            done.segments = computed.total;
            done.points_built = self.field.points_built(&done.counts);
            self.query = Query::default();
            self.field.all_seen();
            self.map.batches.iter_mut().for_each(|b| (b.relit, b.stale) = (false, false));
            (self.fresh, self.pending) = (false, false);
            gpu.end_update();
            self.groups.end_update();
            self.took[usize::from(going.is_rebuild)] = Some(going.watch.took());
            self.dirty.clear(gpu)?;
        }
        done.finished = true;
        if going.is_rebuild {
            (done.counts.invalid, done.counts.changed) = (done.photons, done.photons);
        }
        Ok(None)
    }

    /// What is to be done again, where the driver ended loops.
    fn done_again(
        &mut self,
        gpu: &Gpu,
        counts: &Counters,
        is_rebuild: bool,
    ) -> Result<Option<Next>> {
        let failed = |items, stage, remedy| Err(Counters::unfinished_error(items, stage, remedy));
        if counts.unfinished > 0 {
            if !self.map.slow_down() && is_rebuild {
                let remedy = "lower `majorant` and the extinctions, or the volume's resolution";
                return failed(counts.unfinished, "trace", remedy);
            }
            self.restart();
            return Ok(Some(Next::Photons(0)));
        }
        if counts.unfinished_light > 0 {
            return failed(counts.unfinished_light, self.field.name(), self.field.remedy());
        }
        if counts.unfinished_segments > 0 {
            if !self.segments.slow_down(&*self.field) {
                let remedy = "raise `segments`, or lower `radius`";
                return failed(counts.unfinished_segments, "segment", remedy);
            }
            self.counters.restore(gpu)?;
            return Ok(Some(Next::Look));
        }
        Ok(None)
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

impl Going {
    /// Which part of a stage comes next, of how many.
    fn part(&self) -> [u64; 2] {
        let (part, of) = match self.next {
            Next::Photons(at) => (at, self.parts.len()),
            Next::Segments(at) => (at, self.rays.len()),
            _ => (0, 1),
        };
        [part as u64, of as u64]
    }

    /// The share of a stage that is done.
    fn share(&self) -> f64 {
        let [part, of] = self.part();
        match self.next {
            Next::Survey | Next::Look | Next::Count | Next::End(_) => 1.0,
            _ => part as f64 / of as f64,
        }
    }

    /// Tells the part.
    fn tell_part(&self, progress: &mut Progress) {
        let [part, of] = self.part();
        progress.set_part(part, of);
    }

    /// Whether it is abandoned before what comes next.
    fn stops(&self, progress: &mut Progress) -> bool {
        match self.next {
            Next::Photons(_) => progress.stops("photons"),
            Next::Survey => progress.stops("light field"),
            Next::Look => progress.stops("segments"),
            _ => false,
        }
    }
}

enum Answer {
    Waiting(Reading),
    Words(Vec<u32>),
}

/// What was asked for, if anything was; those that play until the end wait for it.
fn answered(gpu: &Gpu, reading: Option<Reading>, play: Play) -> Result<Answer> {
    let Some(reading) = reading else { return Ok(Answer::Words(Vec::new())) };
    if play.waits() {
        gpu.wait_for_answer(&reading)?;
    } else if !gpu.is_answered(&reading)? {
        return Ok(Answer::Waiting(reading));
    }
    gpu.taken(reading).map(Answer::Words)
}

fn request<'a>(
    query: &'a Query,
    is_rebuild: bool,
    source: &Scene,
    split: &'a Split,
) -> Request<'a> {
    let asks_for_light = source.settings.spatial != Spatial::Off;
    Request { query, is_rebuild, asks_for_light, split }
}

fn light_ids(scene: &Scene) -> Vec<u32> {
    scene.lights.iter().map(|light| light.id).collect()
}
