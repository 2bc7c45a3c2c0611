//! The `points` light field: photons side by side with those of the same cell of a grid
//! whose edge is the gather radius, H(8).
//!
//! Only live slots enter, with what a gather needs of each, side by side with those of their cell
//! ([`buckets`]). One table has the points of all lights, as far as a binding holds them: a
//! ray is marched once for each.
//!
//! An update leaves points in their order. Those that went are dropped, those that came join the
//! others in their buckets. Whose light changed is known on the way (`changes`), so that segments
//! take the old light out and add the new, and gather nothing else.

pub mod buckets;
mod changes;
mod refresh;
mod table;

use std::sync::Arc;

use self::buckets::{Buckets, Fields, most_points};
use self::changes::{Changes, Moved};
use self::refresh::Survey;
use self::table::{Block, Table};
use super::dirty::Dirty;
use super::{LightField, Request, Run, SegmentLight};
use crate::bits::{CONTRIBUTION, words};
use crate::device_scene::{Context, DeviceScene};
use crate::error::{Error, Result};
use crate::gpu::counter::Counters;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::pace::Pace;
use crate::gpu::read::Words;
use crate::gpu::run::Stage;
use crate::gpu::{Gpu, Progress};
use crate::history::{CHANGE_EMISSION, CHANGE_FALLEN, CHANGE_RISEN, CHANGE_SCATTERING};
use crate::photon::{Follows, PhotonMap};
use crate::scene::{Estimator, Settings, Weighting};
use crate::split::Split;

/// Points of which a work group finds means.
pub const MEAN_BLOCK: u32 = 512;

shared_struct! {
    /// The geometry of the grid, as every kernel that touches it is told.
    pub struct PointsParams {
        /// Cells along each axis.
        pub grid: [u32; 3],
        /// Slots to look at, or points.
        pub count: u32,
        /// Gather radius and edge of a cell, mm.
        pub radius: f32,
        /// Slots for runs of cells, a power of two; 0 where each cell has a bucket.
        pub runs: u32,
        /// Buckets.
        pub buckets: u32,
        /// 1 / (4/3 pi r³).
        pub per_ball: f32,
        /// -1 where light that segments have seen is taken out, 1 where light is added.
        pub sign: f32,
        /// Lights that a point counts for.
        pub lights_each: u32,
        /// 1 where it is of all slots, or of all points; 0 where of those that moved, stay or are
        /// listed.
        pub all: u32,
        /// 1 where nobody has seen these points.
        pub fresh: u32,
        /// Bins whose extinction changed since.
        pub changed: [u32; 2],
        /// The first of the points that are a batch's, where nobody has seen them; or of those
        /// listed that are looked at.
        pub first: u32,
        /// The first of the table's slots that are a batch's.
        pub first_slot: u32,
        /// How many those are.
        pub slots: u32,
        /// Of the hash.
        pub salt: u32,
        /// Runs that share a bit, as a power of two.
        pub mask_shift: u32,
        /// Keeps the size a multiple of 16.
        pub pad0: u32,
    }
}

shared_struct! {
    /// What an update needs to know of a point.
    pub struct Origin {
        /// Its slot among those of all members of its table.
        pub slot: u32,
        /// The mean extinction around it, 1/mm, where `even` divides by it.
        pub mean: f32,
    }
}

/// Points that may have other light where they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reach {
    /// Any: the query has what light depends on.
    All,
    /// Those of batches whose slots changed.
    StaleBatches,
}

/// The points of a table, bucket by bucket.
pub struct Contents {
    /// Position, mm (three `f32`), and packed direction of each.
    pub places: Vec<[u32; 4]>,
    /// Contribution, 1/(mm³ sr), and g of each.
    pub lights: Vec<[f32; 4]>,
    /// The historygram of the values that the mean around each is of; none where none is kept.
    pub mean_histories: Vec<u64>,
    /// Where each bucket begins, and the last ends.
    pub starts: Vec<u32>,
    /// The cell of each bucket, x fastest; `None` where it has none.
    pub cells: Vec<Option<u32>>,
}

