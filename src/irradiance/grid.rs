//! The learned grid: cells of several levels, in a hash table.

use super::CacheParams;
use crate::bits::CONTRIBUTION;
use crate::device_scene::DeviceScene;
use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::scene::Scene;

/// Levels, of edges 4, 2, 1 and 1/2 voxels.
pub const LEVELS: u32 = 4;
/// Edge of the coarsest cells, voxels.
const COARSEST: u32 = 4;
/// Words of a slot: key, samples, and three sums of 64 bits.
pub const SLOT_WORDS: u32 = 8;

/// The grid on the device.
pub struct Grid {
    pub(super) table: wgpu::Buffer,
    size: [u32; 3],
    levels: u32,
    per_edge: [f32; 3],
    slots: u32,
    scale: f32,
}

/// What a grid holds.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Cells {
    /// Cells of each level, coarse to fine.
    pub by_level: Vec<u64>,
    /// Samples of each level's cells together.
    pub samples: Vec<u64>,
    /// Slots of the table.
    pub slots: u64,
    /// Cells that were made.
    pub made: u64,
    /// Samples that found no room in a cell of a level.
    pub refused: u64,
}

impl Grid {
    /// An empty grid for a scene.
    ///
    /// # Errors
    /// It does not fit the adapter.
    pub fn new(gpu: &Gpu, device: &DeviceScene, scene: &Scene) -> Result<Self> {
        let size = device.params.size.map(|n| n.div_ceil(COARSEST));
        let coarse = size.iter().map(|&n| u64::from(n)).product::<u64>();
        // Keys are places among all cells, 32 bits: large volumes do without the finest.
        let keys = |levels: u32| coarse * ((1_u64 << (3 * levels)) - 1) / 7;
        let levels = (1..=LEVELS).rev().find(|&levels| keys(levels) < u64::from(u32::MAX));
        let Some(levels) = levels else {
            return Err(Error::capacity("irradiance cache", "the volume has too many voxels"));
        };
        let wanted = (scene.settings.cache_mib * 1_048_576.0) as u64;
        let bytes = wanted.min(gpu.max_binding());
        let each = u64::from(4 * SLOT_WORDS);
        let slots = 1_u32 << (bytes / each).max(64).ilog2();
        let words = slots as usize * SLOT_WORDS as usize;
        // The light that the scene's flux gives, spread over the sphere around the volume.
        let extent = device.params.extent.map(f64::from);
        let radius_squared = extent.iter().map(|e| e * e).sum::<f64>() / 4.0;
        let flux = scene.settings.flux_unit.unwrap_or(1.0);
        let typical = flux / (std::f64::consts::PI * radius_squared) / (4.0 * std::f64::consts::PI);
        Ok(Self {
            table: gpu.buffer::<u32>("irradiance cache", words)?,
            size,
            levels,
            per_edge: device.params.per_voxel.map(|n| n / COARSEST as f32),
            slots,
            scale: (CONTRIBUTION / typical) as f32,
        })
    }

    pub(super) fn params(&self) -> CacheParams {
        CacheParams {
            grid: self.size,
            levels: self.levels,
            per_edge: self.per_edge,
            slots: self.slots,
            scale: self.scale,
            per_sum: self.scale.recip(),
            // Chains of probes stay short.
            room: self.slots / 8 * 7,
            ..Default::default()
        }
    }

    pub(super) fn level_of(&self, key: u32) -> Option<u32> {
        let place = u64::from(key.checked_sub(1)?);
        let coarse = self.size.iter().map(|&n| u64::from(n)).product::<u64>();
        (0..self.levels).find(|level| place < coarse * ((1_u64 << (3 * (level + 1))) - 1) / 7)
    }

    pub(super) fn cells(&self, gpu: &Gpu) -> Result<Cells> {
        let words = gpu.read::<u32>("irradiance cache", &self.table)?;
        let levels = self.levels as usize;
        let mut cells = Cells {
            by_level: vec![0; levels],
            samples: vec![0; levels],
            slots: self.slots.into(),
            ..Default::default()
        };
        for slot in words.chunks_exact(SLOT_WORDS as usize).filter(|slot| slot[0] != 0) {
            let level = self.level_of(slot[0]).unwrap_or_default() as usize;
            cells.by_level[level] += 1;
            cells.samples[level] += u64::from(slot[1]);
        }
        Ok(cells)
    }
}
