//! What a build of the points changed, for segments to correct their sums by.
//!
//! Points whose light changed, be it that they came or went, are listed with the light that
//! segments have seen, to be taken out, and the light that they have now, bucket by bucket, and
//! gathered as all are.
//! Where they are many, segments gather all points anew.

use std::ops::Range;

use super::buckets::Buckets;
use super::table::{Block, Bucketed};
use super::{Points, PointsParams};
use crate::device_scene::Context;
use crate::error::Result;
use crate::field::Run;
use crate::field::dirty::Dirty;
use crate::gpu::pool::Pooled;
use crate::gpu::queue::Total;
use crate::gpu::run::Stage;
use crate::gpu::scan::Scanner;
use crate::gpu::work::WorkList;
use crate::gpu::{Gpu, Progress};

/// What differs from what the segments have seen.
pub(super) enum Changes {
    /// Nothing.
    None,
    /// Points with the light that was seen and the light that they have.
    Listed(Box<Listed>),
    /// So much that all is to be gathered anew.
    TooMany,
}

/// In the buckets of their cells.
pub(super) struct Listed {
    /// Lights, of which a point has one or two.
    count: u32,
    places: Pooled,
    lights: Pooled,
    buckets: Buckets,
}

impl Listed {
    pub(super) fn run(&self) -> Run {
        let Self { count, places, lights, buckets } = self;
        Bucketed { count: *count, places, lights, buckets }.run()
    }
}

/// Points whose light may have changed.
pub(super) struct Moved {
    count: u32,
    places: Pooled,
    /// The light that segments have seen; `None`: dark.
    seen: Option<Pooled>,
    /// The light of now; `None`: dark.
    now: Option<Pooled>,
    /// Those whose light did, listed; `None`: all.
    list: Option<WorkList>,
}

impl Moved {
    /// All points of a part that went, of which this light was seen.
    pub(super) fn gone(part: &Block, seen: Pooled) -> Self {
        Self { seen: Some(seen), now: None, ..Self::all(part) }
    }

    /// All points of a part that came.
    pub(super) fn came(part: &Block) -> Self {
        Self { seen: None, ..Self::all(part) }
    }

    /// Those whose light is not what was `seen`, as listed.
    pub(super) fn some(part: &Block, seen: Pooled, list: WorkList) -> Self {
        Self { seen: Some(seen), list: Some(list), ..Self::all(part) }
    }

    fn all(part: &Block) -> Self {
        let [places, lights] = [&part.places, &part.lights].map(Clone::clone);
        let seen = Some(lights.clone());
        Self { count: part.count, places, seen, now: Some(lights), list: None }
    }

    fn list(mut self, gpu: &Gpu) -> Result<Found> {
        let list = match self.list.take() {
            Some(list) => list,
            None => {
                let mut list = WorkList::new(gpu, self.count)?;
                list.fill(gpu.stage("list").once(), None)?;
                list
            }
        };
        Ok(Found { points: self, list })
    }
}

/// Points whose light changed.
struct Found {
    /// Those that may have.
    points: Moved,
    /// Which of them did.
    list: WorkList,
}

impl Found {
    /// Lights of each: seen, of now, or both.
    fn lights_each(&self) -> u32 {
        [&self.points.seen, &self.points.now].into_iter().flatten().count() as u32
    }
}

fn count(found: &[Found]) -> u64 {
    found.iter().map(|found| u64::from(found.list.count)).sum()
}

impl Points {
    /// Finds the points whose light changed in the last build, those that came and went among
    /// them, and marks where it did. Returns how many they are.
    ///
    /// # Errors
    /// The device failed.
    pub(super) fn compare(
        &mut self,
        cx: Context,
        dirty: &Dirty,
        progress: &mut Progress,
    ) -> Result<u64> {
        let moved = std::mem::take(&mut self.moved).into_iter();
        let listed = moved.map(|m| m.list(cx.gpu)).collect::<Result<Vec<_>>>()?;
        self.mark_around(cx, dirty, &listed, progress)?;
        if matches!(self.changes, Changes::None) {
            self.changes = self.found(cx.gpu, &listed)?;
        }
        if let Changes::Listed(taken) = &self.changes {
            self.built += u64::from(taken.count);
        }
        Ok(count(&listed))
    }

