//! Runs of what is compared: turn by turn, since a machine is not as fast at all times, so
//! that neighbours can be set against each other.

use std::time::{Duration, Instant};

use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::gpu::clock::Timing;
use crate::measure::{self, Cost, Rebuild};
use crate::scene::Scene;
use crate::update::{Phases, PhotonFrame, Updated};

const WARM_UP: Duration = Duration::from_millis(200);

/// All runs of one of the steps.
#[derive(Default)]
pub(super) struct Runs {
    /// What the last did. The first update may meet wider histories than those whose times are the
    /// medians.
    pub updated: Updated,
    costs: Vec<Cost>,
}

impl Runs {
    /// The median.
    pub fn median(&self, of: impl Fn(&Cost) -> f64) -> f64 {
        median(self.costs.iter().map(of).collect())
    }

    /// Ratios to the runs of another step, each to its neighbour.
    pub fn over(&self, other: &Self, of: impl Fn(&Cost) -> f64) -> Vec<f64> {
        self.costs.iter().zip(&other.costs).map(|(a, b)| of(a) / of(b)).collect()
    }

    /// Medians of totals, phases and stages.
    pub fn typical(&self) -> Cost {
        let first = self.costs.first().map_or(&[][..], |cost| &cost.stages);
        let stages = first
            .iter()
            .map(|row| Timing { ms: self.median(|c| c.in_kernels(&[row.stage])), ..row.clone() });
        Cost {
            stages: stages.collect(),
            total: self.median(|c| c.total),
            effort: self.costs.last().map(|cost| cost.effort).unwrap_or_default(),
            phases: Phases {
                photons: self.median(|c| c.phases.photons),
                light_field: self.median(|c| c.phases.light_field),
                segments: self.median(|c| c.phases.segments),
            },
        }
    }
}

/// Runs the steps one after the other, `runs` times over.
pub(super) fn in_turn<const N: usize>(
    runs: usize,
    mut steps: [&mut dyn FnMut() -> Result<Rebuild>; N],
) -> Result<[Runs; N]> {
    let mut all = [(); N].map(|()| Runs::default());
    for _ in 0..runs {
        for (step, done) in steps.iter_mut().zip(&mut all) {
            let Rebuild { done: updated, cost } = step()?;
            done.costs.push(cost);
            done.updated = updated;
        }
    }
    Ok(all)
}

/// A step that rebuilds a frame.
pub(super) fn rebuild(gpu: &Gpu, frame: &mut PhotonFrame) -> impl FnMut() -> Result<Rebuild> {
    move || measure::rebuild(gpu, frame, &mut Progress::silent())
}

/// A step that applies an edit; that it is undone again does not count.
pub(super) fn edit(
    gpu: &Gpu,
    frame: &mut PhotonFrame,
    before: &Scene,
    after: &Scene,
) -> impl FnMut() -> Result<Rebuild> {
    move || {
        let silent = &mut Progress::silent();
        let measure::Update { done, cost, .. } = measure::update(gpu, frame, after, silent)?;
        measure::update(gpu, frame, before, silent)?;
        Ok(Rebuild { done, cost })
    }
}

/// Rebuilds a frame until a hardware adapter has found its clock rate, which falls while it idles.
pub(super) fn warm(gpu: &Gpu, frame: &mut PhotonFrame) -> Result<()> {
    let begun = Instant::now();
    while gpu.report().kind != "software" && begun.elapsed() < WARM_UP {
        measure::rebuild(gpu, frame, &mut Progress::silent())?;
    }
    Ok(())
}

/// The median; NaN of nothing.
pub(super) fn median(values: Vec<f64>) -> f64 {
    quantile(values, 0.5)
}

/// What a share of the values lies below, between two of them in proportion; NaN of nothing.
pub(super) fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let at = share * values.len().saturating_sub(1) as f64;
    let of = |i: f64| values.get(i as usize).copied().unwrap_or(f64::NAN);
    of(at.floor()) + (of(at.ceil()) - of(at.floor())) * at.fract()
}
