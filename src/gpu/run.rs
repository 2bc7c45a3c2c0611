//! Running kernels: named dispatches, their times, and slices under a time budget.

use std::time::{Duration, Instant};

use wgpu::util::DeviceExt;

use super::kernel::Kernel;
use super::{GROUP, Gpu, lock};
use crate::error::{Error, Result};

/// Work groups in one dimension that WebGPU allows.
const MAX_GROUPS: u32 = 65_535;

/// What a kernel can be given by name.
#[derive(Clone, Copy)]
pub enum Resource<'a> {
    /// A whole storage or uniform buffer.
    Buffer(&'a wgpu::Buffer),
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

    /// Milliseconds of the stages whose name begins with `prefix`.
    pub fn ms(&self, prefix: &str) -> f64 {
        self.0.iter().filter(|row| row.stage.starts_with(prefix)).map(|row| row.ms).sum()
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

/// Dispatches that are submitted and waited for together.
pub struct Stage<'g> {
    gpu: &'g Gpu,
    name: &'static str,
    encoder: wgpu::CommandEncoder,
    queries: Option<wgpu::QuerySet>,
    dispatched: Vec<&'static str>,
}

/// Dispatches that one stage may hold, for the sake of its timestamps.
const STAGE_DISPATCHES: u32 = 64;

impl Gpu {
    /// Begins a stage.
    pub fn stage(&self, name: &'static str) -> Stage<'_> {
        let queries = self.tick.map(|_| {
            self.device().create_query_set(&wgpu::QuerySetDescriptor {
                label: Some(name),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * STAGE_DISPATCHES,
            })
        });
        Stage {
            gpu: self,
            name,
            encoder: self.device().create_command_encoder(&Default::default()),
            queries,
            dispatched: Vec::new(),
        }
    }

    /// Runs `work` over the items `0..total` in slices that each take about the
    /// slice budget, so that no driver loses patience and no viewer freezes.
    /// `work` records the dispatches for its range; `progress` hears how many items are done.
    ///
    /// # Errors
    /// Those of `work` and of the device.
    pub fn sliced(
        &self,
        name: &'static str,
        total: u64,
        first_slice: u64,
        mut work: impl FnMut(&mut Stage, std::ops::Range<u64>) -> Result<()>,
        progress: &mut dyn FnMut(u64),
    ) -> Result<()> {
        let mut slice = first_slice.clamp(1, total.max(1));
        let mut done = 0;
        while done < total {
            let end = (done + slice).min(total);
            let begun = Instant::now();
            let mut stage = self.stage(name);
            work(&mut stage, done..end)?;
            stage.finish()?;
            done = end;
            progress(done);
            let factor = self.slice_budget.as_secs_f64() / begun.elapsed().as_secs_f64().max(1e-6);
            slice = ((slice as f64 * factor.clamp(0.25, 4.0)) as u64).max(u64::from(GROUP));
        }
        Ok(())
    }
}

impl Stage<'_> {
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
        if self.dispatched.len() as u32 == STAGE_DISPATCHES {
            return Err(Error::device(kernel.name, "too many dispatches in one stage"));
        }
        let device = self.gpu.device();
        let params = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some(kernel.name),
            contents: bytemuck::bytes_of(params),
            usage: wgpu::BufferUsages::UNIFORM,
        });
        let mut entries = Vec::with_capacity(kernel.bindings.len());
        for (name, &binding) in &kernel.bindings {
            let given = bindings.iter().find(|(given, _)| given == name).map(|(_, r)| *r);
            let resource = match given {
                Some(Resource::Buffer(buffer)) => buffer.as_entire_binding(),
                Some(Resource::Texture(view)) => wgpu::BindingResource::TextureView(view),
                None if name == "params" => params.as_entire_binding(),
                None => {
                    return Err(Error::device(kernel.name, format!("`{name}` was not bound")));
                }
            };
            entries.push(wgpu::BindGroupEntry { binding, resource });
        }
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(kernel.name),
            layout: &kernel.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let at = 2 * self.dispatched.len() as u32;
        let mut pass = self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(kernel.name),
            timestamp_writes: self.queries.as_ref().map(|query_set| {
                wgpu::ComputePassTimestampWrites {
                    query_set,
                    beginning_of_pass_write_index: Some(at),
                    end_of_pass_write_index: Some(at + 1),
                }
            }),
        });
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, &group, &[]);
        let [x, y] = groups_for(items);
        pass.dispatch_workgroups(x, y, 1);
        drop(pass);
        self.dispatched.push(kernel.name);
        self.gpu.check(kernel.name)
    }

    /// Clears a whole buffer to zero.
    pub fn clear(&mut self, buffer: &wgpu::Buffer) {
        self.encoder.clear_buffer(buffer, 0, None);
    }

    /// Copies the beginning of one buffer to another.
    pub fn copy(&mut self, from: &wgpu::Buffer, to: &wgpu::Buffer, bytes: u64) {
        self.encoder.copy_buffer_to_buffer(from, 0, to, 0, bytes);
    }

    /// Submits, waits, and notes the times.
    ///
    /// # Errors
    /// The device failed.
    pub fn finish(mut self) -> Result<()> {
        let gpu = self.gpu;
        let count = self.dispatched.len() as u32;
        let stamps = self.queries.take().filter(|_| count > 0).map(|queries| {
            let size = u64::from(2 * count) * 8;
            let make = |usage| {
                gpu.device().create_buffer(&wgpu::BufferDescriptor {
                    label: Some("timestamps"),
                    size,
                    usage,
                    mapped_at_creation: false,
                })
            };
            let resolved = make(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC);
            let staging = make(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ);
            self.encoder.resolve_query_set(&queries, 0..2 * count, &resolved, 0);
            self.encoder.copy_buffer_to_buffer(&resolved, 0, &staging, 0, size);
            staging
        });
        let begun = Instant::now();
        gpu.queue().submit([self.encoder.finish()]);
        let stamps = match &stamps {
            Some(staging) => Some(gpu.map_and_copy::<u64>(self.name, staging)?),
            None => gpu.wait(self.name).map(|()| None)?,
        };
        let wall = begun.elapsed();
        let mut timings = lock(&gpu.timings);
        for (i, name) in self.dispatched.iter().enumerate() {
            let ms = match (&stamps, gpu.tick) {
                (Some(t), Some(tick)) => {
                    t[2 * i + 1].saturating_sub(t[2 * i]) as f64 * f64::from(tick) * 1e-6
                }
                _ => milliseconds(wall) / f64::from(count),
            };
            timings.add(name, ms);
        }
        Ok(())
    }
}

/// A duration in milliseconds.
pub fn milliseconds(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}
