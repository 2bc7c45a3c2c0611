//! How an update brings the points of a table up to date: those that are where they were keep
//! their order, and new ones join them in their buckets.

use super::buckets::Buckets;
use super::changes::Moved;
use super::table::{Block, Member, Table};
use super::{MEAN_BLOCK, Points, PointsParams, Reach};
use crate::device_scene::Context;
use crate::error::Result;
use crate::gpu::run::{Bytes, Stage};
use crate::gpu::scan::Scanner;
use crate::gpu::work::{WorkList, fill};
use crate::gpu::{GROUP, Gpu};
use crate::photon::{Batch, PhotonMap, SlotMarks};
use crate::split::Split;

/// Points that are where they were.
struct Kept {
    /// Marked, not listed. One more than there are: it is asked how many are kept before the end.
    list: WorkList,
    /// How many are kept before each word of marks.
    ranks: wgpu::Buffer,
}

impl Kept {
    /// None of so many.
    fn none(gpu: &Gpu, count: u32) -> Result<Self> {
        let list = WorkList::new(gpu, count + 1)?;
        let ranks = list.ranks(gpu)?;
        Ok(Self { list, ranks })
    }
}

/// Slots of a batch whose points are new to a table.
struct Entering<'a> {
    member: &'a Member,
    batch: &'a Batch,
    list: WorkList,
}

fn count(entering: &[Entering]) -> u32 {
    entering.iter().map(|of| of.list.count).sum()
}

impl Points {
    /// The points of a table as they are now: those that are kept, with the light that they have
    /// now, and the others; or all anew where that is cheaper.
    pub(super) fn refreshed(
        &mut self,
        cx: Context,
        map: &PhotonMap,
        mut table: Table,
        reach: Reach,
        split: &Split,
    ) -> Result<Table> {
        let gpu = cx.gpu;
        if !table.members.iter().any(|member| member.moves(map)) {
            let moved = self.refresh(cx, map, &table, None, reach)?;
            self.moved.push(moved);
            return Ok(table);
        }
        let is_first = table.part.count == 0;
        let mut entering = self.entering(gpu, map, &table.members)?;
        let mut kept = self.kept(gpu, map, &table)?;
        let lists = entering.iter_mut().map(|of| &mut of.list).chain([&mut kept.list]);
        WorkList::learn(gpu, &mut lists.collect::<Vec<_>>())?;
        let (new, stay) = (count(&entering), kept.list.count);
        let is_anew = split.anew.unwrap_or(is_anew_cheaper(new, stay));
        if !is_first && (is_anew || !table.buckets.have_room(new)) {
            self.moved.push(Moved::gone(&table.part));
            table = Table { members: table.members, ..self.empty(gpu)? };
            table.members.iter_mut().for_each(|member| member.entered = false);
            entering = self.entering(gpu, map, &table.members)?;
            kept = Kept::none(gpu, 0)?;
            let lists = entering.iter_mut().map(|of| &mut of.list);
            WorkList::learn(gpu, &mut lists.collect::<Vec<_>>())?;
        } else if !is_first {
            let moved = self.refresh(cx, map, &table, Some(&kept.list), reach)?;
            self.moved.push(moved);
        }
        if table.part.count == 0 {
            table.buckets = self.buckets(gpu, count(&entering))?;
        }
        table.buckets.expect(count(&entering));
        self.elsewhere += if is_first { 0 } else { u64::from(new) };
        let new = self.entered(cx, &table.buckets, &entering)?;
        self.moved.push(Moved::came(&new));
        let part = self.merged(gpu, &table, &kept, &new)?;
        self.built += u64::from(new.count) * if self.even { 2 } else { 1 };
        self.built += u64::from(part.count);
        table.members.retain(|member| member.batch(map).is_some());
        table.members.iter_mut().for_each(|member| member.entered = true);
        Ok(Table { part, ..table })
    }

