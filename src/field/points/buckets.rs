//! Where points of a cell lie: a bucket for each cell of a small grid, or a hash table of the runs of
//! cells that have any.

use std::cell::RefCell;

use super::PointsParams;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::pool::Pooled;
use crate::split::Split;

/// Cells of a grid that each have a bucket, at most: 32 MiB, and as much again for points that changed.
pub const MAX_BUCKETS: u32 = 1 << 22;
/// Cells of a run (`RUN` in `kernels/shared/points.wgsl`).
const RUN: u32 = 4;
/// Bits for runs that may have points, at most: 16 MiB.
const MOST_BITS: u32 = 1 << 27;
/// Slots of the smallest hash table.
const MIN_RUNS: u32 = 16;

/// Whether so many cells have a hash table.
pub(super) fn are_hashed(cells: u64, split: &Split) -> bool {
    cells > split.buckets.unwrap_or(MAX_BUCKETS).into()
}

/// Bytes of the buckets of so many points, at most.
pub fn most_bytes(are_hashed: bool, points: u64) -> u64 {
    let runs = (2 * points).next_power_of_two().max(MIN_RUNS.into());
    if are_hashed {
        4 * (u64::from(RUN) + 1) * runs + u64::from(MOST_BITS / 8)
    } else {
        8 * u64::from(MAX_BUCKETS)
    }
}

/// Points whose hash table fits a binding of so many bytes.
pub(super) fn most_points(binding: u64) -> u32 {
    let runs =
        (binding.saturating_sub(u64::from(MOST_BITS / 8)) / (4 * u64::from(RUN + 1))).max(2) - 1;
    1_u32 << runs.ilog2().min(28)
}

/// What gathers are told of grids: few ever differ.
#[derive(Default)]
pub(super) struct Fields(RefCell<Vec<(PointsParams, wgpu::Buffer)>>);

impl Fields {
    fn of(&self, gpu: &Gpu, params: PointsParams) -> Result<wgpu::Buffer> {
        let params = PointsParams { changed: [0; 2], ..params };
        let mut known = self.0.borrow_mut();
        if let Some((_, buffer)) = known.iter().find(|(of, _)| *of == params) {
            return Ok(buffer.clone());
        }
        let buffer = gpu.upload("points field", &[params])?;
        known.push((params, buffer.clone()));
        Ok(buffer)
    }
}

/// Where buckets begin.
pub(super) struct Buckets {
    /// The grid, with how many buckets there are, and slots of the hash table.
    pub params: PointsParams,
    /// Where each bucket begins, and the last ends; then which rows around each cell have points, or
    /// the runs that slots of the hash table have.
    pub starts: Pooled,
    /// The same as `params`, for gathers.
    pub field: wgpu::Buffer,
    /// Points that ever came: as many runs as that there may be, at most.
    ever: u64,
}

impl Buckets {
    /// Empty ones for so many points. A hash table has two slots or more for each, as far as a binding
    /// holds them, and always more than that.
    ///
    /// # Errors
    /// The memory is refused.
    pub fn new(
        gpu: &Gpu,
        grid: PointsParams,
        count: u32,
        is_hashed: bool,
        fields: &Fields,
    ) -> Result<Self> {
        let [x, y, z] = grid.grid;
        let mut params = PointsParams { runs: 0, buckets: x * y * z, ..grid };
        let mut words = 2 * params.buckets as usize + 1;
        if is_hashed {
            // Runs are counted from 1.
            let all = (x * y * z).div_ceil(RUN) + 1;
            params.mask_shift = (all.div_ceil(MOST_BITS)).next_power_of_two().ilog2();
            let mask = (all >> params.mask_shift) / 32 + 1;
            let words_of = |runs: u32| (RUN as usize + 1) * runs as usize + 1 + mask as usize;
            let mut runs = (2 * count).next_power_of_two().max(MIN_RUNS);
            while 4 * words_of(runs) as u64 > gpu.max_binding() && runs / 2 > count {
                runs /= 2;
            }
            (params.runs, params.buckets) = (runs, RUN * runs);
            words = words_of(runs);
        }
        let starts = gpu.lend::<u32>("points starts", words)?;
        let field = fields.of(gpu, params)?;
        Ok(Self { params, starts, field, ever: 0 })
    }

    /// Whether as many more points surely find a slot, and soon.
    pub fn have_room(&self, more: u32) -> bool {
        let runs = u64::from(self.params.runs);
        runs == 0 || 4 * (self.ever + u64::from(more)) <= 3 * runs
    }

    /// Notes that so many points come.
    pub fn expect(&mut self, points: u32) {
        self.ever += u64::from(points);
    }

    /// What kernels are told of them, and of so many points.
    pub fn with(&self, count: u32) -> PointsParams {
        PointsParams { count, ..self.params }
    }

    /// The cell of each bucket; `None` where it has none.
    pub fn cells(&self, starts: &[u32]) -> Vec<Option<u32>> {
        let PointsParams { runs, buckets, .. } = self.params;
        if runs == 0 {
            return (0..buckets).map(Some).collect();
        }
        let held = &starts[buckets as usize + 1..][..runs as usize];
        let cells = held.iter().flat_map(|&run| {
            (0..RUN).map(move |cell| run.checked_sub(1).map(|run| RUN * run + cell))
        });
        cells.take(buckets as usize).collect()
    }
}
