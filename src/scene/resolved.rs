//! What the transfer function's table resolves of a scene's materials in a volume.

use std::ops::RangeInclusive;

use super::{Filter, Scene};
use crate::error::{Error, Result};
use crate::transfer::{Domain, Material, TABLE_ENTRIES, joined, ramp_weight};
use crate::volume::{Volume, Voxels};

/// Distinct whole numbers up to which a volume may be one of labels.
const LABELS: usize = TABLE_ENTRIES;

/// Share of the voxels at either end that the table's domain need not have.
const OUTLIERS: f64 = 1e-4;

/// Values far from the others that it need not have either, however many voxels have them.
const MOST_PADDINGS: usize = 4;

/// How far those must be, in widths of the range of the others.
const FAR: f64 = 4.0;

impl Scene {
    /// What must be said of materials that cannot look as they are meant to: those that no value of
    /// the data meets, or none that the table resolves, and those that are thinner than what it
    /// tells apart.
    pub fn unresolved(&self, volume: &Volume) -> Vec<String> {
        let domain = self.domain(volume);
        let told = self.materials.iter().filter(|m| m.is_visible());
        told.filter_map(|m| unresolved(m, &domain, volume)).collect()
    }

    /// Refuses labels that are too far apart for the table: one would have the material of another.
    pub(super) fn check_labels(&self, volume: &Volume) -> Result<()> {
        let numbers = volume.numbers();
        if self.filter != Filter::Nearest || !numbers.are_whole || numbers.are_few() {
            return Ok(());
        }
        let domain = self.domain(volume);
        let mut told = self.materials.iter().filter(|m| m.is_visible());
        let thin = told.find(|m| thin(m, &domain, volume).is_some());
        let Some((thin, levels)) = thin.zip(volume.levels(LABELS)) else { return Ok(()) };
        let [low, high] = volume.range();
        Err(Error::setting(format!(
            "material `{}` is for {} of {} labels from {low} to {high}: so far apart the table cannot \
             tell neighbours apart; renumber the labels from 0 to {}",
            thin.name,
            span(thin),
            levels.len(),
            levels.len() - 1
        )))
    }

    /// The range of values that the table is to resolve, where data have too many for all of them:
    /// where [nearly all](Ends) lie, joined with what materials and edits name. `None` where that is
    /// one value.
    pub(super) fn derived_range(&self, volume: &Volume) -> Option<[f64; 2]> {
        let numbers = volume.numbers();
        let edits = self.edits.iter().map(|edit| &edit.changes);
        let ramps = edits.clone().flat_map(|changes| &changes.materials);
        let ramps = ramps.filter_map(|change| change.ramp.clone());
        let changed = ramps.map(|ramp| Material { ramp, ..Material::neutral() });
        let added = edits.flat_map(|changes| changes.add_materials.clone());
        let all: Vec<_> = self.materials.iter().cloned().chain(changed).chain(added).collect();
        let ends = Ends { volume, voxels: volume.size().iter().map(|&n| n as usize).product() };
        let mut range = ends.robust();
        for _ in 0..MOST_PADDINGS {
            // What is left out has the material of an outermost entry: it must be its own.
            let is_told = |range: [f64; 2], value: f64| {
                let domain = Domain::fitting(Some(range), &numbers, &all);
                let entry = if value < range[0] { 0 } else { TABLE_ENTRIES - 1 };
                let told = domain.value(entry);
                all.iter().all(|m| ramp_weight(&m.ramp, value) == ramp_weight(&m.ramp, told))
            };
            let [low, high] = range;
            let [above, below] = [ends.without_lowest(range), ends.without_highest(range)];
            let above = above.filter(|&range| is_told(range, low));
            let below = below.filter(|&range| is_told(range, high));
            let Some(inner) = above.or(below) else { break };
            range = inner;
        }
        let range = joined(range, &numbers, &all);
        (range[0] < range[1]).then_some(range)
    }
}

/// Where nearly all voxels of a volume lie: all but a ten thousandth at either end, and but those of
/// one value, padding say, that is far from the others.
struct Ends<'a> {
    volume: &'a Volume,
    voxels: usize,
}

