//! Memory that comes back: what one update needs for a while, the next one needs again.

use std::collections::HashMap;
use std::ops::Deref;
use std::sync::{Arc, Mutex, Weak};

use super::resource::Resource;
use super::{Gpu, lock};
use crate::error::Result;

/// A buffer that goes back to where it is from when nobody holds it.
#[derive(Clone, Debug)]
pub struct Pooled(Arc<Lent>);

#[derive(Debug)]
struct Lent {
    buffer: wgpu::Buffer,
    pool: Weak<Mutex<Idle>>,
}

impl Deref for Pooled {
    type Target = wgpu::Buffer;

    fn deref(&self) -> &wgpu::Buffer {
        &self.0.buffer
    }
}

impl From<&Pooled> for Resource {
    fn from(pooled: &Pooled) -> Self {
        Self::Buffer(pooled.0.buffer.clone())
    }
}

impl Drop for Lent {
    fn drop(&mut self) {
        if let Some(pool) = self.pool.upgrade() {
            lock(&pool).put(self.buffer.clone());
        }
    }
}

/// Buffers that nobody holds, by their size.
#[derive(Debug, Default)]
pub(super) struct Idle {
    buffers: HashMap<u64, Vec<Rested>>,
    /// Updates that were made.
    updates: u64,
}

#[derive(Debug)]
struct Rested {
    buffer: wgpu::Buffer,
    since: u64,
}

/// Updates that a buffer may rest.
pub(super) const REST: u64 = 2;

impl Idle {
    fn put(&mut self, buffer: wgpu::Buffer) {
        let since = self.updates;
        self.buffers.entry(buffer.size()).or_default().push(Rested { buffer, since });
    }

    fn take(&mut self, size: u64) -> Option<wgpu::Buffer> {
        self.buffers.get_mut(&size)?.pop().map(|rested| rested.buffer)
    }

    fn end_update(&mut self) {
        self.updates += 1;
        let updates = self.updates;
        for buffers in self.buffers.values_mut() {
            buffers.retain(|rested| updates - rested.since <= REST);
        }
        self.buffers.retain(|_, buffers| !buffers.is_empty());
    }
}

/// Steps of sizes from one power of two to the next: so that a list that is a little longer finds the
/// buffer of a shorter one.
const STEPS: u64 = 8;

/// The size of the buffers that hold so many bytes: at most an eighth more.
fn class(bytes: u64) -> u64 {
    let step = (bytes.max(256).next_power_of_two() / 2 / STEPS).max(256);
    bytes.max(1).next_multiple_of(step)
}

impl Gpu {
    /// A zeroed storage buffer for `count` items of type `T` or a few more, for a while: until every
    /// stage has ended that it is used in, for then it is given to others.
    ///
    /// # Errors
    /// As [`Gpu::buffer`].
    pub fn lend<T: bytemuck::Pod>(&self, stage: &'static str, count: usize) -> Result<Pooled> {
        let asked = (count.max(1) * size_of::<T>()) as u64;
        let size = class(asked).min(self.max_binding()).max(asked.next_multiple_of(4));
        let found = lock(&self.idle).take(size);
        let buffer = match found {
            Some(buffer) => {
                // After all that was recorded with it.
                let mut clear = self.stage(stage);
                clear.clear(&buffer);
                clear.finish()?;
                buffer
            }
            None => self.buffer::<u32>(stage, (size / 4) as usize)?,
        };
        Ok(Pooled(Arc::new(Lent { buffer, pool: Arc::downgrade(&self.idle) })))
    }

    /// An update has ended: what rested for long is let go.
    pub fn end_update(&self) {
        lock(&self.idle).end_update();
    }

    /// Lets go what nobody holds.
    pub fn forget_idle(&self) {
        lock(&self.idle).buffers.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::class;

    #[test]
    fn sizes_are_a_little_more_than_what_is_asked() {
        for bytes in [0, 1, 4, 255, 256, 257, 1000, 5000, 1 << 20, (1 << 20) + 4, 123_456_789] {
            let size = class(bytes);
            assert!(size >= bytes && size.is_multiple_of(256), "{size} for {bytes}");
            assert!(size <= bytes + (bytes / 8).max(256), "{size} for {bytes}");
            assert_eq!(class(size), size);
        }
    }
}
