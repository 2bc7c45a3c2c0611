//! The `points` light field: photons sorted by the cell of a grid whose edge is the
//! gather radius, H(8).
//!
//! Only live slots enter: listed, sorted by cell key with a stable radix sort, then copied
//! out in that order with what a gather needs. A table of buckets, each of 2^shift
//! consecutive keys, says where to begin; it needs no probing, and its size is bounded
//! however small the radius.
//!
//! An update leaves points in their order. Those that went are dropped, those that came join
//! the others in their buckets. Whose light changed is known on the way
//! (`changes`), so that segments take the old light out and add the new, and gather nothing
//! else.

mod changes;
mod refresh;

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::frame::{DeviceScene, words};
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::run::{Bindings, Stage};
use crate::gpu::sort::Sorter;
use crate::gpu::{GROUP, Gpu};
use crate::photon::{Batch, PhotonMap};
use crate::query::{CHANGE_ALBEDO, CHANGE_FALLEN, CHANGE_PHASE, CHANGE_RISEN, Query};
use crate::render::{Progress, Split};
use crate::scene::{Settings, Weighting};
use crate::segment::Run;
use crate::work::WorkList;
use changes::{Changes, Moved};

/// Buckets of one batch's table, at most: 16 MiB.
const MAX_BUCKETS: u64 = 1 << 22;
/// Points of which a work group finds means.
pub const MEAN_BLOCK: u32 = 512;
/// Between two buckets that are known so many less one are looked for next.
pub const BUCKET_STEP: u32 = 16;

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
        /// 1 where segments have seen light of what is taken, or of all there is.
        pub had: u32,
        /// Buckets from one whose begin is looked for to the next; 0: far apart, among all.
        pub step: u32,
        /// 1 where it is of all slots, or of all points; 0 where of those that moved, stay or are
        /// listed.
        pub all: u32,
        /// 1 where a point that is where it was has other light only if its mean changed.
        pub stay: u32,
        /// Bins whose extinction changed since.
        pub changed: [u32; 2],
        /// 1 where what is taken has light.
        pub has: u32,
        /// 1 where nobody has seen these points.
        pub fresh: u32,
    }
}

shared_struct! {
    /// The light of a point, its colour and g: dark where it was not there, or is not any more.
    pub struct Change {
        /// What segments have seen.
        pub seen: [f32; 4],
        /// What it is.
        pub now: [f32; 4],
    }
}

/// Points in the order of their cells' keys, or, of changes, bucket by bucket, with what a gather
/// needs of each.
struct Sorted {
    count: u32,
    keys: wgpu::Buffer,
    places: wgpu::Buffer,
    /// A light each, or, of changes, a [`Change`].
    lights: wgpu::Buffer,
    starts: wgpu::Buffer,
    field: wgpu::Buffer,
}

impl Sorted {
    /// Room for `params.count` points, beside keys and starts.
    fn new(gpu: &Gpu, [keys, starts]: [wgpu::Buffer; 2], params: &PointsParams) -> Result<Self> {
        let lights = gpu.buffer::<[f32; 4]>("point lights", params.count as usize)?;
        Self::of(gpu, [keys, starts, lights], params)
    }

    /// The same, beside lights.
    fn of(
        gpu: &Gpu,
        [keys, starts, lights]: [wgpu::Buffer; 3],
        params: &PointsParams,
    ) -> Result<Self> {
        let count = params.count;
        Ok(Self {
            count,
            keys,
            places: gpu.buffer::<[u32; 4]>("point places", count as usize)?,
            lights,
            starts,
            field: gpu.upload("points field", std::slice::from_ref(params))?,
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

    /// In place of what tells of points that were there.
    fn nobody(&self) -> Bindings<'_> {
        vec![
            ("kept", (&self.starts).into()),
            ("seen_lights", (&self.lights).into()),
            ("changed", (&self.keys).into()),
        ]
    }

    fn run(&self) -> Run<'_> {
        Run { bindings: self.bindings(), points: self.count }
    }

    fn bytes(&self) -> u64 {
        [&self.keys, &self.places, &self.lights, &self.starts].map(wgpu::Buffer::size).iter().sum()
    }
}

/// Sorted points, and what updates need to know of them.
struct Part {
    points: Sorted,
    /// The slot of each point.
    slots: wgpu::Buffer,
    /// The mean extinction around each, 1/mm, where `even` divides by it.
    means: wgpu::Buffer,
    /// The historygram of the values that each mean is of, where updates are to come.
    mean_histories: wgpu::Buffer,
}

impl Part {
    fn bindings<'a>(&'a self, batch: &'a Batch) -> Bindings<'a> {
        let mut bindings = self.points.bindings();
        bindings.extend([
            ("states", (&batch.states).into()),
            ("slots", (&self.slots).into()),
            ("means", (&self.means).into()),
            ("mean_histories", (&self.mean_histories).into()),
        ]);
        bindings
    }

