//! Running kernels: named dispatches, their times, and slices under a time budget.

use std::cell::Cell;
use std::time::{Duration, Instant};

use super::kernel::Kernel;
use super::recorder::{DISPATCHES, UNIFORM};
use super::{GROUP, Gpu, lock};
use crate::error::{Error, Result};

/// Work groups in one dimension that WebGPU allows.
const MAX_GROUPS: u32 = 65_535;

/// What a kernel can be given by name.
#[derive(Clone, Copy)]
pub enum Resource<'a> {
    /// A whole storage or uniform buffer.
    Buffer(&'a wgpu::Buffer),
    /// Some bytes of a buffer: they begin at a multiple of 256.
    Bytes(Bytes<'a>),
    /// A texture.
    Texture(&'a wgpu::TextureView),
}

impl<'a> From<&'a wgpu::Buffer> for Resource<'a> {
    fn from(buffer: &'a wgpu::Buffer) -> Self {
        Self::Buffer(buffer)
    }
}

impl<'a> From<&'a wgpu::TextureView> for Resource<'a> {
    fn from(view: &'a wgpu::TextureView) -> Self {
        Self::Texture(view)
    }
}

/// A part of a buffer.
#[derive(Clone, Copy)]
pub struct Bytes<'a> {
    /// The buffer.
    pub buffer: &'a wgpu::Buffer,
    /// Where the part begins.
    pub offset: u64,
    /// How many bytes it has.
    pub size: u64,
}

impl<'a> Bytes<'a> {
    /// All of a buffer.
    pub fn all(buffer: &'a wgpu::Buffer) -> Self {
        Self { buffer, offset: 0, size: buffer.size() }
    }
}

impl<'a> From<Bytes<'a>> for Resource<'a> {
    fn from(bytes: Bytes<'a>) -> Self {
        Self::Bytes(bytes)
    }
}

/// Resources by the name that the kernels give them.
pub type Bindings<'a> = Vec<(&'static str, Resource<'a>)>;

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

/// Work groups for `items` threads: in two dimensions where one does not suffice.
pub fn groups_for(items: u64) -> [u32; 2] {
    let groups = items.div_ceil(u64::from(GROUP)).max(1);
    let rows = groups.div_ceil(u64::from(MAX_GROUPS));
    [groups.div_ceil(rows) as u32, rows as u32]
}

/// Dispatches that belong together.
pub struct Stage<'g> {
    gpu: &'g Gpu,
    name: &'static str,
    dispatched: Vec<&'static str>,
    /// The first dispatch, where the host's clock has to do.
    begun: Instant,
}

/// Submissions whose times wait to be read, at most.
const UNREAD: usize = 256;

/// Room for the timestamps of one submission, used again and again.
pub(super) struct Stamps {
    pub(super) queries: wgpu::QuerySet,
    pub(super) resolved: wgpu::Buffer,
    pub(super) staging: wgpu::Buffer,
}

/// Phases that times are summed by, beside their names.
pub const PHASES: usize = 4;

