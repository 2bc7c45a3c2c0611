//! The `points` light field: photons sorted by the cell of a grid whose edge is the
//! gather radius, H(8).
//!
//! Only live slots enter: listed, sorted by cell key with a stable radix sort, then copied
//! out in that order with what a gather needs. Points that are where they were keep their
//! order; only others are sorted, and merged with them. A table of buckets, each of 2^shift
//! consecutive keys, says where to begin; it needs no probing, and its size is bounded
//! however small the radius.
//!
//! After an edit the points are compared with those that the segments have seen. What
//! went and what came are sorted lists of their own, so that segments take the ones out
//! and add the others, and gather nothing else.

use std::sync::Arc;

use crate::counter::CounterBuffer;
use crate::dirty::Dirty;
use crate::error::{Error, Result};
use crate::frame::{DeviceScene, words};
use crate::gpu::Gpu;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::run::{Bindings, Resource, Stage};
use crate::gpu::sort::Sorter;
use crate::photon::{Batch, PhotonMap};
use crate::query::{CHANGE_ALBEDO, CHANGE_FALLEN, CHANGE_PHASE, CHANGE_RISEN};
use crate::render::Progress;
use crate::scene::{Settings, Weighting};
use crate::segment::Run;
use crate::work::WorkList;

/// Buckets of one batch's table, at most: 16 MiB.
const MAX_BUCKETS: u64 = 1 << 22;
/// Buckets that are so far apart are looked for among all points, the others between them.
pub const BUCKET_STEP: u32 = 256;

shared_struct! {
    /// The geometry of the hash, as every kernel that touches it is told.
    pub struct PointsParams {
        /// Cells along each axis.
        pub grid: [u32; 3],
        /// Slots to look at, or sorted points.
        pub count: u32,
        /// Gather radius and edge of a cell, mm.
        pub radius: f32,
        /// Keys in a bucket, as a power of two.
        pub shift: u32,
        /// Buckets in the table.
        pub buckets: u32,
        /// 1 / (4/3 pi r³).
        pub kernel: f32,
        /// Place of the first point that is taken, or of the first new one.
        pub first: u32,
        /// -1 where what is taken has gone.
        pub sign: f32,
        /// Buckets from one whose begin is looked for to the next.
        pub step: u32,
        /// Which means are known: 0 none, 1 those of points that others were, 2 all.
        pub known: u32,
        /// Bins whose extinction changed since.
        pub changed: [u32; 2],
        /// Keeps the size a multiple of 16.
        pub pad: [u32; 2],
    }
}

/// Of which points the mean extinction around them was found before.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Known {
    /// Of none.
    None,
    /// Of those that were other points before.
    BySource,
    /// Of all, which are what they were.
    All,
}

/// Slots in the order of their cells' keys, equal ones in their own.
struct Order {
    count: u32,
    keys: wgpu::Buffer,
    slots: wgpu::Buffer,
    /// Which point each was before, where some are kept.
    sources: wgpu::Buffer,
    known: Known,
}

impl Order {
    fn new(gpu: &Gpu, count: u32, known: Known) -> Result<Self> {
        let sources = if known == Known::BySource { count } else { 0 };
        Ok(Self {
            count,
            keys: gpu.buffer::<u32>("points keys", count as usize)?,
            slots: gpu.buffer::<u32>("points slots", count as usize)?,
            sources: gpu.buffer::<u32>("points sources", sources as usize)?,
            known,
        })
    }
}

/// Points in the order of their cells' keys, with what a gather needs of each.
struct Sorted {
    count: u32,
    keys: wgpu::Buffer,
    places: wgpu::Buffer,
    lights: wgpu::Buffer,
    starts: wgpu::Buffer,
    field: wgpu::Buffer,
}

impl Sorted {
    fn new(gpu: &Gpu, keys: wgpu::Buffer, count: u32, params: &PointsParams) -> Result<Self> {
        Ok(Self {
            count,
            keys,
            places: gpu.buffer::<[u32; 4]>("point places", count as usize)?,
            lights: gpu.buffer::<[f32; 4]>("point lights", count as usize)?,
            starts: gpu.buffer::<u32>("points starts", params.buckets as usize + 1)?,
            field: gpu.upload("points field", &[PointsParams { count, ..*params }])?,
        })
    }

