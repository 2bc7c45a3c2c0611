//! Where light changed, so that only the segments that look there are computed again.
//!
//! Stages that change the light field mark the blocks in which a sample may read what
//! changed: the fluence grid compares each cell with what it was; points mark what is
//! around each interaction that came, went or weighs otherwise. Marks stay until all
//! segments were updated.

use std::sync::Arc;

use crate::bits::words;
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::resource::Bindings;
use crate::gpu::work::fill;
use crate::scene::Spatial;

/// Blocks of a macro-cell along each axis.
pub const DIRTY_SPLIT: u32 = 2;
/// Blocks that one thread marks, at most, of the turns that an adapter lets it take.
const MOST_PER_TURN: f32 = 0.3;

shared_struct! {
    /// The geometry of the marks, and the paper's axis historygrams.
    pub struct DirtyGrid {
        /// Blocks along each axis.
        pub blocks: [u32; 3],
        /// Which test segments make, a [`Spatial`].
        pub spatial: u32,
        /// Edge of a block, mm.
        pub edge: [f32; 3],
        /// How far from a point its light is read, mm.
        pub reach: f32,
        /// Which 64ths of the bounds hold marked blocks.
        pub along_x: [u32; 2],
        /// The same along the second axis.
        pub along_y: [u32; 2],
        /// The same along the third axis.
        pub along_z: [u32; 2],
        /// Keeps the size a multiple of 16.
        pub pad: [u32; 2],
    }
}

/// The marks.
pub struct Dirty {
    grid: DirtyGrid,
    extent: [f32; 3],
    grid_buffer: wgpu::Buffer,
    bits: wgpu::Buffer,
    vacant: Arc<Kernel>,
    most: f32,
}

impl Dirty {
    /// No marks. `reach` is the light field's own, mm.
    ///
    /// # Errors
    /// The device refuses the memory.
    pub fn new(gpu: &Gpu, scene: &DeviceScene, reach: f32, spatial: Spatial) -> Result<Self> {
        let params = &scene.params;
        let blocks = params.cells.map(|n| n * DIRTY_SPLIT);
        let count: usize = blocks.iter().map(|&n| n as usize).product();
        let grid = DirtyGrid {
            blocks,
            spatial: spatial as u32,
            edge: params.cell_mm.map(|e| e / DIRTY_SPLIT as f32),
            // Light is looked up at most half an interval off a sample; the rest is for rounding.
            reach: reach
                + 0.5 * params.step
                + 0.01 * params.cell_mm.into_iter().fold(0.0, f32::max),
            ..Default::default()
        };
        Ok(Self {
            grid,
            extent: params.extent,
            grid_buffer: gpu.upload("dirty grid", &[grid])?,
            bits: gpu.buffer::<u32>("dirty blocks", count.div_ceil(32))?,
            vacant: gpu.kernel("dirty_vacant", &[])?,
            most: MOST_PER_TURN * gpu.ways().turns as f32,
        })
    }

    /// By the names that the kernels give them.
    pub fn bindings(&self) -> Bindings {
        vec![("dirty_grid", (&self.grid_buffer).into()), ("dirty", (&self.bits).into())]
    }

    /// Whether the blocks around a box of this size, mm, are too many for a thread to mark one by
    /// one: [`Dirty::mark_all`] then.
    pub fn is_far(&self, size: [f32; 3]) -> bool {
        let along = |axis: usize| {
            let blocks = (size[axis] + 2.0 * self.grid.reach) / self.grid.edge[axis] + 2.0;
            blocks.min(self.grid.blocks[axis] as f32)
        };
        (0..3).map(along).product::<f32>() > self.most
    }

    /// Marks every block.
    ///
    /// # Errors
    /// The device failed.
    pub fn mark_all(&self, gpu: &Gpu) -> Result<()> {
        fill(gpu, "dirty", &self.bits, &[u32::MAX])
    }

    /// Forgets all marks.
    ///
    /// # Errors
    /// The device failed.
    pub fn clear(&self, gpu: &Gpu) -> Result<()> {
        let mut stage = gpu.stage("dirty");
        stage.clear(&self.bits);
        stage.finish()
    }

    /// Prepares the test of the segments: marks where the scene is empty are taken off, and the axis
    /// historygrams are found where they are asked for.
    ///
    /// # Errors
    /// The device failed.
    pub fn project(&mut self, gpu: &Gpu, scene: &DeviceScene) -> Result<()> {
        let mut stage = gpu.stage("dirty_vacant");
        let bindings = [scene.bindings(), self.bindings()].concat();
        stage.dispatch(&self.vacant, self.bits.size() / 4, &bindings, &())?;
        stage.finish()?;
        if self.grid.spatial != Spatial::Axes as u32 {
            return Ok(());
        }
        let [nx, ny, _] = self.grid.blocks;
        let mut along = [0_u64; 3];
        for block in self.marked(gpu)? {
            let at = [block % nx, block / nx % ny, block / (nx * ny)];
            for axis in 0..3 {
                let slabs_per_block = self.grid.edge[axis] / self.extent[axis] * 64.0;
                // The last blocks may lie beyond the bounds, as macro-cells do.
                let slab = |edge: u32| (edge as f32 * slabs_per_block).min(63.0) as u32;
                // One more at either end, for rounding's sake.
                for i in slab(at[axis]).saturating_sub(1)..=(slab(at[axis] + 1) + 1).min(63) {
                    along[axis] |= 1 << i;
                }
            }
        }
        [self.grid.along_x, self.grid.along_y, self.grid.along_z] = along.map(words);
        gpu.write(&self.grid_buffer, &[self.grid])?;
        Ok(())
    }

    /// Numbers of the marked blocks, x fastest.
    ///
    /// # Errors
    /// The device failed.
    pub fn marked(&self, gpu: &Gpu) -> Result<Vec<u32>> {
        let words = gpu.read::<u32>("dirty blocks", &self.bits)?;
        let bits = |(i, word): (usize, u32)| {
            (0..32).filter(move |bit| word >> bit & 1 == 1).map(move |bit| i as u32 * 32 + bit)
        };
        Ok(words.into_iter().enumerate().flat_map(bits).collect())
    }

    /// Bytes of the marks.
    pub fn bytes(&self) -> u64 {
        self.bits.size()
    }
}
