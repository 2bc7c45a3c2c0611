//! The `points` light field: photons sorted by the cell of a grid whose edge is the
//! gather radius, H(8).
//!
//! Only live slots enter: marked, ranked by a prefix sum, sorted by cell key with a
//! stable radix sort, then copied out in that order with what a gather needs. A table
//! of buckets, each of 2^shift consecutive keys, says where to begin; it needs no
//! probing, and its size is bounded however small the radius.

use std::sync::Arc;

use crate::dirty::Dirty;
use crate::error::{Error, Result};
use crate::frame::DeviceScene;
use crate::gpu::Gpu;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::run::Bindings;
use crate::gpu::scan::Scanner;
use crate::gpu::sort::Sorter;
use crate::photon::{Batch, PhotonMap};
use crate::query::{CHANGE_ALBEDO, CHANGE_FALLEN, CHANGE_PHASE, CHANGE_RISEN};
use crate::render::Progress;
use crate::scene::{Settings, Weighting};

/// Buckets of one batch's table, at most: 16 MiB.
const MAX_BUCKETS: u64 = 1 << 22;

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
    }
}

/// The sorted points of one photon batch.
struct SortedBatch {
    /// Light and first photon of the batch.
    key: (u32, u32),
    /// Its photons.
    slots: u32,
    count: u32,
    places: wgpu::Buffer,
    lights: wgpu::Buffer,
    starts: wgpu::Buffer,
    field: wgpu::Buffer,
}

impl SortedBatch {
    fn bindings(&self) -> Bindings<'_> {
        vec![
            ("field", (&self.field).into()),
            ("point_places", (&self.places).into()),
            ("point_lights", (&self.lights).into()),
            ("starts", (&self.starts).into()),
        ]
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
    mark: Arc<Kernel>,
    compact: Arc<Kernel>,
    record: Arc<Kernel>,
    find: Arc<Kernel>,
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
        Ok(Self {
            even,
            radius: radius as f32,
            params: PointsParams {
                grid: grid.map(|n| n as u32),
                count: 0,
                radius: radius as f32,
                shift,
                buckets: cells.div_ceil(1 << shift) as u32,
                kernel: (0.75 / (std::f64::consts::PI * radius.powi(3))) as f32,
            },
            key_bits: u64::BITS - (cells - 1).leading_zeros(),
            batches: Vec::new(),
            mark: gpu.kernel("points_mark", &[])?,
            compact: gpu.kernel("points_compact", &[])?,
            record: record_kernel(gpu, scene, even)?,
            find: gpu.kernel("points_starts", &[])?,
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

    /// Sorts the live slots of the batches that changed, or of `all`, and marks where
    /// contributions changed without their slots.
    ///
    /// # Errors
    /// The device failed.
    pub fn build(
        &mut self,
        gpu: &Gpu,
        scene: &DeviceScene,
        (map, all): (&mut PhotonMap, bool),
        dirty: &Dirty,
        progress: &mut Progress,
    ) -> Result<()> {
        let total = map.batches.len();
        let mut before = std::mem::take(&mut self.batches);
        for i in 0..total {
            let batch = &map.batches[i];
            let key = (batch.light_id, batch.first_index);
            let own = before.iter().position(|b| b.key == key).map(|at| before.swap_remove(at));
            let kept = own.filter(|own| !all && !batch.stale && own.slots == batch.photons);
            let sorted = match kept {
                Some(own) => own,
                None => self.sorted(gpu, scene, map, batch, dirty)?,
            };
            self.batches.push(sorted);
            map.batches[i].stale = false;
            progress.at("sort", i as u64 + 1, total as u64);
        }
        Ok(())
    }

    fn sorted(
        &self,
        gpu: &Gpu,
        scene: &DeviceScene,
        map: &PhotonMap,
        batch: &Batch,
        dirty: &Dirty,
    ) -> Result<SortedBatch> {
        let slots = batch.photons * map.max_events;
        let ranks = gpu.buffer::<u32>("points ranks", slots as usize + 1)?;
        let scanner = Scanner::new(gpu, slots + 1)?;
        let all = PointsParams { count: slots, ..self.params };
        let slot_bindings =
            [("places", (&batch.places).into()), ("states", (&batch.states).into())];
        let mut bindings = [scene.bindings(), dirty.bindings(), slot_bindings.to_vec()].concat();
        bindings.extend([("marks", (&ranks).into()), ("ranks", (&ranks).into())]);

        let mut stage = gpu.stage("points_mark");
        stage.dispatch(&self.mark, u64::from(slots) + 1, &bindings, &all)?;
        scanner.record(&mut stage, &ranks, slots + 1)?;
        stage.finish()?;
        let count = gpu.read_word("points_mark", &ranks, slots.into())?;

        let keys = gpu.buffer::<u32>("points keys", count as usize)?;
        let order = gpu.buffer::<u32>("points order", count as usize)?;
        let mut stage = gpu.stage("points_compact");
        bindings.extend([("keys", (&keys).into()), ("slots", (&order).into())]);
        stage.dispatch(&self.compact, slots.into(), &bindings, &all)?;
        stage.finish()?;
        Sorter::new(gpu, count)?.sort(gpu, &keys, &order, count, self.key_bits)?;

        let live = PointsParams { count, ..self.params };
        let sorted = SortedBatch {
            key: (batch.light_id, batch.first_index),
            slots: batch.photons,
            count,
            places: gpu.buffer::<[u32; 4]>("point places", count as usize)?,
            lights: gpu.buffer::<[f32; 4]>("point lights", count as usize)?,
            starts: gpu.buffer::<u32>("points starts", live.buckets as usize + 1)?,
            field: gpu.upload("points field", &[live])?,
        };
        bindings.extend(sorted.bindings());
        let mut stage = gpu.stage("points_record");
        stage.dispatch(&self.record, count.into(), &bindings, &live)?;
        stage.dispatch(&self.find, u64::from(live.buckets) + 1, &bindings, &live)?;
        stage.finish()?;
        Ok(sorted)
    }

    /// The sorted field of each batch, by the names that the segment kernel gives it, and
    /// how many points it has.
    pub fn bindings(&self) -> Vec<(Bindings<'_>, u32)> {
        self.batches.iter().map(|b| (b.bindings(), b.count)).collect()
    }

    /// The sorted points of all batches: position and direction, contribution and g.
    ///
    /// # Errors
    /// The device failed.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<([u32; 4], [u32; 4])>> {
        let mut all = Vec::new();
        for batch in &self.batches {
            let places = gpu.read::<[u32; 4]>("point places", &batch.places)?;
            let lights = gpu.read::<[u32; 4]>("point lights", &batch.lights)?;
            all.extend(places.into_iter().zip(lights).take(batch.count as usize));
        }
        Ok(all)
    }

    /// Bytes of the sorted points and their tables.
    pub fn bytes(&self) -> u64 {
        self.batches.iter().map(|b| b.places.size() + b.lights.size() + b.starts.size()).sum()
    }
}

fn record_kernel(gpu: &Gpu, scene: &DeviceScene, even: bool) -> Result<Arc<Kernel>> {
    let mut flags = scene.flags(&["nearest", "float_voxels", "anisotropic"]);
    flags.extend(even.then_some("even"));
    gpu.kernel("points_record", &flags)
}
