//! From where on taking all points anew is faster than merging those that moved with the
//! others: edits of growing size, each as either.

use serde_json::json;

use super::runs::{median, warm};
use super::{Chart, Effort, Report, Series, Sheet, built_in};
use crate::error::Result;
use crate::field::points::Points;
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::measure;
use crate::scene::{Estimator, Scene, Weighting};
use crate::split::Split;
use crate::update::{Phases, PhotonFrame};

/// Scenes of one light.
const SCENES: [&str; 2] = ["hand", "engine"];
/// What the first materials' extinctions are multiplied by.
const FACTORS: [f64; 3] = [0.9, 0.5, 0.1];

/// Measures the update of the light field, and of the segments that look it up, after edits of
/// extinctions: where points are taken anew all light counts as changed.
///
/// # Errors
/// Memory does not suffice; the device failed.
pub fn run(gpu: &Gpu, effort: Effort, progress: &mut Progress) -> Result<Report> {
    let mut report = Report::new(gpu, "merging", effort);
    let columns = [
        "scene",
        "light field",
        "materials",
        "factor",
        "points",
        "moved %",
        "anew ms",
        "merged ms",
        "segments after anew ms",
        "segments after merged ms",
    ];
    let mut sheet = Sheet::new("merging", &columns);
    let mut series = Vec::new();
    for (i, name) in SCENES.into_iter().enumerate() {
        for weighting in [Weighting::Plain, Weighting::Even] {
            progress.at("merging", i as u64, SCENES.len() as u64);
            let mut scene = built_in(name)?;
            scene.scale(effort.scale);
            let settings = &mut scene.settings;
            (settings.estimator, settings.weighting) = (Some(Estimator::Points), weighting);
            settings.rays = 1;
            let volume = scene.volume.load()?;
            scene.settle(&volume);
            let silent = &mut Progress::silent();
            let mut frame = measure::fresh(gpu, &scene, &volume)?;
            frame.rebuild(gpu, &Split::default(), silent)?;
            warm(gpu, &mut frame)?;
            let mut points = Vec::new();
            for (count, factor) in edits(&scene) {
                let after = thinned(&scene, count, factor);
                let (mut ms, mut moved) = ([const { Vec::new() }; 4], 0.0);
                for run in 0..=effort.runs {
                    for anew in [true, false] {
                        let took = update(gpu, &mut frame, &after, anew)?;
                        update(gpu, &mut frame, &scene, false)?;
                        // A driver may compile a kernel when it first runs.
                        if run > 0 {
                            ms[usize::from(!anew)].push(took.phases.light_field);
                            ms[2 + usize::from(!anew)].push(took.phases.segments);
                        }
                        moved = took.moved;
                    }
                }
                let ms = ms.map(median);
                points.push((100.0 * moved, (ms[1] + ms[3]) / (ms[0] + ms[2])));
                let round = |x: f64| json!((x * 1e3).round() / 1e3);
                let mut row = vec![
                    json!(name),
                    json!(frame.field.name()),
                    json!(count),
                    json!(factor),
                    json!(points_of(&frame)),
                    round(100.0 * moved),
                ];
                row.extend(ms.map(round));
                sheet.rows.push(row);
            }
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let name = format!("{name}, {}", frame.field.name());
            series.push(Series { name, points, joined: true });
        }
    }
    report.charts.push(Chart {
        name: "merging".to_owned(),
        title: "Points merged against taken anew".to_owned(),
        axes: [
            "points that moved, %".to_owned(),
            "light field and segments, time merged / anew".to_owned(),
        ],
        log_x: false,
        series,
    });
    report.sheets.push(sheet);
    Ok(report)
}

fn edits(scene: &Scene) -> impl Iterator<Item = (usize, f64)> {
    (1..=scene.materials.len()).flat_map(|count| FACTORS.map(|factor| (count, factor)))
}

/// With another extinction of its first materials.
fn thinned(scene: &Scene, count: usize, factor: f64) -> Scene {
    let mut after = scene.clone();
    after.materials[..count].iter_mut().for_each(|m| m.extinction *= factor);
    after
}

/// How many points there are.
fn points_of(frame: &PhotonFrame) -> u64 {
    frame.field.points().map_or(0, Points::count)
}

/// An update of a merge or of all anew.
struct Took {
    /// The share of the points that moved.
    moved: f64,
    phases: Phases,
}

fn update(gpu: &Gpu, frame: &mut PhotonFrame, scene: &Scene, anew: bool) -> Result<Took> {
    let split = Split { anew: Some(anew), ..Split::default() };
    frame.edit(gpu, scene, &split)?;
    frame.update(gpu, &split, &mut Progress::silent())?;
    let moved = frame.field.points().map_or(0, |points| points.elsewhere);
    let moved = moved as f64 / points_of(frame).max(1) as f64;
    Ok(Took { moved, phases: Phases::of_last(gpu)? })
}
