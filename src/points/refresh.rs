//! How an update brings the points of a batch up to date: those that are where they were keep
//! their order, and new ones join them in their buckets.

use super::changes::Moved;
use super::{Part, Points, PointsParams, Sorted, SortedBatch, mean_threads};
use crate::error::Result;
use crate::frame::DeviceScene;
use crate::gpu::Gpu;
use crate::gpu::scan::Scanner;
use crate::photon::{Batch, PhotonMap};
use crate::render::Split;
use crate::work::WorkList;

/// Points that are where they were.
struct Kept {
    /// Marked, not listed.
    list: WorkList,
    /// How many are kept before each word of marks.
    ranks: wgpu::Buffer,
}

impl Points {
    /// The points of a batch that are where they were, with the light that they have now, and
    /// the others; or all sorted anew where that is cheaper.
    pub(super) fn refreshed(
        &mut self,
        gpu: &Gpu,
        scene: &DeviceScene,
        (map, batch): (&PhotonMap, &Batch),
        (mut own, split): (SortedBatch, &Split),
    ) -> Result<SortedBatch> {
        if !batch.any_moved {
            self.moved.push(self.refresh(gpu, scene, batch, (&own.part, None))?);
            return Ok(own);
        }
        let mut kept = self.kept(gpu, batch, &own.part)?;
        let mut new = self.live(gpu, batch, own.all_slots, false)?;
        WorkList::learn(gpu, &mut [&mut kept.list, &mut new])?;
        self.elsewhere += u64::from(new.count);
        if split.sort.unwrap_or_else(|| self.is_sorting_cheaper(new.count, kept.list.count)) {
            let now = self.sorted(gpu, scene, (map, batch))?;
            self.moved.extend([Moved::gone(&own.part), Moved::came(&now.part)]);
            return Ok(now);
        }
        self.moved.push(self.refresh(gpu, scene, batch, (&own.part, Some(&kept.list)))?);
        let new = self.part(gpu, scene, batch, (&new, 0))?;
        self.moved.push(Moved::came(&new));
        own.part = self.merged(gpu, (own.part, &kept), &new)?;
        Ok(own)
    }

    /// Whether to sort all points anew rather than those that moved, and merge them with those
    /// that are kept. Merging was measured to pay until 60 % moved; until 80 % where means are
    /// known, which sorting anew forgets; where extinction changed, until 10 % if it changed
    /// around all points, and 80 % if around few: half is between.
    fn is_sorting_cheaper(&self, moved: u32, kept: u32) -> bool {
        let share = match (self.even, self.params.changed == [0, 0]) {
            (false, _) => 0.6,
            (true, true) => 0.8,
            (true, false) => 0.5,
        };
        f64::from(moved) > share * (f64::from(moved) + f64::from(kept))
    }

    /// Finds the points of a part that are where they were; how many is to be learned yet.
    fn kept(&self, gpu: &Gpu, batch: &Batch, part: &Part) -> Result<Kept> {
        let count = part.points.count;
        // One more than there are: it is asked how many are kept before the end.
        let list = WorkList::new(gpu, count + 1)?;
        let ranks = list.ranks(gpu)?;
        let bindings = [
            ("moved", (&batch.moved).into()),
            ("slots", (&part.slots).into()),
            ("marks", (&list.marks).into()),
        ];
        let mut stage = gpu.stage("points_keep");
        let words = u64::from((count + 1).div_ceil(32));
        stage.dispatch(&self.keep, words, &bindings, &self.params(count))?;
        list.rank(&mut stage, &ranks)?;
        stage.finish()?;
        Ok(Kept { list, ranks })
    }

