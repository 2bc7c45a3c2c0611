//! Our counterpart of the Historygrams paper's table 1: its seven edits on phantoms that
//! stand in for its scans, beside its figures.

use serde_json::json;

use super::runs::{edit, in_turn, median, rebuild, warm};
use super::{Chart, Effort, Report, Series, Sheet};
use super::{built_in, percent, without_histories};
use crate::error::Result;
use crate::film::metrics::Metrics;
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::history::Query;
use crate::measure::{self, Cost};
use crate::photon::State;
use crate::scene::{Estimator, Scene, Spatial, Weighting};
use crate::split::Split;
use crate::update::PhotonFrame;

/// A row of the paper's table. Photons and segments are those of the scene.
struct Row {
    name: &'static str,
    scene: &'static str,
    edit: &'static str,
    /// S_n; the paper tells it for the engine (2), and single from multiple scattering for
    /// the others.
    events: u32,
    samples_per_voxel: f64,
    paper: Paper,
}

/// What the paper has for a row, by the names of the sheet's columns.
type Paper = [f64; PAPER.len()];

const PAPER: [&str; 10] = [
    "paper photons",
    "paper segments",
    "paper full trace s",
    "paper full gather s",
    "paper overhead %",
    "paper trace s",
    "paper retraced %",
    "paper gather s",
    "paper recomputed %",
    "paper speed-up",
];

#[rustfmt::skip]
const ROWS: [Row; 7] = [
    row("hand, bone", "hand", "bone", 16, 8.0,
        [2.1e6, 10.0, 0.22, 1.97, 16.0, 0.10, 19.0, 1.63, 29.0, 1.3]),
    row("cornell, sphere", "cornell", "sphere", 1, 2.0,
        [4.2e6, 7.0, 0.32, 9.11, 26.0, 0.04, 3.0, 0.57, 18.0, 15.2]),
    row("engine, material", "engine", "material", 2, 4.0,
        [2.1e6, 10.0, 0.37, 5.41, 5.0, 0.10, 5.0, 0.64, 19.0, 7.7]),
    row("torso, skin", "torso", "skin", 1, 1.5,
        [2.1e6, 9.0, 0.37, 1.31, 25.0, 0.25, 74.0, 0.43, 24.0, 2.4]),
    row("torso, vessels", "torso", "vessels", 1, 1.5,
        [2.1e6, 9.0, 0.23, 1.32, 3.0, 0.15, 71.0, 1.11, 100.0, 1.2]),
    row("kidneys, vessels", "kidneys", "vessels", 1, 4.0,
        [1.6e6, 7.0, 0.11, 1.25, 8.0, 0.03, 24.0, 0.16, 4.0, 6.8]),
    row("kidneys, contents", "kidneys", "contents", 1, 4.0,
        [1.6e6, 7.0, 0.11, 0.95, 11.0, 0.07, 35.0, 0.25, 9.0, 3.2]),
];

const fn row(
    name: &'static str,
    scene: &'static str,
    edit: &'static str,
    events: u32,
    samples_per_voxel: f64,
    paper: Paper,
) -> Row {
    Row { name, scene, edit, events, samples_per_voxel, paper }
}

impl Row {
    fn paper_speedup(&self) -> f64 {
        self.paper[PAPER.len() - 1]
    }
}

/// How the light is estimated, and which segments an edit recomputes.
struct Variant {
    name: &'static str,
    estimator: Estimator,
    weighting: Weighting,
    spatial: Spatial,
}

const VARIANTS: [Variant; 3] = [
    Variant {
        name: "points as in the paper",
        estimator: Estimator::Points,
        weighting: Weighting::Plain,
        spatial: Spatial::Off,
    },
    Variant {
        name: "points exact",
        estimator: Estimator::Points,
        weighting: Weighting::Even,
        spatial: Spatial::Exact,
    },
    Variant {
        name: "fluence exact",
        estimator: Estimator::Fluence,
        weighting: Weighting::Even,
        spatial: Spatial::Exact,
    },
];

const COLUMNS: [&str; 27] = [
    "edit",
    "variant",
    "photons",
    "events",
    "samples/voxel",
    "segments",
    "full trace ms",
    "full field ms",
    "full gather ms",
    "full total ms",
    "overhead %",
    "touched %",
    "of those that interact %",
    "retraced %",
    "reweighed %",
    "changed %",
    "precision",
    "recomputed %",
    "trace ms",
    "field ms",
    "gather ms",
    "total ms",
    "waits for the device",
    "speed-up",
    "mismatches",
    "relMSE of stale light",
    "above paper",
];

