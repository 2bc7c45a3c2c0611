//! What macro-cells can be made of: the table entries that each can produce.

use rayon::prelude::*;

use super::{EntryMap, TABLE_ENTRIES, Table};
use crate::volume::cells::MacroCells;

/// The table entries that each macro-cell of a volume can produce.
#[derive(Clone, Debug)]
pub struct CellEntries {
    /// Least and greatest entry of each cell, widened by one each way for rounding's sake.
    pub ranges: Vec<[u16; 2]>,
}

impl CellEntries {
    /// Those of the values that the cells have.
    pub fn of(cells: &MacroCells, map: EntryMap) -> Self {
        let entries = |&[low, high]: &[f32; 2]| {
            let (low, high) = (map.entry_of(low).saturating_sub(1), map.entry_of(high) + 1);
            [low, high.min(TABLE_ENTRIES - 1)].map(|e| e as u16)
        };
        Self { ranges: cells.ranges.iter().map(entries).collect() }
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
    pub fn fold<T: Copy + Send + Sync>(
        &self,
        of: impl Fn(usize) -> T,
        join: impl Fn(T, T) -> T + Sync,
    ) -> Vec<T> {
        let levels = spans(of, &join);
        let joined = |range: &[u16; 2]| {
            let [low, high] = range.map(usize::from);
            let level = (high - low + 1).ilog2() as usize;
            join(levels[level][low], levels[level][high + 1 - (1 << level)])
        };
        self.ranges.par_iter().map(joined).collect()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::Domain;

    #[test]
    fn entries_are_widened_and_stay_in_the_table() {
        let cells = MacroCells { counts: [3, 1, 1], ranges: vec![[0.0; 2], [0.0, 1.0], [0.5; 2]] };
        let map = EntryMap { gain: TABLE_ENTRIES as f32, shift: 0.0 };
        assert_eq!(CellEntries::of(&cells, map).ranges, [[0, 1], [0, 4095], [2047, 2049]]);
    }

    #[test]
    fn majorants_agree_with_a_plain_search() {
        let ranges: Vec<_> =
            (0..500_u32).map(|i| [i * 7919 % 4096, i * 31 % 4096].map(|e| e as u16)).collect();
        let ranges = ranges.iter().map(|&[a, b]| [a.min(b), a.max(b)]).collect();
        let cells = CellEntries { ranges };
        let mut table = Table::build(&[], &Domain::over([0.0, 1.0]), None);
        for e in 0..TABLE_ENTRIES {
            table.extinction[e] = ((e * 2_654_435_761) % 1000) as f32;
        }
        table.emission[4000] = [0.0, 5.0, 0.0];
        let majorants = cells.majorants(&table, 2000.0);
        for (i, &[low, high]) in cells.ranges.iter().enumerate() {
            let range = usize::from(low)..=usize::from(high);
            let glow = if range.contains(&4000) { 2000.0 } else { 0.0 };
            let greatest = range.map(|e| table.extinction[e]).fold(glow, f32::max);
            assert_eq!(majorants[i], greatest);
        }
    }
}