    /// Marks the light around the listed points.
    fn mark_around(
        &self,
        cx: Context,
        dirty: &Dirty,
        listed: &[Found],
        progress: &mut Progress,
    ) -> Result<()> {
        let items = count(listed);
        // Where most went and others came, they are everywhere.
        if items > 0 && dirty.is_far([0.0; 3]) || 2 * items > 3 * self.count() {
            return dirty.mark_all(cx.gpu);
        }
        for Found { points, list } in listed {
            let mut bindings = dirty.bindings();
            bindings.push(("point_places", (&points.places).into()));
            bindings.push(("work", (&list.items).into()));
            bindings.push(("counters", cx.counters.buffer().into()));
            let (kernel, all) = (self.dirty.clone(), self.params(0));
            let work = move |stage: &mut Stage, range: Range<u64>| {
                let params =
                    PointsParams { first: range.start as u32, count: range.end as u32, ..all };
                stage.dispatch(&kernel, range.end - range.start, &bindings, &params)
            };
            let total = Total::Known(list.count.into());
            cx.gpu.sliced("points_dirty", total, &self.dirty_pace, work, progress)?;
        }
        Ok(())
    }

    /// Takes the listed points, unless to gather all anew is cheaper, which was measured to be so
    /// where they have more lights than there are points.
    fn found(&self, gpu: &Gpu, listed: &[Found]) -> Result<Changes> {
        let lights = listed.iter().map(|f| u64::from(f.lights_each()) * u64::from(f.list.count));
        let lights = lights.sum::<u64>();
        let fits = lights * size_of::<[f32; 4]>() as u64 <= gpu.max_binding();
        match lights {
            0 => Ok(Changes::None),
            _ if lights >= self.count() || !fits => Ok(Changes::TooMany),
            _ => Ok(Changes::Listed(self.taken(gpu, listed, lights as u32)?.into())),
        }
    }

    /// All listed points together, in the buckets of their cells.
    fn taken(&self, gpu: &Gpu, listed: &[Found], lights: u32) -> Result<Listed> {
        let mut taken = Listed {
            count: lights,
            places: gpu.lend::<[u32; 4]>("point places", lights as usize)?,
            lights: gpu.lend::<[f32; 4]>("point lights", lights as usize)?,
            buckets: self.buckets(gpu, lights)?,
        };
        taken.buckets.expect(lights);
        let mut stage = gpu.stage("points_take").once();
        for found in listed {
            let Found { points, list } = found;
            let bindings = [
                ("work", (&list.items).into()),
                ("from_places", (&points.places).into()),
                ("starts", (&taken.buckets.starts).into()),
            ];
            let lights_each = found.lights_each();
            let params = PointsParams { lights_each, ..taken.buckets.with(list.count) };
            stage.dispatch(&self.tally, list.count.into(), &bindings, &params)?;
        }
        let begins = taken.buckets.params.buckets + 1;
        let scanner = Scanner::new(gpu, begins)?;
        scanner.record(&mut stage, &taken.buckets.starts, begins)?;
        for Found { points, list } in listed {
            for (lights, sign) in [(&points.seen, -1.0), (&points.now, 1.0)] {
                let Some(lights) = lights else { continue };
                let bindings = [
                    ("work", (&list.items).into()),
                    ("from_places", (&points.places).into()),
                    ("from_lights", lights.into()),
                    ("starts", (&taken.buckets.starts).into()),
                    ("point_places", (&taken.places).into()),
                    ("point_lights", (&taken.lights).into()),
                ];
                let params = PointsParams { sign, ..taken.buckets.with(list.count) };
                stage.dispatch(&self.take, list.count.into(), &bindings, &params)?;
            }
        }
        self.tell_rows(&mut stage, &taken.buckets)?;
        stage.finish()?;
        Ok(taken)
    }
}
