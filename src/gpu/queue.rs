//! What is recorded: a queue of commands in the host's memory, and who plays them.
//!
//! Stages record, and wait for nothing. Long work stands in the queue as one command, and is cut into
//! slices only when its turn comes, by what slices before it took. So whoever plays may stop after any
//! slice, and go on later.
//!
//! There is one encoder for all commands, one pass for all dispatches between copies, one buffer for
//! all that they are told: of their own would take the host longer than the device takes for many a
//! kernel.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::time::Instant;

use super::clock::{Stamps, Timed, milliseconds};
use super::pace::{Pace, Slice};
use super::resource::Bytes;
use super::run::Stage;
use super::turns::{Arguments, MOST_TURNS, Told};
use super::{Gpu, Progress, lock};
use crate::error::Result;

/// Dispatches that are submitted together, whether anybody waits or not: enough to keep a
/// device busy while more are recorded.
pub(super) const DISPATCHES: usize = 64;

/// Where a kernel's uniform may begin, on any adapter; none is larger.
pub(super) const UNIFORM: usize = 256;

/// Slices that the device may have before it that are not done.
const AHEAD: usize = 2;

/// What is to be done.
pub(super) enum Command {
    Dispatch(Dispatch),
    Clear(Bytes),
    Copy {
        from: Bytes,
        to: wgpu::Buffer,
        at: u64,
    },
    Read {
        staging: wgpu::Buffer,
        bytes: u64,
        answer: Arc<AtomicU8>,
    },
    Work(Box<Work>),
    /// The end of a stage, where the host's clock has to do: those that may not wait leave it untimed.
    End,
}

/// A kernel with all that it is given.
pub(super) struct Dispatch {
    pub pipeline: wgpu::ComputePipeline,
    pub group: wgpu::BindGroup,
    /// For its `params`, if it has any.
    pub told: Option<Vec<u8>>,
    pub size: Size,
    pub timed: Timed,
}

/// How many work groups.
#[derive(Clone)]
pub(super) enum Size {
    Known([u32; 2]),
    Told(Arguments),
}

/// Records a range of the items of a work.
pub(super) type Make = Box<dyn FnMut(&mut Stage, Range<u64>) -> Result<()> + Send>;

/// Work that is cut into slices.
pub(super) struct Work {
    pub name: &'static str,
    pub phase: usize,
    pub total: Total,
    pub done: u64,
    /// Of work whose length the device has: the size of its slices, and where the arguments of the
    /// next one are.
    pub turns: Option<Turns>,
    pub pace: Pace,
    pub make: Make,
}

#[derive(Clone, Copy)]
pub(super) struct Turns {
    slice: u32,
    at: u32,
}

/// How many items a work has.
#[derive(Clone, Debug)]
pub enum Total {
    /// So many.
    Known(u64),
    /// As the device has it.
    Told(Told),
}

impl Total {
    /// At most so many.
    pub fn bound(&self) -> u64 {
        match self {
            Self::Known(items) => *items,
            Self::Told(told) => told.bound(),
        }
    }
}

/// How far those wait that play.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Play {
    /// Until all is encoded, to be submitted when enough is, or when somebody asks: they wait for
    /// slices.
    Encode,
    /// Until all is submitted: they wait for slices.
    Submit,
    /// As far as the device has room, and at least one slice until it is so late: they never wait.
    Until(Instant),
}

impl Play {
    /// Whether whoever plays is to stop.
    pub fn is_over(self) -> bool {
        matches!(self, Self::Until(late) if Instant::now() >= late)
    }

    /// Whether those wait that play.
    pub fn waits(self) -> bool {
        !matches!(self, Self::Until(_))
    }
}

/// A slice that was submitted.
struct InFlight {
    submission: wgpu::SubmissionIndex,
    is_done: Arc<AtomicBool>,
}

/// Who encodes and submits.
pub(super) struct Player {
    encoder: Option<wgpu::CommandEncoder>,
    /// Of the encoder; it ends before anything else is recorded there.
    pass: Option<wgpu::ComputePass<'static>>,
    uniforms: wgpu::Buffer,
    /// What the dispatches are told, [`UNIFORM`] bytes each.
    told: Vec<u8>,
    stamps: Option<Stamps>,
    timed: Vec<Timed>,
    /// Readings to be mapped when they are submitted.
    reads: Vec<(wgpu::Buffer, u64, Arc<AtomicU8>)>,
    in_flight: VecDeque<InFlight>,
    slices: u64,
}

/// What becomes of a reading.
pub(super) const ASKED: u8 = 0;
pub(super) const ANSWERED: u8 = 1;
pub(super) const FAILED: u8 = 2;

