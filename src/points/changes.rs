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
    /// The light that was seen and the light now, with the points that lost and have it marked.
    Some([(wgpu::Buffer, WorkList); 2]),
}

impl Moved {
    /// All points of a part.
    pub(super) fn all(part: &Part, sign: f32) -> Self {
        Self::new(part, Lights::All(part.points.lights.clone(), sign))
    }

    /// Those whose light is not what was `seen`, as marked.
    pub(super) fn some(part: &Part, seen: wgpu::Buffer, [went, came]: [WorkList; 2]) -> Self {
        Self::new(part, Lights::Some([(seen, went), (part.points.lights.clone(), came)]))
    }

    fn new(part: &Part, what: Lights) -> Self {
        let Sorted { count, keys, places, .. } = &part.points;
        Self { count: *count, keys: keys.clone(), places: places.clone(), what }
    }

    /// Lists them: what went, what came, or both.
    fn list(self, gpu: &Gpu, listed: &mut Vec<Listed>) -> Result<()> {
        let Self { count, keys, places, what } = self;
        let mut add = |lights, sign, list| {
            let (keys, places) = (keys.clone(), places.clone());
            listed.push(Listed { keys, places, lights, sign, list });
        };
        match what {
            Lights::All(lights, sign) => {
                let mut list = WorkList::new(gpu, count)?;
                list.fill(gpu.stage("list"), None)?;
                add(lights, sign, list);
            }
            Lights::Some(both) => {
                for ((lights, mut list), sign) in both.into_iter().zip([-1.0, 1.0]) {
                    list.compact(gpu.stage("list"), None)?;
                    add(lights, sign, list);
                }
            }
        }
        Ok(())
    }
}

/// Points that came (sign 1) or went (-1).
struct Listed {
    keys: wgpu::Buffer,
    places: wgpu::Buffer,
    lights: wgpu::Buffer,
    sign: f32,
    list: WorkList,
}

impl Points {
    /// Finds which points came and which went in the last build, and marks where light
    /// changed. Returns how many points went and came; those of another light did both.
    ///
    /// # Errors
    /// The device failed, or ended the loops that mark what is around a point.
    pub fn compare(&mut self, gpu: &Gpu, dirty: &Dirty, counters: &CounterBuffer) -> Result<u64> {
        let mut listed = Vec::new();
        for moved in std::mem::take(&mut self.moved) {
            moved.list(gpu, &mut listed)?;
        }
        self.mark_around(gpu, (dirty, counters), &listed)?;
        if matches!(self.changes, Changes::None) {
            self.changes = self.found(gpu, &listed)?;
        }
        counters.read(gpu)?.all_finished("points", "lower `radius`")?;
        Ok(listed.iter().map(|l| u64::from(l.list.count)).sum())
    }

    /// Marks the light around the listed points.
    fn mark_around(
        &self,
        gpu: &Gpu,
        (dirty, counters): (&Dirty, &CounterBuffer),
        listed: &[Listed],
    ) -> Result<()> {
        for Listed { places, list, .. } in listed {
            let mut bindings = dirty.bindings();
            bindings.push(("point_places", places.into()));
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
        let all = self.count();
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
        for Listed { keys, places: own, lights: light, sign, list } in listed {
            let bindings = [
                ("work", (&list.items).into()),
                ("keys", keys.into()),
                ("point_places", own.into()),
                ("point_lights", light.into()),
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
            self.arrange(&mut stage, &self.arrange[2], (&order, total), buffers)?;
        }
        self.find(&mut stage, &sorted)?;
        stage.finish()?;
        Ok(sorted)
    }
}
