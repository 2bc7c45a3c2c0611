//! What a table of points holds, and of which batches.

use std::ops::Range;

use super::PointsParams;
use crate::error::Result;
use crate::field::Run;
use crate::gpu::Gpu;
use crate::gpu::run::Bindings;
use crate::photon::{Batch, PhotonMap};

/// Points, and what updates need to know of them.
pub(super) struct Part {
    pub count: u32,
    /// The index of each one's cell.
    pub keys: wgpu::Buffer,
    pub places: wgpu::Buffer,
    pub lights: wgpu::Buffer,
    /// The slot of each, among those of all members of its table.
    pub slots: wgpu::Buffer,
    /// The mean extinction around each, 1/mm, where `even` divides by it.
    pub means: wgpu::Buffer,
    /// The historygram of the values that each mean is of, where updates are to come.
    pub mean_histories: wgpu::Buffer,
}

impl Part {
    /// Room for so many points, that have means and histories of those, or not.
    pub fn new(gpu: &Gpu, count: u32, [means, histories]: [bool; 2]) -> Result<Self> {
        let room = |is_wanted| if is_wanted { count as usize } else { 0 };
        Ok(Self {
            count,
            keys: gpu.buffer::<u32>("points keys", room(true))?,
            places: gpu.buffer::<[u32; 4]>("point places", room(true))?,
            lights: gpu.buffer::<[f32; 4]>("point lights", room(true))?,
            slots: gpu.buffer::<u32>("points slots", room(true))?,
            means: gpu.buffer::<f32>("point means", room(means))?,
            mean_histories: gpu.buffer::<[u32; 2]>("mean histories", room(means && histories))?,
        })
    }

    pub fn bindings(&self) -> Bindings<'_> {
        vec![
            ("keys", (&self.keys).into()),
            ("point_places", (&self.places).into()),
            ("point_lights", (&self.lights).into()),
            ("slots", (&self.slots).into()),
            ("means", (&self.means).into()),
            ("mean_histories", (&self.mean_histories).into()),
        ]
    }

    /// As what there was, beside points that are bound by the other names.
    pub fn seen(&self) -> Bindings<'_> {
        vec![
            ("seen_keys", (&self.keys).into()),
            ("seen_places", (&self.places).into()),
            ("seen_lights", (&self.lights).into()),
            ("seen_slots", (&self.slots).into()),
            ("seen_means", (&self.means).into()),
            ("seen_histories", (&self.mean_histories).into()),
        ]
    }

    fn bytes(&self) -> u64 {
        let places = [&self.keys, &self.places, &self.lights];
        let origins = [&self.slots, &self.means, &self.mean_histories];
        [places, origins].as_flattened().iter().map(|buffer| buffer.size()).sum()
    }
}

/// What a gather is told: places, lights, where buckets begin, and the grid.
pub(super) fn run(count: u32, [places, lights, starts, field]: [&wgpu::Buffer; 4]) -> Run<'_> {
    let bindings = vec![
        ("field", field.into()),
        ("point_places", places.into()),
        ("point_lights", lights.into()),
        ("starts", starts.into()),
    ];
    Run { bindings, points: count }
}

/// Light and first photon.
fn key(batch: &Batch) -> (u32, u32) {
    (batch.light_id, batch.first_index)
}

/// A photon batch whose points a table has.
pub(super) struct Member {
    key: (u32, u32),
    photons: u32,
    /// Its slots, empty ones included, among those of the table; they begin with a word of marks.
    pub slots: Range<u32>,
    /// Its points are in the table.
    pub entered: bool,
}

impl Member {
    fn is(&self, batch: &Batch) -> bool {
        (self.key, self.photons) == (key(batch), batch.photons)
    }

    /// Its batch, unless that is gone.
    pub fn batch<'a>(&self, map: &'a PhotonMap) -> Option<&'a Batch> {
        map.batches.iter().find(|batch| self.is(batch))
    }

    /// Whether slots of it are to leave the table, or to enter it.
    pub fn moves(&self, map: &PhotonMap) -> bool {
        !self.entered || self.batch(map).is_none_or(|batch| batch.any_moved)
    }

    /// Where its slots begin, of so many bits.
    pub fn bits<'a>(&self, bits: &'a wgpu::Buffer) -> (&'a wgpu::Buffer, u64) {
        (bits, u64::from(self.slots.start / 8))
    }

    /// Where its slots are, for kernels.
    pub fn within(&self, params: PointsParams) -> PointsParams {
        PointsParams { first_slot: self.slots.start, slots: self.slots.len() as u32, ..params }
    }
}

/// Points in buckets.
pub(super) struct Table {
    /// In the order of their slots.
    pub members: Vec<Member>,
    pub part: Part,
    /// Where each bucket begins, and the last ends; then which rows around each cell have points.
    pub starts: wgpu::Buffer,
}

impl Table {
    pub fn has(&self, batch: &Batch) -> bool {
        self.members.iter().any(|member| member.is(batch))
    }

    pub fn has_any(&self, map: &PhotonMap) -> bool {
        self.members.iter().any(|member| member.batch(map).is_some())
    }

    /// Whether it knows all slots of its members as they are.
    pub fn is_current(&self, map: &PhotonMap) -> bool {
        let knows = |batch: &Batch| !batch.stale;
        self.members.iter().all(|member| member.entered && member.batch(map).is_some_and(knows))
    }

    /// Makes a batch a member if there is room for its slots, where `most` may be.
    pub fn admit(&mut self, batch: &Batch, slots: u32, most: u32) -> bool {
        let mut begin = 0;
        let mut at = 0;
        for member in &self.members {
            if member.slots.start.saturating_sub(begin) >= slots {
                break;
            }
            begin = member.slots.end.next_multiple_of(32);
            at += 1;
        }
        let fits = begin.checked_add(slots).is_some_and(|end| end <= most);
        if fits {
            let slots = begin..begin + slots;
            let (key, photons) = (key(batch), batch.photons);
            self.members.insert(at, Member { key, photons, slots, entered: false });
        }
        fits
    }

    /// Slots of all members.
    pub fn slots(&self) -> u32 {
        self.members.last().map_or(0, |member| member.slots.end)
    }

    pub fn run<'a>(&'a self, field: &'a wgpu::Buffer) -> Run<'a> {
        run(self.part.count, [&self.part.places, &self.part.lights, &self.starts, field])
    }

    pub fn bytes(&self) -> u64 {
        self.part.bytes() + self.starts.size()
    }
}
