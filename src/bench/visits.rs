//! Whether an update's time is in proportion to its work: edits of growing size on the
//! built-in scenes, stage by stage, against a full rebuild.

use glam::DVec3;
use serde_json::json;

use super::runs::{edit, in_turn, median, rebuild, warm};
use super::{Chart, Effort, Report, Series, Sheet};
use super::{built_in, without_histories};
use crate::error::Result;
use crate::gpu::Gpu;
use crate::measure::{self, Cost};
use crate::render::{Progress, Split};
use crate::scene::{Estimator, LightKind, Scene};
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

/// A stage's kernels and what it visits. Points are visited where their light changed; in a full
/// rebuild all come.
type Stage = (&'static str, &'static [&'static str], fn(&Updated) -> u64);

const STAGES: [Stage; 4] = [
    (
        "trace",
        &["trace", "weigh", "photon_query", "journal", "compare", "chosen", "list_rank", "list"],
        |u| u.counts.steps + u.counts.tentative,
    ),
    ("deposit", &["deposit", "resolve"], |u| u.counts.deposits),
    (
        "points",
        &[
            "points_mark",
            "points_keep",
            "points_key",
            "sort_count",
            "sort_scatter",
            "points_merge",
            "points_order",
            "points_mean",
            "points_record",
            "points_starts",
            "points_dirty",
            "points_take",
            "points_join",
            "points_place",
            "points_arrange",
            "points_origins",
        ],
        |u| u.points,
    ),
    ("segment", &["segment", "segment_query", "composite"], |u| {
        u.counts.samples + u.counts.gathered
    }),
];

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
    let mut series = STAGES.map(|(name, _, _)| Series {
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
            in_turn(1, [&mut edit(gpu, &mut frame, (&scene, after))])?;
        }
        for (what, after) in edits(&scene) {
            let (kind, materials) = what;
            let mut fastest = measure::fresh(gpu, &without_histories(&after), &volume)?;
            warm(gpu, &mut fastest)?;
            let [full, update] = in_turn(
                effort.runs,
                [&mut rebuild(gpu, &mut fastest), &mut edit(gpu, &mut frame, (&scene, &after))],
            )?;
            let label = [json!(name), json!(estimator.to_string()), json!(kind), json!(materials)];
            for ((stage, kernels, visits), series) in STAGES.iter().zip(&mut series) {
                let (all, some) = (visits(&full.updated), visits(&update.updated));
                let ms = |cost: &Cost| cost.in_kernels(kernels);
                let full_ms = full.median(ms);
                if all == 0 || full_ms == 0.0 {
                    continue;
                }
                let share = some as f64 / all as f64;
                let time = median(update.over(&full, ms));
                series.points.push((share.max(1e-3), time));
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
    let mut series = series.to_vec();
    let curve = (0..=30).map(|i| 10_f64.powf(-3.0 + 0.1 * f64::from(i)));
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
    let at = |name: &str| columns.iter().position(|c| *c == name).unwrap_or_default();
    let [stage_at, within_at] = [at("stage"), at("within")];
    report.notes.push(format!("{} edits", whole.rows.len()));
    for (stage, ..) in STAGES {
        let rows = sheet.rows.iter().filter(|row| row[stage_at] == json!(stage));
        let within = rows.clone().filter(|row| row[within_at] == json!(true)).count();
        let all = rows.count();
        report.notes.push(format!("{stage}: {within} of {all} are within the bound"));
    }
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
