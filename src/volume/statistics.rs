//! What values a volume has, and how many voxels each: quantiles, distinct values, counts.
//!
//! Scans have outliers: one voxel of metal or a damaged one may be far beyond all others. So
//! whoever wants to know where the values of a volume lie asks for quantiles, not for the range.

use std::cmp::Ordering::Less;

use rayon::prelude::*;

use super::{Volume, Voxels};

/// Voxels that one thread counts before the sums are put together.
const CHUNK: usize = 1 << 18;

impl Volume {
    /// The values below which the given shares of the voxels lie: exactly the value of rank
    /// `round(share * (voxels - 1))` when all are sorted, nothing interpolated. Shares are clamped to
    /// [0, 1], so that 0 is the least value and 1 the greatest.
    pub fn quantiles(&self, shares: &[f64]) -> Vec<f64> {
        let last = self.voxel_count() - 1;
        let ranks: Vec<usize> =
            shares.iter().map(|s| (s.clamp(0.0, 1.0) * last as f64).round() as usize).collect();
        match &self.voxels {
            Voxels::U8(data) => self.stored_quantiles(data, &ranks),
            Voxels::U16(data) => self.stored_quantiles(data, &ranks),
            Voxels::F32(data) => float_quantiles(data, &ranks),
        }
    }

    /// The distinct values in ascending order, each with its voxels; `None` where there are more
    /// than `most`.
    pub fn levels(&self, most: usize) -> Option<Vec<(f64, u64)>> {
        let counted = |counts: Vec<u64>| {
            let met = counts.iter().enumerate().filter(|(_, n)| **n > 0);
            let levels: Vec<_> =
                met.take(most + 1).map(|(stored, &n)| (self.physical(stored), n)).collect();
            (levels.len() <= most).then_some(levels)
        };
        match &self.voxels {
            Voxels::U8(data) => counted(stored_counts(data)),
            Voxels::U16(data) => counted(stored_counts(data)),
            Voxels::F32(data) => {
                let mut levels: Vec<(f32, u64)> = Vec::new();
                for &value in data {
                    match levels.binary_search_by(|(v, _)| v.partial_cmp(&value).unwrap_or(Less)) {
                        Ok(at) => levels[at].1 += 1,
                        Err(_) if levels.len() == most => return None,
                        Err(at) => levels.insert(at, (value, 1)),
                    }
                }
                Some(levels.into_iter().map(|(v, n)| (v.into(), n)).collect())
            }
        }
    }

    /// How many voxels lie in each of `bins` equal parts of [low, high]; what lies outside is
    /// counted nowhere. The upper end belongs to the last part.
    pub fn counts(&self, [low, high]: [f64; 2], bins: usize) -> Vec<u64> {
        let bin = |value: f64| {
            let inside = (low..=high).contains(&value);
            inside.then(|| (((value - low) / (high - low) * bins as f64) as usize).min(bins - 1))
        };
        let mut counts = vec![0; bins];
        let mut add = |value: f64, n: u64| {
            if let Some(at) = bin(value) {
                counts[at] += n;
            }
        };
        let mut stored = |by_stored: Vec<u64>| {
            for (at, n) in by_stored.into_iter().enumerate().filter(|(_, n)| *n > 0) {
                add(self.physical(at), n);
            }
        };
        match &self.voxels {
            Voxels::U8(data) => stored(stored_counts(data)),
            Voxels::U16(data) => stored(stored_counts(data)),
            Voxels::F32(data) => {
                return summed(data, bins, |counts, chunk| {
                    for at in chunk.iter().filter_map(|&v| bin(v.into())) {
                        counts[at] += 1;
                    }
                });
            }
        }
        counts
    }

    fn voxel_count(&self) -> usize {
        self.size.iter().map(|&n| n as usize).product()
    }

    /// The physical value of a stored integer, as [`Volume::value`] has it.
    fn physical(&self, stored: usize) -> f64 {
        self.range[0] + self.step * stored as f64
    }

