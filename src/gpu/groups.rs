//! Bind groups, kept for as long as their owner is there: a group holds the memory that it is of.

use std::collections::HashMap;
use std::num::NonZero;
use std::sync::{Arc, Mutex, Weak};

use super::kernel::Kernel;
use super::pool::REST;
use super::queue::UNIFORM;
use super::resource::{Bytes, Resource};
use super::{Gpu, lock};
use crate::error::Result;

/// The bind groups of somebody, whose memory they hold.
#[derive(Clone, Default)]
pub struct Groups(Arc<Mutex<Kept>>);

#[derive(Default)]
struct Kept {
    groups: HashMap<Key, Group>,
    /// Updates that were made.
    updates: u64,
}

struct Group {
    group: wgpu::BindGroup,
    used: u64,
}

#[derive(PartialEq, Eq, Hash)]
struct Key {
    kernel: usize,
    resources: Vec<(u32, Resource)>,
}

impl Groups {
    /// Forgets them, and with them the memory that nobody else holds.
    pub fn clear(&self) {
        lock(&self.0).groups.clear();
    }

    /// An update has ended: those are forgotten that it and the one before did not use.
    pub fn end_update(&self) {
        let mut kept = lock(&self.0);
        kept.updates += 1;
        let updates = kept.updates;
        kept.groups.retain(|_, group| updates - group.used <= REST);
    }
}

/// Whose groups are kept now.
#[derive(Default)]
pub(super) struct Keeper(Mutex<Weak<Mutex<Kept>>>);

impl Keeper {
    /// The group of a kernel that is given these.
    pub fn get(
        &self,
        gpu: &Gpu,
        kernel: &Kernel,
        resources: Vec<(u32, Resource)>,
        keeps: bool,
    ) -> Result<wgpu::BindGroup> {
        let Some(kept) = lock(&self.0).upgrade().filter(|_| keeps) else {
            return Ok(gpu.bind(kernel, &resources));
        };
        let mut kept = lock(&kept);
        let (key, used) = (Key { kernel: kernel.id, resources }, kept.updates);
        if let Some(found) = kept.groups.get_mut(&key) {
            found.used = used;
            return Ok(found.group.clone());
        }
        let group = gpu.bind(kernel, &key.resources);
        gpu.check(kernel.name)?;
        kept.groups.insert(key, Group { group: group.clone(), used });
        Ok(group)
    }
}

impl Gpu {
    /// From here on groups are kept there, for as long as it is there.
    pub fn keep_groups(&self, groups: &Groups) {
        *lock(&self.keeper.0) = Arc::downgrade(&groups.0);
    }

    fn bind(&self, kernel: &Kernel, resources: &[(u32, Resource)]) -> wgpu::BindGroup {
        let told = kernel.told.map(|binding| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: &self.uniforms,
                offset: 0,
                size: NonZero::new(UNIFORM as u64),
            }),
        });
        let entries = resources
            .iter()
            .map(|(binding, resource)| wgpu::BindGroupEntry {
                binding: *binding,
                resource: binding_of(resource),
            })
            .chain(told)
            .collect::<Vec<_>>();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(kernel.name),
            layout: &kernel.layout,
            entries: &entries,
        })
    }
}

fn binding_of(resource: &Resource) -> wgpu::BindingResource<'_> {
    match resource {
        Resource::Buffer(buffer) => buffer.as_entire_binding(),
        Resource::Bytes(Bytes { buffer, offset, size }) => {
            let (offset, size) = (*offset, NonZero::new(*size));
            wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset, size })
        }
        Resource::Texture(view) => wgpu::BindingResource::TextureView(view),
    }
}