const MEMORY: [&str; 11] = [
    "edit",
    "variant",
    "history B/photon",
    "paper history B/photon",
    "lists B/photon",
    "points at most B/photon",
    "journal MiB",
    "history MiB/segment layer",
    "lists MiB/segment layer",
    "B/segment",
    "paper B/segment",
];

/// Measures all rows.
///
/// # Errors
/// Memory does not suffice; the device failed.
pub fn run(gpu: &Gpu, effort: Effort, progress: &mut Progress) -> Result<Report> {
    let mut report = Report::new(gpu, "table1", effort);
    let mut sheet = Sheet::new("table1", &[&COLUMNS[..], &PAPER].concat());
    let mut memory = Sheet::new("table1-memory", &MEMORY);
    let mut speedups: Vec<Series> =
        ["the paper", VARIANTS[0].name, VARIANTS[1].name, VARIANTS[2].name]
            .map(|name| Series { name: name.to_owned(), points: Vec::new(), joined: false })
            .into();
    let total = (ROWS.len() * VARIANTS.len()) as u64;
    for (number, row) in ROWS.iter().enumerate() {
        let at = number as f64 + 1.0;
        speedups[0].points.push((at, row.paper_speedup()));
        for (v, variant) in VARIANTS.iter().enumerate() {
            progress.at("table 1", (number * VARIANTS.len() + v) as u64, total);
            let measured = measured(gpu, effort, row, variant)?;
            report.mismatches += measured.wrong;
            speedups[v + 1].points.push((at, measured.speedup));
            sheet.rows.push(measured.figures);
            memory.rows.push(measured.memory);
        }
    }
    report.notes.push(
        "touched: photons whose flights or whose light the edit may change, also of those alone \
         that interact at all, since many miss the phantoms in their bounds; retraced: \
         photons with a flight that is flown again, all of it or in part; reweighed: photons with \
         a slot of which only the power was found again; precision: changed / (retraced or \
         reweighed). Mismatches are against a rebuild by the same kernels; the paper's settings \
         (spatial off) leave stale light and have some; relMSE of stale light: of the updated \
         image against the rebuilt one."
            .to_owned(),
    );
    report.charts.push(Chart {
        name: "table1".to_owned(),
        title: "Speed-up of an update over a full rebuild, by row of table 1".to_owned(),
        axes: ["row of the table".to_owned(), "speed-up".to_owned()],
        log_x: false,
        series: speedups,
    });
    report.sheets = vec![sheet, memory];
    Ok(report)
}

fn scene_of(row: &Row, variant: &Variant, effort: Effort) -> Result<Scene> {
    let mut scene = built_in(row.scene)?;
    scene.scale(effort.scale);
    let settings = &mut scene.settings;
    settings.estimator = Some(variant.estimator);
    settings.weighting = variant.weighting;
    settings.spatial = variant.spatial;
    settings.max_events = row.events;
    settings.roulette_from = row.events.max(settings.roulette_from);
    settings.step = 1.0 / row.samples_per_voxel;
    settings.rays = 1;
    Ok(scene)
}

/// One variant of one row, measured.
struct Measured {
    speedup: f64,
    /// What differs that must not.
    wrong: u64,
    /// Its row in the sheet.
    figures: Vec<serde_json::Value>,
    /// Its row in the sheet of bytes.
    memory: Vec<serde_json::Value>,
}

