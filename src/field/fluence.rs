//! The `fluence` light field: every flight's power times length, summed on a grid.
//!
//! Sums are 64-bit integers, so they have no order, and what was added can be taken out
//! with nothing left over. A resolve pass turns them into mean fluence for each cell, in
//! the one of two textures that does not hold what was there before, and marks the cells
//! that differ.

use std::ops::Range;
use std::sync::Arc;

use crate::bits::CONTRIBUTION;
use crate::device_scene::DeviceScene;
use crate::error::{Error, Result};
use crate::field::dirty::Dirty;
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::gpu::counter::CounterBuffer;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::run::{Bindings, Pace, Stage};
use crate::photon::{PhotonMap, PhotonParams};
use crate::scene::Settings;

shared_struct! {
    /// What the resolve kernel is told.
    pub struct ResolveParams {
        /// Cells along each axis.
        pub grid: [u32; 3],
        /// Fluence for each unit of a sum.
        pub per_sum: f32,
        /// Edge of a cell, mm.
        pub edge: [f32; 3],
        /// 1 where cells that differ are marked.
        pub marks: u32,
    }
}

shared_struct! {
    /// What a fetch needs to know.
    pub struct FluenceParams {
        /// Cells along each axis.
        pub grid: [u32; 3],
        /// Keeps the size a multiple of 16.
        pub pad: u32,
    }
}

/// The fluence grid.
pub struct Fluence {
    /// Cells along each axis.
    pub grid: [u32; 3],
    scale: f32,
    per_sum: f32,
    edge: [f32; 3],
    /// Whether the sums are those of the slots; else all is summed again.
    pub current: bool,
    /// The sums: red, green, blue.
    pub sums: [wgpu::Buffer; 3],
    field: wgpu::Buffer,
    before: wgpu::TextureView,
    view: wgpu::TextureView,
    deposit: Arc<Kernel>,
    resolve: Arc<Kernel>,
    pace: Pace,
    chosen_pace: Pace,
}

fn texture(gpu: &Gpu, grid: [u32; 3]) -> wgpu::Texture {
    let [width, height, depth_or_array_layers] = grid;
    gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: Some("fluence"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format: wgpu::TextureFormat::Rgba32Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING,
        view_formats: &[],
    })
}

impl Fluence {
    /// An empty grid for a scene.
    ///
    /// # Errors
    /// The grid does not fit the adapter.
    pub fn new(gpu: &Gpu, scene: &DeviceScene, settings: &Settings) -> Result<Self> {
        let grid = scene.frame.size.map(|n| ((f64::from(n) * settings.grid).round() as u32).max(1));
        let cells: u64 = grid.iter().map(|&n| u64::from(n)).product();
        let bytes = cells * 8;
        gpu.fits("fluence grid", bytes).map_err(|_| {
            Error::capacity(
                "fluence grid",
                format!(
                    "{}x{}x{} cells take {bytes} bytes a channel, and the adapter binds {}; lower \
                     `grid` (now {})",
                    grid[0],
                    grid[1],
                    grid[2],
                    gpu.max_binding(),
                    settings.grid
                ),
            )
        })?;
        let extent = scene.frame.extent;
        let edge: [f64; 3] = std::array::from_fn(|i| f64::from(extent[i]) / f64::from(grid[i]));
        let typical = settings.flux_unit.unwrap_or(1.0) / settings.photons as f64
            * edge.iter().copied().fold(f64::INFINITY, f64::min);
        let scale = CONTRIBUTION / typical;
        let textures = [texture(gpu, grid), texture(gpu, grid)];
        gpu.check("fluence grid")?;
        let [before, view] = textures.map(|t| t.create_view(&Default::default()));
        let sum = || gpu.buffer::<u64>("fluence sums", cells as usize);
        Ok(Self {
            grid,
            scale: scale as f32,
            per_sum: (1.0 / (scale * edge.iter().product::<f64>())) as f32,
            edge: edge.map(|e| e as f32),
            current: false,
            sums: [sum()?, sum()?, sum()?],
            field: gpu.upload("fluence field", &[FluenceParams { grid, pad: 0 }])?,
            before,
            view,
            deposit: gpu.kernel("deposit", &[])?,
            resolve: gpu.kernel("resolve", &[])?,
            pace: Pace::new(1 << 14),
            chosen_pace: Pace::new(1 << 14),
        })
    }

