//! Photons of several lights that fit one binding, and whose they are.

use std::ops::Range;

use crate::device_scene::lights::MAX_LIGHTS;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::layout::shared_struct;
use crate::gpu::resource::Bindings;
use crate::gpu::work::WorkList;

use super::SlotMarks;

shared_struct! {
    /// Photons of a light in a batch, as kernels see them.
    pub struct QuotaRecord {
        /// The batch's photon that is the first of these.
        pub first: u32,
        /// How many.
        pub photons: u32,
        /// The light's place in the scene; all ones: it is gone.
        pub light: u32,
        /// The light's photon that is the first of these.
        pub first_index: u32,
    }
}

shared_struct! {
    /// Whose photons a batch has.
    pub struct Quotas {
        /// How many lights have some.
        pub count: u32,
        /// A bit for each whose light has another power now.
        pub relit: u32,
        /// Keeps the array aligned.
        pub pad0: u32,
        /// Keeps the array aligned.
        pub pad1: u32,
        /// The lights' photons, side by side.
        pub all: [QuotaRecord; MAX_LIGHTS],
    }
}

shared_struct! {
    /// What is told of photons that are to be forgotten.
    pub struct ForgetParams {
        /// The first of them.
        pub first: u32,
        /// How many.
        pub photons: u32,
        /// Photons in the batch.
        pub stride: u32,
        /// Slots of a photon.
        pub events: u32,
    }
}

/// Photons of a light that lie side by side in a batch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Quota {
    /// The light's stable id.
    pub light_id: u32,
    /// Photons of the light in all; 0: some of them are no more, and these stay idle.
    pub of: u32,
    /// The light's place in the scene; `None`: it is gone, and its photons are idle.
    pub light: Option<u32>,
    /// The light's photon that is the first here.
    pub first_index: u32,
    /// Which of the batch's photons they are.
    pub photons: Range<u32>,
    /// The light's power changed, and an update has not finished since.
    pub relit: bool,
}

/// Photons that fit one binding.
pub struct Batch {
    /// Which of all batches that were ever made.
    pub number: u32,
    /// Whose they are, side by side.
    pub quotas: Vec<Quota>,
    /// How many.
    pub photons: u32,
    /// Position and direction of each slot.
    pub places: wgpu::Buffer,
    /// Power, entry, kind and history of each slot.
    pub states: wgpu::Buffer,
    /// What is to be done with each photon.
    pub tasks: wgpu::Buffer,
    /// The photons to work on.
    pub list: WorkList,
    /// Whether it has listed any, that anybody knows of.
    pub is_listed: bool,
    /// Slots may have changed that the light field does not know of yet.
    pub stale: bool,
    /// [`SlotMarks`] of its slots.
    pub slot_marks: wgpu::Buffer,
    /// [`Quotas`], and what it holds.
    pub(super) told: wgpu::Buffer,
    was_told: Quotas,
    max_events: u32,
}

impl Batch {
    pub(super) fn new(gpu: &Gpu, number: u32, quotas: Vec<Quota>, max_events: u32) -> Result<Self> {
        let photons = quotas.last().map_or(0, |quota| quota.photons.end);
        let slots = photons as usize * max_events as usize;
        let batch = Self {
            number,
            quotas,
            photons,
            places: gpu.buffer::<[u32; 4]>("photon places", slots)?,
            states: gpu.buffer::<[u32; 4]>("photon states", slots)?,
            tasks: gpu.buffer::<u32>("photon tasks", photons as usize)?,
            list: WorkList::new(gpu, photons)?,
            is_listed: false,
            stale: true,
            slot_marks: gpu.buffer::<SlotMarks>("slot marks", slots.div_ceil(32))?,
            told: gpu.upload("quotas", &[Quotas::default()])?,
            was_told: Quotas::default(),
            max_events,
        };
        batch.forget(gpu, 0..photons)?;
        Ok(batch)
    }

    /// Its resources, by the names that the kernels give them.
    pub fn bindings(&self) -> Bindings {
        vec![
            ("places", (&self.places).into()),
            ("states", (&self.states).into()),
            ("tasks", (&self.tasks).into()),
            ("work", (&self.list.items).into()),
            ("marks", (&self.list.marks).into()),
            ("quotas", (&self.told).into()),
        ]
    }

    /// Whether a light of it has another power now.
    pub fn is_relit(&self) -> bool {
        self.quotas.iter().any(|quota| quota.relit)
    }

