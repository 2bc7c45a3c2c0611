//! Measurements of edits: the tables and figures of the Historygrams paper on our scenes,
//! and what else an update is judged by. Each gives a [`Report`]: sheets and charts.
//!
//! Times are kernel times by phase ([`crate::update::Phases`]) and wall-clock totals, the
//! medians of several runs; ratios are medians of ratios between neighbouring runs.

pub mod bins;
pub mod demo;
mod edits;
pub mod merging;
pub mod overhead;
mod report;
mod runs;
pub mod steps;
pub mod sweeps;
pub mod table1;
pub mod table2;
mod truth;
pub mod visits;

use crate::error::Result;
use crate::scene::{Scale, Scene};

pub use edits::{
    Cost, Measured, Mismatches, Rebuild, Update, compare, differing_pixels, fresh, measure,
    rebuild, update,
};
pub use report::{Chart, Report, Series, Sheet};
use truth::Truth;

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Size of the scenes.
    pub scale: Scale,
    /// Runs of each measurement, of which the median counts.
    pub runs: usize,
}

/// A built-in scene by name, not settled yet.
fn built_in(name: &str) -> Result<Scene> {
    let text = match name {
        "cornell" => include_str!("../../data/scenes/cornell.toml"),
        "engine" => include_str!("../../data/scenes/engine.toml"),
        "torso" => include_str!("../../data/scenes/torso.toml"),
        "aorta" => include_str!("../../data/scenes/aorta.toml"),
        "kidneys" => include_str!("../../data/scenes/kidneys.toml"),
        _ => include_str!("../../data/scenes/hand.toml"),
    };
    Scene::parse(text, name)
}

/// The scene with histories compiled out.
fn without_histories(scene: &Scene) -> Scene {
    let mut plain = scene.clone();
    plain.settings.history = false;
    plain
}

fn percent(part: u64, whole: u64) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}