    fn bindings(&self) -> Bindings<'_> {
        vec![
            ("field", (&self.field).into()),
            ("point_places", (&self.places).into()),
            ("point_lights", (&self.lights).into()),
            ("starts", (&self.starts).into()),
            ("keys", (&self.keys).into()),
        ]
    }

    fn run(&self) -> Run<'_> {
        Run { bindings: self.bindings(), points: self.count }
    }

    fn bytes(&self) -> u64 {
        [&self.keys, &self.places, &self.lights, &self.starts].map(wgpu::Buffer::size).iter().sum()
    }
}

/// The points of one photon batch.
struct SortedBatch {
    /// Light and first photon of the batch.
    key: (u32, u32),
    /// Its photons.
    photons: u32,
    /// Its slots, empty ones included.
    all_slots: u32,
    points: Sorted,
    /// The slot of each point.
    slots: wgpu::Buffer,
    /// The mean extinction around each, 1/mm, where `even` divides by it.
    means: wgpu::Buffer,
}

/// What differs from what the segments have seen.
enum Changes {
    /// Nothing.
    None,
    /// What went, with negative light, and what came.
    Listed(Sorted),
    /// So much that all is to be gathered anew.
    TooMany,
}

/// Points of a batch that came (sign 1) or went (-1).
struct Marked<'a> {
    batch: &'a SortedBatch,
    sign: f32,
    list: WorkList,
}

impl<'a> Marked<'a> {
    fn all(gpu: &Gpu, batch: &'a SortedBatch, sign: f32) -> Result<Self> {
        let list = WorkList::new(gpu, batch.points.count)?;
        list.mark_all(gpu)?;
        Ok(Self { batch, sign, list })
    }
}

/// The sorted points of all batches.
pub struct Points {
    /// Gather radius, mm.
    pub radius: f32,
    params: PointsParams,
    /// Whether fluence is blurred, not collision density.
    pub even: bool,
    key_bits: u32,
    batches: Vec<Arc<SortedBatch>>,
    /// The batches that all segments were computed from.
    seen: Vec<Arc<SortedBatch>>,
    /// What went and came since then.
    changes: Changes,
    /// No points, for a scene without lights.
    none: Sorted,
    mark: Arc<Kernel>,
    keep: Arc<Kernel>,
    key: Arc<Kernel>,
    merge: Arc<Kernel>,
    mean: Arc<Kernel>,
    record: Arc<Kernel>,
    starts: Arc<Kernel>,
    number: Arc<Kernel>,
    compare: Arc<Kernel>,
    dirty: Arc<Kernel>,
    take: Arc<Kernel>,
    arrange: Arc<Kernel>,
}

impl Points {
    /// An empty field for a scene.
    ///
    /// # Errors
    /// The radius is too small for the volume.
    pub fn new(gpu: &Gpu, scene: &DeviceScene, settings: &Settings, radius: f64) -> Result<Self> {
        let grid = scene.frame.extent.map(|e| (f64::from(e) / radius).ceil().max(1.0));
        let cells = grid.iter().product::<f64>();
        if cells > f64::from(u32::MAX) {
            return Err(Error::capacity(
                "points",
                format!(
                    "a radius of {radius} mm makes {cells:.0} cells, more than 2^32: raise `radius`"
                ),
            ));
        }
        let cells = cells as u64;
        let shift = cells.div_ceil(MAX_BUCKETS).next_power_of_two().ilog2();
        let even = settings.weighting == Weighting::Even;
        let params = PointsParams {
            grid: grid.map(|n| n as u32),
            count: 0,
            radius: radius as f32,
            shift,
            buckets: cells.div_ceil(1 << shift) as u32,
            kernel: (0.75 / (std::f64::consts::PI * radius.powi(3))) as f32,
            ..Default::default()
        };
        let none = PointsParams { shift: 31, buckets: 2, ..params };
        Ok(Self {
            even,
            radius: radius as f32,
            none: Sorted::new(gpu, gpu.buffer::<u32>("points keys", 0)?, 0, &none)?,
            params,
            key_bits: u64::BITS - (cells - 1).leading_zeros(),
            batches: Vec::new(),
            seen: Vec::new(),
            changes: Changes::None,
            mark: gpu.kernel("points_mark", &[])?,
            keep: gpu.kernel("points_keep", &[])?,
            key: gpu.kernel("points_key", &[])?,
            merge: gpu.kernel("points_merge", &[])?,
            mean: gpu.kernel("points_mean", &scene.flags(&["nearest", "float_voxels"]))?,
            record: record_kernel(gpu, scene, even)?,
            starts: gpu.kernel("points_starts", &[])?,
            number: gpu.kernel("points_number", &[])?,
            compare: gpu.kernel("points_match", &[])?,
            dirty: gpu.kernel("points_dirty", &[])?,
            take: gpu.kernel("points_take", &[])?,
            arrange: gpu.kernel("points_arrange", &[])?,
        })
    }

