//! How an update brings the points of a table up to date: those that are where they were keep
//! their order, and new ones join them in their buckets.

use super::changes::Moved;
use super::table::{Block, Member, Table};
use super::{MEAN_BLOCK, Points, PointsParams, Reach};
use crate::device_scene::Context;
use crate::error::Result;
use crate::gpu::pool::Pooled;
use crate::gpu::read::Words;
use crate::gpu::resource::Bytes;
use crate::gpu::run::Stage;
use crate::gpu::scan::Scanner;
use crate::gpu::sort::CountParams;
use crate::gpu::work::{WorkList, fill};
use crate::gpu::{GROUP, Gpu};
use crate::photon::{Batch, PhotonMap, SlotMarks};
use crate::split::Split;

/// Points that are where they were.
struct Kept {
    /// Marked, not listed. One more than there are: it is asked how many are kept before the end.
    list: WorkList,
    /// How many are kept before each word of marks.
    ranks: Pooled,
}

impl Kept {
    /// None of so many.
    fn none(gpu: &Gpu, count: u32) -> Result<Self> {
        let list = WorkList::new(gpu, count + 1)?;
        let ranks = list.ranks(gpu)?;
        Ok(Self { list, ranks })
    }
}

/// What is known of a table before it is brought up to date. How many are listed is to be learned.
pub(super) struct Survey {
    table: Table,
    /// Its slots that enter it, where any may.
    entering: Option<WorkList>,
    /// Its points that are where they were, where any may not be.
    kept: Option<Kept>,
    /// Those that stay, with the light that was seen.
    staying: Option<Staying>,
}

/// Points that stay.
struct Staying {
    /// The light that segments have seen of them.
    seen: Pooled,
    /// Those of which it is another now.
    changed: WorkList,
}

impl Survey {
    fn lists(&mut self) -> impl Iterator<Item = &mut WorkList> {
        let Self { entering, kept, staying, .. } = self;
        let kept = kept.as_mut().map(|kept| &mut kept.list);
        let changed = staying.as_mut().map(|staying| &mut staying.changed);
        [entering.as_mut(), kept, changed].into_iter().flatten()
    }

    /// Where the device has how many are listed.
    pub(super) fn lengths(&mut self) -> Vec<Words> {
        self.lists().map(|list| list.length()).collect()
    }

    /// Learns that; returns what is not of this table.
    pub(super) fn learn<'a>(&mut self, mut lengths: &'a [u32]) -> &'a [u32] {
        for list in self.lists() {
            if let Some((first, rest)) = lengths.split_first() {
                (list.count, lengths) = (*first, rest);
            }
        }
        lengths
    }
}

impl Points {
    /// Finds out what becomes of the points of a table: those that stay are given the light that they
    /// have now.
    pub(super) fn surveyed(
        &self,
        cx: Context,
        map: &PhotonMap,
        table: Table,
        reach: Reach,
    ) -> Result<Survey> {
        let gpu = cx.gpu;
        let is_asked = reach == Reach::All || !table.is_current(map);
        let moves = table.members.iter().any(|member| member.moves(map));
        let (mut entering, mut kept, mut staying) = (None, None, None);
        if is_asked && moves {
            entering = Some(self.entering(gpu, map, &table)?);
        }
        if is_asked && table.part.count > 0 {
            if moves {
                kept = Some(self.kept(gpu, map, &table)?);
            }
            let list = kept.as_ref().map(|kept| &kept.list);
            staying = Some(self.refresh(cx, map, &table, list, reach)?);
        }
        Ok(Survey { table, entering, kept, staying })
    }

