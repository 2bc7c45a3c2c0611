//! What a build of the points changed, for segments to correct their sums by.
//!
//! Points whose light changed, be it that they came or went, are listed with the light that
//! segments have seen, to be taken out, and the light that they have now, bucket by bucket, and
//! gathered as all are.
//! Where they are many, segments gather all points anew.

use std::ops::Range;

use super::table::{Part, run};
use super::{Points, PointsParams};
use crate::error::Result;
use crate::field::Run;
use crate::field::dirty::Dirty;
use crate::gpu::Gpu;
use crate::gpu::counter::CounterBuffer;
use crate::gpu::run::Stage;
use crate::gpu::scan::Scanner;
use crate::gpu::work::WorkList;

/// What differs from what the segments have seen.
pub(super) enum Changes {
    /// Nothing.
    None,
    /// Points with the light that was seen and the light that they have.
    Listed(Listed),
    /// So much that all is to be gathered anew.
    TooMany,
}

/// In the buckets of their cells.
pub(super) struct Listed {
    /// Lights, of which a point has one or two.
    count: u32,
    places: wgpu::Buffer,
    lights: wgpu::Buffer,
    starts: wgpu::Buffer,
}

impl Listed {
    pub(super) fn run<'a>(&'a self, field: &'a wgpu::Buffer) -> Run<'a> {
        run(self.count, [&self.places, &self.lights, &self.starts, field])
    }
}

/// Points whose light may have changed.
pub(super) struct Moved {
    count: u32,
    keys: wgpu::Buffer,
    places: wgpu::Buffer,
    /// The light that was seen, and that of now; `None`: dark.
    lights: [Option<wgpu::Buffer>; 2],
    /// Those whose light did; `None`: all.
    marked: Option<WorkList>,
}

impl Moved {
    /// All points of a part that went.
    pub(super) fn gone(part: &Part) -> Self {
        Self::new(part, [Some(&part.lights), None], None)
    }

    /// All points of a part that came.
    pub(super) fn came(part: &Part) -> Self {
        Self::new(part, [None, Some(&part.lights)], None)
    }

    /// Those whose light is not what was `seen`, as marked.
    pub(super) fn some(part: &Part, seen: &wgpu::Buffer, marked: WorkList) -> Self {
        Self::new(part, [Some(seen), Some(&part.lights)], Some(marked))
    }

    fn new(part: &Part, lights: [Option<&wgpu::Buffer>; 2], marked: Option<WorkList>) -> Self {
        let Part { count, keys, places, .. } = part;
        let (keys, places) = (keys.clone(), places.clone());
        Self { count: *count, keys, places, lights: lights.map(|l| l.cloned()), marked }
    }

    /// Lights of each: seen, of now, or both.
    fn lights_each(&self) -> u64 {
        self.lights.iter().flatten().count() as u64
    }

    /// How many are marked is to be learned yet.
    fn list(&mut self, gpu: &Gpu) -> Result<WorkList> {
        let stage = gpu.stage("list");
        match self.marked.take() {
            Some(list) => list.record(stage).map(|()| list),
            None => {
                let mut list = WorkList::new(gpu, self.count)?;
                list.fill(stage, None).map(|()| list)
            }
        }
    }
}

/// With a list of those whose light did.
type Found = (Moved, WorkList);

fn count(found: &[Found]) -> u64 {
    found.iter().map(|(_, list)| u64::from(list.count)).sum()
}

impl Points {
    /// Finds the points whose light changed in the last build, those that came and went among
    /// them, and marks where it did. Returns how many they are.
    ///
    /// # Errors
    /// The device failed, or ended the loops that mark what is around a point.
    pub fn compare(&mut self, gpu: &Gpu, dirty: &Dirty, counters: &CounterBuffer) -> Result<u64> {
        let moved = std::mem::take(&mut self.moved).into_iter();
        let listed = moved.map(|mut m| m.list(gpu).map(|list| (m, list)));
        let mut listed = listed.collect::<Result<Vec<_>>>()?;
        // A list of all knows its length.
        let lists = listed.iter_mut().map(|(_, list)| list).filter(|list| list.count == 0);
        WorkList::learn(gpu, &mut lists.collect::<Vec<_>>())?;
        self.mark_around(gpu, (dirty, counters), &listed)?;
        if matches!(self.changes, Changes::None) {
            self.changes = self.found(gpu, &listed)?;
        }
        if let Changes::Listed(taken) = &self.changes {
            self.built += u64::from(taken.count);
        }
        counters.read(gpu)?.all_finished("points", "lower `radius`")?;
        Ok(count(&listed))
    }