    /// Takes the kernels that suit an edited scene.
    ///
    /// # Errors
    /// The device refuses them.
    pub fn respecialise(&mut self, gpu: &Gpu, scene: &DeviceScene) -> Result<()> {
        self.record = record_kernel(gpu, scene, self.even)?;
        Ok(())
    }

    /// Columns of the transfer function that contributions depend on, `CHANGE_` bits.
    pub fn columns(&self) -> u32 {
        let extinction = if self.even { CHANGE_RISEN | CHANGE_FALLEN } else { 0 };
        CHANGE_PHASE | CHANGE_ALBEDO | extinction
    }

    /// Has the next build sort all points anew.
    pub fn forget(&mut self) {
        self.batches.clear();
    }

    /// Sorts the live slots of the batches that changed, and records them or `all` points;
    /// `changed` has the bins whose extinction changed since the segments were computed.
    ///
    /// # Errors
    /// The device failed.
    pub fn build(
        &mut self,
        gpu: &Gpu,
        scene: &DeviceScene,
        map: &mut PhotonMap,
        (all, changed): (bool, u64),
        progress: &mut Progress,
    ) -> Result<()> {
        let total = map.batches.len();
        let before = std::mem::take(&mut self.batches);
        self.changes = Changes::None;
        self.params.changed = words(changed);
        for i in 0..total {
            let batch = &map.batches[i];
            let now = match of_batch(&before, batch) {
                Some(own) if !all && !batch.stale => own.clone(),
                Some(own) if !batch.stale => Arc::new(self.same(gpu, scene, batch, own)?),
                own => Arc::new(self.sorted(gpu, scene, (map, batch), own.map(Arc::as_ref))?),
            };
            self.batches.push(now);
            map.batches[i].stale = false;
            progress.at("sort", i as u64 + 1, total as u64);
        }
        Ok(())
    }

    /// The points as they were, with the light that they have now.
    fn same(
        &self,
        gpu: &Gpu,
        scene: &DeviceScene,
        batch: &Batch,
        before: &SortedBatch,
    ) -> Result<SortedBatch> {
        let count = before.points.count;
        let order = Order {
            count,
            keys: before.points.keys.clone(),
            slots: before.slots.clone(),
            sources: gpu.buffer::<u32>("points sources", 0)?,
            known: Known::All,
        };
        let points = Sorted {
            count,
            keys: before.points.keys.clone(),
            places: before.points.places.clone(),
            lights: gpu.buffer::<[f32; 4]>("point lights", count as usize)?,
            starts: before.points.starts.clone(),
            field: before.points.field.clone(),
        };
        self.recorded(gpu, scene, (batch, before.all_slots), (order, points), Some(before))
    }

    /// The live slots of a batch in order. Points of `before` that are where they were keep
    /// theirs.
    fn sorted(
        &self,
        gpu: &Gpu,
        scene: &DeviceScene,
        (map, batch): (&PhotonMap, &Batch),
        before: Option<&SortedBatch>,
    ) -> Result<SortedBatch> {
        let all_slots = batch.photons * map.max_events;
        let mut new = WorkList::new(gpu, all_slots)?;
        let bindings = [("states", (&batch.states).into()), ("marks", (&new.marks).into())];
        let mut stage = gpu.stage("points_mark");
        new.unmark(&mut stage);
        stage.dispatch(&self.mark, all_slots.into(), &bindings, &self.params(all_slots))?;
        stage.finish()?;
        let kept = before.map(|before| self.kept(gpu, before, batch, &new)).transpose()?;
        new.compact(gpu.stage("list"), None)?;
        if kept.as_ref().is_some_and(|kept| cheaper_to_sort(new.count, kept.count)) {
            return self.sorted(gpu, scene, (map, batch), None);
        }

        let mut order = self.by_key(gpu, batch, &new)?;
        if let (Some(before), Some(kept)) = (before, &kept) {
            order = self.merged(gpu, (before, kept), &order)?;
        }
        let points = Sorted::new(gpu, order.keys.clone(), order.count, &self.params)?;
        let now = self.recorded(gpu, scene, (batch, all_slots), (order, points), before)?;
        let mut stage = gpu.stage("points_starts");
        self.find(&mut stage, &now.points.bindings(), &self.params(now.points.count))?;
        stage.finish()?;
        Ok(now)
    }

