//! Recording what kernels are to do: dispatches, copies, and long work that is cut into slices.

use std::ops::Range;

use super::clock::Timed;
use super::kernel::Kernel;
use super::pace::{Pace, Slice};
use super::queue::{Command, Dispatch, Play, Size, Total, UNIFORM, Work};
use super::resource::{Bytes, Resource};
use super::turns::{Arguments, Told, groups_for};
use super::{Gpu, Progress, lock};
use crate::error::{Error, Result};

/// Dispatches that belong together.
pub struct Stage<'g> {
    gpu: &'g Gpu,
    name: &'static str,
    phase: usize,
    commands: Vec<Command>,
    /// Groups of dispatches that the device has the length of.
    size: Option<Size>,
    /// What is to be learned from the time that dispatches take.
    slice: Option<Slice>,
    /// Whether what kernels are given is kept for the next time.
    keeps: bool,
}

impl Gpu {
    /// Begins a stage.
    pub fn stage(&self, name: &'static str) -> Stage<'_> {
        Stage::of_phase(self, name, self.phase())
    }

    /// Records `work` over as many items as `total` has, in slices that each take about the slice
    /// budget, so that no driver loses patience and no viewer freezes. `work` records the dispatches
    /// for a range of them; beyond the end of a list whose length the device has they do nothing.
    ///
    /// # Errors
    /// Those of `work` and of the device, if it is played at once ([`Gpu::set_stepped`]).
    pub fn sliced(
        &self,
        name: &'static str,
        total: Total,
        pace: &Pace,
        work: impl FnMut(&mut Stage, Range<u64>) -> Result<()> + Send + 'static,
        progress: &mut Progress,
    ) -> Result<()> {
        let (phase, pace, make) = (self.phase(), pace.clone(), Box::new(work));
        let work = Work { name, phase, total, done: 0, turns: None, pace, make };
        lock(&self.queued).push_back(Command::Work(Box::new(work)));
        self.play_unless_stepped(progress)
    }

    fn play_unless_stepped(&self, progress: &mut Progress) -> Result<()> {
        match self.is_stepped() {
            true => Ok(()),
            false => self.play(Play::Encode, progress).map(|_| ()),
        }
    }
}

impl<'g> Stage<'g> {
    pub(super) fn of_phase(gpu: &'g Gpu, name: &'static str, phase: usize) -> Self {
        Self { gpu, name, phase, commands: Vec::new(), size: None, slice: None, keeps: true }
    }

    /// Its kernels are given what will not be there the next time.
    pub fn once(mut self) -> Self {
        self.keeps = false;
        self
    }

    pub(super) fn follow(&mut self, arguments: Arguments) {
        self.size = Some(Size::Told(arguments));
    }

    pub(super) fn teach(&mut self, slice: Slice) {
        self.slice = Some(slice);
    }

    pub(super) fn into_commands(self) -> Vec<Command> {
        self.commands
    }

    /// Records one dispatch over `items` threads, or as many as the slice has that it is of. `params`
    /// fills the kernel's uniform of that name.
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
        let size = self.size.clone().unwrap_or_else(|| Size::Known(groups_for(items)));
        self.dispatch_sized(kernel, size, bindings, params)
    }

    /// Records one dispatch over a list whose length the device has.
    ///
    /// # Errors
    /// A binding is missing, or the device refuses.
    pub fn dispatch_told<P: bytemuck::Pod>(
        &mut self,
        kernel: &Kernel,
        told: &Told,
        bindings: &[(&'static str, Resource)],
        params: &P,
    ) -> Result<()> {
        let at = self.find_turns(told, told.bound().min(u64::from(u32::MAX)) as u32, 1)?;
        self.dispatch_sized(kernel, Size::Told(self.gpu.argument(at)), bindings, params)
    }

    fn dispatch_sized<P: bytemuck::Pod>(
        &mut self,
        kernel: &Kernel,
        size: Size,
        bindings: &[(&'static str, Resource)],
        params: &P,
    ) -> Result<()> {
        const { assert!(size_of::<P>() <= UNIFORM, "a uniform exceeds its room") };
        let group = self.gpu.group(kernel, bindings, self.keeps)?;
        let told = kernel.told.map(|_| bytemuck::bytes_of(params).to_vec());
        let timed = Timed { kernel: kernel.name, phase: self.phase, slice: self.slice.clone() };
        let pipeline = kernel.pipeline.clone();
        self.commands.push(Command::Dispatch(Dispatch { pipeline, group, told, size, timed }));
        Ok(())
    }

    /// Where it runs.
    pub fn gpu(&self) -> &'g Gpu {
        self.gpu
    }

    /// Clears a whole buffer to zero.
    pub fn clear(&mut self, buffer: &wgpu::Buffer) {
        self.clear_bytes(Bytes::all(buffer));
    }

    /// Clears a part of a buffer to zero.
    pub fn clear_bytes(&mut self, bytes: Bytes) {
        self.commands.push(Command::Clear(bytes));
    }

    /// Copies a part of a buffer into another, from the byte `at` there on.
    pub fn copy(&mut self, from: Bytes, to: &wgpu::Buffer, at: u64) {
        self.commands.push(Command::Copy { from, to: to.clone(), at });
    }

    pub(super) fn push(&mut self, command: Command) {
        self.commands.push(command);
    }

    /// Ends the stage. Nobody waits, unless the device has no clock and the host's must do.
    ///
    /// # Errors
    /// The device failed.
    pub fn finish(mut self) -> Result<()> {
        if self.gpu.tick.is_none() {
            self.commands.push(Command::End);
        }
        lock(&self.gpu.queued).extend(self.commands);
        self.gpu.play_unless_stepped(&mut Progress::silent())?;
        self.gpu.check(self.name)
    }
}

impl Gpu {
    /// What a kernel is given, by its layout.
    fn group(
        &self,
        kernel: &Kernel,
        bindings: &[(&'static str, Resource)],
        keeps: bool,
    ) -> Result<wgpu::BindGroup> {
        let given = |name: &str| bindings.iter().find(|(given, _)| *given == name).map(|(_, r)| r);
        let mut resources = Vec::with_capacity(kernel.bindings.len());
        for (name, &binding) in &kernel.bindings {
            let resource = given(name)
                .ok_or_else(|| Error::device(kernel.name, format!("`{name}` was not bound")))?;
            resources.push((binding, resource.clone()));
        }
        self.keeper.get(self, kernel, resources, keeps)
    }
}
