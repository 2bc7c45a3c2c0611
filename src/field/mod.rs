//! The light field: one of two estimators, behind what segments ask of it.

pub mod dirty;
pub mod fluence;
pub mod points;

use self::fluence::Fluence;
use self::points::Points;
use crate::gpu::run::Bindings;

/// The light field that segments read.
pub enum LightField {
    /// Photons in the buckets of a grid.
    Points(Box<Points>),
    /// The fluence grid.
    Fluence(Box<Fluence>),
}

/// Points that are gathered together.
pub struct Run<'a> {
    /// By the names that the segment kernel gives them.
    pub bindings: Bindings<'a>,
    /// How many points.
    pub points: u32,
}

impl LightField {
    /// All light, in runs.
    pub(crate) fn runs(&self) -> Vec<Run<'_>> {
        match self {
            Self::Points(points) => points.runs(),
            Self::Fluence(fluence) => vec![Run { bindings: fluence.bindings(), points: 0 }],
        }
    }

    /// The light that changed since all segments were computed; `None` where all is to be
    /// gathered anew.
    pub(crate) fn changes(&self) -> Option<Vec<Run<'_>>> {
        match self {
            Self::Points(points) => points.changes(),
            Self::Fluence(_) => None,
        }
    }
}