impl Player {
    pub fn new(uniforms: wgpu::Buffer) -> Self {
        Self {
            encoder: None,
            pass: None,
            uniforms,
            told: Vec::new(),
            stamps: None,
            timed: Vec::new(),
            reads: Vec::new(),
            in_flight: VecDeque::new(),
            slices: 0,
        }
    }

    /// The encoder, no pass being open.
    fn encoder(&mut self, gpu: &Gpu) -> &mut wgpu::CommandEncoder {
        self.pass = None;
        self.encoder.get_or_insert_with(|| gpu.device.create_command_encoder(&Default::default()))
    }

    /// Encodes a command that is no work.
    fn encode(&mut self, gpu: &Gpu, command: Command, play: Play) -> Result<()> {
        match command {
            Command::Dispatch(dispatch) => self.dispatch(gpu, dispatch),
            Command::Clear(Bytes { buffer, offset, size }) => {
                self.encoder(gpu).clear_buffer(&buffer, offset, Some(size));
            }
            Command::Copy { from: Bytes { buffer, offset, size }, to, at } => {
                self.encoder(gpu).copy_buffer_to_buffer(&buffer, offset, &to, at, size);
            }
            Command::Read { staging, bytes, answer } => {
                self.encoder(gpu);
                self.reads.push((staging, bytes, answer));
                self.submit(gpu);
            }
            Command::End if play.waits() => return self.end(gpu),
            Command::End => {}
            Command::Work(_) => {}
        }
        Ok(())
    }

    fn dispatch(&mut self, gpu: &Gpu, dispatch: Dispatch) {
        let Dispatch { pipeline, group, told, size, timed } = dispatch;
        // Offsets of uniforms are told beside the group, which is the same for all.
        let offset = self.told.len() as u32;
        let offsets = if told.is_some() { &[offset][..] } else { &[] };
        self.told.extend(told.into_iter().flatten());
        self.told.resize(self.told.len().next_multiple_of(UNIFORM), 0);
        if gpu.is_timed() && self.stamps.is_none() && self.timed.is_empty() {
            self.stamps = Some(gpu.spare_stamps());
        }
        let queries = self.stamps.as_ref().map(|stamps| stamps.queries.clone());
        let [begin, end] = [0, 1].map(|after| 2 * self.timed.len() as u32 + after);
        let are_inside =
            gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY_INSIDE_PASSES);
        let around = queries.as_ref().filter(|_| !are_inside).map(|query_set| {
            wgpu::ComputePassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(begin),
                end_of_pass_write_index: Some(end),
            }
        });
        let has_own_pass = around.is_some();
        let mut pass = self.pass.take().unwrap_or_else(|| {
            let own = wgpu::ComputePassDescriptor { label: None, timestamp_writes: around };
            self.encoder(gpu).begin_compute_pass(&own).forget_lifetime()
        });
        let inside = queries.as_ref().filter(|_| are_inside);
        inside.inspect(|queries| pass.write_timestamp(queries, begin));
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, offsets);
        match size {
            Size::Known([x, y]) => pass.dispatch_workgroups(x, y, 1),
            Size::Told(Arguments { buffer, offset }) => {
                pass.dispatch_workgroups_indirect(&buffer, offset);
            }
        }
        inside.inspect(|queries| pass.write_timestamp(queries, end));
        self.pass = Some(pass).filter(|_| !has_own_pass);
        self.timed.push(timed);
        if self.timed.len() == DISPATCHES {
            self.submit(gpu);
        }
    }

    /// Submits all that is encoded.
    pub fn submit(&mut self, gpu: &Gpu) -> Option<wgpu::SubmissionIndex> {
        self.pass = None;
        let mut encoder = self.encoder.take()?;
        let (timed, stamps) = (std::mem::take(&mut self.timed), self.stamps.take());
        if let Some(Stamps { queries, resolved, staging }) = &stamps {
            let count = 2 * timed.len() as u32;
            encoder.resolve_query_set(queries, 0..count, resolved, 0);
            encoder.copy_buffer_to_buffer(resolved, 0, staging, 0, u64::from(count) * 8);
        }
        // Before this submission, and after all before it.
        gpu.queue.write_buffer(&self.uniforms, 0, &self.told);
        self.told.clear();
        {
            let effort = &mut lock(&gpu.clock).effort;
            effort.submits += 1;
            effort.dispatches += timed.len() as u64;
        }
        let submission = gpu.queue.submit([encoder.finish()]);
        if let Some(stamps) = stamps {
            gpu.expect_times(stamps, timed);
        }
        for (staging, bytes, answer) in self.reads.drain(..) {
            staging.map_async(wgpu::MapMode::Read, ..bytes, move |mapped| {
                answer.store(if mapped.is_ok() { ANSWERED } else { FAILED }, Ordering::Release);
            });
        }
        Some(submission)
    }

    /// The end of a stage on a device without a clock.
    fn end(&mut self, gpu: &Gpu) -> Result<()> {
        let timed = self.timed.clone();
        if self.pass.is_none() && self.encoder.is_none() {
            return Ok(());
        }
        // All before it was waited for.
        let begun = Instant::now();
        self.submit(gpu);
        gpu.wait_for(None, "stage")?;
        gpu.note_evenly(&timed, milliseconds(begun.elapsed()));
        Ok(())
    }

    /// Whether the device has room for another slice.
    fn has_room(&mut self, gpu: &Gpu, play: Play) -> Result<bool> {
        while let Some(first) = self.in_flight.front() {
            if first.is_done.load(Ordering::Acquire) {
                self.in_flight.pop_front();
            } else if self.in_flight.len() < AHEAD {
                break;
            } else if play.waits() {
                gpu.wait_for(Some(first.submission.clone()), "slice")?;
                lock(&gpu.clock).effort.paced += 1;
                self.in_flight.pop_front();
            } else {
                gpu.poll("slice")?;
                if !first.is_done.load(Ordering::Acquire) {
                    return Ok(false);
                }
            }
        }
        gpu.harvest()?;
        Ok(true)
    }

    /// Plays the next slice of a work. Returns whether there are more.
    fn turn(&mut self, gpu: &Gpu, work: &mut Work, play: Play) -> Result<bool> {
        let bound = work.total.bound();
        if bound == 0 {
            return Ok(false);
        }
        let mut slice = work.pace.slice();
        let mut stage = Stage::of_phase(gpu, work.name, work.phase);
        if let Total::Told(told) = &work.total {
            let turns = match work.turns {
                Some(turns) => turns,
                None => {
                    slice = slice.max(bound.div_ceil(u64::from(MOST_TURNS)));
                    let slice = slice.min(u64::from(u32::MAX)) as u32;
                    let count = bound.div_ceil(u64::from(slice)) as u32;
                    Turns { slice, at: stage.find_turns(told, slice, count)? }
                }
            };
            slice = turns.slice.into();
            work.turns = Some(Turns { at: turns.at + 1, ..turns });
            stage.follow(gpu.argument(turns.at));
        }
        let items = slice.min(bound - work.done);
        if matches!(work.total, Total::Known(_)) {
            self.slices += 1;
            stage.teach(Slice { number: self.slices, items, pace: work.pace.clone() });
        }
        (work.make)(&mut stage, work.done..work.done + items)?;
        // What fitted before, all in one, needs no submission of its own.
        let is_short = items == bound && work.pace.has_proven(items);
        for command in stage.into_commands() {
            self.encode(gpu, command, play)?;
        }
        work.done += items;
        if gpu.tick.is_none() && play.waits() {
            self.end(gpu)?;
        } else if !is_short && let Some(submission) = self.submit(gpu) {
            let is_done = Arc::new(AtomicBool::new(false));
            let heard = is_done.clone();
            gpu.queue.on_submitted_work_done(move || heard.store(true, Ordering::Release));
            self.in_flight.push_back(InFlight { submission, is_done });
        }
        Ok(work.done < bound)
    }
}

