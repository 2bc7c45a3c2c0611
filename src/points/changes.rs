//! What a build of the points changed, for segments to correct their sums by.
//!
//! Points that went, with negative light, and points that came are listed, sorted together,
//! and gathered as any others are. Where they are many, segments gather all points anew.

use super::{Part, Points, PointsParams, Sorted};
use crate::counter::CounterBuffer;
use crate::dirty::Dirty;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::sort::Sorter;
use crate::work::WorkList;

/// What differs from what the segments have seen.
pub(super) enum Changes {
    /// Nothing.
    None,
    /// What went, with negative light, and what came.
    Listed(Sorted),
    /// So much that all is to be gathered anew.
    TooMany,
}

/// Points that may have gone and come.
pub(super) struct Moved {
    count: u32,
    keys: wgpu::Buffer,
    places: wgpu::Buffer,
    what: Lights,
}

enum Lights {
    /// All of one light went (sign -1) or came (1).
    All(wgpu::Buffer, f32),
    /// The light before, and now.
    Differing([wgpu::Buffer; 2]),
}

impl Moved {
    /// All points of a part.
    pub(super) fn all(part: &Part, sign: f32) -> Self {
        Self::new(part, Lights::All(part.points.lights.clone(), sign))
    }

    /// Those whose light is not what was `seen`.
    pub(super) fn since(seen: wgpu::Buffer, part: &Part) -> Self {
        Self::new(part, Lights::Differing([seen, part.points.lights.clone()]))
    }

    fn new(part: &Part, what: Lights) -> Self {
        let Sorted { count, keys, places, .. } = &part.points;
        Self { count: *count, keys: keys.clone(), places: places.clone(), what }
    }
}

/// Points that came (sign 1) or went (-1).
struct Listed<'a> {
    of: &'a Moved,
    lights: &'a wgpu::Buffer,
    sign: f32,
    list: WorkList,
}

impl Points {
    /// Finds which points came and which went in the last build, and marks where light
    /// changed.
    ///
    /// # Errors
    /// The device failed, or ended the loops that mark what is around a point.
    pub fn compare(&mut self, gpu: &Gpu, dirty: &Dirty, counters: &CounterBuffer) -> Result<()> {
        let moved = std::mem::take(&mut self.moved);
        let mut listed = Vec::new();
        for moved in &moved {
            self.list(gpu, moved, &mut listed)?;
        }
        self.mark_around(gpu, (dirty, counters), &listed)?;
        if matches!(self.changes, Changes::None) {
            self.changes = self.found(gpu, &listed)?;
        }
        counters.read(gpu)?.all_finished("points", "lower `radius`")
    }

    fn list<'a>(&self, gpu: &Gpu, moved: &'a Moved, listed: &mut Vec<Listed<'a>>) -> Result<()> {
        let list = || WorkList::new(gpu, moved.count);
        match &moved.what {
            Lights::All(lights, sign) => {
                let mut list = list()?;
                list.fill(gpu.stage("list"), None)?;
                listed.push(Listed { of: moved, lights, sign: *sign, list });
            }
            Lights::Differing([seen, now]) => {
                let (mut went, mut came) = (list()?, list()?);
                let bindings = [
                    ("seen_lights", seen.into()),
                    ("point_lights", now.into()),
                    ("went", (&went.marks).into()),
                    ("came", (&came.marks).into()),
                ];
                let mut stage = gpu.stage("points_match");
                went.unmark(&mut stage);
                came.unmark(&mut stage);
                stage.dispatch(
                    &self.compare,
                    moved.count.into(),
                    &bindings,
                    &self.params(moved.count),
                )?;
                went.compact(stage, None)?;
                came.compact(gpu.stage("list"), None)?;
                listed.push(Listed { of: moved, lights: seen, sign: -1.0, list: went });
                listed.push(Listed { of: moved, lights: now, sign: 1.0, list: came });
            }
        }
        Ok(())
    }

    /// Marks the light around the listed points.
    fn mark_around(
        &self,
        gpu: &Gpu,
        (dirty, counters): (&Dirty, &CounterBuffer),
        listed: &[Listed],
    ) -> Result<()> {
        for Listed { of, list, .. } in listed {
            let mut bindings = dirty.bindings();
            bindings.push(("point_places", (&of.places).into()));
            bindings.push(("work", (&list.items).into()));
            bindings.push(("counters", counters.buffer().into()));
            let mut stage = gpu.stage("points_dirty");
            stage.dispatch(&self.dirty, list.count.into(), &bindings, &self.params(list.count))?;
            stage.finish()?;
        }
        Ok(())
    }

    /// Takes the listed points, unless to gather all points anew is cheaper: those that
    /// changed lie close together as a rule, so they are denser around what they touch than
    /// their share tells.
    fn found(&self, gpu: &Gpu, listed: &[Listed]) -> Result<Changes> {
        let total: u64 = listed.iter().map(|l| u64::from(l.list.count)).sum();
        let all: u64 = self.batches.iter().map(|b| u64::from(b.part.points.count)).sum();
        let fits = total * size_of::<[u32; 4]>() as u64 <= gpu.max_binding();
        match total {
            0 => Ok(Changes::None),
            _ if 2 * total >= all || !fits => Ok(Changes::TooMany),
            _ => Ok(Changes::Listed(self.taken(gpu, listed, total as u32)?)),
        }
    }

    /// All listed points, sorted together.
    fn taken(&self, gpu: &Gpu, listed: &[Listed], total: u32) -> Result<Sorted> {
        let order = gpu.buffer::<u32>("points slots", total as usize)?;
        let keys = gpu.buffer::<u32>("points keys", total as usize)?;
        let sorted = Sorted::new(gpu, keys, total, &self.params)?;
        let places = gpu.buffer::<[u32; 4]>("point places", total as usize)?;
        let lights = gpu.buffer::<[f32; 4]>("point lights", total as usize)?;
        let mut first = 0;
        for Listed { of, lights: own, sign, list } in listed {
            let bindings = [
                ("work", (&list.items).into()),
                ("keys", (&of.keys).into()),
                ("point_places", (&of.places).into()),
                ("point_lights", (*own).into()),
                ("taken_keys", (&sorted.keys).into()),
                ("taken_order", (&order).into()),
                ("taken_places", (&places).into()),
                ("taken_lights", (&lights).into()),
            ];
            let params = PointsParams { first, sign: *sign, ..self.params(list.count) };
            first += list.count;
            let mut stage = gpu.stage("points_take");
            stage.dispatch(&self.take, list.count.into(), &bindings, &params)?;
            stage.finish()?;
        }
        Sorter::new(gpu, total)?.sort(gpu, &sorted.keys, &order, total, self.key_bits)?;
        let mut stage = gpu.stage("points_arrange");
        for (taken, sorted) in [(&places, &sorted.places), (&lights, &sorted.lights)] {
            let buffers = [taken, taken, sorted];
            self.arrange(&mut stage, &self.arrange_fours, (&order, total), buffers)?;
        }
        self.find(&mut stage, &sorted)?;
        stage.finish()?;
        Ok(sorted)
    }
}
