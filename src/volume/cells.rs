//! Macro-cells: what a block of voxels can look like, whatever the materials.
//!
//! Each cell of [`CELL_EDGE`]³ voxels knows the closed range of table entries that the
//! volume filter can produce in it: from its least to its greatest value with a border
//! of one voxel, widened by one entry each way. It depends on the data alone.

use std::num::NonZero;

use super::Volume;
use crate::transfer::{Bins, TABLE_ENTRIES, Table, entry_of};

/// Voxels along the edge of a macro-cell.
pub const CELL_EDGE: u32 = 8;

/// The macro-cells of a volume, x fastest.
#[derive(Clone, Debug)]
pub struct MacroCells {
    /// Cells along each axis.
    pub counts: [u32; 3],
    /// Least and greatest table entry of each cell.
    pub entries: Vec<[u16; 2]>,
}

impl MacroCells {
    /// Looks at every voxel once, and at those on borders again.
    pub fn of(volume: &Volume) -> Self {
        let counts = volume.size().map(|n| n.div_ceil(CELL_EDGE));
        let total = counts.iter().map(|&n| n as usize).product();
        Self { counts, entries: each(total, |cell| entry_range(volume, counts, cell)) }
    }

    /// The bins that each cell can produce, as history masks of two words.
    pub fn masks(&self, bins: &Bins) -> Vec<[u32; 2]> {
        // Bins ascend with entries, so a range of entries is a range of bins.
        let mask = |&[low, high]: &[u16; 2]| {
            let (low, high) = (bins.bin_of_entry[low as usize], bins.bin_of_entry[high as usize]);
            let bits = u64::MAX >> (63 - high) & u64::MAX << low;
            [bits as u32, (bits >> 32) as u32]
        };
        self.entries.iter().map(mask).collect()
    }

    /// The greatest extinction that each cell can produce, 1/mm; where it can only emit,
    /// `glow_rate` instead, so that a Poisson process finds the emission.
    pub fn majorants(&self, table: &Table, glow_rate: f32) -> Vec<f32> {
        let rate = |e: usize| {
            let glows = table.emission[e] != [0.0; 3];
            table.extinction[e].max(if glows { glow_rate } else { 0.0 })
        };
        self.fold(rate, f32::max)
    }

    /// All entries that each cell can produce, joined: a maximum, a union. `join` must not mind
    /// an entry twice.
    pub fn fold<T: Copy + Default + Send + Sync>(
        &self,
        of: impl Fn(usize) -> T,
        join: impl Fn(T, T) -> T + Sync,
    ) -> Vec<T> {
        let levels = spans(of, &join);
        each(self.entries.len(), |cell| {
            let [low, high] = self.entries[cell].map(usize::from);
            let level = (high - low + 1).ilog2() as usize;
            join(levels[level][low], levels[level][high + 1 - (1 << level)])
        })
    }
}

/// A sparse table, which answers any range in two look-ups: what 2^k neighbouring entries have,
/// from each on as long as there are so many, for all k.
pub fn spans<T: Copy>(of: impl Fn(usize) -> T, join: impl Fn(T, T) -> T) -> Vec<Vec<T>> {
    let mut levels = vec![(0..TABLE_ENTRIES).map(of).collect::<Vec<T>>()];
    for width in (0..).map(|k| 1 << k).take_while(|w| 2 * w <= TABLE_ENTRIES) {
        let below = &levels[levels.len() - 1];
        let next = (0..=TABLE_ENTRIES - 2 * width).map(|i| join(below[i], below[i + width]));
        levels.push(next.collect());
    }
    levels
}

/// Something of each cell, found by as many threads as the machine has.
fn each<T: Copy + Default + Send>(total: usize, of: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let mut all = vec![T::default(); total];
    let threads = std::thread::available_parallelism().map_or(1, NonZero::get);
    let share = total.div_ceil(threads).max(1);
    let of = &of;
    std::thread::scope(|scope| {
        for (part, chunk) in all.chunks_mut(share).enumerate() {
            scope.spawn(move || {
                for (i, item) in chunk.iter_mut().enumerate() {
                    *item = of(part * share + i);
                }
            });
        }
    });
    all
}

fn entry_range(volume: &Volume, counts: [u32; 3], cell: usize) -> [u16; 2] {
    let (nx, ny) = (counts[0] as usize, counts[1] as usize);
    let at = [cell % nx, cell / nx % ny, cell / (nx * ny)].map(|c| c as u32 * CELL_EDGE);
    let span = |axis: usize| {
        at[axis].saturating_sub(1)..(at[axis] + CELL_EDGE + 1).min(volume.size()[axis])
    };
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for k in span(2) {
        for j in span(1) {
            for i in span(0) {
                let v = volume.unit(i, j, k);
                low = low.min(v);
                high = high.max(v);
            }
        }
    }
    let widened = [entry_of(low).saturating_sub(1), (entry_of(high) + 1).min(TABLE_ENTRIES - 1)];
    widened.map(|e| e as u16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::Volume;
    use glam::{DMat3, DVec3};

    fn volume(size: [u32; 3], value: impl Fn(u32, u32, u32) -> u16) -> Volume {
        let mut values = Vec::new();
        for k in 0..size[2] {
            for j in 0..size[1] {
                for i in 0..size[0] {
                    values.push(value(i, j, k));
                }
            }
        }
        Volume::new(size, DVec3::ONE, DMat3::IDENTITY, DVec3::ZERO, values).expect("a sound volume")
    }

    #[test]
    fn a_cell_sees_its_voxels_and_one_around_them() {
        // One bright voxel just outside cell 0, two in from the start of cell 1.
        for (x, seen) in [(7, true), (8, true), (9, false)] {
            let v = volume([20, 9, 8], |i, j, k| if (i, j, k) == (x, 0, 0) { 4095 } else { 0 });
            let cells = MacroCells::of(&v);
            assert_eq!(cells.counts, [3, 2, 1]);
            assert_eq!(cells.entries[0][1] == 4095, seen, "voxel {x}");
            assert_eq!(cells.entries[1][1], 4095);
            assert_eq!(cells.entries[5], [0, 1]);
        }
    }

    #[test]
    fn masks_and_majorants_agree_with_a_plain_search() {
        let v = volume([40, 24, 16], |i, j, k| {
            ((i * 7919 + j * 104_729 + k * 31) % 4096 / (1 + k / 8 * 9)) as u16
        });
        let cells = MacroCells::of(&v);
        let bins = Bins::uniform(1);
        let mut table = Table::build(&[], v.range(), None);
        for e in 0..TABLE_ENTRIES {
            table.extinction[e] = ((e * 2_654_435_761) % 1000) as f32;
        }
        let (masks, majorants) = (cells.masks(&bins), cells.majorants(&table, 0.0));
        for (i, &[low, high]) in cells.entries.iter().enumerate() {
            let range = low as usize..=high as usize;
            let mask = range.clone().fold(0, |m, e| m | bins.bit(e));
            assert_eq!(u64::from(masks[i][0]) | u64::from(masks[i][1]) << 32, mask);
            let greatest = range.map(|e| table.extinction[e]).fold(0.0, f32::max);
            assert_eq!(majorants[i], greatest);
        }
    }
}