    fn bytes(&self) -> u64 {
        let own = [&self.slots, &self.means, &self.mean_histories];
        self.points.bytes() + own.map(wgpu::Buffer::size).iter().sum::<u64>()
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
    part: Part,
}

impl SortedBatch {
    fn is_of(&self, batch: &Batch) -> bool {
        self.key == (batch.light_id, batch.first_index) && self.photons == batch.photons
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
    batches: Vec<SortedBatch>,
    /// What the last build changed.
    moved: Vec<Moved>,
    /// The points whose light changed since all segments were computed.
    changes: Changes,
    /// Points of a batch that the last build did not find where they had been.
    pub(crate) elsewhere: u64,
    /// Means have histories.
    history: bool,
    /// Segments have not seen what an earlier build changed.
    unsettled: bool,
    /// No points: for a scene without lights, and where a kernel wants some that it will not
    /// look at.
    none: Sorted,
    mark: Arc<Kernel>,
    keep: Arc<Kernel>,
    key: Arc<Kernel>,
    merge: Arc<Kernel>,
    shift: Arc<Kernel>,
    mean: Arc<Kernel>,
    record: Arc<Kernel>,
    starts: Arc<Kernel>,
    dirty: Arc<Kernel>,
    take: Arc<Kernel>,
    tally: Arc<Kernel>,
    place: Arc<Kernel>,
    arrange: Arc<Kernel>,
    origins: Arc<Kernel>,
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
        let keys = gpu.buffer::<u32>("points keys", 0)?;
        Ok(Self {
            even,
            radius: radius as f32,
            none: Sorted::new(gpu, [keys, starts(gpu, none.buckets)?], &none)?,
            params,
            key_bits: u64::BITS - (cells - 1).leading_zeros(),
            batches: Vec::new(),
            moved: Vec::new(),
            changes: Changes::None,
            elsewhere: 0,
            history: settings.history,
            unsettled: false,
            mark: gpu.kernel("points_mark", &[])?,
            keep: gpu.kernel("points_keep", &[])?,
            key: gpu.kernel("points_key", &[])?,
            merge: gpu.kernel("points_merge", &[])?,
            shift: gpu.kernel("points_shift", &[])?,
            mean: gpu.kernel(
                "points_mean",
                &scene.flags(&["nearest", "float_voxels", "history", "listed_bins"]),
            )?,
            record: record_kernel(gpu, scene, even)?,
            starts: gpu.kernel("points_starts", &[])?,
            dirty: gpu.kernel("points_dirty", &[])?,
            take: gpu.kernel("points_take", &[])?,
            tally: gpu.kernel("points_count", &[])?,
            place: gpu.kernel("points_place", &[])?,
            arrange: gpu.kernel("points_arrange", &[])?,
            origins: gpu.kernel("points_origins", if even { &["even"] } else { &[] })?,
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

    /// Has the next build sort all points anew.
    pub fn forget(&mut self) {
        self.batches.clear();
        self.moved.clear();
        self.unsettled = false;
    }

    /// Brings the points up to date: of batches that changed, or of all where the query has
    /// what their light depends on.
    ///
    /// # Errors
    /// The device failed.
    pub fn build(
        &mut self,
        gpu: &Gpu,
        scene: &DeviceScene,
        map: &mut PhotonMap,
        (query, split): (&Query, &Split),
        progress: &mut Progress,
    ) -> Result<()> {
        let total = map.batches.len();
        self.elsewhere = 0;
        let mut before = std::mem::take(&mut self.batches);
        // Segments correct their sums by what one build changed, not by two.
        self.changes = if self.unsettled { Changes::TooMany } else { Changes::None };
        let reaches = |columns| query.changes.iter().any(|change| change & columns != 0);
        let extinction = CHANGE_RISEN | CHANGE_FALLEN;
        let weights = reaches(CHANGE_PHASE | CHANGE_ALBEDO);
        let all = weights || self.even && reaches(extinction);
        self.params.changed = words(query.mask(extinction, &scene.bins));
        self.params.stay = (!weights).into();
        self.moved.clear();
        for i in 0..total {
            let batch = &map.batches[i];
            let own = before.iter().position(|sorted| sorted.is_of(batch));
            let now = match own.map(|at| before.swap_remove(at)) {
                Some(own) if !all && !batch.stale => own,
                Some(own) => self.refreshed(gpu, scene, (map, batch), (own, split))?,
                None => {
                    let now = self.sorted(gpu, scene, (map, batch))?;
                    self.moved.push(Moved::came(&now.part));
                    now
                }
            };
            self.batches.push(now);
            map.batches[i].settle(gpu)?;
            progress.at("sort", i as u64 + 1, total as u64);
        }
        self.moved.extend(before.iter().map(|gone| Moved::gone(&gone.part)));
        self.unsettled |= !self.moved.is_empty();
        Ok(())
    }

    /// All live slots of a batch, sorted.
    fn sorted(
        &self,
        gpu: &Gpu,
        scene: &DeviceScene,
        (map, batch): (&PhotonMap, &Batch),
    ) -> Result<SortedBatch> {
        let all_slots = batch.photons * map.max_events;
        let mut live = self.live(gpu, batch, all_slots, true)?;
        WorkList::learn(gpu, &mut [&mut live])?;
        Ok(SortedBatch {
            key: (batch.light_id, batch.first_index),
            photons: batch.photons,
            all_slots,
            part: self.part(gpu, scene, batch, (&live, self.params.buckets))?,
        })
    }

    /// The slots of a batch that enter the light field, of all or of those that moved; how many
    /// is to be learned yet.
    fn live(&self, gpu: &Gpu, batch: &Batch, all_slots: u32, all: bool) -> Result<WorkList> {
        let live = WorkList::new(gpu, all_slots)?;
        let bindings = [
            ("states", (&batch.states).into()),
            ("moved", (&batch.moved).into()),
            ("marks", (&live.marks).into()),
        ];
        let params = PointsParams { all: all.into(), ..self.params(all_slots) };
        let mut stage = gpu.stage("points_mark");
        stage.dispatch(&self.mark, all_slots.div_ceil(32).into(), &bindings, &params)?;
        live.record(stage)?;
        Ok(live)
    }

    /// The listed slots, sorted in so many buckets; as listed in none, if nobody gathers them.
    fn part(
        &self,
        gpu: &Gpu,
        scene: &DeviceScene,
        batch: &Batch,
        (list, buckets): (&WorkList, u32),
    ) -> Result<Part> {
        let count = list.count;
        let words = |stage: &'static str| gpu.buffer::<u32>(stage, count as usize);
        let (keys, slots) = (words("points keys")?, words("points slots")?);
        let bindings = [
            ("places", (&batch.places).into()),
            ("work", (&list.items).into()),
            ("keys", (&keys).into()),
            ("slots", (&slots).into()),
        ];
        let params = PointsParams { buckets, ..self.params(count) };
        let mut stage = gpu.stage("points_key");
        stage.dispatch(&self.key, count.into(), &bindings, &params)?;
        stage.finish()?;
        if buckets > 0 {
            Sorter::new(gpu, count)?.sort(gpu, &keys, &slots, count, self.key_bits)?;
        }
        let points = Sorted::new(gpu, [keys, starts(gpu, buckets)?], &params)?;
        let mut stage = gpu.stage("points_place");
        let places = [
            ("slots", (&slots).into()),
            ("places", (&batch.places).into()),
            ("point_places", (&points.places).into()),
        ];
        stage.dispatch(&self.place, count.into(), &places, &params)?;
        if buckets > 0 {
            self.find(&mut stage, &points)?;
        }
        stage.finish()?;
        let [means, mean_histories] = self.means(gpu, count)?;
        let part = Part { points, slots, means, mean_histories };
        let none = &self.none;
        let bindings = [scene.bindings(), part.bindings(batch), none.nobody()].concat();
        let params = PointsParams { fresh: 1, ..params };
        let mut stage = gpu.stage("points_record");
        if self.even {
            stage.dispatch(&self.mean, mean_threads(count), &bindings, &params)?;
        }
        stage.dispatch(&self.record, count.into(), &bindings, &params)?;
        stage.finish()?;
        Ok(part)
    }

    /// Room for the means of points, and for their histories.
    fn means(&self, gpu: &Gpu, count: u32) -> Result<[wgpu::Buffer; 2]> {
        let room = |is_wanted| if is_wanted { count as usize } else { 0 };
        Ok([
            gpu.buffer::<f32>("point means", room(self.even))?,
            gpu.buffer::<[u32; 2]>("mean histories", room(self.even && self.history))?,
        ])
    }

    fn params(&self, count: u32) -> PointsParams {
        PointsParams { count, ..self.params }
    }

    /// Records where each bucket begins.
    fn find(&self, stage: &mut Stage, points: &Sorted) -> Result<()> {
        for step in [0, BUCKET_STEP, 1] {
            let params = PointsParams { step, ..self.params(points.count) };
            let known = if step == 0 { BUCKET_STEP } else { step } * BUCKET_STEP;
            let threads = u64::from(params.buckets / known) + 1;
            stage.dispatch(&self.starts, threads, &points.bindings(), &params)?;
        }
        Ok(())
    }

    /// All segments were computed from what there is.
    pub fn settle(&mut self) {
        self.changes = Changes::None;
        self.unsettled = false;
        self.moved.clear();
    }

    /// Points that a gather tests at a sample, if they are spread evenly.
    pub(crate) fn tests_per_sample(&self) -> f64 {
        let all = self.count() as f64;
        let cells: f64 = self.params.grid.iter().map(|&n| f64::from(n)).product();
        all * (27.0 / cells).min(1.0)
    }

    /// All points.
    pub(crate) fn runs(&self) -> Vec<Run<'_>> {
        match self.batches.is_empty() {
            true => vec![self.none.run()],
            false => self.batches.iter().map(|batch| batch.part.points.run()).collect(),
        }
    }

    /// The points whose light changed since all segments were computed, with old and new light;
    /// `None` where all points are to be gathered anew.
    pub(crate) fn changes(&self) -> Option<Vec<Run<'_>>> {
        match &self.changes {
            Changes::None => Some(Vec::new()),
            Changes::Listed(points) => Some(vec![points.run()]),
            Changes::TooMany => None,
        }
    }

    /// How many points there are.
    pub fn count(&self) -> u64 {
        self.batches.iter().map(|b| u64::from(b.part.points.count)).sum()
    }

    /// The sorted points of all batches: position and direction, contribution and g.
    ///
    /// # Errors
    /// The device failed.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<([u32; 4], [u32; 4])>> {
        let mut all = Vec::new();
        for batch in &self.batches {
            let points = &batch.part.points;
            let places = gpu.read::<[u32; 4]>("point places", &points.places)?;
            let lights = gpu.read::<[u32; 4]>("point lights", &points.lights)?;
            all.extend(places.into_iter().zip(lights).take(points.count as usize));
        }
        Ok(all)
    }