/// The points of all photons.
pub struct Points {
    /// Gather radius, mm.
    pub radius: f32,
    /// Units of the segments' sums.
    scale: f32,
    params: PointsParams,
    /// Whether buckets are those of a hash table.
    is_hashed: bool,
    fields: Fields,
    /// Whether fluence is blurred, not collision density.
    pub even: bool,
    tables: Vec<Table>,
    /// What the last build changed.
    moved: Vec<Moved>,
    /// The points whose light changed since all segments were computed.
    changes: Changes,
    /// Points of tables with others that the last build did not find where they had been.
    pub(crate) elsewhere: u64,
    /// Means, lights and places that points were given since an edit or a rebuild began, beside
    /// those of which the device knows how many ([`Counters::refreshed`](crate::gpu::counter::Counters)).
    pub(crate) built: u64,
    /// Means have histories.
    history: bool,
    /// Segments have not seen what an earlier build changed.
    unsettled: bool,
    /// Tables of which it is found out what becomes of their points.
    surveys: Vec<Survey>,
    /// No points, where a kernel wants some that it will not look at.
    none: Block,
    mark: Arc<Kernel>,
    keep: Arc<Kernel>,
    key: Arc<Kernel>,
    merge: Arc<Kernel>,
    shift: Arc<Kernel>,
    mean: Arc<Kernel>,
    query: Arc<Kernel>,
    record: Arc<Kernel>,
    dirty: Arc<Kernel>,
    dirty_pace: Pace,
    take: Arc<Kernel>,
    count: Arc<Kernel>,
    tally: Arc<Kernel>,
    rows: Arc<Kernel>,
    arrange: Arc<Kernel>,
    origins: Arc<Kernel>,
}

/// The gather radius, mm, and how many cells the grid has along each axis.
fn grid_of(scene: &DeviceScene, settings: &Settings) -> (f64, [f64; 3]) {
    let spacing = scene.params.per_voxel.map(|n| 1.0 / f64::from(n));
    let smallest = spacing.iter().copied().fold(f64::INFINITY, f64::min);
    let radius = settings.radius.unwrap_or(smallest);
    (radius, scene.params.extent.map(|e| (f64::from(e) / radius).ceil().max(1.0)))
}

/// Whether the points of a scene would lie in a hash table.
pub fn are_hashed(scene: &DeviceScene, settings: &Settings) -> bool {
    let (_, grid) = grid_of(scene, settings);
    buckets::are_hashed(grid.iter().product::<f64>() as u64, &Split::default())
}

