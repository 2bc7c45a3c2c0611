//! Figures 7 to 9 of the Historygrams paper: an edit's cost over the number of photons,
//! for one and two events, and over the number of segments.

use serde_json::json;

use super::runs::{edit, in_turn, median, rebuild};
use super::{Chart, Effort, Report, Series, Sheet};
use super::{built_in, percent, without_histories};
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::measure;
use crate::scene::{Estimator, Scale, Scene, Spatial, Weighting};
use crate::split::Split;

/// Photons at full scale, as the paper has them.
const PHOTONS: [u64; 5] = [250_000, 500_000, 1_000_000, 2_000_000, 4_000_000];
const SEGMENTS: [u32; 6] = [1, 2, 4, 7, 14, 28];
const SCENES: [(&str, &str, &str); 2] =
    [("figure7", "cornell", "sphere"), ("figure8", "kidneys", "vessels")];

/// The paper's settings, and the exact estimator that we would use.
const VARIANTS: [(&str, Estimator, Spatial); 2] = [
    ("points as in the paper", Estimator::Points, Spatial::Off),
    ("fluence exact", Estimator::Fluence, Spatial::Exact),
];

/// Measures all three figures.
///
/// # Errors
/// Memory does not suffice; the device failed.
pub fn run(gpu: &Gpu, effort: Effort, progress: &mut Progress) -> Result<Report> {
    let mut report = Report::new(gpu, "sweeps", effort);
    let of_axis = |first: &str, name: &str| {
        Sheet::new(
            name,
            &[
                "variant",
                first,
                "events",
                "full ms",
                "update ms",
                "trace ms",
                "gather ms",
                "retraced %",
                "reweighed %",
                "recomputed %",
                "speed-up",
            ],
        )
    };
    let shrink = match effort.scale {
        Scale::Small => 16,
        Scale::Medium => 4,
        Scale::Full => 1,
    };
    for (figure, scene, edit) in SCENES {
        let mut sheet = of_axis("photons", figure);
        let mut speed = chart(&format!("{figure}-speedup"), scene, "photons", "speed-up");
        let mut times = chart(&format!("{figure}-times"), scene, "photons", "update, ms");
        for (variant, estimator, spatial) in VARIANTS {
            for events in [1, 2] {
                let mut points: [Vec<(f64, f64)>; 3] = Default::default();
                for (i, photons) in PHOTONS.iter().map(|p| p / shrink).enumerate() {
                    progress.at(figure, i as u64, PHOTONS.len() as u64);
                    let change = |s: &mut Scene| {
                        (s.settings.photons, s.settings.max_events) = (photons, events);
                    };
                    let case = Case { scene, edit, estimator, spatial };
                    let row = measured(gpu, effort, case, &change)?;
                    let x = photons as f64;
                    points[0].push((x, row.speedup));
                    points[1].push((x, row.trace));
                    points[2].push((x, row.gather));
                    sheet.rows.push(row.cells(variant, photons, events));
                }
                let [speedups, traces, gathers] = points;
                let series = |name: String, points| Series { name, points, joined: true };
                speed.series.push(series(format!("{variant}, {events} events"), speedups));
                if events == 1 {
                    times.series.push(series(format!("{variant}, photons"), traces));
                    times.series.push(series(format!("{variant}, segments"), gathers));
                }
            }
        }
        report.sheets.push(sheet);
        report.charts.extend([speed, times]);
    }
    let mut sheet = of_axis("segments", "figure9");
    let mut times = chart("figure9", "cornell and kidneys", "segments of a ray", "update, ms");
    times.log_x = true;
    for (_, scene, edit) in SCENES {
        for (variant, estimator, spatial) in VARIANTS {
            let mut points = Vec::new();
            for (i, segments) in SEGMENTS.into_iter().enumerate() {
                progress.at("figure9", i as u64, SEGMENTS.len() as u64);
                let change = |s: &mut Scene| {
                    (s.settings.segments, s.settings.max_events) = (segments, 1);
                    s.settings.photons = 2_100_000 / shrink;
                };
                let case = Case { scene, edit, estimator, spatial };
                let row = measured(gpu, effort, case, &change)?;
                points.push((f64::from(segments), row.update));
                let label = format!("{scene}, {variant}");
                sheet.rows.push(row.cells(&label, segments.into(), 1));
            }
            times.series.push(Series { name: format!("{scene}, {variant}"), points, joined: true });
        }
    }
    report.sheets.push(sheet);
    report.charts.push(times);
    Ok(report)
}

fn chart(name: &str, scene: &str, x: &str, y: &str) -> Chart {
    Chart {
        name: name.to_owned(),
        title: format!("{scene}: {y} over {x}"),
        axes: [x.to_owned(), y.to_owned()],
        log_x: true,
        series: Vec::new(),
    }
}

/// What is measured.
#[derive(Clone, Copy)]
struct Case {
    scene: &'static str,
    edit: &'static str,
    estimator: Estimator,
    spatial: Spatial,
}

struct Row {
    full: f64,
    update: f64,
    trace: f64,
    gather: f64,
    shares: [f64; 3],
    speedup: f64,
}

impl Row {
    fn cells(&self, variant: &str, x: u64, events: u32) -> Vec<serde_json::Value> {
        let [retraced, reweighed, recomputed] = self.shares;
        let numbers = [
            self.full,
            self.update,
            self.trace,
            self.gather,
            retraced,
            reweighed,
            recomputed,
            self.speedup,
        ];
        let mut cells = vec![json!(variant), json!(x), json!(events)];
        cells.extend(numbers.map(|n| json!((n * 1e3).round() / 1e3)));
        cells
    }
}

fn measured(gpu: &Gpu, effort: Effort, case: Case, change: &dyn Fn(&mut Scene)) -> Result<Row> {
    let mut scene = built_in(case.scene)?;
    scene.scale(effort.scale);
    change(&mut scene);
    let settings = &mut scene.settings;
    (settings.estimator, settings.weighting) = (Some(case.estimator), Weighting::Plain);
    (settings.spatial, settings.rays) = (case.spatial, 1);
    let volume = scene.volume.load()?;
    scene.settle(&volume);
    let after = scene.edited(case.edit)?;
    let mut fastest = measure::fresh(gpu, &without_histories(&after), &volume)?;
    let mut frame = measure::fresh(gpu, &scene, &volume)?;
    frame.rebuild(gpu, &Split::default(), &mut Progress::silent())?;
    let [full, update] = in_turn(
        effort.runs,
        [&mut rebuild(gpu, &mut fastest), &mut edit(gpu, &mut frame, &scene, &after)],
    )?;
    let u = &update.updated;
    Ok(Row {
        full: full.median(|cost| cost.total),
        update: update.median(|cost| cost.total),
        trace: update.median(|cost| cost.phases.photons),
        gather: update.median(|cost| cost.phases.segments),
        shares: [
            percent(u.counts.invalid, u.photons),
            percent(u.counts.reweighed, u.photons),
            percent(u.recomputed, u.segments),
        ],
        speedup: median(full.over(&update, |cost| cost.total)),
    })
}