impl Gpu {
    /// Plays what was recorded. Returns whether all of it is submitted.
    ///
    /// # Errors
    /// The device failed: nothing remains recorded.
    pub fn play(&self, play: Play, progress: &mut Progress) -> Result<bool> {
        // Who plays does so alone: commands keep their order.
        let mut player = lock(&self.player);
        let played = self.play_with(&mut player, play, progress);
        if played.is_err() {
            lock(&self.queued).clear();
        }
        played
    }

    fn play_with(&self, player: &mut Player, play: Play, progress: &mut Progress) -> Result<bool> {
        let mut has_played = false;
        loop {
            let next = lock(&self.queued).pop_front();
            match next {
                None => break,
                Some(Command::Work(mut work)) => {
                    if has_played && play.is_over() || !player.has_room(self, play)? {
                        lock(&self.queued).push_front(Command::Work(work));
                        player.submit(self);
                        return Ok(false);
                    }
                    has_played = true;
                    let (name, bound) = (work.name, work.total.bound());
                    let is_more = player.turn(self, &mut work, play)?;
                    progress.at(name, work.done, bound);
                    if is_more {
                        lock(&self.queued).push_front(Command::Work(work));
                    }
                }
                Some(command) => player.encode(self, command, play)?,
            }
        }
        if play != Play::Encode {
            player.submit(self);
        }
        self.check("submit").map(|()| true)
    }

    /// Submits all that was recorded.
    ///
    /// # Errors
    /// The device failed.
    pub(super) fn submit(&self) -> Result<()> {
        self.play(Play::Submit, &mut Progress::silent()).map(|_| ())
    }

    /// Forgets what was recorded and not played yet.
    pub fn discard(&self) {
        lock(&self.queued).clear();
    }
}
