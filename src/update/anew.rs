//! What a change of settings has made anew, and what is kept.

use std::fmt;

use crate::scene::{Estimator, Scene};

/// What is computed anew as a whole after a change of settings; the rest is kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Anew {
    /// All photons are traced.
    pub photons: bool,
    /// The light field is built from all photons.
    pub light_field: bool,
    /// All segments are computed.
    pub segments: bool,
}

impl Anew {
    /// All of it.
    pub const EVERYTHING: Self = Self { photons: true, light_field: true, segments: true };
}

impl fmt::Display for Anew {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all = [
            ("photons", self.photons),
            ("light field", self.light_field),
            ("segments", self.segments),
        ];
        let those = |anew: bool| {
            let names = all.iter().filter(move |(_, is)| *is == anew).map(|(name, _)| *name);
            names.collect::<Vec<_>>().join(", ")
        };
        match (those(true), those(false)) {
            (made, kept) if kept.is_empty() => write!(f, "{made} anew"),
            (made, kept) if made.is_empty() => write!(f, "{kept} kept"),
            (made, kept) => write!(f, "{made} anew; {kept} kept"),
        }
    }
}

/// Parts of a frame, by what other settings ask of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Parts {
    /// What kernels are told of the scene.
    pub constants: bool,
    /// Paths of photons.
    pub paths: bool,
    /// Room for photons.
    pub slots: bool,
    /// The light field.
    pub field: bool,
    /// Room for segments.
    pub bands: bool,
    /// Where light changed.
    pub dirty: bool,
}

impl Parts {
    /// What settings of `after` have made anew, where the light field was of one estimator and is to
    /// be of another.
    pub fn between(before: &Scene, after: &Scene, estimators: [Estimator; 2]) -> Self {
        let (a, b) = (&before.settings, &after.settings);
        let size = |scene: &Scene| (scene.camera.width, scene.camera.height);
        let slots = a.photons != b.photons
            || a.max_events != b.max_events
            || a.roulette_from != b.roulette_from
            || a.roulette_survival != b.roulette_survival;
        // Another majorant or range counts only if what follows from it is another (`collides_as`).
        let marks = a.seed != b.seed || a.skip_empty != b.skip_empty || a.history != b.history;
        let field = a.photons != b.photons
            || a.flux_unit != b.flux_unit
            || a.history != b.history
            || estimators[0] != estimators[1]
            || a.weighting != b.weighting
            || a.radius != b.radius
            || a.grid != b.grid;
        Self {
            constants: marks || a.step != b.step,
            paths: marks || slots,
            slots,
            field,
            bands: field
                || size(before) != size(after)
                || a.rays != b.rays
                || a.segments != b.segments,
            dirty: field || a.step != b.step || a.spatial != b.spatial,
        }
    }

    /// All of them.
    pub fn all() -> Self {
        Self { constants: true, paths: true, slots: true, field: true, bands: true, dirty: true }
    }

    /// Whether there is any.
    pub fn any(self) -> bool {
        self != Self::default()
    }

    /// These and others.
    pub fn and(self, other: Self) -> Self {
        Self {
            constants: self.constants || other.constants,
            paths: self.paths || other.paths,
            slots: self.slots || other.slots,
            field: self.field || other.field,
            bands: self.bands || other.bands,
            dirty: self.dirty || other.dirty,
        }
    }

    /// What that means for who reads a report.
    pub fn report(self) -> Anew {
        Anew { photons: self.paths, light_field: self.paths || self.field, segments: self.any() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_told() {
        let segments = Anew { segments: true, ..Default::default() };
        assert_eq!(segments.to_string(), "segments anew; photons, light field kept");
        let all = Anew::EVERYTHING;
        assert_eq!(all.to_string(), "photons, light field, segments anew");
    }
}
