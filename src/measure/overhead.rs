//! What keeping histories costs a full rebuild: compiled out against in, interleaved.

use serde_json::json;

use super::runs::{in_turn, median, quantile, rebuild, warm};
use super::{Effort, Report, Sheet, built_in, without_histories};
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::measure::{self, Cost};
use crate::scene::Estimator;

/// With `points` of as few events as the paper has, for gathers are dear, and once of as many as
/// table 1 has.
const CASES: [(&str, Estimator, Option<u32>); 11] = [
    ("hand", Estimator::Fluence, None),
    ("hand", Estimator::Points, Some(2)),
    ("hand", Estimator::Points, Some(16)),
    ("cornell", Estimator::Fluence, None),
    ("cornell", Estimator::Points, Some(2)),
    ("engine", Estimator::Fluence, None),
    ("engine", Estimator::Points, Some(2)),
    ("torso", Estimator::Fluence, None),
    ("torso", Estimator::Points, Some(2)),
    ("kidneys", Estimator::Fluence, None),
    ("kidneys", Estimator::Points, Some(2)),
];

/// Measures the five built-in scenes with both light fields.
///
/// # Errors
/// Memory does not suffice; the device failed.
pub fn run(gpu: &Gpu, effort: Effort, progress: &mut Progress) -> Result<Report> {
    let mut report = Report::new(gpu, "overhead", effort);
    let columns = [
        "scene",
        "light field",
        "events",
        "without ms",
        "with ms",
        "overhead %",
        "lower quartile %",
        "upper quartile %",
        "of tracing %",
    ];
    let mut sheet = Sheet::new("overhead", &columns);
    for (i, (name, estimator, events)) in CASES.into_iter().enumerate() {
        progress.at("overhead", i as u64, CASES.len() as u64);
        let mut scene = built_in(name)?;
        scene.scale(effort.scale);
        (scene.settings.estimator, scene.settings.rays) = (Some(estimator), 1);
        scene.settings.max_events = events.unwrap_or(scene.settings.max_events);
        let volume = scene.volume.load()?;
        scene.settle(&volume);
        let mut plain = measure::fresh(gpu, &without_histories(&scene), &volume)?;
        let mut kept = measure::fresh(gpu, &scene, &volume)?;
        warm(gpu, &mut plain)?;
        let [without, with] =
            in_turn(effort.runs, [&mut rebuild(gpu, &mut plain), &mut rebuild(gpu, &mut kept)])?;
        let overheads = |of: fn(&Cost) -> f64| -> Vec<f64> {
            with.over(&without, of).into_iter().map(|ratio| 100.0 * (ratio - 1.0)).collect()
        };
        let whole = overheads(Cost::kernels);
        let traced = overheads(|cost| cost.phases.photons);
        let round = |x: f64| json!((x * 100.0).round() / 100.0);
        sheet.rows.push(vec![
            json!(name),
            json!(estimator.to_string()),
            json!(scene.settings.max_events),
            round(without.median(Cost::kernels)),
            round(with.median(Cost::kernels)),
            round(median(whole.clone())),
            round(quantile(whole.clone(), 0.25)),
            round(quantile(whole, 0.75)),
            round(median(traced)),
        ]);
    }
    report.sheets.push(sheet);
    Ok(report)
}
