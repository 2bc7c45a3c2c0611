//! What the transfer function's table resolves of a scene's materials in a volume.

use super::{Filter, Scene};
use crate::error::{Error, Result};
use crate::transfer::{Domain, Material, TABLE_ENTRIES, ramp_weight};
use crate::volume::Volume;

/// Distinct whole numbers up to which a volume may be one of labels.
const LABELS: usize = TABLE_ENTRIES;

impl Scene {
    /// What must be said of materials that cannot look as they are meant to: those that no value of
    /// the data meets, and those that are thinner than an entry of the table.
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
        let step = self.domain(volume).step();
        let thin = self.materials.iter().find(|m| m.is_visible() && m.width() < step);
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
}

/// The values that a material is for, as people write them.
fn span(material: &Material) -> String {
    let ends = [material.ramp.first(), material.ramp.last()].map(|p| p.map_or(0.0, |p| p[0]));
    format!("{} to {}", ends[0], ends[1])
}

fn unresolved(material: &Material, domain: &Domain, volume: &Volume) -> Option<String> {
    let [low, high] = volume.range();
    let half = 0.5 * domain.step();
    let in_data = (0..TABLE_ENTRIES).map(|entry| domain.value(entry));
    let mut in_data = in_data.filter(|v| (low - half..=high + half).contains(v));
    let (name, span) = (&material.name, span(material));
    if !in_data.any(|value| ramp_weight(&material.ramp, value) > 0.0) {
        return Some(format!(
            "material `{name}` ({span}) meets no value of the data, which go from {low} to {high}: \
             check its window and the data's unit (`photogram info` shows the histogram)"
        ));
    }
    (material.width() < domain.step()).then(|| {
        format!(
            "material `{name}` ({span}) is thinner than an entry of the table, which stands for {}: \
             set `range` in [settings] to the values that matter",
            domain.step()
        )
    })
}