    /// Sums the flights of all photons, from nothing.
    ///
    /// # Errors
    /// The device failed.
    pub fn sum_all(
        &mut self,
        gpu: &Gpu,
        scene: &DeviceScene,
        map: &mut PhotonMap,
        counters: &CounterBuffer,
        progress: &mut Progress,
    ) -> Result<()> {
        let mut stage = gpu.stage("deposit");
        self.sums.iter().for_each(|sum| stage.clear(sum));
        stage.finish()?;
        for batch in &mut map.batches {
            batch.list_all(gpu, None)?;
        }
        for batch in &map.batches {
            let slots = (map.params(batch), map.live_bindings(batch));
            self.deposit(gpu, scene, slots, counters, progress)?;
        }
        self.current = true;
        Ok(())
    }

    /// Adds the flights of the listed or of the chosen photons, or takes them out, as the
    /// parameters say: of the live slots or of the journal.
    ///
    /// # Errors
    /// The device failed.
    pub fn deposit(
        &self,
        gpu: &Gpu,
        scene: &DeviceScene,
        (params, slots): (PhotonParams, Bindings),
        counters: &CounterBuffer,
        progress: &mut Progress,
    ) -> Result<()> {
        let mut bindings = [scene.bindings(), slots, self.sum_bindings()].concat();
        bindings.push(("counters", counters.buffer().into()));
        let total = u64::from(params.listed) * u64::from(params.max_events);
        let work = |stage: &mut Stage, range: Range<u64>| {
            let items = range.end - range.start;
            let params = PhotonParams {
                first_item: range.start as u32,
                items: items as u32,
                scale: self.scale,
                grid: self.grid,
                ..params
            };
            stage.dispatch(&self.deposit, items, &bindings, &params)
        };
        let progress = &mut |n| progress.at("deposit", n, total);
        // Fewer of the chosen photons' slots are empty.
        let pace = if params.chosen == 1 { &self.chosen_pace } else { &self.pace };
        gpu.sliced("deposit", total, pace, work, progress)
    }

    /// Turns sums into fluence, and marks the cells that differ from before, if anybody `asks`.
    ///
    /// # Errors
    /// The device failed, or ended the loops that deposited flights or mark cells.
    pub fn resolve(
        &mut self,
        gpu: &Gpu,
        (dirty, asks): (&Dirty, bool),
        counters: &CounterBuffer,
    ) -> Result<()> {
        let is_far = dirty.is_far(self.edge.map(|edge| 2.0 * edge));
        if asks && is_far {
            dirty.mark_all(gpu)?;
        }
        std::mem::swap(&mut self.before, &mut self.view);
        let mut stage = gpu.stage("resolve");
        let cells = self.grid.iter().map(|&n| u64::from(n)).product();
        let (grid, per_sum, edge) = (self.grid, self.per_sum, self.edge);
        let mut bindings = [self.sum_bindings(), dirty.bindings()].concat();
        bindings.extend([("before", (&self.before).into()), ("fluence", (&self.view).into())]);
        bindings.push(("counters", counters.buffer().into()));
        let params = ResolveParams { grid, per_sum, edge, marks: (asks && !is_far).into() };
        stage.dispatch(&self.resolve, cells, &bindings, &params)?;
        stage.finish()?;
        counters.read(gpu)?.all_finished("fluence", "change `grid`")
    }

    /// The resolved field, by the names that the segment kernel gives it.
    pub fn bindings(&self) -> Bindings<'_> {
        vec![("field", (&self.field).into()), ("fluence", (&self.view).into())]
    }

    /// The sums as they are: red, green, blue.
    ///
    /// # Errors
    /// The device failed.
    pub fn read(&self, gpu: &Gpu) -> Result<[Vec<u64>; 3]> {
        let [r, g, b] = &self.sums;
        let read = |sum| gpu.read("fluence sums", sum);
        Ok([read(r)?, read(g)?, read(b)?])
    }

    /// Bytes of the sums and of the resolved field.
    pub fn bytes(&self) -> u64 {
        // Both textures have 16 bytes a cell, the sums 8 a channel.
        self.sums.iter().map(wgpu::Buffer::size).sum::<u64>() + self.sums[0].size() * 4
    }

    fn sum_bindings(&self) -> Bindings<'_> {
        let [r, g, b] = &self.sums;
        vec![("red", r.into()), ("green", g.into()), ("blue", b.into())]
    }
}