impl Points {
    /// An empty field for a scene.
    ///
    /// # Errors
    /// The radius is too small for the volume.
    pub fn new(gpu: &Gpu, scene: &DeviceScene, settings: &Settings, split: &Split) -> Result<Self> {
        let (radius, grid) = grid_of(scene, settings);
        let cells = grid.iter().product::<f64>();
        if cells > f64::from(u32::MAX) {
            return Err(Error::capacity(
                "points",
                format!(
                    "a radius of {radius} mm makes {cells:.0} cells, more than 2^32: raise `radius`"
                ),
            ));
        }
        let is_hashed = buckets::are_hashed(cells as u64, split);
        let hashed: &[&str] = if is_hashed { &["hashed"] } else { &[] };
        let even = settings.weighting == Weighting::Even;
        let params = PointsParams {
            grid: grid.map(|n| n as u32),
            count: 0,
            radius: radius as f32,
            salt: split.salt.unwrap_or(0),
            per_ball: (0.75 / (std::f64::consts::PI * radius.powi(3))) as f32,
            ..Default::default()
        };
        // What segments sum is scaled so that a typical photon has its bits.
        let photon = settings.flux_unit.unwrap_or(1.0) / settings.photons as f64;
        let ball = 4.0 / 3.0 * std::f64::consts::PI * f64::from(radius as f32).powi(3);
        let spacing = 1.0 / scene.params.per_voxel.iter().copied().fold(0.0, f32::max);
        let typical = photon / ball / (4.0 * std::f64::consts::PI) * f64::from(spacing);
        Ok(Self {
            even,
            radius: radius as f32,
            scale: (CONTRIBUTION / typical) as f32,
            none: Block::new(gpu, 0, false)?,
            is_hashed,
            fields: Fields::default(),
            params,
            tables: Vec::new(),
            moved: Vec::new(),
            changes: Changes::None,
            elsewhere: 0,
            built: 0,
            history: settings.history,
            unsettled: false,
            surveys: Vec::new(),
            mark: gpu.kernel("points_mark", &[])?,
            keep: gpu.kernel("points_keep", &[])?,
            key: gpu.kernel("points_key", hashed)?,
            merge: gpu.kernel("points_merge", &[])?,
            shift: gpu.kernel("points_shift", hashed)?,
            mean: gpu.kernel("points_mean", &scene.flags())?,
            query: gpu.kernel("points_query", &[])?,
            record: record_kernel(gpu, scene, even)?,
            dirty: gpu.kernel("points_dirty", &[])?,
            dirty_pace: Pace::new(gpu, 1 << 14),
            take: gpu.kernel("points_take", hashed)?,
            rows: gpu.kernel("points_rows", &[])?,
            count: gpu.kernel("sort_count", &[])?,
            tally: gpu.kernel("points_count", hashed)?,
            arrange: gpu.kernel("points_arrange", &[])?,
            origins: gpu.kernel("points_origins", if even { &["even"] } else { &[] })?,
        })
    }

    /// Finds out what becomes of the points: of batches that may have changed, or of all where the
    /// query has what their light depends on.
    fn survey_all(&mut self, cx: Context, map: &PhotonMap, request: &Request) -> Result<()> {
        let (gpu, query) = (cx.gpu, request.query);
        self.elsewhere = 0;
        // Segments correct their sums by what one build changed, not by two.
        self.changes = if self.unsettled { Changes::TooMany } else { Changes::None };
        let has = |columns| query.changes.iter().any(|change| change & columns != 0);
        let extinction = CHANGE_RISEN | CHANGE_FALLEN;
        let all = has(CHANGE_SCATTERING) || self.even && has(extinction);
        let reach = if all { Reach::All } else { Reach::StaleBatches };
        self.params.changed = words(query.mask(extinction, &cx.scene.bins));
        self.moved.clear();
        let mut fit = (gpu.max_binding() / 16).min(u32::MAX.into()) as u32;
        if self.is_hashed {
            fit = fit.min(most_points(gpu.max_binding()));
        }
        let most = request.split.table_slots.unwrap_or(fit);
        for table in self.with_all(gpu, map, most)? {
            let survey = self.surveyed(cx, map, table, reach)?;
            self.surveys.push(survey);
        }
        Ok(())
    }

    /// All tables, with those batches among their members that are new: in the first table that
    /// has room, or in one of their own.
    fn with_all(&mut self, gpu: &Gpu, map: &PhotonMap, most: u32) -> Result<Vec<Table>> {
        let mut tables = std::mem::take(&mut self.tables);
        tables.retain(|table| table.part.count > 0 || table.has_any(map));
        for batch in &map.batches {
            if tables.iter().any(|table| table.has(batch)) {
                continue;
            }
            let slots = batch.photons * map.max_events;
            if !tables.iter_mut().any(|table| table.admit(batch, slots, most)) {
                let mut table = self.empty(gpu)?;
                table.admit(batch, slots, slots);
                tables.push(table);
            }
        }
        if tables.is_empty() {
            tables.push(self.empty(gpu)?);
        }
        Ok(tables)
    }

    fn empty(&self, gpu: &Gpu) -> Result<Table> {
        let part = Block::new(gpu, 0, self.has_histories())?;
        Ok(Table { members: Vec::new(), part, buckets: self.buckets(gpu, 0)? })
    }

    /// Whether points have means, and those histories.
    fn has_histories(&self) -> bool {
        self.even && self.history
    }

