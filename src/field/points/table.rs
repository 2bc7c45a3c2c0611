//! What a table of points holds, and of which batches.

use std::ops::Range;

use super::buckets::Buckets;
use super::{Origin, PointsParams};
use crate::error::Result;
use crate::field::Run;
use crate::gpu::Gpu;
use crate::gpu::pool::Pooled;
use crate::gpu::resource::Bindings;
use crate::photon::{Batch, PhotonMap};

/// Points, and what updates need to know of them.
pub(super) struct Block {
    pub count: u32,
    /// The bucket of each.
    pub buckets: Pooled,
    pub places: Pooled,
    pub lights: Pooled,
    /// The [`Origin`] of each.
    pub origins: Pooled,
    /// The historygram of the values that each mean is of, where updates are to come.
    pub mean_histories: Pooled,
}

impl Block {
    /// Room for so many points, that have histories of their means, or not.
    pub fn new(gpu: &Gpu, count: u32, has_histories: bool) -> Result<Self> {
        let room = |is_wanted| if is_wanted { count as usize } else { 0 };
        Ok(Self {
            count,
            buckets: gpu.lend::<u32>("points buckets", room(true))?,
            places: gpu.lend::<[u32; 4]>("point places", room(true))?,
            lights: gpu.lend::<[f32; 4]>("point lights", room(true))?,
            origins: gpu.lend::<Origin>("point origins", room(true))?,
            mean_histories: gpu.lend::<[u32; 2]>("mean histories", room(has_histories))?,
        })
    }

    pub fn bindings(&self) -> Bindings {
        vec![
            ("buckets", (&self.buckets).into()),
            ("point_places", (&self.places).into()),
            ("point_lights", (&self.lights).into()),
            ("origins", (&self.origins).into()),
            ("mean_histories", (&self.mean_histories).into()),
        ]
    }

    /// As what there was, beside points that are bound by the other names.
    pub fn seen(&self) -> Bindings {
        vec![
            ("seen_buckets", (&self.buckets).into()),
            ("seen_places", (&self.places).into()),
            ("seen_lights", (&self.lights).into()),
            ("seen_origins", (&self.origins).into()),
            ("seen_histories", (&self.mean_histories).into()),
        ]
    }

    fn bytes(&self) -> u64 {
        let places = [&self.buckets, &self.places, &self.lights];
        let origins = [&self.origins, &self.mean_histories];
        places.iter().chain(&origins).map(|buffer| buffer.size()).sum()
    }
}

/// Points in the buckets of their cells, as a gather reads them.
pub(super) struct Bucketed<'a> {
    pub count: u32,
    pub places: &'a wgpu::Buffer,
    pub lights: &'a wgpu::Buffer,
    pub buckets: &'a Buckets,
}

impl Bucketed<'_> {
    pub fn run(self) -> Run {
        let bindings = vec![
            ("field", (&self.buckets.field).into()),
            ("point_places", self.places.into()),
            ("point_lights", self.lights.into()),
            ("starts", (&self.buckets.starts).into()),
        ];
        Run { bindings, points: self.count }
    }
}

/// A photon batch whose points a table has.
pub(super) struct Member {
    number: u32,
    /// Its slots, empty ones included, among those of the table; they begin with a word of marks.
    pub slots: Range<u32>,
    /// Its points are in the table.
    pub entered: bool,
}

impl Member {
    fn is(&self, batch: &Batch) -> bool {
        self.number == batch.number
    }

    /// Its batch, unless that is gone.
    pub fn batch<'a>(&self, map: &'a PhotonMap) -> Option<&'a Batch> {
        map.batches.iter().find(|batch| self.is(batch))
    }

    /// Whether slots of it may leave the table, or enter it.
    pub fn moves(&self, map: &PhotonMap) -> bool {
        !self.entered || self.batch(map).is_none_or(|batch| batch.stale)
    }

    /// Where its slot marks begin among those of the table, bytes.
    pub fn marks_at(&self) -> u64 {
        // Two words for 32 slots.
        u64::from(self.slots.start / 4)
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
    pub part: Block,
    pub buckets: Buckets,
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
            let number = batch.number;
            self.members.insert(at, Member { number, slots, entered: false });
        }
        fits
    }

    /// Slots of all members.
    pub fn slots(&self) -> u32 {
        self.members.last().map_or(0, |member| member.slots.end)
    }

    pub fn run(&self) -> Run {
        let Block { count, places, lights, .. } = &self.part;
        Bucketed { count: *count, places, lights, buckets: &self.buckets }.run()
    }

    pub fn bytes(&self) -> u64 {
        self.part.bytes() + self.buckets.starts.size()
    }
}
