//! The bins of histories: from table entries to bits.

use super::LAYERS;
use crate::transfer::{CellEntries, Domain, TABLE_ENTRIES, Table};
use crate::volume::Numbers;

/// Bins of a history: the bits of its mask.
pub const BINS: usize = 64;

/// From table entries to bins: entry e is of bin `(e * scale >> 16) + after`, at least
/// `low` and at most `high`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bins {
    /// Bins for each entry, in 2^-16.
    pub scale: u32,
    /// Bins before the first.
    pub after: i32,
    /// The least bin, from 0 on.
    pub low: i32,
    /// The greatest bin, below [`BINS`].
    pub high: i32,
    /// Classes of marks that a photon's history tells apart, 1, 2, 4 or 8: as many
    /// neighbouring bins share their bits.
    pub mark_classes: u32,
}

impl Bins {
    /// Equal bins over the whole table: `entry >> 6`.
    pub fn uniform(mark_classes: u32) -> Self {
        Self::over(TABLE_ENTRIES, mark_classes)
    }

    /// Equal bins over the entries that data can have: up to 64 labels have a bin each.
    pub fn of(domain: &Domain, numbers: &Numbers, mark_classes: u32) -> Self {
        Self::over(domain.used(numbers), mark_classes)
    }

    fn over(entries: usize, mark_classes: u32) -> Self {
        let scale = ((BINS << 16) / entries) as u32;
        Self { scale, after: 0, low: 0, high: BINS as i32 - 1, mark_classes }
    }

    /// The bin of an entry, below [`BINS`]; it never falls from one entry to the next.
    pub fn bin(&self, entry: usize) -> u32 {
        let bin = ((entry as u32 * self.scale) >> 16) as i32 + self.after;
        bin.clamp(self.low, self.high) as u32
    }

    /// The bit of a photon's history for a tentative collision at an entry, with a mark of
    /// the given layer.
    pub fn tentative_bit(&self, entry: usize, layer: u32) -> u64 {
        self.with_mark(1 << (self.bin(entry) & !(self.mark_classes - 1)), layer)
    }

    /// Bits of tentative collisions in the first layer, moved to another.
    pub fn with_mark(&self, first: u64, layer: u32) -> u64 {
        first << (layer * self.mark_classes / LAYERS)
    }

    /// The history bit of an entry.
    pub fn bit(&self, entry: usize) -> u64 {
        1 << self.bin(entry)
    }

    /// Bins with any extinction or emission.
    pub fn opaque_mask(&self, table: &Table) -> u64 {
        let visible = (0..TABLE_ENTRIES).filter(|&e| !table.is_empty_entry(e));
        visible.fold(0, |mask, e| mask | self.bit(e))
    }

    /// The bins that each macro-cell can produce.
    pub fn masks(&self, cells: &CellEntries) -> Vec<u64> {
        // Bins ascend with entries, so a range of entries is a range of bins.
        let mask = |&[low, high]: &[u16; 2]| {
            let [low, high] = [low, high].map(|e| self.bin(usize::from(e)));
            u64::MAX >> (63 - high) & u64::MAX << low
        };
        cells.ranges.iter().map(mask).collect()
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::transfer::Material;

    fn window(low: f64, high: f64) -> Material {
        Material {
            name: String::new(),
            ramp: vec![[low, 1.0], [high, 1.0]],
            extinction: 1.0,
            scatter: 1.0,
            colour: DVec3::ONE,
            emission: DVec3::ZERO,
            phase_g: 0.0,
        }
    }

    #[test]
    fn bins_cover_the_table_and_the_mask_names_what_is_there() {
        let bins = Bins::uniform(1);
        assert!((0..TABLE_ENTRIES).all(|e| bins.bin(e) as usize == e >> 6));
        let mut top = window(0.999, 1.0);
        let glow = Material { extinction: 0.0, emission: DVec3::X, ..window(0.0, 0.01) };
        let both = Table::build(&[top.clone(), glow], &Domain::over([0.0, 1.0]), None);
        assert_eq!(bins.opaque_mask(&both), 1 << 63 | 1);
        top.extinction = 0.0;
        assert_eq!(bins.opaque_mask(&Table::build(&[top], &Domain::over([0.0, 1.0]), None)), 0);
    }

    #[test]
    fn each_of_up_to_64_labels_has_a_bin_of_its_own() {
        for labels in [1, 2, 3, 7, 16, 17, 63, 64] {
            let span = f64::from(labels - 1);
            let numbers = Numbers { least: 1.0, step: 1.0, span, are_whole: true };
            let domain = Domain::fitting(None, &numbers, &[]);
            let (map, bins) = (domain.map(&numbers), Bins::of(&domain, &numbers, 1));
            let bin = |label: i32| bins.bin(map.entry_of(label as f32));
            assert!((1..labels).all(|label| bin(label) > bin(label - 1)), "{labels} labels");
        }
    }

    #[test]
    fn masks_of_cells_agree_with_a_plain_search() {
        let ranges = vec![[0, 1], [0, 4095], [63, 64], [100, 2000], [4094, 4095]];
        let cells = CellEntries { ranges };
        for bins in [Bins::uniform(1), Bins::uniform(4)] {
            for (mask, &[low, high]) in bins.masks(&cells).iter().zip(&cells.ranges) {
                let plain = (low..=high).fold(0, |m, e| m | bins.bit(usize::from(e)));
                assert_eq!(*mask, plain, "{low} to {high}");
            }
        }
    }
}
