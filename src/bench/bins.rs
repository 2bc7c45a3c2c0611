//! Which bins histories should have: shares of photons and segments invalidated, how many
//! of those changed, and the flights traced again if a photon had but one history.

use serde_json::json;

use super::{Effort, Report, Sheet, built_in, edited, percent};
use crate::error::Result;
use crate::frame::DeviceScene;
use crate::gpu::Gpu;
use crate::render::{Progress, Split};
use crate::scene::Scene;
use crate::transfer::{BINS, Bins, TABLE_ENTRIES};
use crate::update::PhotonFrame;
use crate::volume::Volume;

/// Scenes with an edit of a material's density.
const EDITS: [(&str, &str, f64); 7] = [
    ("hand", "skin", 0.5),
    ("hand", "vessels", 0.05),
    ("hand", "bone", 1.25),
    ("engine", "block", 0.07),
    ("torso", "skin", 4.0),
    ("kidneys", "cortex", 2.0),
    ("kidneys", "contents", 0.0),
];

/// Measures every kind of bins on every edit.
///
/// # Errors
/// Memory does not suffice; the device failed.
pub fn run(gpu: &Gpu, effort: Effort, progress: &mut Progress) -> Result<Report> {
    let mut report = Report::new(gpu, "bins", effort);
    let columns = [
        "scene",
        "edit",
        "bins",
        "invalid %",
        "changed %",
        "precision",
        "segments %",
        "flights, history per slot %",
        "flights, history per photon %",
        "update ms",
    ];
    let mut sheet = Sheet::new("bins", &columns);
    for (i, (name, material, factor)) in EDITS.into_iter().enumerate() {
        progress.at("bins", i as u64, EDITS.len() as u64);
        let mut scene = built_in(name)?;
        scene.scale(effort.scale);
        scene.settings.rays = 1;
        let volume = scene.volume.load()?;
        scene.settle(&volume);
        let mut after = scene.clone();
        for m in after.materials.iter_mut().filter(|m| m.name == material) {
            m.extinction *= factor;
        }
        for (label, bins) in kinds(&volume) {
            let silent = &mut Progress::silent();
            let device = DeviceScene::with_bins(gpu, &scene, &volume, bins)?;
            let mut frame = PhotonFrame::new(gpu, &scene, device, 1, &Split::default())?;
            frame.rebuild(gpu, &Split::default(), silent)?;
            let flights = flights(gpu, &mut frame, (&scene, &after))?;
            let edit = edited(gpu, &mut frame, (&scene, &after), effort.runs, silent)?;
            let (u, c) = (&edit.updated, &edit.updated.counts);
            let round = |x: f64| json!((x * 1e3).round() / 1e3);
            sheet.rows.push(vec![
                json!(name),
                json!(format!("{material} x {factor}")),
                json!(label),
                round(percent(c.invalid, u.photons)),
                round(percent(c.changed, u.photons)),
                round(c.changed as f64 / u.listed.max(1) as f64),
                round(percent(u.recomputed, u.segments)),
                round(percent(flights[0], flights[2])),
                round(percent(flights[1], flights[2])),
                round(edit.cost.total),
            ]);
        }
    }
    report.sheets.push(sheet);
    Ok(report)
}

/// The kinds of bins that are compared. `32` uses half of the word.
fn kinds(volume: &Volume) -> Vec<(&'static str, Bins)> {
    let mut all = Vec::new();
    let mut thirty_two = Bins::uniform(1);
    thirty_two.bin_of_entry.iter_mut().for_each(|bin| *bin /= 2);
    all.push(("32 values", thirty_two));
    for (label, classes) in
        [("64 values", 1), ("32 values x 2 marks", 2), ("16 x 4", 4), ("8 x 8", 8)]
    {
        all.push((label, Bins::uniform(classes)));
    }
    for (label, classes) in [("64 equalised", 1), ("16 equalised x 4", 4)] {
        all.push((label, equalised(volume, classes)));
    }
    all
}

/// Bins that each hold about as many voxels, the emptiest value aside.
fn equalised(volume: &Volume, mark_classes: u32) -> Bins {
    let mut counts = volume.histogram(TABLE_ENTRIES);
    // Half of a scan is air of one value: it gets the share of the fullest of the others.
    let mut sorted = counts.clone();
    sorted.sort_unstable();
    let cap = sorted[TABLE_ENTRIES - TABLE_ENTRIES / 64].max(1);
    counts.iter_mut().for_each(|n| *n = (*n).min(cap));
    let total: u64 = counts.iter().sum::<u64>().max(1);
    let mut below = 0;
    let bin_of_entry = counts.iter().map(|n| {
        let bin = (below * BINS as u64 / total).min(BINS as u64 - 1);
        below += n;
        bin as u32
    });
    Bins { bin_of_entry: bin_of_entry.collect(), mark_classes }
}

/// Flights that an edit has traced again from each photon's first invalid slot, the same if
/// a photon had one history, and all that there are.
fn flights(
    gpu: &Gpu,
    frame: &mut PhotonFrame,
    (before, after): (&Scene, &Scene),
) -> Result<[u64; 3]> {
    let split = Split::default();
    // Abandoned as soon as it has listed what to trace.
    frame.edit(gpu, after, &split)?;
    frame.update(gpu, &split, &mut Progress::until(&mut |_| true))?;
    let mut counts = [0; 3];
    for batch in &frame.map.batches {
        let tasks = gpu.read::<u32>("bins", &batch.tasks)?;
        let states = gpu.read::<[u32; 4]>("bins", &batch.states)?;
        for (slot, state) in states.iter().enumerate() {
            let (event, photon) = (slot as u32 / batch.photons, slot % batch.photons as usize);
            let flown = u64::from(state[1] >> 30 != 0);
            let retraced = tasks[photon] >> 8 & 0xff;
            counts[0] += flown * u64::from(event >= retraced);
            counts[1] += flown * u64::from(retraced != 0xff);
            counts[2] += flown;
        }
    }
    frame.edit(gpu, before, &split)?;
    frame.update(gpu, &split, &mut Progress::silent())?;
    Ok(counts)
}
