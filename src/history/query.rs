//! What an edit of the transfer function changes: entry by entry and column by column,
//! and as query masks over the bins of histories, H(10).

use super::{Bins, LAYERS};
use crate::transfer::{TABLE_ENTRIES, Table, sum_unit};

/// The entry's extinction rose: flights that met it may be stopped there.
pub const CHANGE_RISEN: u32 = 1;
/// The entry's extinction fell: photons that interacted there may fly on.
pub const CHANGE_FALLEN: u32 = 2;
/// The entry scatters into other directions.
pub const CHANGE_PHASE: u32 = 4;
/// The entry scatters another share or colour.
pub const CHANGE_ALBEDO: u32 = 8;
/// Either: photons that interacted there give other light.
pub const CHANGE_SCATTERING: u32 = CHANGE_PHASE | CHANGE_ALBEDO;
/// The entry emits something else.
pub const CHANGE_EMISSION: u32 = 16;

/// The difference of two transfer functions; several edits may be added up.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Query {
    /// The `CHANGE_` bits of each table entry.
    pub changes: Vec<u32>,
    /// The layers of marks, a bit each, in which an entry may stop a flight that it did not.
    pub opened: Vec<u8>,
    /// Bits of photon histories that stand for them.
    pub risen: u64,
}

impl Default for Query {
    fn default() -> Self {
        Self { changes: vec![0; TABLE_ENTRIES], opened: vec![0; TABLE_ENTRIES], risen: 0 }
    }
}

impl Query {
    /// What is different in `new`. A tentative collision of mark m becomes real where
    /// extinction rises from at most m times the majorant to more; `bins` says which bits
    /// of a history stand for it.
    pub fn between(old: &Table, new: &Table, bins: &Bins, majorant: f32) -> Self {
        let mut query = Self::default();
        // Segments read sums of emission in this unit.
        let [unit, other] = [old, new].map(|table| sum_unit(table.max_emission()));
        for (e, change) in query.changes.iter_mut().enumerate() {
            let (before, after) = (old.extinction[e], new.extinction[e]);
            let bits = |colour: [f32; 3]| colour.map(f32::to_bits);
            let differs = [
                (after > before, CHANGE_RISEN),
                (after < before, CHANGE_FALLEN),
                (old.phase_g[e].to_bits() != new.phase_g[e].to_bits(), CHANGE_PHASE),
                (bits(old.albedo(e)) != bits(new.albedo(e)), CHANGE_ALBEDO),
                (bits(old.emission[e]) != bits(new.emission[e]), CHANGE_EMISSION),
                (unit != other && new.emission[e] != [0.0; 3], CHANGE_EMISSION),
            ];
            *change =
                differs.iter().filter(|(differs, _)| *differs).fold(0, |all, (_, bit)| all | bit);
            if after > before {
                for layer in octaves(before, after, majorant) {
                    query.opened[e] |= 1 << layer;
                    query.risen |= bins.tentative_bit(e, layer);
                }
            }
        }
        query
    }

    /// Adds what another edit changes.
    pub fn add(&mut self, other: &Self) {
        for (change, more) in self.changes.iter_mut().zip(&other.changes) {
            *change |= more;
        }
        for (layers, more) in self.opened.iter_mut().zip(&other.opened) {
            *layers |= more;
        }
        self.risen |= other.risen;
    }

    /// Whether nothing changes.
    pub fn is_empty(&self) -> bool {
        self.changes.iter().all(|&c| c == 0)
    }

    /// The bins of the entries of which any of the `columns` changed.
    pub fn mask(&self, columns: u32, bins: &Bins) -> u64 {
        let hit = self.changes.iter().enumerate().filter(|(_, change)| *change & columns != 0);
        hit.fold(0, |mask, (entry, _)| mask | bins.bit(entry))
    }
}

