//! What kernels are told, many dispatches' in one buffer: one for each would take longer to
//! make than all else about a dispatch.

use std::num::NonZero;
use std::sync::{Arc, Mutex};

use super::{Gpu, lock};

/// Bytes of one buffer.
const ROOM: usize = 1 << 16;

/// Where a kernel's uniform may begin, on any adapter.
const ALIGNMENT: usize = 256;

/// The uniforms of dispatches that are recorded together.
pub(super) struct Uniforms {
    buffer: wgpu::Buffer,
    bytes: Mutex<Vec<u8>>,
}

impl Uniforms {
    fn new(gpu: &Gpu) -> Arc<Self> {
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("uniforms"),
            size: ROOM as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Arc::new(Self { buffer, bytes: Mutex::default() })
    }

    /// The uniform that begins at a byte.
    pub(super) fn binding(&self, at: u64, size: usize) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.buffer,
            offset: at,
            size: NonZero::new(size as u64),
        })
    }

    /// Brings all to the device, before what is submitted next.
    pub(super) fn write(&self, queue: &wgpu::Queue) {
        queue.write_buffer(&self.buffer, 0, &lock(&self.bytes));
    }
}

impl Gpu {
    /// Takes a uniform; returns where it will be.
    pub(super) fn uniform(&self, contents: &[u8]) -> (Arc<Uniforms>, u64) {
        let mut current = lock(&self.uniforms);
        let full = |uniforms: &Arc<Uniforms>| lock(&uniforms.bytes).len() + contents.len() > ROOM;
        let uniforms = match current.take().filter(|uniforms| !full(uniforms)) {
            Some(uniforms) => uniforms,
            None => Uniforms::new(self),
        };
        let mut bytes = lock(&uniforms.bytes);
        let at = bytes.len() as u64;
        bytes.extend_from_slice(contents);
        let end = bytes.len().next_multiple_of(ALIGNMENT);
        bytes.resize(end, 0);
        drop(bytes);
        *current = Some(uniforms.clone());
        (uniforms, at)
    }

    /// Begins anew where all dispatches were submitted.
    pub(super) fn reuse_uniforms(&self) {
        let mut current = lock(&self.uniforms);
        if let Some(only) = current.as_mut().and_then(Arc::get_mut) {
            lock(&only.bytes).clear();
        }
    }
}