    /// The points of a table as they are now: those that are kept and the others; or all anew where
    /// that is cheaper.
    pub(super) fn refreshed(
        &mut self,
        cx: Context,
        map: &PhotonMap,
        survey: Survey,
        split: &Split,
    ) -> Result<Table> {
        let Survey { mut table, entering, kept, staying } = survey;
        let gpu = cx.gpu;
        let is_first = table.part.count == 0;
        let (new, stay) = (
            entering.as_ref().map_or(0, |list| list.count),
            kept.as_ref().map_or(table.part.count, |kept| kept.list.count),
        );
        let stays_whole = new == 0 && stay == table.part.count;
        let is_anew = split.anew.unwrap_or(is_anew_cheaper(new, stay));
        let mut entering = entering;
        let mut kept = kept;
        match staying {
            Some(Staying { seen, .. })
                if !stays_whole && (is_anew || !table.buckets.have_room(new)) =>
            {
                self.moved.push(Moved::gone(&table.part, seen));
                table = Table { members: table.members, ..self.empty(gpu)? };
                table.members.iter_mut().for_each(|member| member.entered = false);
                let mut all = self.entering(gpu, map, &table)?;
                // Those that moved and those that did not.
                all.count = new + stay;
                (entering, kept) = (Some(all), None);
            }
            Some(Staying { seen, changed }) => {
                self.moved.push(Moved::some(&table.part, seen, changed));
            }
            None => {}
        }
        let Some(entering) = entering.filter(|_| is_first || !stays_whole) else {
            table.members.retain(|member| member.batch(map).is_some());
            return Ok(table);
        };
        if table.part.count == 0 {
            table.buckets = self.buckets(gpu, entering.count)?;
        }
        table.buckets.expect(entering.count);
        self.elsewhere += if is_first { 0 } else { u64::from(entering.count) };
        let part = self.entered(cx, map, &table, &entering)?;
        self.moved.push(Moved::came(&part));
        let kept = kept.map_or_else(|| Kept::none(gpu, 0), Ok)?;
        let new = part.count;
        let part = self.merged(gpu, &table, &kept, &part)?;
        self.built += u64::from(new) * if self.even { 2 } else { 1 };
        self.built += u64::from(part.count);
        table.members.retain(|member| member.batch(map).is_some());
        table.members.iter_mut().for_each(|member| member.entered = true);
        Ok(Table { part, ..table })
    }