    /// Records what a gather needs of the ordered points.
    fn recorded(
        &self,
        gpu: &Gpu,
        scene: &DeviceScene,
        (batch, all_slots): (&Batch, u32),
        (order, points): (Order, Sorted),
        before: Option<&SortedBatch>,
    ) -> Result<SortedBatch> {
        let Order { count, slots, sources, known, .. } = order;
        let none = gpu.buffer::<f32>("point means", 0)?;
        let means = match self.even {
            true => gpu.buffer::<f32>("point means", count as usize)?,
            false => none.clone(),
        };
        let mut bindings = [scene.bindings(), batch.bindings(), points.bindings()].concat();
        bindings.extend([
            ("slots", (&slots).into()),
            ("sources", (&sources).into()),
            ("known_means", before.map_or(&none, |before| &before.means).into()),
            ("means", (&means).into()),
        ]);
        let params = PointsParams { known: known as u32, ..self.params(count) };
        let mut stage = gpu.stage("points_record");
        if self.even {
            stage.dispatch(&self.mean, count.into(), &bindings, &params)?;
        }
        stage.dispatch(&self.record, count.into(), &bindings, &params)?;
        stage.finish()?;
        let key = (batch.light_id, batch.first_index);
        Ok(SortedBatch { key, photons: batch.photons, all_slots, points, slots, means })
    }

    /// The points that are where they were. Their slots are no longer `new`.
    fn kept(
        &self,
        gpu: &Gpu,
        before: &SortedBatch,
        batch: &Batch,
        new: &WorkList,
    ) -> Result<WorkList> {
        let count = before.points.count;
        let mut kept = WorkList::new(gpu, count)?;
        let bindings = [
            ("places", (&batch.places).into()),
            ("states", (&batch.states).into()),
            ("slots", (&before.slots).into()),
            ("point_places", (&before.points.places).into()),
            ("marks", (&kept.marks).into()),
            ("new_slots", (&new.marks).into()),
        ];
        let mut stage = gpu.stage("points_keep");
        kept.unmark(&mut stage);
        stage.dispatch(&self.keep, count.into(), &bindings, &self.params(count))?;
        kept.compact(stage, None)?;
        Ok(kept)
    }

    /// The listed slots, sorted.
    fn by_key(&self, gpu: &Gpu, batch: &Batch, list: &WorkList) -> Result<Order> {
        let order = Order::new(gpu, list.count, Known::None)?;
        let bindings = [
            ("places", (&batch.places).into()),
            ("work", (&list.items).into()),
            ("keys", (&order.keys).into()),
            ("slots", (&order.slots).into()),
        ];
        let mut stage = gpu.stage("points_key");
        stage.dispatch(&self.key, list.count.into(), &bindings, &self.params(list.count))?;
        stage.finish()?;
        let sorter = Sorter::new(gpu, list.count)?;
        sorter.sort(gpu, &order.keys, &order.slots, list.count, self.key_bits)?;
        Ok(order)
    }

    /// Points that are kept and new ones.
    fn merged(
        &self,
        gpu: &Gpu,
        (before, kept): (&SortedBatch, &WorkList),
        new: &Order,
    ) -> Result<Order> {
        let all = Order::new(gpu, kept.count + new.count, Known::BySource)?;
        let bindings = [
            ("kept", (&kept.items).into()),
            ("seen_keys", (&before.points.keys).into()),
            ("seen_slots", (&before.slots).into()),
            ("new_keys", (&new.keys).into()),
            ("new_slots", (&new.slots).into()),
            ("keys", (&all.keys).into()),
            ("slots", (&all.slots).into()),
            ("sources", (&all.sources).into()),
        ];
        let params = PointsParams { first: kept.count, ..self.params(all.count) };
        let mut stage = gpu.stage("points_merge");
        stage.dispatch(&self.merge, all.count.into(), &bindings, &params)?;
        stage.finish()?;
        Ok(all)
    }

    fn params(&self, count: u32) -> PointsParams {
        PointsParams { count, ..self.params }
    }

