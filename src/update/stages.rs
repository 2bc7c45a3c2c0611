//! The stages of an update, one after the other: each is recorded when all before it is submitted.

use super::outlook::Watch;
use super::{PhotonFrame, Step, Updated, light_ids};
use crate::device_scene::Context;
use crate::error::Result;
use crate::field::Request;
use crate::gpu::counter::{COUNTER_WORDS, Choice, Counters};
use crate::gpu::queue::Play;
use crate::gpu::read::{Reading, Words};
use crate::gpu::{Gpu, Progress};
use crate::history::{CHANGE_EMISSION, Query};
use crate::photon::Part;
use crate::scene::{Scene, Spatial};
use crate::segment::{self, BandRay, Sources};
use crate::split::Split;

// What the device's clock sums the times of an update by.
pub(super) const ELSEWHERE: usize = 0;
pub(super) const PHOTONS: usize = 1;
pub(super) const LIGHT_FIELD: usize = 2;
pub(super) const SEGMENTS: usize = 3;

/// How far an update is.
pub(super) struct Going {
    pub next: Next,
    pub is_rebuild: bool,
    /// Parts of the photons, and rays of the bands.
    parts: Vec<Part>,
    rays: Vec<BandRay>,
    done: Updated,
    pub watch: Watch,
    /// A stage was recorded in this step.
    has_moved: bool,
}

/// What an update does next.
pub(super) enum Next {
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

impl PhotonFrame {
    /// The frame, one line a stage: each is recorded when all before it is submitted.
    pub(super) fn advance(
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
                    Answer::Words(words) => match self.end(gpu, &mut going, split, &words)? {
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
            self.map.arrange(gpu, &self.scene.lights, &light_ids(&self.source), true)?;
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
            batch.is_listed = self.fresh || !is_blind || batch.is_relit() || batch.stale;
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
    fn end(
        &mut self,
        gpu: &Gpu,
        going: &mut Going,
        split: &Split,
        words: &[u32],
    ) -> Result<Option<Next>> {
        let (counts, words) = words.split_at(COUNTER_WORDS);
        let (segments, batches) = words.split_at(self.segments.listed().range.end as usize);
        let done = &mut going.done;
        done.counts = Counters::of(counts);
        if self.pending {
            if let Some(next) = self.done_again(gpu, &done.counts, going.is_rebuild)? {
                return match next {
                    // From nothing, however it began.
                    Next::Photons(_) => {
                        *going = self.begin(gpu, split)?;
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
            for batch in &mut self.map.batches {
                batch.calm();
                batch.stale = false;
            }
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
    pub fn share(&self) -> f64 {
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
