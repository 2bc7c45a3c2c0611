//! Measurements of edits: the tables and figures of the Historygrams paper on our scenes,
//! and what else an update is judged by. Each gives a [`Report`]: sheets and charts.
//!
//! Times are kernel times by phase ([`crate::update::Phases`]) and wall-clock totals, the
//! medians of several runs; ratios are between figures of one run on one adapter.

pub mod bins;
pub mod merging;
pub mod overhead;
mod report;
pub mod sweeps;
pub mod table1;
pub mod visits;

use std::time::{Duration, Instant};

use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::run::Timing;
use crate::measure::{self, Cost};
use crate::render::Progress;
use crate::scene::{Scale, Scene};
use crate::update::{Phases, PhotonFrame, Updated};
use crate::volume::Volume;

pub use report::{Chart, Report, Series, Sheet};

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
        "kidneys" => include_str!("../../data/scenes/kidneys.toml"),
        _ => include_str!("../../data/scenes/hand.toml"),
    };
    Scene::parse(text, name)
}

/// Rebuilds a frame until a hardware adapter has found its clock rate, which falls while it idles.
fn warm(gpu: &Gpu, frame: &mut PhotonFrame, progress: &mut Progress) -> Result<()> {
    let begun = Instant::now();
    while gpu.report().kind != "software" && begun.elapsed() < WARM_UP {
        measure::rebuild(gpu, frame, progress)?;
    }
    Ok(())
}

const WARM_UP: Duration = Duration::from_millis(200);

/// An edit, applied and undone `runs` times over, on a device that is warm from rebuilds.
struct Edited {
    /// What the first did: later ones may meet tighter histories.
    updated: Updated,
    /// Medians.
    cost: Cost,
}

fn edited(
    gpu: &Gpu,
    frame: &mut PhotonFrame,
    (before, after): (&Scene, &Scene),
    runs: usize,
    progress: &mut Progress,
) -> Result<Edited> {
    let mut costs = Vec::new();
    let mut first = None;
    for _ in 0..runs {
        let (_, updated, cost) = measure::update(gpu, frame, after, progress)?;
        costs.push(cost);
        first.get_or_insert(updated);
        measure::update(gpu, frame, before, progress)?;
    }
    Ok(Edited { updated: first.unwrap_or_default(), cost: typical(&costs) })
}

/// A full rebuild, `runs` times over.
fn rebuilt(
    gpu: &Gpu,
    scene: &Scene,
    volume: &Volume,
    runs: usize,
    progress: &mut Progress,
) -> Result<Edited> {
    let mut frame = measure::fresh(gpu, scene, volume)?;
    warm(gpu, &mut frame, progress)?;
    let mut costs = Vec::new();
    let mut last = Updated::default();
    for _ in 0..runs {
        let (updated, cost) = measure::rebuild(gpu, &mut frame, progress)?;
        costs.push(cost);
        last = updated;
    }
    Ok(Edited { updated: last, cost: typical(&costs) })
}

/// The scene with histories compiled out.
fn without_histories(scene: &Scene) -> Scene {
    let mut plain = scene.clone();
    plain.settings.history = false;
    plain
}

/// Medians of totals, phases and stages.
fn typical(costs: &[Cost]) -> Cost {
    let of = |value: &dyn Fn(&Cost) -> f64| median(costs.iter().map(value).collect());
    let rows =
        |c: &Cost, name: &str| c.stages.iter().find(|t| t.stage == name).map_or(0.0, |t| t.ms);
    let stages = costs
        .first()
        .map_or(&[][..], |c| &c.stages)
        .iter()
        .map(|first| Timing { ms: of(&|c| rows(c, first.stage)), ..first.clone() });
    Cost {
        stages: stages.collect(),
        total: of(&|c| c.total),
        waits: of(&|c| c.waits as f64) as u64,
        phases: Phases {
            photons: of(&|c| c.phases.photons),
            light_field: of(&|c| c.phases.light_field),
            segments: of(&|c| c.phases.segments),
        },
    }
}

/// The median; NaN of nothing.
fn median(values: Vec<f64>) -> f64 {
    quantile(values, 0.5)
}

/// What a share of the values lies below, between two of them in proportion; NaN of nothing.
fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let at = share * values.len().saturating_sub(1) as f64;
    let of = |i: f64| values.get(i as usize).copied().unwrap_or(f64::NAN);
    of(at.floor()) + (of(at.ceil()) - of(at.floor())) * at.fract()
}

fn percent(part: u64, whole: u64) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}
