//! What dispatches took, by the device's own clock where it has one.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::pace::Slice;
use super::queue::DISPATCHES;
use super::{Gpu, lock};
use crate::error::{Error, Result};

/// Time spent in each named dispatch.
#[derive(Clone, Debug, Default)]
pub struct Timings(Vec<Timing>);

/// Time spent in the dispatches of one name.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Timing {
    /// The kernel.
    pub stage: &'static str,
    /// Milliseconds, all dispatches together.
    pub ms: f64,
    /// How many dispatches.
    pub dispatches: u32,
}

impl Timings {
    /// One row for each kernel, in the order of first use.
    pub fn rows(&self) -> &[Timing] {
        &self.0
    }

    fn add(&mut self, stage: &'static str, ms: f64) {
        let at = self.0.iter().position(|row| row.stage == stage).unwrap_or_else(|| {
            self.0.push(Timing { stage, ms: 0.0, dispatches: 0 });
            self.0.len() - 1
        });
        self.0[at].ms += ms;
        self.0[at].dispatches += 1;
    }
}

/// Phases that times are summed by, beside their names.
pub const PHASES: usize = 4;

/// What the host did for the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Effort {
    /// How often it waited for all work, to read what came of it.
    pub waits: u64,
    /// How often it waited for a slice of long work, before it submitted the one after the next.
    pub paced: u64,
    /// Submissions.
    pub submits: u64,
    /// Dispatches.
    pub dispatches: u64,
    /// Buffers that it made.
    pub buffers: u64,
}

impl Effort {
    /// What was done since `before`.
    pub fn since(self, before: Self) -> Self {
        Self {
            waits: self.waits - before.waits,
            paced: self.paced - before.paced,
            submits: self.submits - before.submits,
            dispatches: self.dispatches - before.dispatches,
            buffers: self.buffers - before.buffers,
        }
    }
}

/// Room for the timestamps of one submission, used again and again.
pub(super) struct Stamps {
    pub queries: wgpu::QuerySet,
    pub resolved: wgpu::Buffer,
    pub staging: wgpu::Buffer,
}

/// What a dispatch is timed as.
#[derive(Clone)]
pub(super) struct Timed {
    pub kernel: &'static str,
    pub phase: usize,
    /// What its time is to teach.
    pub slice: Option<Slice>,
}

/// Timestamps of a submission.
struct Unread {
    stamps: Stamps,
    timed: Vec<Timed>,
    is_mapped: Arc<AtomicBool>,
}

/// The timestamps of what was submitted, and the sums of those that were read.
#[derive(Default)]
pub(super) struct Clock {
    unread: Vec<Unread>,
    spare: Vec<Stamps>,
    timings: Timings,
    phases: [f64; PHASES],
    /// A slice of which dispatches are still to be read, and what those that were took.
    open: Option<(Slice, f64)>,
    pub effort: Effort,
}

impl Clock {
    fn note(&mut self, timed: &Timed, ms: f64, budget: Duration) {
        self.timings.add(timed.kernel, ms);
        self.phases[timed.phase] += ms;
        let Some(slice) = &timed.slice else { return };
        match &mut self.open {
            Some((open, sum)) if open.number == slice.number => *sum += ms,
            open => {
                let before = open.replace((slice.clone(), ms));
                before.inspect(|(slice, ms)| slice.learn(*ms, budget));
            }
        }
    }
}

impl Gpu {
    /// What the host did for the device since it was opened.
    pub fn effort(&self) -> Effort {
        lock(&self.clock).effort
    }

    /// Has times summed by phase from here on: what was dispatched before is of phase 0.
    ///
    /// # Errors
    /// The device failed.
    pub fn restart_phases(&self) -> Result<()> {
        self.submit()?;
        let mut clock = lock(&self.clock);
        clock.phases = Default::default();
        clock.unread.iter_mut().flat_map(|u| &mut u.timed).for_each(|timed| timed.phase = 0);
        Ok(())
    }

    /// The sum of the times of each phase, ms, all work being done.
    ///
    /// # Errors
    /// The device failed.
    pub fn phase_ms(&self) -> Result<[f64; PHASES]> {
        self.read_clock()?;
        Ok(lock(&self.clock).phases)
    }

    /// The times measured since the last call, by dispatch name, all work being done.
    ///
    /// # Errors
    /// The device failed.
    pub fn take_timings(&self) -> Result<Timings> {
        self.read_clock()?;
        Ok(std::mem::take(&mut lock(&self.clock).timings))
    }

    pub(super) fn spare_stamps(&self) -> Stamps {
        if let Some(spare) = lock(&self.clock).spare.pop() {
            return spare;
        }
        let count = 2 * DISPATCHES as u32;
        let buffer = |usage| {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("timestamps"),
                size: u64::from(count) * 8,
                usage,
                mapped_at_creation: false,
            })
        };
        Stamps {
            queries: self.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count,
            }),
            resolved: buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            staging: buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ),
        }
    }

    /// Takes the timestamps of a submission, to be read when they are there.
    pub(super) fn expect_times(&self, stamps: Stamps, timed: Vec<Timed>) {
        let is_mapped = Arc::new(AtomicBool::new(false));
        let heard = is_mapped.clone();
        // Where mapping fails the device is lost, which all else tells.
        stamps.staging.map_async(wgpu::MapMode::Read, .., move |_| {
            heard.store(true, Ordering::Release);
        });
        lock(&self.clock).unread.push(Unread { stamps, timed, is_mapped });
    }

    /// Notes what dispatches took on the host's clock, each as long as the others.
    pub(super) fn note_evenly(&self, timed: &[Timed], all_ms: f64) {
        let (mut clock, budget) = (lock(&self.clock), self.slice_budget());
        timed.iter().for_each(|each| clock.note(each, all_ms / timed.len() as f64, budget));
    }

    /// Reads the timestamps that are there.
    pub(super) fn harvest(&self) -> Result<()> {
        let (mut clock, budget) = (lock(&self.clock), self.slice_budget());
        let tick = f64::from(self.tick.unwrap_or(0.0)) * 1e-6;
        let ready = clock.unread.iter().take_while(|u| u.is_mapped.load(Ordering::Acquire)).count();
        for Unread { stamps, timed, .. } in clock.unread.drain(..ready).collect::<Vec<_>>() {
            let view = stamps.staging.get_mapped_range(..);
            let view = view.map_err(|e| Error::device("timestamps", e.to_string()))?;
            for (each, pair) in timed.iter().zip(view.chunks_exact(16)) {
                let [begin, end] =
                    [0, 8].map(|at| bytemuck::pod_read_unaligned::<u64>(&pair[at..at + 8]));
                clock.note(each, end.saturating_sub(begin) as f64 * tick, budget);
            }
            drop(view);
            stamps.staging.unmap();
            clock.spare.push(stamps);
        }
        Ok(())
    }

    /// Waits for all that was recorded, and notes the times.
    fn read_clock(&self) -> Result<()> {
        self.wait("timestamps")?;
        self.harvest()?;
        let (mut clock, budget) = (lock(&self.clock), self.slice_budget());
        clock.open.take().inspect(|(slice, ms)| slice.learn(*ms, budget));
        Ok(())
    }
}

/// A duration in milliseconds.
pub fn milliseconds(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}