    /// Empty buckets for so many points.
    fn buckets(&self, gpu: &Gpu, count: u32) -> Result<Buckets> {
        Buckets::new(gpu, self.params, count, self.is_hashed, &self.fields)
    }

    /// Tells which rows around each cell have points, where each is a bucket.
    fn tell_rows(&self, stage: &mut Stage, buckets: &Buckets) -> Result<()> {
        if self.is_hashed {
            return Ok(());
        }
        let cells = buckets.params.buckets.into();
        let bindings = [("starts", (&buckets.starts).into())];
        stage.dispatch(&self.rows, cells, &bindings, &buckets.params)
    }

    fn params(&self, count: u32) -> PointsParams {
        PointsParams { count, ..self.params }
    }

    /// How many points there are.
    pub fn count(&self) -> u64 {
        self.tables.iter().map(|table| u64::from(table.part.count)).sum()
    }

    /// How many tables there are.
    pub fn tables(&self) -> usize {
        self.tables.len()
    }

    /// What each table holds.
    ///
    /// # Errors
    /// The device failed.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<Contents>> {
        let contents = self.tables.iter().map(|Table { part, buckets, .. }| {
            let mut places = gpu.read::<[u32; 4]>("point places", &part.places)?;
            let mut lights = gpu.read::<[f32; 4]>("point lights", &part.lights)?;
            places.truncate(part.count as usize);
            lights.truncate(part.count as usize);
            let mut starts = gpu.read("points starts", &buckets.starts)?;
            let cells = buckets.cells(&starts);
            starts.truncate(buckets.params.buckets as usize + 1);
            let mut mean_histories = gpu.read("mean histories", &part.mean_histories)?;
            mean_histories.truncate(if self.has_histories() { places.len() } else { 0 });
            Ok(Contents { places, lights, mean_histories, starts, cells })
        });
        contents.collect()
    }

    /// All points, place and light, in the order of their bits: that in which those of a bucket
    /// come is left open.
    ///
    /// # Errors
    /// The device failed.
    pub fn sorted(&self, gpu: &Gpu) -> Result<Vec<[u32; 8]>> {
        let tables = self.read(gpu)?.into_iter();
        let each = tables.flat_map(|table| table.places.into_iter().zip(table.lights));
        let mut all: Vec<[u32; 8]> =
            each.map(|(place, light)| bytemuck::cast([place, light.map(f32::to_bits)])).collect();
        all.sort_unstable();
        Ok(all)
    }
}

