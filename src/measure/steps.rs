//! Error against the march step of view rays, for both light fields: how much of the error is the
//! step's, and what a shorter one costs.

use std::path::Path;

use serde_json::json;

use super::{Chart, Effort, Report, Series, Sheet, Truth, built_in};
use crate::error::Result;
use crate::gpu::{Gpu, Progress};
use crate::measure;
use crate::scene::Estimator;

/// Steps, in smallest spacings.
const STEPS: [f64; 5] = [2.0, 1.0, 0.5, 0.25, 0.125];
/// Samples a pixel of the reference, whose own noise is taken out of the errors.
const SAMPLES: u32 = 64;
const PHOTONS: u64 = 250_000;
const RAYS: u32 = 4;
/// Pixels across and down, at most: gathers of points are dear.
const PIXELS: u32 = 96;

/// Measures three built-in scenes, and a scan if it is in the folder of scans.
///
/// # Errors
/// Memory does not suffice; the device failed.
pub fn run(gpu: &Gpu, effort: Effort, scans: &Path, progress: &mut Progress) -> Result<Report> {
    let mut report = Report::new(gpu, "steps", effort);
    let columns = ["scene", "light field", "step", "relMSE", "segments ms", "samples"];
    let mut sheet = Sheet::new("steps", &columns);
    let mut scenes =
        ["hand", "kidneys", "torso"].map(built_in).into_iter().collect::<Result<Vec<_>>>()?;
    let aorta = scans.join("aorta_ct.nii.gz");
    match aorta.exists() {
        true => {
            let mut scene = built_in("aorta")?;
            scene.volume = crate::scene::VolumeSource::File(aorta);
            scenes.push(scene);
        }
        false => report.notes.push(format!("aorta is left out: there is no {}", aorta.display())),
    }
    for mut scene in scenes {
        scene.scale(effort.scale);
        scene.settings.photons = PHOTONS;
        scene.camera.width = scene.camera.width.min(PIXELS);
        scene.camera.height = scene.camera.height.min(PIXELS);
        let volume = scene.volume.load()?;
        scene.settle(&volume);
        let truth = Truth::of(gpu, &scene, &volume, SAMPLES, progress)?;
        let mut chart = Chart {
            name: format!("steps-{}", scene.name),
            title: format!("{}: error over the march step", scene.name),
            axes: ["step, voxels".to_owned(), "relMSE".to_owned()],
            log_x: true,
            series: Vec::new(),
        };
        for estimator in [Estimator::Fluence, Estimator::Points] {
            if estimator == Estimator::Fluence && scene.materials.iter().any(|m| m.phase_g != 0.0) {
                continue;
            }
            (scene.settings.estimator, scene.settings.rays) = (Some(estimator), RAYS);
            let mut frame = measure::fresh(gpu, &scene, &volume)?;
            let mut points = Vec::new();
            for (i, step) in STEPS.into_iter().enumerate() {
                progress.at("steps", i as u64, STEPS.len() as u64);
                scene.settings.step = step;
                let done = measure::update(gpu, &mut frame, &scene, &mut Progress::silent())?;
                let error = truth.error_of(&frame.segments.image(gpu)?)?;
                points.push((step, error));
                sheet.rows.push(vec![
                    json!(scene.name),
                    json!(estimator.to_string()),
                    json!(step),
                    json!(error),
                    json!(done.cost.phases.segments),
                    json!(done.done.counts.samples),
                ]);
            }
            let name = estimator.to_string();
            chart.series.push(Series { name, points, joined: true });
        }
        report.charts.push(chart);
    }
    report.sheets.push(sheet);
    Ok(report)
}