impl Ends<'_> {
    /// The value of a rank from the least on, and that of a rank from the greatest down.
    fn between(&self, after: usize, before: usize) -> [f64; 2] {
        let last = (self.voxels - 1).max(1) as f64;
        let shares = [after as f64 / last, 1.0 - before as f64 / last];
        let found = self.volume.quantiles(&shares);
        [found[0], found[1]]
    }

    /// Voxels from one value to another.
    fn count(&self, range: [f64; 2]) -> usize {
        self.volume.counts(range, 1).iter().sum::<u64>() as usize
    }

    /// Voxels to be left out at an end of so many: one at least.
    fn outliers(of: usize) -> usize {
        ((of as f64 * OUTLIERS).round() as usize).max(1)
    }

    fn robust(&self) -> [f64; 2] {
        let out = Self::outliers(self.voxels);
        if self.voxels <= 2 * out {
            return self.volume.range();
        }
        let [low, high] = self.between(out, out);
        if low < high {
            return [low, high];
        }
        // Nearly all have one value: the others say more.
        let [least, greatest] = self.volume.range();
        let same = self.count([low, low]);
        let below = self.count([least, low]) - same;
        let above = self.count([low, greatest]) - same;
        let out = Self::outliers(below + above);
        let [first, last] = self.between(out, out);
        [if below > out { first } else { low }, if above > out { last } else { high }]
    }

    /// The range without its lowest value, where that is far from the others.
    fn without_lowest(&self, [low, high]: [f64; 2]) -> Option<[f64; 2]> {
        let after = self.count([self.volume.range()[0], low]);
        let next = after + Self::outliers(self.voxels - after);
        let [next, _] = (next < self.voxels).then(|| self.between(next, 0))?;
        (next < high && next - low > FAR * (high - next)).then_some([next, high])
    }

    /// The same at the other end.
    fn without_highest(&self, [low, high]: [f64; 2]) -> Option<[f64; 2]> {
        let before = self.count([high, self.volume.range()[1]]);
        let next = before + Self::outliers(self.voxels - before);
        let [_, next] = (next < self.voxels).then(|| self.between(0, next))?;
        (low < next && high - next > FAR * (next - low)).then_some([low, next])
    }
}

/// What two values must differ by about a material to be told apart: an entry's step, or that of
/// single precision in the data, and in the numbers above the least that kernels are given.
fn grain(material: &Material, domain: &Domain, volume: &Volume) -> f64 {
    let [low, high] = volume.range();
    let ulp = |value: f64| f64::from((value as f32).abs().next_up() - (value as f32).abs());
    let at = material.ramp.first().map_or(low, |point| point[0].clamp(low, high));
    match volume.voxels() {
        Voxels::F32(_) => domain.step().max(ulp(at)).max(ulp(at - low)),
        Voxels::U8(_) | Voxels::U16(_) => domain.step(),
    }
}

/// What a material's width falls short of, beyond what rounding may take of it.
fn thin(material: &Material, domain: &Domain, volume: &Volume) -> Option<f64> {
    let grain = grain(material, domain, volume);
    (material.width() < 0.999 * grain).then_some(grain)
}

/// The entries of the table that values of the data may go to.
pub(super) fn met(domain: &Domain, volume: &Volume) -> RangeInclusive<usize> {
    let numbers = volume.numbers();
    let map = domain.map(&numbers);
    map.entry_of(0.0)..=map.entry_of(numbers.span as f32)
}

/// The values that a material is for, as people write them.
fn span(material: &Material) -> String {
    let ends = [material.ramp.first(), material.ramp.last()].map(|p| p.map_or(0.0, |p| p[0]));
    format!("{} to {}", ends[0], ends[1])
}

fn unresolved(material: &Material, domain: &Domain, volume: &Volume) -> Option<String> {
    let [low, high] = volume.range();
    let (name, span) = (&material.name, span(material));
    let mut met = met(domain, volume).map(|entry| domain.value(entry));
    if met.any(|value| ramp_weight(&material.ramp, value) > 0.0) {
        return thin(material, domain, volume).map(|grain| {
            format!(
                "material `{name}` ({span}) is thinner than what is told apart there, which is {grain}: \
                 set `range` in [settings] to the values that matter, and crop outliers"
            )
        });
    }
    let ends = [material.ramp.first(), material.ramp.last()].map(|p| p.map_or(low, |p| p[0]));
    if ends[0] > high || ends[1] < low {
        return Some(format!(
            "material `{name}` ({span}) meets no value of the data, which go from {low} to {high}: \
             check its window and the data's unit (`photogram info` shows the histogram)"
        ));
    }
    let [first, last] = [0, TABLE_ENTRIES - 1].map(|entry| domain.value(entry));
    Some(format!(
        "material `{name}` ({span}) meets no entry of the table, which go from {first} to {last} in steps \
         of {}: set `range` in [settings] to the values that matter",
        domain.step()
    ))
}