    /// Gives the points of a part the light that they have now: those that are kept, or all.
    fn refresh(
        &self,
        gpu: &Gpu,
        scene: &DeviceScene,
        batch: &Batch,
        (part, kept): (&Part, Option<&WorkList>),
    ) -> Result<Moved> {
        let count = part.points.count;
        let stay = if batch.any_repowered { 0 } else { self.params.stay };
        let params = PointsParams { all: kept.is_none().into(), stay, ..self.params(count) };
        let seen = gpu.buffer::<[f32; 4]>("point lights", count as usize)?;
        let changed = WorkList::new(gpu, count)?;
        let mut bindings = [scene.bindings(), part.bindings(batch)].concat();
        bindings.extend([
            ("kept", kept.map_or(&self.none.starts, |kept| &kept.marks).into()),
            ("seen_lights", (&seen).into()),
            ("changed", (&changed.marks).into()),
        ]);
        let mut stage = gpu.stage("points_record");
        changed.unmark(&mut stage);
        if self.even && params.changed != [0, 0] {
            stage.dispatch(&self.mean, mean_threads(count), &bindings, &params)?;
        }
        stage.dispatch(&self.record, count.into(), &bindings, &params)?;
        stage.finish()?;
        Ok(Moved::some(part, &seen, changed))
    }

    /// Points that are kept and new ones.
    fn merged(&self, gpu: &Gpu, (before, kept): (Part, &Kept), new: &Part) -> Result<Part> {
        let count = kept.list.count + new.points.count;
        let words = |stage, count: u32| gpu.buffer::<u32>(stage, count as usize);
        let begins = self.params.buckets + 1;
        let added = words("points added", begins)?;
        let starts = &before.points.starts;
        let mut stage = gpu.stage("points_merge");
        stage.clear(&added);
        let keys = &new.points.keys;
        let bindings = [("work", keys.into()), ("keys", keys.into()), ("starts", (&added).into())];
        let params = PointsParams { all: 1, ..self.params(new.points.count) };
        stage.dispatch(&self.tally, params.count.into(), &bindings, &params)?;
        Scanner::new(gpu, begins)?.record(&mut stage, &added, begins)?;
        let keys = words("points keys", count)?;
        let points = Sorted::new(gpu, [keys, starts.clone()], &self.params(count))?;
        let [means, mean_histories] = self.means(gpu, count)?;
        let part = Part { slots: words("points slots", count)?, means, mean_histories, points };
        for (from, fresh) in [(&before, 0), (new, 1)] {
            let params = PointsParams { fresh, ..self.params(from.points.count) };
            let order = words("points order", params.count)?;
            let bindings = [
                ("kept", (&kept.list.marks).into()),
                ("ranks", (&kept.ranks).into()),
                ("keys", (&from.points.keys).into()),
                ("starts", starts.into()),
                ("added", (&added).into()),
                ("order", (&order).into()),
            ];
            stage.dispatch(&self.merge, params.count.into(), &bindings, &params)?;
            let bindings = [
                ("order", (&order).into()),
                ("seen_keys", (&from.points.keys).into()),
                ("seen_places", (&from.points.places).into()),
                ("seen_lights", (&from.points.lights).into()),
                ("seen_slots", (&from.slots).into()),
                ("seen_means", (&from.means).into()),
                ("seen_histories", (&from.mean_histories).into()),
                ("keys", (&part.points.keys).into()),
                ("point_places", (&part.points.places).into()),
                ("point_lights", (&part.points.lights).into()),
                ("slots", (&part.slots).into()),
                ("means", (&part.means).into()),
                ("mean_histories", (&part.mean_histories).into()),
            ];
            stage.dispatch(&self.arrange, params.count.into(), &bindings, &params)?;
            stage.dispatch(&self.origins, params.count.into(), &bindings, &params)?;
        }
        let bindings = [
            ("kept", (&kept.list.marks).into()),
            ("ranks", (&kept.ranks).into()),
            ("added", (&added).into()),
            ("starts", starts.into()),
        ];
        stage.dispatch(&self.shift, begins.into(), &bindings, &self.params)?;
        stage.finish()?;
        Ok(part)
    }
}
