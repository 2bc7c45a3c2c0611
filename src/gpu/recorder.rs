//! What is recorded and not submitted yet: one encoder for all stages, one pass for all
//! dispatches between copies, one buffer for all that they are told. Encoders, passes and
//! buffers of their own would take the host longer than the device takes for many a kernel.

use std::num::NonZero;

use super::kernel::Kernel;
use super::run::{Bytes, Resource, Stamps};
use super::{Gpu, lock};
use crate::error::{Error, Result};

/// Dispatches that are submitted together, whether anybody waits or not: enough to keep a
/// device busy while more are recorded.
pub(super) const DISPATCHES: u32 = 32;

/// Where a kernel's uniform may begin, on any adapter; none is larger.
pub(super) const UNIFORM: usize = 256;

/// The commands.
pub(super) struct Recorder {
    encoder: Option<wgpu::CommandEncoder>,
    /// Of the encoder; it ends before anything else is recorded there.
    pass: Option<wgpu::ComputePass<'static>>,
    uniforms: wgpu::Buffer,
    /// What the dispatches are told, [`UNIFORM`] bytes each.
    told: Vec<u8>,
    stamps: Option<Stamps>,
    /// Kernel and phase of each dispatch.
    names: Vec<(&'static str, usize)>,
}

impl Recorder {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let uniforms = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("uniforms"),
            size: u64::from(DISPATCHES) * UNIFORM as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let (told, names) = (Vec::new(), Vec::new());
        Self { encoder: None, pass: None, uniforms, told, stamps: None, names }
    }

    /// The encoder, no pass being open.
    pub(super) fn encoder(&mut self, gpu: &Gpu) -> &mut wgpu::CommandEncoder {
        self.pass = None;
        self.encoder.get_or_insert_with(|| gpu.device.create_command_encoder(&Default::default()))
    }

    /// Records a dispatch of so many work groups.
    pub(super) fn dispatch(
        &mut self,
        gpu: &Gpu,
        kernel: &Kernel,
        [x, y]: [u32; 2],
        bindings: &[(&'static str, Resource)],
        told: &[u8],
    ) -> Result<()> {
        let group = self.group(gpu, kernel, bindings, told.len())?;
        self.told.extend_from_slice(told);
        self.told.resize(self.told.len().next_multiple_of(UNIFORM), 0);
        let phase = lock(&gpu.clock).phase;
        if gpu.tick.is_some() && self.stamps.is_none() {
            self.stamps = Some(gpu.spare_stamps());
        }
        let queries = self.stamps.as_ref().map(|stamps| stamps.queries.clone());
        let [begin, end] = [0, 1].map(|after| 2 * self.names.len() as u32 + after);
        let features = gpu.device.features();
        let are_inside = features.contains(wgpu::Features::TIMESTAMP_QUERY_INSIDE_PASSES);
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
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(x, y, 1);
        inside.inspect(|queries| pass.write_timestamp(queries, end));
        self.pass = Some(pass).filter(|_| !has_own_pass);
        self.names.push((kernel.name, phase));
        if self.names.len() as u32 == DISPATCHES {
            self.submit(gpu);
        }
        Ok(())
    }

    /// A kernel's resources, with the next uniform.
    fn group(
        &self,
        gpu: &Gpu,
        kernel: &Kernel,
        bindings: &[(&'static str, Resource)],
        told: usize,
    ) -> Result<wgpu::BindGroup> {
        let mut entries = Vec::with_capacity(kernel.bindings.len());
        for (name, &binding) in &kernel.bindings {
            let given = bindings.iter().find(|(given, _)| given == name).map(|(_, r)| *r);
            let resource = match given {
                Some(Resource::Buffer(buffer)) => buffer.as_entire_binding(),
                Some(Resource::Bytes(Bytes { buffer, offset, size })) => {
                    let size = NonZero::new(size);
                    wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset, size })
                }
                Some(Resource::Texture(view)) => wgpu::BindingResource::TextureView(view),
                None if name == "params" => wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &self.uniforms,
                    offset: self.told.len() as u64,
                    size: NonZero::new(told as u64),
                }),
                None => {
                    return Err(Error::device(kernel.name, format!("`{name}` was not bound")));
                }
            };
            entries.push(wgpu::BindGroupEntry { binding, resource });
        }
        Ok(gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(kernel.name),
            layout: &kernel.layout,
            entries: &entries,
        }))
    }

    /// Submits all that is recorded.
    pub(super) fn submit(&mut self, gpu: &Gpu) {
        self.pass = None;
        let Some(mut encoder) = self.encoder.take() else { return };
        let (names, stamps) = (std::mem::take(&mut self.names), self.stamps.take());
        if let Some(Stamps { queries, resolved, staging }) = &stamps {
            let count = 2 * names.len() as u32;
            encoder.resolve_query_set(queries, 0..count, resolved, 0);
            encoder.copy_buffer_to_buffer(resolved, 0, staging, 0, u64::from(count) * 8);
        }
        // Before this submission, and after all before it.
        gpu.queue.write_buffer(&self.uniforms, 0, &self.told);
        self.told.clear();
        gpu.queue.submit([encoder.finish()]);
        // Not sooner: another thread would read it.
        lock(&gpu.clock).unread.extend(stamps.map(|stamps| (stamps, names)));
    }
}
