//! The `fluence` light field: every flight's power times length, summed on a grid.
//!
//! Sums are 64-bit integers, so they have no order, and what was added can be taken out
//! with nothing left over. A resolve pass turns them into mean fluence for each cell.

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::frame::DeviceScene;
use crate::gpu::Gpu;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::run::Bindings;
use crate::photon::{CounterBuffer, PhotonMap, PhotonParams};
use crate::render::{CONTRIBUTION, Progress};
use crate::scene::Settings;

shared_struct! {
    /// What the resolve kernel is told.
    pub struct ResolveParams {
        /// Cells along each axis.
        pub grid: [u32; 3],
        /// Fluence for each unit of a sum.
        pub per_sum: f32,
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
    sums: [wgpu::Buffer; 3],
    field: wgpu::Buffer,
    view: wgpu::TextureView,
    deposit: Arc<Kernel>,
    resolve: Arc<Kernel>,
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
        let typical = settings.flux_unit.unwrap_or(1.0) / f64::from(scene.lights.photons.max(1))
            * edge.iter().copied().fold(f64::INFINITY, f64::min);
        let scale = CONTRIBUTION / typical;
        let texture = gpu.device().create_texture(&wgpu::TextureDescriptor {
            label: Some("fluence"),
            size: wgpu::Extent3d {
                width: grid[0],
                height: grid[1],
                depth_or_array_layers: grid[2],
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D3,
            format: wgpu::TextureFormat::Rgba32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING,
            view_formats: &[],
        });
        gpu.check("fluence grid")?;
        let sum = || gpu.buffer::<u64>("fluence sums", cells as usize);
        Ok(Self {
            grid,
            scale: scale as f32,
            per_sum: (1.0 / (scale * edge.iter().product::<f64>())) as f32,
            sums: [sum()?, sum()?, sum()?],
            field: gpu.upload("fluence field", &[FluenceParams { grid, pad: 0 }])?,
            view: texture.create_view(&Default::default()),
            deposit: gpu.kernel("deposit", &[])?,
            resolve: gpu.kernel("resolve", &[])?,
        })
    }

    /// Sums the flights of all photons, from nothing.
    ///
    /// # Errors
    /// The device failed.
    pub fn build(
        &self,
        gpu: &Gpu,
        scene: &DeviceScene,
        map: &PhotonMap,
        counters: &CounterBuffer,
        progress: &mut Progress,
    ) -> Result<()> {
        let mut stage = gpu.stage("deposit");
        self.sums.iter().for_each(|sum| stage.clear(sum));
        stage.finish()?;
        for batch in &map.batches {
            let mut bindings = [scene.bindings(), batch.bindings(), self.sum_bindings()].concat();
            bindings.push(("counters", counters.buffer().into()));
            let slots = u64::from(batch.photons) * u64::from(map.max_events);
            gpu.sliced(
                "deposit",
                slots,
                1 << 14,
                |stage, range| {
                    let params = PhotonParams {
                        first_item: range.start as u32,
                        items: (range.end - range.start) as u32,
                        scale: self.scale,
                        grid: self.grid,
                        ..map.params(batch)
                    };
                    stage.dispatch(&self.deposit, range.end - range.start, &bindings, &params)
                },
                &mut |n| progress.at("deposit", n, slots),
            )?;
        }
        counters.read(gpu)?.all_finished("deposit", "lower `grid`")?;
        let mut stage = gpu.stage("resolve");
        let cells = self.grid.iter().map(|&n| u64::from(n)).product();
        let params = ResolveParams { grid: self.grid, per_sum: self.per_sum };
        let mut bindings = self.sum_bindings();
        bindings.push(("fluence", (&self.view).into()));
        stage.dispatch(&self.resolve, cells, &bindings, &params)?;
        stage.finish()
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
        // The field has 16 bytes a cell, the sums 8 a channel.
        self.sums.iter().map(wgpu::Buffer::size).sum::<u64>() + self.sums[0].size() * 2
    }

    fn sum_bindings(&self) -> Bindings<'_> {
        let [r, g, b] = &self.sums;
        vec![("red", r.into()), ("green", g.into()), ("blue", b.into())]
    }
}