    /// Records where each bucket begins.
    fn find(
        &self,
        stage: &mut Stage,
        bindings: &[(&'static str, Resource)],
        live: &PointsParams,
    ) -> Result<()> {
        for step in [BUCKET_STEP, 1] {
            let params = PointsParams { step, ..*live };
            stage.dispatch(&self.starts, u64::from(live.buckets / step) + 1, bindings, &params)?;
        }
        Ok(())
    }

    /// Finds which points came and which went since all segments were computed, and marks
    /// where light changed.
    ///
    /// # Errors
    /// The device failed, or ended the loops that mark what is around a point.
    pub fn compare(&mut self, gpu: &Gpu, dirty: &Dirty, counters: &CounterBuffer) -> Result<()> {
        let key = |b: &&Arc<SortedBatch>| (b.key, b.photons);
        let mut gone: Vec<_> = self.seen.iter().collect();
        let mut marked = Vec::new();
        for now in &self.batches {
            let at = gone.iter().position(|seen| key(seen) == key(&now));
            match at.map(|at| gone.swap_remove(at)) {
                Some(seen) if Arc::ptr_eq(seen, now) => {}
                Some(seen) => marked.extend(self.marked(gpu, seen, now)?),
                None => marked.push(Marked::all(gpu, now, 1.0)?),
            }
        }
        for seen in gone {
            marked.push(Marked::all(gpu, seen, -1.0)?);
        }
        self.changes = self.found(gpu, (dirty, counters), &mut marked)?;
        counters.read(gpu)?.all_finished("points", "lower `radius`")
    }

    /// What went of a batch, and what came.
    fn marked<'a>(
        &self,
        gpu: &Gpu,
        seen: &'a SortedBatch,
        now: &'a SortedBatch,
    ) -> Result<[Marked<'a>; 2]> {
        let (went, came) = (Marked::all(gpu, seen, -1.0)?, Marked::all(gpu, now, 1.0)?);
        let numbers = gpu.buffer::<u32>("points numbers", now.all_slots as usize)?;
        let mut bindings = now.points.bindings();
        bindings.extend([
            ("slots", (&now.slots).into()),
            ("numbers", (&numbers).into()),
            ("seen_slots", (&seen.slots).into()),
            ("seen_places", (&seen.points.places).into()),
            ("seen_lights", (&seen.points.lights).into()),
            ("went", (&went.list.marks).into()),
            ("came", (&came.list.marks).into()),
        ]);
        let [seen, now] = [seen, now].map(|batch| batch.points.count);
        let mut stage = gpu.stage("points_match");
        stage.dispatch(&self.number, now.into(), &bindings, &self.params(now))?;
        stage.dispatch(&self.compare, seen.into(), &bindings, &self.params(seen))?;
        stage.finish()?;
        Ok([went, came])
    }

    /// Lists the marked points and marks the light around them. Takes them, unless to gather
    /// all points anew is cheaper: those that changed lie close together as a rule, so they
    /// are denser around what they touch than their share tells.
    fn found(
        &self,
        gpu: &Gpu,
        (dirty, counters): (&Dirty, &CounterBuffer),
        marked: &mut [Marked],
    ) -> Result<Changes> {
        let mut total = 0;
        for m in &mut *marked {
            m.list.compact(gpu.stage("list"), None)?;
            let count = m.list.count;
            let mut bindings = [m.batch.points.bindings(), dirty.bindings()].concat();
            bindings.push(("work", (&m.list.items).into()));
            bindings.push(("counters", counters.buffer().into()));
            let mut stage = gpu.stage("points_dirty");
            stage.dispatch(&self.dirty, count.into(), &bindings, &self.params(count))?;
            stage.finish()?;
            total += u64::from(count);
        }
        let all: u64 = self.batches.iter().map(|b| u64::from(b.points.count)).sum();
        let fits = total * size_of::<[u32; 4]>() as u64 <= gpu.max_binding();
        match total {
            0 => Ok(Changes::None),
            _ if 2 * total >= all || !fits => Ok(Changes::TooMany),
            _ => Ok(Changes::Listed(self.taken(gpu, marked, total as u32)?)),
        }
    }

    /// All marked points, sorted together.
    fn taken(&self, gpu: &Gpu, marked: &[Marked], total: u32) -> Result<Sorted> {
        let Order { keys, slots: order, .. } = Order::new(gpu, total, Known::None)?;
        let sorted = Sorted::new(gpu, keys, total, &self.params)?;
        let places = gpu.buffer::<[u32; 4]>("point places", total as usize)?;
        let lights = gpu.buffer::<[f32; 4]>("point lights", total as usize)?;
        let taken = [
            ("taken_keys", (&sorted.keys).into()),
            ("taken_order", (&order).into()),
            ("taken_places", (&places).into()),
            ("taken_lights", (&lights).into()),
        ];
        let mut first = 0;
        for m in marked {
            let mut bindings = m.batch.points.bindings();
            bindings.extend(taken);
            bindings.push(("work", (&m.list.items).into()));
            let count = m.list.count;
            let params = PointsParams { count, first, sign: m.sign, ..self.params };
            first += count;
            let mut stage = gpu.stage("points_take");
            stage.dispatch(&self.take, count.into(), &bindings, &params)?;
            stage.finish()?;
        }
        Sorter::new(gpu, total)?.sort(gpu, &sorted.keys, &order, total, self.key_bits)?;
        let bindings = [sorted.bindings(), taken.to_vec()].concat();
        let live = self.params(total);
        let mut stage = gpu.stage("points_arrange");
        stage.dispatch(&self.arrange, total.into(), &bindings, &live)?;
        self.find(&mut stage, &bindings, &live)?;
        stage.finish()?;
        Ok(sorted)
    }

    /// All segments were computed from what there is.
    pub fn settle(&mut self) {
        self.seen.clone_from(&self.batches);
        self.changes = Changes::None;
    }

    /// All points.
    pub(crate) fn runs(&self) -> Vec<Run<'_>> {
        match self.batches.is_empty() {
            true => vec![self.none.run()],
            false => self.batches.iter().map(|b| b.points.run()).collect(),
        }
    }