    /// No light of it has another power than its photons know.
    pub fn calm(&mut self) {
        self.quotas.iter_mut().for_each(|quota| quota.relit = false);
    }

    /// Tells the device whose photons it has.
    ///
    /// # Errors
    /// The device failed.
    pub fn tell(&mut self, gpu: &Gpu) -> Result<()> {
        let mut told = Quotas { count: self.quotas.len() as u32, ..Default::default() };
        for (i, (quota, record)) in self.quotas.iter().zip(&mut told.all).enumerate() {
            *record = QuotaRecord {
                first: quota.photons.start,
                photons: quota.photons.len() as u32,
                light: quota.light.unwrap_or(u32::MAX),
                first_index: quota.first_index,
            };
            told.relit |= u32::from(quota.relit) << i;
        }
        if told != self.was_told {
            gpu.write(&self.told, &[told])?;
            self.was_told = told;
        }
        Ok(())
    }

    /// Marks photons as never computed, which the first slot of each tells.
    ///
    /// # Errors
    /// The device failed.
    pub fn forget(&self, gpu: &Gpu, photons: Range<u32>) -> Result<()> {
        let params = ForgetParams {
            first: photons.start,
            photons: photons.len() as u32,
            stride: self.photons,
            events: self.max_events,
        };
        let mut bindings = self.bindings();
        bindings.push(("slot_marks", (&self.slot_marks).into()));
        let slots = u64::from(params.photons) * u64::from(params.events);
        let mut stage = gpu.stage("forget");
        stage.dispatch(&*gpu.kernel("forget", &[])?, slots, &bindings, &params)?;
        stage.finish()
    }

    /// The light field knows all slots as they are.
    ///
    /// # Errors
    /// The device failed.
    pub fn unmark(&mut self, gpu: &Gpu) -> Result<()> {
        if std::mem::take(&mut self.stale) {
            let mut stage = gpu.stage("slot marks");
            stage.clear(&self.slot_marks);
            stage.finish()?;
        }
        Ok(())
    }

    /// Lists every photon, with a task from event 0.
    ///
    /// # Errors
    /// The device failed.
    pub fn list_all(&mut self, gpu: &Gpu, shuffle: Option<u64>) -> Result<()> {
        let mut stage = gpu.stage("list");
        stage.clear(&self.tasks);
        self.list.fill(stage, shuffle)
    }
}

/// Deals the photons of lights (place in the scene, id, how many) to as few batches as can be of at most
/// so many, none much larger than the others: one after the other, so that few lights are in two.
pub(super) fn dealt(lights: &[(u32, u32, u32)], most: u32) -> Vec<Vec<Quota>> {
    let all = lights.iter().map(|(_, _, photons)| u64::from(*photons)).sum::<u64>();
    let batches = all.div_ceil(most.into()).max(1);
    let each = all.div_ceil(batches) as u32;
    let mut dealt = vec![Vec::new()];
    let mut room = each;
    for &(light, light_id, of) in lights {
        let mut first_index = 0;
        while first_index < of {
            if room == 0 {
                dealt.push(Vec::new());
                room = each;
            }
            let count = room.min(of - first_index);
            let begin = each - room;
            let photons = begin..begin + count;
            let light = Some(light);
            let quota = Quota { light_id, of, light, first_index, photons, relit: false };
            dealt.last_mut().map(|batch| batch.push(quota)).unwrap_or_default();
            (first_index, room) = (first_index + count, room - count);
        }
    }
    dealt.retain(|batch| !batch.is_empty());
    dealt
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_photons_are_dealt_once() {
        for most in [1, 7, 40, 1000] {
            let lights = [(0, 5, 33), (1, 2, 1), (2, 9, 50)];
            let dealt = dealt(&lights, most);
            assert_eq!(dealt.len() as u32, 84_u32.div_ceil(most));
            for (light, light_id, photons) in lights {
                let mut next = 0;
                for quota in dealt.iter().flatten().filter(|quota| quota.light_id == light_id) {
                    assert_eq!((quota.light, quota.first_index), (Some(light), next));
                    next += quota.photons.len() as u32;
                }
                assert_eq!(next, photons);
            }
            for batch in dealt {
                let mut end = 0;
                for quota in batch {
                    assert_eq!(quota.photons.start, end);
                    end = quota.photons.end;
                }
                assert!(end <= most);
            }
        }
    }
}