    fn stored_quantiles<T: Copy + Into<usize> + Sync>(
        &self,
        data: &[T],
        ranks: &[usize],
    ) -> Vec<f64> {
        // Stored order is physical order, whatever the sign of the file's slope.
        let mut below = 0;
        let ends: Vec<u64> = stored_counts(data)
            .into_iter()
            .map(|n| {
                below += n;
                below
            })
            .collect();
        let stored = |rank: &usize| ends.partition_point(|&end| end <= *rank as u64);
        ranks.iter().map(|rank| self.physical(stored(rank))).collect()
    }
}

/// Sums what each thread counts of its chunks.
fn summed<T: Sync>(data: &[T], bins: usize, count: impl Fn(&mut [u64], &[T]) + Sync) -> Vec<u64> {
    data.par_chunks(CHUNK)
        .fold(
            || vec![0; bins],
            |mut counts, chunk| {
                count(&mut counts, chunk);
                counts
            },
        )
        .reduce(
            || vec![0; bins],
            |mut a, b| {
                a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                a
            },
        )
}

fn stored_counts<T: Copy + Into<usize> + Sync>(data: &[T]) -> Vec<u64> {
    summed(data, 1 << (8 * size_of::<T>()), |counts, chunk| {
        for &stored in chunk {
            counts[stored.into()] += 1;
        }
    })
}

/// Counts by the upper half of a key, then sorts only what shares that half with a rank.
fn float_quantiles(data: &[f32], ranks: &[usize]) -> Vec<f64> {
    const HALF: u32 = 16;
    let counts = summed(data, 1 << HALF, |counts, chunk| {
        for &value in chunk {
            counts[(key_of(value) >> HALF) as usize] += 1;
        }
    });
    let mut begins = Vec::with_capacity(counts.len());
    let mut below = 0;
    for n in &counts {
        begins.push(below);
        below += *n as usize;
    }
    let bucket = |rank: usize| begins.partition_point(|&begin| begin <= rank) - 1;
    let mut wanted = vec![false; counts.len()];
    for &rank in ranks {
        wanted[bucket(rank)] = true;
    }
    let mut kept: Vec<u32> = data
        .par_iter()
        .map(|&value| key_of(value))
        .filter(|key| wanted[(key >> HALF) as usize])
        .collect();
    kept.par_sort_unstable();
    let value = |&rank: &usize| {
        let left_out = |b: &usize| if wanted[*b] { 0 } else { counts[*b] as usize };
        let before: usize = (0..bucket(rank)).map(|b| left_out(&b)).sum();
        f64::from(value_of(kept[rank - before]))
    };
    ranks.iter().map(value).collect()
}