impl LightField for Points {
    fn name(&self) -> &'static str {
        if self.even { "points even" } else { "points plain" }
    }

    fn estimator(&self) -> Estimator {
        Estimator::Points
    }

    fn follows(&self) -> Follows {
        Follows::Slots
    }

    fn reach(&self) -> f32 {
        self.radius
    }

    fn respecialise(&mut self, gpu: &Gpu, scene: &DeviceScene) -> Result<()> {
        self.record = record_kernel(gpu, scene, self.even)?;
        Ok(())
    }

    fn count_anew(&mut self) {
        self.built = 0;
    }

    fn begin(&mut self, _cx: Context, _map: &PhotonMap, request: &Request) -> Result<()> {
        if request.is_rebuild {
            self.tables.clear();
            self.moved.clear();
            self.surveys.clear();
            self.unsettled = false;
        }
        Ok(())
    }

    fn survey(&mut self, cx: Context, map: &PhotonMap, request: &Request) -> Result<Vec<Words>> {
        self.survey_all(cx, map, request)?;
        Ok(self.surveys.iter_mut().flat_map(Survey::lengths).collect())
    }

    fn build(
        &mut self,
        cx: Context,
        map: &mut PhotonMap,
        request: &Request,
        dirty: &Dirty,
        mut learned: &[u32],
        progress: &mut Progress,
    ) -> Result<u64> {
        for mut survey in std::mem::take(&mut self.surveys) {
            learned = survey.learn(learned);
            let table = self.refreshed(cx, map, survey, request.split)?;
            self.tables.push(table);
        }
        map.batches.iter_mut().try_for_each(|batch| batch.unmark(cx.gpu))?;
        self.unsettled |= !self.moved.is_empty();
        if request.is_rebuild || !request.asks_for_light {
            // Nobody asks what changed.
            self.moved.clear();
            return Ok(if request.is_rebuild { self.count() } else { 0 });
        }
        self.compare(cx, dirty, progress)
    }

    fn remedy(&self) -> &'static str {
        "lower `radius`"
    }

    fn all_seen(&mut self) {
        self.changes = Changes::None;
        self.unsettled = false;
        self.moved.clear();
    }

    fn columns_read(&self) -> u32 {
        CHANGE_RISEN | CHANGE_FALLEN | CHANGE_EMISSION
    }

    fn segment_light(&self) -> SegmentLight {
        SegmentLight::Sums { scale: self.scale }
    }

    fn segment_flags(&self) -> Vec<&'static str> {
        let flags = [("even", self.even), ("hashed", self.is_hashed)];
        flags.iter().filter(|(_, on)| *on).map(|(flag, _)| *flag).collect()
    }

    fn runs(&self) -> Vec<Run> {
        self.tables.iter().map(|table| table.run()).collect()
    }

    /// The points whose light changed, with old and new light.
    fn changes(&self) -> Option<Vec<Run>> {
        match &self.changes {
            Changes::None => Some(Vec::new()),
            Changes::Listed(listed) => Some(vec![listed.run()]),
            Changes::TooMany => None,
        }
    }

    fn tests_per_sample(&self) -> f64 {
        let all = self.count() as f64;
        let cells: f64 = self.params.grid.iter().map(|&n| f64::from(n)).product();
        all * (27.0 / cells).min(1.0)
    }

    fn points_built(&self, counts: &Counters) -> u64 {
        self.built + counts.refreshed
    }

    fn radius(&self) -> Option<f32> {
        Some(self.radius)
    }

    fn bytes(&self) -> u64 {
        self.tables.iter().map(Table::bytes).sum()
    }

    /// Lists of slots, of points that are kept and of those whose light changed, at 4.25 bytes an
    /// item; two bits for each slot; the light that points had before; all of them anew, once as they
    /// come and once in their buckets, with the places of both; or lights that changed, fewer than
    /// there are points, at 32 bytes each.
    fn update_bytes(&self) -> u64 {
        let slots: u64 = self.tables.iter().map(|table| u64::from(table.slots())).sum();
        let points = self.count();
        (17 * slots + 2 * 17 * points) / 4 + slots / 4 + (16 + 8) * points + 2 * self.bytes()
    }

    /// Those of means.
    fn history_bytes(&self) -> u64 {
        let all = self.tables.iter().map(|table| table.part.mean_histories.size());
        if self.has_histories() { all.sum() } else { 0 }
    }

    fn differing(&self, gpu: &Gpu, other: &dyn LightField) -> Result<u64> {
        let Some(other) = other.points() else { return Ok(u64::MAX) };
        let (own, others) = (self.sorted(gpu)?, other.sorted(gpu)?);
        Ok((own.len().max(others.len()) - in_both(&own, &others)) as u64)
    }

    fn points(&self) -> Option<&Points> {
        Some(self)
    }
}

/// How many items of two sorted lists are in both.
fn in_both<T: Ord>(one: &[T], other: &[T]) -> usize {
    let (mut a, mut b, mut both) = (0, 0, 0);
    while a < one.len() && b < other.len() {
        let order = one[a].cmp(&other[b]);
        both += usize::from(order.is_eq());
        a += usize::from(order.is_le());
        b += usize::from(order.is_ge());
    }
    both
}

fn record_kernel(gpu: &Gpu, scene: &DeviceScene, even: bool) -> Result<Arc<Kernel>> {
    let mut flags = scene.flags();
    flags.extend(even.then_some("even"));
    gpu.kernel("points_record", &flags)
}