/// The layers of marks (see `kernels/shared/flight.wgsl`) that hold a mark m with
/// `before <= m * majorant < after`.
fn octaves(before: f32, after: f32, majorant: f32) -> impl Iterator<Item = u32> {
    (0..LAYERS).filter(move |&layer| {
        let high = majorant * 0.5_f32.powi(layer as i32);
        let low = if layer == LAYERS - 1 { 0.0 } else { high / 2.0 };
        low < after && high >= before
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::Domain;

    fn table(edit: impl Fn(&mut Table)) -> Table {
        let mut table = Table::build(&[], &Domain::over([0.0, 1.0]), None);
        edit(&mut table);
        table
    }

    #[test]
    fn columns_and_directions_are_told_apart() {
        let old = table(|t| t.extinction[64..192].fill(0.5));
        let new = table(|t| {
            t.extinction[64..128].fill(0.75);
            t.extinction[128..192].fill(0.25);
            t.phase_g[200] = 0.5;
            t.scatter[300] = 1.0;
            t.colour[300] = [0.0, 0.5, 0.0];
            t.scatter[301] = 1.0;
            t.emission[4095] = [0.0, 0.0, 1.0];
        });
        let bins = Bins::uniform(1);
        let q = Query::between(&old, &new, &bins, 1.0);
        let at = |bit: u32| -> Vec<usize> {
            (0..TABLE_ENTRIES).filter(|&e| q.changes[e] & bit != 0).collect()
        };
        assert_eq!(at(CHANGE_RISEN), (64..128).collect::<Vec<_>>());
        assert_eq!(at(CHANGE_FALLEN), (128..192).collect::<Vec<_>>());
        assert_eq!(at(CHANGE_PHASE), [200]);
        // Scatter without colour is no albedo: nothing that anybody could see.
        assert_eq!(at(CHANGE_ALBEDO), [300]);
        assert_eq!(at(CHANGE_EMISSION), [4095]);
        assert_eq!(q.risen, 1 << 1);
        assert_eq!([63, 64, 127, 128].map(|e| q.opened[e]), [0, 0b11, 0b11, 0]);
        assert_eq!(q.mask(CHANGE_RISEN | CHANGE_FALLEN, &bins), 0b110);
        assert_eq!(q.mask(u32::MAX, &bins), 0b11110 | 1 << 63);
        let mut both = Query::between(&new, &table(|_| ()), &bins, 1.0);
        assert_eq!((both.risen, &both.opened), (0, &Query::default().opened));
        both.add(&q);
        assert_eq!((both.risen, &both.opened), (q.risen, &q.opened));
        assert_eq!(both.changes[64], CHANGE_RISEN | CHANGE_FALLEN);
        assert!(!q.is_empty() && Query::between(&new, &new, &bins, 1.0).is_empty());
    }

    #[test]
    fn where_sums_of_emission_have_another_unit_all_that_glows_is_asked_for() {
        let glowing = |brightest: f32| {
            table(|t| (t.emission[5], t.emission[900]) = ([0.1; 3], [brightest, 0.0, 0.0]))
        };
        let changed = |before: f32, after: f32| {
            let query = Query::between(&glowing(before), &glowing(after), &Bins::uniform(1), 1.0);
            (0..TABLE_ENTRIES).filter(|&e| query.changes[e] == CHANGE_EMISSION).collect::<Vec<_>>()
        };
        assert_eq!(changed(2.1, 3.9), [900]);
        assert_eq!(changed(2.1, 4.1), [5, 900]);
        assert_eq!(changed(2.1, 0.0), [5, 900]);
    }

    #[test]
    fn marks_that_stay_on_their_side_are_not_asked_for() {
        let entry = 70; // bin 1
        let query = |before: f32, after: f32| {
            let old = table(|t| t.extinction[entry] = before);
            let new = table(|t| t.extinction[entry] = after);
            Query::between(&old, &new, &Bins::uniform(8), 1.0).risen
        };
        // Bin 1 shares its bits with bins 0 to 7; bit k is layer k.
        assert_eq!(query(0.0, 1.0), 0xff);
        assert_eq!(query(0.0, 0.1), 0b1111_1000);
        assert_eq!(query(0.3, 1.0), 0b11);
        assert_eq!(query(0.3, 0.4), 0b10);
        assert_eq!(query(0.4, 0.3), 0);
        // A mark may round up to its layer's upper end.
        assert_eq!(query(0.5, 0.6), 0b11);
    }
}