/// A number that ascends as its float does.
fn key_of(value: f32) -> u32 {
    let bits = value.to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

fn value_of(key: u32) -> f32 {
    f32::from_bits(if key >> 31 == 0 { !key } else { key & !(1 << 31) })
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::volume::Values;

    const SIZE: [u32; 3] = [31, 17, 13];
    const COUNT: usize = 31 * 17 * 13;
    const SHARES: [f64; 9] = [0.0, 1e-4, 0.01, 0.25, 0.5, 0.75, 0.999, 0.9999, 1.0];

    fn volume(values: impl Into<Values>) -> Volume {
        Volume::new(SIZE, DVec3::ONE, DMat3::IDENTITY, DVec3::ZERO, values).unwrap()
    }

    /// Numbers without an order, from 0 to 2^32.
    fn hashed(n: usize) -> u32 {
        let mixed = (n as u32 ^ 0x9e37_79b9).wrapping_mul(0x85eb_ca6b);
        (mixed ^ mixed >> 13).wrapping_mul(0xc2b2_ae35)
    }

    /// By sorting all values that the volume says it has.
    fn sorted(volume: &Volume) -> Vec<f64> {
        let [ni, nj, nk] = volume.size();
        let mut all = Vec::new();
        for k in 0..nk {
            for j in 0..nj {
                all.extend((0..ni).map(|i| volume.value(i, j, k)));
            }
        }
        all.sort_by(f64::total_cmp);
        all
    }

    fn check(what: &str, volume: &Volume) {
        let all = sorted(volume);
        let expect: Vec<f64> =
            SHARES.iter().map(|s| all[(s * (COUNT - 1) as f64).round() as usize]).collect();
        assert_eq!(volume.quantiles(&SHARES), expect, "{what}");
        let [low, high] = [all[COUNT / 10], all[COUNT - COUNT / 10]];
        let mut counts = vec![0; 7];
        for v in all.iter().filter(|v| (low..=high).contains(v)) {
            counts[(((v - low) / (high - low) * 7.0) as usize).min(6)] += 1;
        }
        assert_eq!(volume.counts([low, high], 7), counts, "{what}");
    }

    #[test]
    fn quantiles_and_counts_are_those_of_a_sort() {
        check("u8", &volume((0..COUNT).map(|n| hashed(n) as u8).collect::<Vec<_>>()));
        let short = |n| (hashed(n) >> 16) as i16 / 9;
        check("u16", &volume((0..COUNT).map(short).collect::<Vec<_>>()));
        let float = |n| hashed(n) as f32 / 1e9 - 1.5;
        check("f32", &volume((0..COUNT).map(float).collect::<Vec<_>>()));
        // A scan's values crowd: many in one bucket of the floats.
        let crowd = |n: usize| 1.0 + hashed(n) as f32 * 1e-14;
        check("crowded f32", &volume((0..COUNT).map(crowd).collect::<Vec<_>>()));
        let turned = Values::from((0..COUNT).map(short).collect::<Vec<_>>()).mapped(-0.5, 10.0);
        check("negative slope", &volume(turned));
        let turned = Values::from((0..COUNT).map(float).collect::<Vec<_>>()).mapped(-3.0, 1.0);
        check("negative slope, f32", &volume(turned));
    }

    #[test]
    fn a_constant_volume_has_one_value() {
        for v in [volume(vec![7u8; COUNT]), volume(vec![7i16; COUNT]), volume(vec![7f32; COUNT])] {
            assert_eq!(v.quantiles(&SHARES), [7.0; SHARES.len()]);
            assert_eq!(v.levels(1), Some(vec![(7.0, COUNT as u64)]));
            assert_eq!(v.levels(0), None);
        }
    }

    #[test]
    fn one_outlier_moves_no_inner_quantile() {
        let plain: Vec<f32> = (0..COUNT).map(|n| (n % 100) as f32).collect();
        let mut hurt = plain.clone();
        hurt[COUNT / 2] = 1e7;
        let (plain, hurt) = (volume(plain), volume(hurt));
        let inner = [0.001, 0.5, 0.999];
        assert_eq!(plain.quantiles(&inner), hurt.quantiles(&inner));
        assert_eq!(hurt.quantiles(&[1.0]), [1e7]);
    }

    #[test]
    fn shares_beyond_the_ends_are_the_ends() {
        let v = volume((0..COUNT).map(|n| n as f32).collect::<Vec<_>>());
        assert_eq!(v.quantiles(&[-1.0, 2.0, f64::INFINITY]), [0.0, 6850.0, 6850.0]);
        assert!(v.quantiles(&[]).is_empty());
    }

    #[test]
    fn levels_are_counted_by_value() {
        let v = volume((0..COUNT).map(|n| [0.5f32, -1.0, 3.0][n % 3]).collect::<Vec<_>>());
        let third = COUNT as u64 / 3;
        assert_eq!(v.levels(3), Some(vec![(-1.0, third + 1), (0.5, third + 1), (3.0, third)]));
        assert_eq!(v.levels(2), None);
        let v = volume(
            Values::from((0..COUNT).map(|n| (n % 2) as u8).collect::<Vec<_>>()).mapped(-2.0, 5.0),
        );
        let half = COUNT as u64 / 2;
        assert_eq!(v.levels(2), Some(vec![(3.0, half), (5.0, half + 1)]));
    }
}
