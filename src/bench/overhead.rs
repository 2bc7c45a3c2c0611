//! What keeping histories costs a full rebuild: compiled out against in, interleaved.

use serde_json::json;

use super::{Effort, Report, Sheet, built_in, median, quantile, warm, without_histories};
use crate::error::Result;
use crate::gpu::Gpu;
use crate::measure;
use crate::render::Progress;
use crate::scene::Estimator;

const SCENES: [&str; 5] = ["hand", "cornell", "engine", "torso", "kidneys"];

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
    for (i, name) in SCENES.into_iter().enumerate() {
        for estimator in [Estimator::Fluence, Estimator::Points] {
            progress.at("overhead", i as u64, SCENES.len() as u64);
            let mut scene = built_in(name)?;
            scene.scale(effort.scale);
            scene.settings.estimator = Some(estimator);
            if estimator == Estimator::Points {
                // As few events as the paper has: gathers are dear.
                scene.settings.max_events = 2;
            }
            let volume = scene.volume.load()?;
            scene.settle(&volume);
            let silent = &mut Progress::silent();
            let mut frames = [
                measure::fresh(gpu, &without_histories(&scene), &volume)?,
                measure::fresh(gpu, &scene, &volume)?,
            ];
            warm(gpu, &mut frames[0], silent)?;
            let (mut kernels, mut trace) = ([const { Vec::new() }; 2], [const { Vec::new() }; 2]);
            for _ in 0..effort.runs {
                for (i, frame) in frames.iter_mut().enumerate() {
                    let p = measure::rebuild(gpu, frame, silent)?.1.phases;
                    kernels[i].push(p.photons + p.light_field + p.segments);
                    trace[i].push(p.photons);
                }
            }
            // Of each pair of neighbouring runs: the machine is not as fast at all times.
            let overheads = |[without, with]: &[Vec<f64>; 2]| -> Vec<f64> {
                without.iter().zip(with).map(|(a, b)| 100.0 * (b / a - 1.0)).collect()
            };
            let (whole, traced) = (overheads(&kernels), overheads(&trace));
            let [without, with] = kernels.map(median);
            let round = |x: f64| json!((x * 100.0).round() / 100.0);
            sheet.rows.push(vec![
                json!(name),
                json!(estimator.to_string()),
                json!(scene.settings.max_events),
                round(without),
                round(with),
                round(median(whole.clone())),
                round(quantile(whole.clone(), 0.25)),
                round(quantile(whole, 0.75)),
                round(median(traced)),
            ]);
        }
    }
    report.sheets.push(sheet);
    Ok(report)
}