    /// Finds the points of a table that are where they were.
    fn kept(&self, gpu: &Gpu, map: &PhotonMap, table: &Table) -> Result<Kept> {
        let count = table.part.count;
        let kept = Kept::none(gpu, count)?;
        // Of batches that are gone, all.
        let marks = slot_marks(gpu, table)?;
        if table.members.iter().any(|member| member.batch(map).is_none()) {
            fill(gpu, "points_keep", &marks, &[u32::MAX])?;
        }
        let mut stage = gpu.stage("points_keep").once();
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

    /// Lists the slots that enter a table: those that moved, or all, told as slots of the table.
    fn entering(&self, gpu: &Gpu, map: &PhotonMap, table: &Table) -> Result<WorkList> {
        let list = WorkList::new(gpu, table.slots())?;
        let mut stage = gpu.stage("points_mark").once();
        for (member, batch) in entering_members(map, table) {
            let slots = member.slots.len() as u32;
            let bindings = [
                ("states", (&batch.states).into()),
                ("slot_marks", (&batch.slot_marks).into()),
                ("marks", (&list.marks).into()),
            ];
            let all = (!member.entered).into();
            let params = member.within(PointsParams { all, ..self.params(slots) });
            stage.dispatch(&self.mark, slots.div_ceil(32).into(), &bindings, &params)?;
        }
        list.record(stage)?;
        Ok(list)
    }

    /// The points of the slots that enter, batch by batch.
    fn entered(
        &self,
        cx: Context,
        map: &PhotonMap,
        table: &Table,
        entering: &WorkList,
    ) -> Result<Block> {
        let Context { gpu, scene, counters } = cx;
        let all = entering.count;
        let part = Block::new(gpu, all, self.has_histories())?;
        let none = &self.none;
        let mut bindings = [scene.bindings(), part.bindings()].concat();
        bindings.extend([
            ("work", (&entering.items).into()),
            ("kept", (&none.lights).into()),
            ("changed", (&none.buckets).into()),
            ("starts", (&table.buckets.starts).into()),
            ("counters", counters.buffer().into()),
        ]);
        let each = entering_members(map, table)
            .map(|(member, batch)| {
                let params = member.within(PointsParams { fresh: 1, ..table.buckets.with(all) });
                let own = [("states", (&batch.states).into()), ("places", (&batch.places).into())];
                ([bindings.as_slice(), &own].concat(), params)
            })
            .collect::<Vec<_>>();
        let mut stage = gpu.stage("points_key").once();
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
    ) -> Result<Staying> {
        let Context { gpu, scene, counters } = cx;
        let part = &table.part;
        let count = part.count;
        let params = PointsParams { all: kept.is_none().into(), ..self.params(count) };
        let seen = gpu.lend::<[f32; 4]>("point lights", count as usize)?;
        let changed = WorkList::new(gpu, count)?;
        let mut bindings = [scene.bindings(), part.bindings()].concat();
        bindings.extend([
            ("kept", kept.map_or(&self.none.buckets, |kept| &kept.marks).into()),
            ("changed", (&changed.marks).into()),
            ("counters", counters.buffer().into()),
        ]);
        let mut stage = gpu.stage("points_record").once();
        changed.unmark(&mut stage);
        stage.copy(Bytes::all(&part.lights), &seen, 0);
        if self.even && params.changed != [0, 0] {
            stage.dispatch(&self.mean, mean_threads(count), &bindings, &params)?;
        }
        let alters = |member: &Member| member.batch(map).is_some_and(|batch| batch.stale);
        // It must be there until all is recorded.
        let marks = match table.members.iter().any(alters) {
            true => Some(slot_marks(gpu, table)?),
            false => None,
        };
        if let Some(marks) = &marks {
            copy_marks(&mut stage, map, table, marks);
            let own = [bindings.as_slice(), &[("slot_marks", marks.into())]].concat();
            stage.dispatch(&self.query, count.into(), &own, &params)?;
        }
        for member in &table.members {
            let batch = member.batch(map);
            if reach == Reach::StaleBatches && batch.is_some_and(|batch| !batch.stale) {
                continue;
            }
            // Of a batch that is gone no point is kept, and no state is asked for.
            let states = batch.map_or(&*part.places, |batch| &batch.states);
            let own = [bindings.as_slice(), &[("states", states.into())]].concat();
            let params = member.within(params);
            stage.dispatch(&self.record, count.div_ceil(32).into(), &own, &params)?;
        }
        changed.record(stage)?;
        Ok(Staying { seen, changed })
    }

    /// Points of a table that are kept and new ones; where buckets begin is found anew.
    fn merged(&self, gpu: &Gpu, table: &Table, kept: &Kept, new: &Block) -> Result<Block> {
        let Table { part: before, buckets, .. } = table;
        let begins = buckets.params.buckets + 1;
        let added = gpu.lend::<u32>("points added", begins as usize)?;
        let mut stage = gpu.stage("points_merge").once();
        stage.clear(&added);
        let bindings = [("keys", (&new.buckets).into()), ("starts", (&added).into())];
        stage.dispatch(
            &self.count,
            new.count.into(),
            &bindings,
            &CountParams { count: new.count },
        )?;
        let scanner = Scanner::new(gpu, begins)?;
        scanner.record(&mut stage, &added, begins)?;
        let part = Block::new(gpu, kept.list.count + new.count, self.has_histories())?;
        let kept = [
            ("kept", (&kept.list.marks).into()),
            ("ranks", (&kept.ranks).into()),
            ("starts", (&buckets.starts).into()),
            ("added", (&added).into()),
        ];
        let order = |from: &Block| gpu.lend::<u32>("points order", from.count as usize);
        let orders = [order(before)?, order(new)?];
        for ((from, fresh), order) in [(before, 0), (new, 1)].into_iter().zip(&orders) {
            let params = PointsParams { fresh, ..buckets.with(from.count) };
            let own = [("buckets", (&from.buckets).into()), ("order", order.into())];
            let bindings = [kept.as_slice(), &own].concat();
            stage.dispatch(&self.merge, params.count.into(), &bindings, &params)?;
            let mut bindings = [from.seen(), part.bindings()].concat();
            bindings.push(("order", order.into()));
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

/// Members of a table of which slots may enter it, with their batches.
fn entering_members<'a>(
    map: &'a PhotonMap,
    table: &'a Table,
) -> impl Iterator<Item = (&'a Member, &'a Batch)> {
    let members = table.members.iter().filter(|member| member.moves(map));
    members.filter_map(|member| Some((member, member.batch(map)?)))
}

/// Room for the slot marks of all members of a table.
fn slot_marks(gpu: &Gpu, table: &Table) -> Result<Pooled> {
    gpu.lend::<SlotMarks>("slot marks", table.slots().div_ceil(32) as usize)
}

/// Copies there what is marked in the batches that there are.
fn copy_marks(stage: &mut Stage, map: &PhotonMap, table: &Table, marks: &Pooled) {
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
