//! Whether an update's time is in proportion to its work: edits of growing size on the
//! built-in scenes, stage by stage, against a full rebuild.

use glam::DVec3;
use serde_json::json;

use super::runs::{edit, in_turn, median, rebuild, warm};
use super::{Chart, Effort, Report, Series, Sheet};
use super::{built_in, without_histories};
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::measure::{self, Cost};
use crate::scene::{Estimator, LightKind, Scene};
use crate::split::Split;
use crate::update::Updated;

const SCENES: [(&str, Estimator); 7] = [
    ("hand", Estimator::Fluence),
    ("cornell", Estimator::Fluence),
    ("engine", Estimator::Fluence),
    ("torso", Estimator::Fluence),
    ("kidneys", Estimator::Fluence),
    ("hand", Estimator::Points),
    ("kidneys", Estimator::Points),
];

/// What a stage takes, ms, and what it visits.
type Stage = (&'static str, fn(&Cost) -> f64, fn(&Updated) -> u64);

/// With fluence, flights are deposited between traces.
const OF_FLUENCE: [Stage; 3] = [
    ("trace", |c| c.phases.photons + c.phases.light_field - deposits(c), flown),
    ("deposit", deposits, |u| u.counts.deposits),
    ("segment", |c| c.phases.segments, gathered),
];
/// A visit of points is a mean, a light or a place that one is given.
const OF_POINTS: [Stage; 3] = [
    ("trace", |c| c.phases.photons, flown),
    ("points", |c| c.phases.light_field, |u| u.points_built),
    ("segment", |c| c.phases.segments, gathered),
];

fn deposits(cost: &Cost) -> f64 {
    cost.in_kernels(&["deposit", "resolve"])
}

fn flown(updated: &Updated) -> u64 {
    updated.counts.steps + updated.counts.tentative
}

fn gathered(updated: &Updated) -> u64 {
    updated.counts.samples + updated.counts.gathered
}

/// The edit that touches everything.
const EVERYTHING: &str = "lights moved";

/// What a stage may cost beyond its share of the visits: `1.3 share + 0.1`.
fn bound(share: f64) -> f64 {
    1.3 * share + 0.1
}

/// Measures edits that recolour one material, then two, and so on, edits that halve their
/// extinction, and one that moves all lights, which touches everything.
///
/// # Errors
/// Memory does not suffice; the device failed.
pub fn run(gpu: &Gpu, effort: Effort, progress: &mut Progress) -> Result<Report> {
    let mut report = Report::new(gpu, "visits", effort);
    let columns = [
        "scene",
        "light field",
        "edit",
        "materials",
        "stage",
        "full visits",
        "visits",
        "full ms",
        "ms",
        "share of visits",
        "share of time",
        "within",
    ];
    let mut sheet = Sheet::new("visits", &columns);
    let whole_columns =
        ["scene", "light field", "edit", "materials", "full ms", "update ms", "ratio", "all"];
    let mut whole = Sheet::new("visits-whole", &whole_columns);
    let mut series = ["trace", "deposit", "points", "segment"].map(|name| Series {
        name: name.to_owned(),
        points: Vec::new(),
        joined: false,
    });
    let silent = &mut Progress::silent();
    for (i, (name, estimator)) in SCENES.into_iter().enumerate() {
        progress.at("visits", i as u64, SCENES.len() as u64);
        let mut scene = built_in(name)?;
        scene.scale(effort.scale);
        (scene.settings.estimator, scene.settings.rays) = (Some(estimator), 1);
        let volume = scene.volume.load()?;
        scene.settle(&volume);
        let mut frame = measure::fresh(gpu, &scene, &volume)?;
        frame.rebuild(gpu, &Split::default(), silent)?;
        // A driver may compile a kernel when it first runs.
        for (_, after) in edits(&scene).iter().take(2) {
            in_turn(1, [&mut edit(gpu, &mut frame, &scene, after)])?;
        }
        for (what, after) in edits(&scene) {
            let (kind, materials) = what;
            let mut fastest = measure::fresh(gpu, &without_histories(&after), &volume)?;
            warm(gpu, &mut fastest)?;
            let [full, update] = in_turn(
                effort.runs,
                [&mut rebuild(gpu, &mut fastest), &mut edit(gpu, &mut frame, &scene, &after)],
            )?;
            let label = [json!(name), json!(estimator.to_string()), json!(kind), json!(materials)];
            let stages = match estimator {
                Estimator::Fluence => OF_FLUENCE,
                Estimator::Points => OF_POINTS,
            };
            for (stage, ms, visits) in stages {
                let (all, some) = (visits(&full.updated), visits(&update.updated));
                let full_ms = full.median(ms);
                let share = some as f64 / all as f64;
                let time = median(update.over(&full, ms));
                let of_stage = series.iter_mut().filter(|series| series.name == stage);
                of_stage.for_each(|series| series.points.push((share.max(1e-3), time)));
                let mut row = label.to_vec();
                row.extend([
                    json!(stage),
                    json!(all),
                    json!(some),
                    json!(full_ms),
                    json!(update.median(ms)),
                    json!(share),
                    json!(time),
                    json!(time <= bound(share)),
                ]);
                sheet.rows.push(row);
            }
            let mut row = label.to_vec();
            row.extend([
                json!(full.median(|cost| cost.total)),
                json!(update.median(|cost| cost.total)),
                json!(median(update.over(&full, |cost| cost.total))),
                json!(kind == EVERYTHING),
            ]);
            whole.rows.push(row);
        }
    }
    let at = |name: &str| columns.iter().position(|c| *c == name).unwrap_or_default();
    let [stage_at, within_at] = [at("stage"), at("within")];
    report.notes.push(format!("{} edits", whole.rows.len()));
    let curve = (0..=30).map(|i| 10_f64.powf(-3.0 + 0.1 * f64::from(i)));
    let mut series = series.to_vec();
    for name in series.iter().map(|series| &series.name) {
        let rows = sheet.rows.iter().filter(|row| row[stage_at] == json!(name));
        let within = rows.clone().filter(|row| row[within_at] == json!(true)).count();
        report.notes.push(format!("{name}: {within} of {} are within the bound", rows.count()));
    }
    series.push(Series {
        name: "1.3 x share of visits + 0.1".to_owned(),
        points: curve.map(|x| (x, bound(x))).collect(),
        joined: true,
    });
    report.charts.push(Chart {
        name: "visits".to_owned(),
        title: "Stages of updates against a full rebuild: time over visits".to_owned(),
        axes: ["share of visits".to_owned(), "share of time".to_owned()],
        log_x: true,
        series,
    });
    report.sheets = vec![sheet, whole];
    Ok(report)
}

/// Edits of one material, of two, and so on; then all lights moved.
fn edits(scene: &Scene) -> Vec<((&'static str, usize), Scene)> {
    let mut all = Vec::new();
    for count in 1..=scene.materials.len() {
        for kind in ["colour", "extinction"] {
            let mut after = scene.clone();
            for material in &mut after.materials[..count] {
                match kind {
                    "colour" => material.colour *= 0.7,
                    _ => material.extinction *= 0.5,
                }
            }
            all.push(((kind, count), after));
        }
    }
    let mut moved = scene.clone();
    for light in &mut moved.lights {
        match &mut light.kind {
            LightKind::Point { position } => *position *= 0.9,
            LightKind::Rectangle { corner, edge_u, .. } => *corner += 0.25 * *edge_u,
            LightKind::Directional { direction } => *direction += 0.1 * DVec3::Z,
            _ => {}
        }
    }
    all.push(((EVERYTHING, 0), moved));
    all
}