    /// Finds the points of a table that are where they were; how many is to be learned yet.
    fn kept(&self, gpu: &Gpu, map: &PhotonMap, table: &Table) -> Result<Kept> {
        let count = table.part.count;
        let kept = Kept::none(gpu, count)?;
        // Of batches that are gone, all.
        let marks = slot_marks(gpu, table)?;
        if table.members.iter().any(|member| member.batch(map).is_none()) {
            fill(gpu, "points_keep", &marks, &[u32::MAX])?;
        }
        let mut stage = gpu.stage("points_keep");
        copy_marks(&mut stage, map, table, &marks);
        let bindings = [
            ("slot_marks", (&marks).into()),
            ("origins", (&table.part.origins).into()),
            ("marks", (&kept.list.marks).into()),
        ];
        let words = u64::from((count + 1).div_ceil(32));
        stage.dispatch(&self.keep, words, &bindings, &self.params(count))?;
        kept.list.rank(&mut stage, &kept.ranks)?;
        stage.finish()?;
        Ok(kept)
    }

    /// Finds the slots of members that enter the table: those that moved, or all; how many is to
    /// be learned yet.
    fn entering<'a>(
        &self,
        gpu: &Gpu,
        map: &'a PhotonMap,
        members: &'a [Member],
    ) -> Result<Vec<Entering<'a>>> {
        let present = members.iter().filter_map(|m| Some((m, m.batch(map)?)));
        let some = present.filter(|(member, _)| member.moves(map));
        some.map(|(member, batch)| {
            let slots = member.slots.len() as u32;
            let list = WorkList::new(gpu, slots)?;
            let bindings = [
                ("states", (&batch.states).into()),
                ("slot_marks", (&batch.slot_marks).into()),
                ("marks", (&list.marks).into()),
            ];
            let params = PointsParams { all: (!member.entered).into(), ..self.params(slots) };
            let mut stage = gpu.stage("points_mark");
            stage.dispatch(&self.mark, slots.div_ceil(32).into(), &bindings, &params)?;
            list.record(stage)?;
            Ok(Entering { member, batch, list })
        })
        .collect()
    }

    /// The points of the slots that enter, batch by batch.
    fn entered(&self, cx: Context, buckets: &Buckets, entering: &[Entering]) -> Result<Block> {
        let Context { gpu, scene, counters } = cx;
        let all = count(entering);
        let part = Block::new(gpu, all, self.has_histories())?;
        let none = &self.none;
        let mut bindings = [scene.bindings(), part.bindings()].concat();
        bindings.extend([
            ("kept", (&none.lights).into()),
            ("changed", (&none.buckets).into()),
            ("starts", (&buckets.starts).into()),
            ("counters", counters.buffer().into()),
        ]);
        let mut first = 0;
        let mut each = Vec::new();
        for Entering { member, batch, list } in entering {
            let params =
                member.within(PointsParams { fresh: 1, first, ..buckets.with(list.count) });
            let own = [
                ("states", (&batch.states).into()),
                ("places", (&batch.places).into()),
                ("work", (&list.items).into()),
            ];
            each.push(([bindings.as_slice(), &own].concat(), params));
            first += list.count;
        }
        let mut stage = gpu.stage("points_key");
        for (bindings, params) in &each {
            stage.dispatch(&self.key, params.count.into(), bindings, params)?;
        }
        if self.even {
            let params = PointsParams { fresh: 1, ..self.params(all) };
            stage.dispatch(&self.mean, mean_threads(all), &bindings, &params)?;
        }
        for (bindings, params) in &each {
            stage.dispatch(&self.record, params.count.into(), bindings, params)?;
        }
        stage.finish()?;
        Ok(part)
    }

    /// Gives the points of a table the light that they have now: those that are `kept`, or all.
    fn refresh(
        &self,
        cx: Context,
        map: &PhotonMap,
        table: &Table,
        kept: Option<&WorkList>,
        reach: Reach,
    ) -> Result<Moved> {
        let Context { gpu, scene, counters } = cx;
        let part = &table.part;
        let count = part.count;
        let params = PointsParams { all: kept.is_none().into(), ..self.params(count) };
        let seen = gpu.buffer::<[f32; 4]>("point lights", count as usize)?;
        let changed = WorkList::new(gpu, count)?;
        let mut bindings = [scene.bindings(), part.bindings()].concat();
        bindings.extend([
            ("kept", kept.map_or(&self.none.buckets, |kept| &kept.marks).into()),
            ("changed", (&changed.marks).into()),
            ("counters", counters.buffer().into()),
        ]);
        let mut stage = gpu.stage("points_record");
        changed.unmark(&mut stage);
        stage.copy(Bytes::all(&part.lights), &seen, 0);
        if self.even && params.changed != [0, 0] {
            stage.dispatch(&self.mean, mean_threads(count), &bindings, &params)?;
        }
        let alters = |member: &Member| member.batch(map).is_some_and(|batch| batch.any_altered);
        if table.members.iter().any(alters) {
            let marks = slot_marks(gpu, table)?;
            copy_marks(&mut stage, map, table, &marks);
            let own = [bindings.as_slice(), &[("slot_marks", (&marks).into())]].concat();
            stage.dispatch(&self.query, count.into(), &own, &params)?;
        }
        for member in &table.members {
            let batch = member.batch(map);
            if reach == Reach::StaleBatches && batch.is_some_and(|batch| !batch.stale) {
                continue;
            }
            // Of a batch that is gone no point is kept, and no state is asked for.
            let states = batch.map_or(&part.places, |batch| &batch.states);
            let own = [bindings.as_slice(), &[("states", states.into())]].concat();
            let params = member.within(params);
            stage.dispatch(&self.record, count.div_ceil(32).into(), &own, &params)?;
        }
        stage.finish()?;
        Ok(Moved::some(part, seen, changed))
    }

    /// Points of a table that are kept and new ones; where buckets begin is found anew.
    fn merged(&self, gpu: &Gpu, table: &Table, kept: &Kept, new: &Block) -> Result<Block> {
        let Table { part: before, buckets, .. } = table;
        let begins = buckets.params.buckets + 1;
        let added = gpu.buffer::<u32>("points added", begins as usize)?;
        let mut stage = gpu.stage("points_merge");
        stage.clear(&added);
        let bindings = [("buckets", (&new.buckets).into()), ("starts", (&added).into())];
        let params = PointsParams { lights_each: 1, ..buckets.with(new.count) };
        stage.dispatch(&self.tally, params.count.into(), &bindings, &params)?;
        Scanner::new(gpu, begins)?.record(&mut stage, &added, begins)?;
        let part = Block::new(gpu, kept.list.count + new.count, self.has_histories())?;
        let kept = [
            ("kept", (&kept.list.marks).into()),
            ("ranks", (&kept.ranks).into()),
            ("starts", (&buckets.starts).into()),
            ("added", (&added).into()),
        ];
        for (from, fresh) in [(before, 0), (new, 1)] {
            let params = PointsParams { fresh, ..buckets.with(from.count) };
            let order = gpu.buffer::<u32>("points order", from.count as usize)?;
            let own = [("buckets", (&from.buckets).into()), ("order", (&order).into())];
            let bindings = [kept.as_slice(), &own].concat();
            stage.dispatch(&self.merge, params.count.into(), &bindings, &params)?;
            let mut bindings = [from.seen(), part.bindings()].concat();
            bindings.push(("order", (&order).into()));
            stage.dispatch(&self.arrange, params.count.into(), &bindings, &params)?;
            // Without histories no update is to come.
            if self.history {
                stage.dispatch(&self.origins, params.count.into(), &bindings, &params)?;
            }
        }
        stage.dispatch(&self.shift, begins.into(), &kept, &buckets.params)?;
        self.tell_rows(&mut stage, buckets)?;
        stage.finish()?;
        Ok(part)
    }
}

/// Room for the slot marks of all members of a table.
fn slot_marks(gpu: &Gpu, table: &Table) -> Result<wgpu::Buffer> {
    gpu.buffer::<SlotMarks>("slot marks", table.slots().div_ceil(32) as usize)
}

/// Copies there what is marked in the batches that there are.
fn copy_marks(stage: &mut Stage, map: &PhotonMap, table: &Table, marks: &wgpu::Buffer) {
    for member in &table.members {
        if let Some(batch) = member.batch(map) {
            stage.copy(Bytes::all(&batch.slot_marks), marks, member.marks_at());
        }
    }
}

/// Whether to take all points anew rather than those that moved, and merge them with those that
/// are kept. With the segments that it spares, merging was measured to pay until 30 % moved, and to
/// be level until 80.
fn is_anew_cheaper(moved: u32, kept: u32) -> bool {
    f64::from(moved) > 0.8 * (f64::from(moved) + f64::from(kept))
}

/// A group finds those means of so many points that there are to be found.
fn mean_threads(count: u32) -> u64 {
    u64::from(count.div_ceil(MEAN_BLOCK) * GROUP)
}