    /// What went and what came since all segments were computed; `None` where all points are
    /// to be gathered anew.
    pub(crate) fn changes(&self) -> Option<Vec<Run<'_>>> {
        match &self.changes {
            Changes::None => Some(Vec::new()),
            Changes::Listed(points) => Some(vec![points.run()]),
            Changes::TooMany => None,
        }
    }

    /// The sorted points of all batches: position and direction, contribution and g.
    ///
    /// # Errors
    /// The device failed.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<([u32; 4], [u32; 4])>> {
        let mut all = Vec::new();
        for batch in &self.batches {
            let points = &batch.points;
            let places = gpu.read::<[u32; 4]>("point places", &points.places)?;
            let lights = gpu.read::<[u32; 4]>("point lights", &points.lights)?;
            all.extend(places.into_iter().zip(lights).take(points.count as usize));
        }
        Ok(all)
    }

    /// Bytes that an update of all points takes beside them, at most: those that segments
    /// have seen; work lists of slots, of points that are kept, that went and that came, at
    /// 4.25 bytes an item; and for each slot which point it is.
    pub fn update_bytes(&self) -> u64 {
        let lists = self.batches.iter().map(|batch| {
            let (slots, points) = (u64::from(batch.all_slots), u64::from(batch.points.count));
            (17 * slots + 3 * 17 * points) / 4 + 4 * slots
        });
        self.bytes() + lists.sum::<u64>()
    }

    /// Bytes of the sorted points and their tables.
    pub fn bytes(&self) -> u64 {
        self.batches.iter().map(|b| b.points.bytes() + b.slots.size() + b.means.size()).sum()
    }
}

fn of_batch<'a>(all: &'a [Arc<SortedBatch>], batch: &Batch) -> Option<&'a Arc<SortedBatch>> {
    let key = (batch.light_id, batch.first_index);
    all.iter().find(|b| b.key == key && b.photons == batch.photons)
}

fn record_kernel(gpu: &Gpu, scene: &DeviceScene, even: bool) -> Result<Arc<Kernel>> {
    let mut flags = scene.flags(&["anisotropic"]);
    flags.extend(even.then_some("even"));
    gpu.kernel("points_record", &flags)
}

/// Whether to sort all points rather than merge those that moved with those that were kept.
/// On two cores (`cornell`, half a million points) marking and sorting all takes 228 ms; with
/// seven in ten moved, sorting those and merging takes 293, and in proportion to their share.
fn cheaper_to_sort(moved: u32, kept: u32) -> bool {
    const BREAK_EVEN: f64 = 0.57;
    f64::from(moved) > BREAK_EVEN * (f64::from(moved) + f64::from(kept))
}