fn measured(gpu: &Gpu, effort: Effort, row: &Row, variant: &Variant) -> Result<Measured> {
    let mut scene = scene_of(row, variant, effort)?;
    let volume = scene.volume.load()?;
    scene.settle(&volume);
    let after = scene.edited(row.edit)?;
    let silent = &mut Progress::silent();
    let mut fastest = measure::fresh(gpu, &without_histories(&after), &volume)?;
    let mut fresh = measure::fresh(gpu, &after, &volume)?;
    let mut frame = measure::fresh(gpu, &scene, &volume)?;
    frame.rebuild(gpu, &Split::default(), silent)?;
    let touched = touched(gpu, &frame, &after)?;
    warm(gpu, &mut fastest)?;
    let [full, kept, update] = in_turn(
        effort.runs,
        [
            &mut rebuild(gpu, &mut fastest),
            &mut rebuild(gpu, &mut fresh),
            &mut edit(gpu, &mut frame, &scene, &after),
        ],
    )?;
    measure::update(gpu, &mut frame, &after, silent)?;
    let mismatches = measure::compare(gpu, &frame, &fresh)?;
    let [shown, right] = [&frame, &fresh].map(|frame| frame.segments.image(gpu));
    let stale = Metrics::of(&shown?, &right?)?.rel_mse;

    let updated = &update.updated;
    let (photons, counts) = (updated.photons, &updated.counts);
    let speedup = median(full.over(&update, |cost| cost.total));
    let overhead_here = 100.0 * (median(kept.over(&full, Cost::kernels)) - 1.0);
    let (full, cost) = (full.typical(), update.typical());
    let round = |x: f64| json!((x * 1e3).round() / 1e3);
    let mut figures = vec![
        json!(row.name),
        json!(variant.name),
        json!(photons),
        json!(row.events),
        json!(row.samples_per_voxel),
        json!(scene.settings.segments),
        round(full.phases.photons),
        round(full.phases.light_field),
        round(full.phases.segments),
        round(full.total),
        round(overhead_here),
        round(percent(touched.photons, photons)),
        round(percent(touched.of_interacting, touched.interacting)),
        round(percent(counts.invalid, photons)),
        round(percent(counts.reweighed, photons)),
        round(percent(counts.changed, photons)),
        match updated.listed {
            0 => json!(null),
            listed => round(counts.changed as f64 / listed as f64),
        },
        round(percent(updated.recomputed, updated.segments)),
        round(cost.phases.photons),
        round(cost.phases.light_field),
        round(cost.phases.segments),
        round(cost.total),
        json!(cost.effort.waits),
        round(speedup),
        json!(mismatches.all()),
        json!(stale),
        json!(speedup > row.paper_speedup()),
    ];
    figures.extend(row.paper.map(|x| json!(x)));
    let lists = frame.list_bytes();
    let of_means = frame.field.history_bytes();
    let per_photon = |bytes: u64| round(bytes as f64 / photons as f64);
    let per_layer =
        |bytes: u64| round(bytes as f64 / f64::from(scene.settings.segments) / 1_048_576.0);
    let memory = vec![
        json!(row.name),
        json!(variant.name),
        per_photon(8 * u64::from(row.events) * photons + of_means),
        // Its section 6.2.1: a historygram for each interaction; one and a colour for each segment.
        json!(8 * row.events),
        per_photon(lists.photons),
        per_photon(lists.points),
        round(lists.journal as f64 / 1_048_576.0),
        per_layer(8 * updated.segments),
        per_layer(lists.segments),
        json!(frame.segments.segment_bytes()),
        json!(16),
    ];
    // Segments that never ask for light may be stale.
    let wrong =
        if variant.spatial == Spatial::Off { mismatches.of_light() } else { mismatches.all() };
    Ok(Measured { speedup, wrong, figures, memory })
}

#[derive(Default)]
struct Touched {
    photons: u64,
    /// Photons that interact at all.
    interacting: u64,
    /// Those of them that are touched.
    of_interacting: u64,
}

/// Photons that an edit may change, by the histories and entries of their slots: more than
/// those that are traced or weighed again, since what changes in a last slot is weighed by
/// the light field.
fn touched(gpu: &Gpu, frame: &PhotonFrame, after: &Scene) -> Result<Touched> {
    let device = &frame.scene;
    let table = device.table_of(after)?;
    let query = Query::between(&device.table, &table, &device.bins, device.params.majorant);
    let mut found = Touched::default();
    for batch in &frame.map.batches {
        let states = gpu.read::<State>("table 1", &batch.states)?;
        let photons = batch.photons as usize;
        for photon in 0..photons {
            let slots = states.iter().skip(photon).step_by(photons);
            let hit = slots.clone().any(|state| {
                let changed = query.changes[state.entry()] != 0;
                state.history() & query.risen != 0 || state.interacts() && changed
            });
            let interacts = states[photon].interacts();
            found.photons += u64::from(hit);
            found.interacting += u64::from(interacts);
            found.of_interacting += u64::from(hit && interacts);
        }
    }
    Ok(found)
}