    /// Bytes that an update takes beside the points, at most: work lists of slots, of points
    /// that are kept and whose light changed, at 4.25 bytes an item; the light that points had
    /// before; 80 % of them sorted by themselves, with room for that, all of them merged, their
    /// order and the places of those; and those whose light changed, at most 70 % as many as there
    /// are points, at 48 bytes each.
    pub fn update_bytes(&self) -> u64 {
        let slots: u64 = self.batches.iter().map(|batch| u64::from(batch.all_slots)).sum();
        let points = self.count();
        (17 * slots + 2 * 17 * points) / 4 + (16 + 7 + 8 + 34) * points + self.bytes() * 9 / 5
    }

    /// Bytes of the sorted points and their tables.
    pub fn bytes(&self) -> u64 {
        self.batches.iter().map(|batch| batch.part.bytes()).sum()
    }
}

/// Room for where so many buckets begin, and the last ends.
fn starts(gpu: &Gpu, buckets: u32) -> Result<wgpu::Buffer> {
    gpu.buffer::<u32>("points starts", buckets as usize + 1)
}

/// A group finds those means of so many points that there are to be found.
fn mean_threads(count: u32) -> u64 {
    u64::from(count.div_ceil(MEAN_BLOCK) * GROUP)
}

fn record_kernel(gpu: &Gpu, scene: &DeviceScene, even: bool) -> Result<Arc<Kernel>> {
    let mut flags = scene.flags(&["anisotropic"]);
    flags.extend(even.then_some("even"));
    gpu.kernel("points_record", &flags)
}