    /// Marks the light around the listed points.
    fn mark_around(
        &self,
        gpu: &Gpu,
        (dirty, counters): (&Dirty, &CounterBuffer),
        listed: &[Found],
    ) -> Result<()> {
        let items = count(listed);
        // Where most went and others came, they are everywhere.
        if items > 0 && dirty.is_far([0.0; 3]) || 2 * items > 3 * self.count() {
            return dirty.mark_all(gpu);
        }
        for (moved, list) in listed {
            let mut bindings = dirty.bindings();
            bindings.push(("point_places", (&moved.places).into()));
            bindings.push(("work", (&list.items).into()));
            bindings.push(("counters", counters.buffer().into()));
            let work = |stage: &mut Stage, range: Range<u64>| {
                let params =
                    PointsParams { first: range.start as u32, ..self.params(range.end as u32) };
                stage.dispatch(&self.dirty, range.end - range.start, &bindings, &params)
            };
            gpu.sliced("points_dirty", list.count.into(), &self.dirty_pace, work, &mut |_| ())?;
        }
        Ok(())
    }

    /// Takes the listed points, unless to gather all anew is cheaper, which was measured to be so
    /// where they have more lights than there are points.
    fn found(&self, gpu: &Gpu, listed: &[Found]) -> Result<Changes> {
        let lights: u64 =
            listed.iter().map(|(moved, list)| moved.lights_each() * u64::from(list.count)).sum();
        let fits = lights * size_of::<[f32; 4]>() as u64 <= gpu.max_binding();
        match lights {
            0 => Ok(Changes::None),
            _ if lights >= self.count() || !fits => Ok(Changes::TooMany),
            _ => Ok(Changes::Listed(self.taken(gpu, listed, lights as u32)?)),
        }
    }

    /// All listed points together, in the buckets of their keys.
    fn taken(&self, gpu: &Gpu, listed: &[Found], lights: u32) -> Result<Listed> {
        let taken = Listed {
            count: lights,
            places: gpu.buffer::<[u32; 4]>("point places", lights as usize)?,
            lights: gpu.buffer::<[f32; 4]>("point lights", lights as usize)?,
            starts: self.starts(gpu)?,
        };
        let mut stage = gpu.stage("points_take");
        stage.clear(&taken.starts);
        for (moved, list) in listed {
            let bindings = [
                ("work", (&list.items).into()),
                ("keys", (&moved.keys).into()),
                ("starts", (&taken.starts).into()),
            ];
            let params = self.taking(moved, list);
            stage.dispatch(&self.tally, list.count.into(), &bindings, &params)?;
        }
        let begins = self.params.buckets + 1;
        Scanner::new(gpu, begins)?.record(&mut stage, &taken.starts, begins)?;
        for (moved, list) in listed {
            let [seen, now] = moved.lights.each_ref().map(Option::as_ref);
            let none = &self.none.lights;
            let bindings = [
                ("work", (&list.items).into()),
                ("keys", (&moved.keys).into()),
                ("seen_places", (&moved.places).into()),
                ("seen_lights", seen.unwrap_or(none).into()),
                ("now_lights", now.unwrap_or(none).into()),
                ("starts", (&taken.starts).into()),
                ("point_places", (&taken.places).into()),
                ("point_lights", (&taken.lights).into()),
            ];
            let params = self.taking(moved, list);
            stage.dispatch(&self.take, list.count.into(), &bindings, &params)?;
        }
        self.tell_rows(&mut stage, &taken.starts)?;
        stage.finish()?;
        Ok(taken)
    }

    /// What kernels are told of points that are taken.
    fn taking(&self, moved: &Moved, list: &WorkList) -> PointsParams {
        let [had, has] = moved.lights.each_ref().map(|light| light.is_some().into());
        PointsParams { had, has, ..self.params(list.count) }
    }
}
