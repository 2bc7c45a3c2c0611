//! Which bins histories should have: shares of photons and segments invalidated, how many
//! of those changed, the flights traced again if a photon had but one history, and what
//! histories of two words would find.

use serde_json::json;

use super::{Effort, Report, Sheet, built_in, edited, percent};
use crate::error::Result;
use crate::frame::DeviceScene;
use crate::gpu::Gpu;
use crate::query::{CHANGE_FALLEN, Query};
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
        "flights, history per slot %",
        "flights, history per photon %",
        "segments %",
        "update ms",
    ];
    let mut sheet = Sheet::new("bins", &columns);
    let round = |x: f64| json!((x * 1e3).round() / 1e3);
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
        let start =
            |label: &str, invalid: u64, (photons, changed): (u64, u64), flights: Flights| {
                vec![
                    json!(name),
                    json!(format!("{material} x {factor}")),
                    json!(label),
                    round(percent(invalid, photons)),
                    round(percent(changed, photons)),
                    round(changed as f64 / invalid.max(1) as f64),
                    round(percent(flights.per_slot, flights.all)),
                    round(percent(flights.per_photon, flights.all)),
                ]
            };
        let (mut photons, mut changed) = (0, 0);
        for (label, bins) in kinds(&volume) {
            let silent = &mut Progress::silent();
            let device = DeviceScene::with_bins(gpu, &scene, &volume, bins)?;
            let mut frame = PhotonFrame::new(gpu, &scene, device, 1, &Split::default())?;
            frame.rebuild(gpu, &Split::default(), silent)?;
            let flights = flights(gpu, &mut frame, (&scene, &after))?;
            let edit = edited(gpu, &mut frame, (&scene, &after), effort.runs, silent)?;
            let (u, c) = (&edit.updated, &edit.updated.counts);
            (photons, changed) = (u.photons, c.changed);
            let mut row = start(label, c.invalid, (photons, changed), flights);
            row.extend([round(percent(u.recomputed, u.segments)), round(edit.cost.total)]);
            sheet.rows.push(row);
        }
        for (label, classes) in [("128 values", 1), ("64 x 2", 2), ("32 x 4", 4), ("16 x 8", 8)] {
            let (invalid, flights) = two_words(gpu, (&scene, &after), &volume, classes)?;
            let mut row = start(label, invalid, (photons, changed), flights);
            row.extend([json!(null), json!(null)]);
            sheet.rows.push(row);
        }
    }
    report.notes.push(
        "Two words are four histories of 32 bits put together: which photons they would find, \
         not how long that takes. A slot would grow from 32 bytes to 40."
            .to_owned(),
    );
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

/// Flights of all photons.
#[derive(Clone, Copy, Default)]
struct Flights {
    /// Those that an edit has traced again, from each photon's first invalid slot.
    per_slot: u64,
    /// The same, if a photon had but one history.
    per_photon: u64,
    all: u64,
}

impl Flights {
    /// Adds the flights of a batch, given the event from which each photon is traced again.
    fn add(&mut self, states: &[[u32; 4]], photons: usize, from: impl Fn(usize) -> u32) {
        for (slot, state) in states.iter().enumerate() {
            let (event, from) = ((slot / photons) as u32, from(slot % photons));
            let flown = u64::from(kind(state) != 0);
            self.per_slot += flown * u64::from(event >= from);
            self.per_photon += flown * u64::from(from != VALID);
            self.all += flown;
        }
    }
}

/// In place of an event: the photon is not traced again.
const VALID: u32 = 0xff;

/// What a slot is: 0 nothing, 1 an interaction, else an exit.
fn kind(state: &[u32; 4]) -> u32 {
    state[1] >> 30
}

/// Flights that an edit has traced again.
fn flights(
    gpu: &Gpu,
    frame: &mut PhotonFrame,
    (before, after): (&Scene, &Scene),
) -> Result<Flights> {
    let split = Split::default();
    // Abandoned as soon as it has listed what to trace.
    frame.edit(gpu, after, &split)?;
    frame.update(gpu, &split, &mut Progress::until(&mut |_| true))?;
    let mut flights = Flights::default();
    for batch in &frame.map.batches {
        let tasks = gpu.read::<u32>("bins", &batch.tasks)?;
        let states = gpu.read::<[u32; 4]>("bins", &batch.states)?;
        flights.add(&states, batch.photons as usize, |photon| tasks[photon] >> 8 & 0xff);
    }
    frame.edit(gpu, before, &split)?;
    frame.update(gpu, &split, &mut Progress::silent())?;
    Ok(flights)
}

/// Photons that histories of 128 bits would find invalid, and their flights: those that any
/// of four histories finds, each of which knows a quarter of the bits.
fn two_words(
    gpu: &Gpu,
    (before, after): (&Scene, &Scene),
    volume: &Volume,
    mark_classes: u32,
) -> Result<(u64, Flights)> {
    const QUARTER: u32 = 32;
    // Values below the quarter share bin 0, those above it bin 40: no bit of theirs is asked.
    const FIRST: u32 = 8;
    const ASKED: u64 = (u32::MAX as u64) << FIRST;
    let split = Split::default();
    let (mut states, mut from) = (Vec::new(), Vec::<Vec<u32>>::new());
    for quarter in 0..4 {
        let bin_of = |entry: u32| match entry / (TABLE_ENTRIES as u32 / 128) {
            bin if bin < quarter * QUARTER => 0,
            bin => FIRST + (bin - quarter * QUARTER).min(QUARTER),
        };
        let bins =
            Bins { bin_of_entry: (0..TABLE_ENTRIES as u32).map(bin_of).collect(), mark_classes };
        let device = DeviceScene::with_bins(gpu, before, volume, bins)?;
        let mut frame = PhotonFrame::new(gpu, before, device, 1, &split)?;
        // The photons will do.
        let mut traced = |boundary| boundary == "light field";
        frame.rebuild(gpu, &split, &mut Progress::until(&mut traced))?;
        let device = &frame.scene;
        let table = device.table_of(after);
        let query = Query::between(&device.table, &table, &device.bins, device.frame.majorant);
        states.clear();
        from.resize_with(frame.map.batches.len(), Vec::new);
        for (batch, from) in frame.map.batches.iter().zip(&mut from) {
            let slots = gpu.read::<[u32; 4]>("bins", &batch.states)?;
            let photons = batch.photons as usize;
            from.resize(photons, VALID);
            for (photon, from) in from.iter_mut().enumerate() {
                let mut own = slots.iter().skip(photon).step_by(photons);
                let invalid = own.position(|slot| {
                    let history = u64::from(slot[2]) | u64::from(slot[3]) << 32;
                    let fallen = query.changes[(slot[1] >> 18 & 0xfff) as usize] & CHANGE_FALLEN;
                    history & query.risen & ASKED != 0 || kind(slot) == 1 && fallen != 0
                });
                *from = invalid.map_or(*from, |event| (event as u32).min(*from));
            }
            states.push(slots);
        }
    }
    let mut flights = Flights::default();
    for (slots, from) in states.iter().zip(&from) {
        flights.add(slots, from.len(), |photon| from[photon]);
    }
    let invalid = from.iter().flatten().filter(|&&event| event != VALID).count();
    Ok((invalid as u64, flights))
}