/// The timestamps of what was submitted, with the kernel and the phase of each dispatch.
#[derive(Default)]
pub(super) struct Clock {
    pub(super) unread: Vec<(Stamps, Vec<(&'static str, usize)>)>,
    spare: Vec<Stamps>,
    pub(super) phase: usize,
    phases: [f64; PHASES],
    /// How often the host has waited for the device.
    pub(super) waits: u64,
}

/// How many items of one kind of work a slice takes, as its past slices tell.
pub struct Pace {
    slice: Cell<u64>,
    /// So many fitted the budget.
    proven: Cell<u64>,
}

impl Pace {
    /// Nothing is known yet but a `slice` to begin with.
    pub fn new(slice: u64) -> Self {
        Self { slice: Cell::new(slice), proven: Cell::new(0) }
    }

    /// Learns from a slice of `items` that took `share` of the budget.
    fn learn(&self, items: u64, share: f64) {
        // The last slice is short, and tells no more than that it did not take too long.
        if items >= self.slice.get() || share > 1.0 {
            let next = items as f64 * share.recip().clamp(0.25, 4.0);
            self.slice.set((next as u64).max(GROUP.into()));
        }
        let proven = self.proven.get();
        self.proven.set(if share <= 1.0 { proven.max(items) } else { proven.min(items - 1) });
    }
}

impl Gpu {
    /// Begins a stage.
    pub fn stage(&self, name: &'static str) -> Stage<'_> {
        Stage { gpu: self, name, dispatched: Vec::new(), begun: Instant::now() }
    }

    /// Has the times of what is dispatched from now on summed as this phase, below [`PHASES`].
    pub fn enter(&self, phase: usize) {
        lock(&self.clock).phase = phase;
    }

    /// How often the host has waited for the device since it was opened.
    pub fn waits(&self) -> u64 {
        lock(&self.clock).waits
    }

    /// Has times summed by phase from here on: what was dispatched before is of phase 0.
    pub fn restart_phases(&self) {
        self.submit();
        let mut clock = lock(&self.clock);
        clock.phases = Default::default();
        clock.unread.iter_mut().flat_map(|(_, names)| names).for_each(|(_, phase)| *phase = 0);
    }

    /// The sum of the times of each phase, ms, all work being done.
    ///
    /// # Errors
    /// The device failed.
    pub fn phase_ms(&self) -> Result<[f64; PHASES]> {
        self.read_clock()?;
        Ok(lock(&self.clock).phases)
    }

    pub(super) fn spare_stamps(&self) -> Stamps {
        if let Some(spare) = lock(&self.clock).spare.pop() {
            return spare;
        }
        let count = 2 * DISPATCHES;
        let buffer = |usage| {
            self.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some("timestamps"),
                size: u64::from(count) * 8,
                usage,
                mapped_at_creation: false,
            })
        };
        Stamps {
            queries: self.device().create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count,
            }),
            resolved: buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            staging: buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ),
        }
    }

    /// Runs `work` over the items `0..total` in slices that each take about the
    /// slice budget, so that no driver loses patience and no viewer freezes: each is waited
    /// for, but a last one of a size that has proven itself.
    /// `work` records the dispatches for its range; `progress` hears how many items are done.
    ///
    /// # Errors
    /// Those of `work` and of the device.
    pub fn sliced(
        &self,
        name: &'static str,
        total: u64,
        pace: &Pace,
        mut work: impl FnMut(&mut Stage, std::ops::Range<u64>) -> Result<()>,
        progress: &mut dyn FnMut(u64),
    ) -> Result<()> {
        if total > pace.proven.get() {
            self.wait(name)?;
        }
        let mut done = 0;
        while done < total {
            let items = pace.slice.get().min(total - done);
            let begun = Instant::now();
            let mut stage = self.stage(name);
            work(&mut stage, done..done + items)?;
            stage.finish()?;
            done += items;
            if done < total || items > pace.proven.get() {
                self.wait(name)?;
                pace.learn(items, begun.elapsed().div_duration_f64(self.slice_budget));
            }
            progress(done);
        }
        Ok(())
    }

    /// Waits for all that was recorded, and notes the times.
    pub(super) fn read_clock(&self) -> Result<()> {
        self.submit();
        let unread = std::mem::take(&mut lock(&self.clock).unread);
        let Some(tick) = self.tick.filter(|_| !unread.is_empty()) else {
            return Ok(());
        };
        for (stamps, _) in &unread {
            stamps.staging.map_async(wgpu::MapMode::Read, .., |_| {});
        }
        self.wait("timestamps")?;
        for (stamps, names) in unread {
            let view = stamps.staging.get_mapped_range(..);
            let view = view.map_err(|e| Error::device("timestamps", e.to_string()))?;
            let times = view.chunks_exact(16).map(|pair| {
                let [begin, end] =
                    [0, 8].map(|at| bytemuck::pod_read_unaligned::<u64>(&pair[at..at + 8]));
                end.saturating_sub(begin) as f64 * f64::from(tick) * 1e-6
            });
            self.note(names.into_iter().zip(times));
            drop(view);
            stamps.staging.unmap();
            lock(&self.clock).spare.push(stamps);
        }
        Ok(())
    }

    fn note(&self, times: impl Iterator<Item = ((&'static str, usize), f64)>) {
        let (mut timings, mut clock) = (lock(&self.timings), lock(&self.clock));
        for ((name, phase), ms) in times {
            timings.add(name, ms);
            clock.phases[phase] += ms;
        }
    }
}

impl<'g> Stage<'g> {
    /// Records one dispatch over `items` threads. `params` fills the kernel's uniform of that name.
    ///
    /// # Errors
    /// A binding is missing, or the device refuses.
    pub fn dispatch<P: bytemuck::Pod>(
        &mut self,
        kernel: &Kernel,
        items: u64,
        bindings: &[(&'static str, Resource)],
        params: &P,
    ) -> Result<()> {
        if self.gpu.tick.is_none() && self.dispatched.is_empty() {
            self.gpu.wait(self.name)?;
            self.begun = Instant::now();
        }
        const { assert!(size_of::<P>() <= UNIFORM, "a uniform exceeds its room") };
        let told = bytemuck::bytes_of(params);
        lock(&self.gpu.recorder).dispatch(self.gpu, kernel, groups_for(items), bindings, told)?;
        self.dispatched.push(kernel.name);
        self.gpu.check(kernel.name)
    }

    /// Where it runs.
    pub fn gpu(&self) -> &'g Gpu {
        self.gpu
    }

    /// Clears a whole buffer to zero.
    pub fn clear(&mut self, buffer: &wgpu::Buffer) {
        lock(&self.gpu.recorder).encoder(self.gpu).clear_buffer(buffer, 0, None);
    }

    /// Clears a part of a buffer to zero.
    pub fn clear_bytes(&mut self, Bytes { buffer, offset, size }: Bytes) {
        lock(&self.gpu.recorder).encoder(self.gpu).clear_buffer(buffer, offset, Some(size));
    }

    /// Copies a part of a buffer into another, from the byte `at` there on.
    pub fn copy(&mut self, from: Bytes, to: &wgpu::Buffer, at: u64) {
        let Bytes { buffer, offset, size } = from;
        let mut recorder = lock(&self.gpu.recorder);
        recorder.encoder(self.gpu).copy_buffer_to_buffer(buffer, offset, to, at, size);
    }

    /// Ends the stage. Nobody waits, unless the device has no clock and the host's must do.
    ///
    /// # Errors
    /// The device failed.
    pub fn finish(self) -> Result<()> {
        let gpu = self.gpu;
        if gpu.tick.is_some() {
            let is_much = lock(&gpu.clock).unread.len() >= UNREAD;
            return if is_much { gpu.read_clock() } else { gpu.check(self.name) };
        }
        gpu.wait(self.name)?;
        let each = milliseconds(self.begun.elapsed()) / self.dispatched.len() as f64;
        let phase = lock(&gpu.clock).phase;
        gpu.note(self.dispatched.into_iter().map(|name| ((name, phase), each)));
        Ok(())
    }
}

/// A duration in milliseconds.
pub fn milliseconds(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}
