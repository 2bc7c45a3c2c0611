//! Which bins histories should have: shares of photons and segments invalidated, how many
//! of those changed, the flights found invalid, also if a photon had but one history, and
//! what histories of two words would find.

use serde_json::json;

use super::runs::{edit, in_turn, rebuild, warm};
use super::{Effort, Report, Sheet, built_in, percent};
use crate::device_scene::{DeviceScene, Storage};
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::history::{Bins, CHANGE_FALLEN, Query};
use crate::photon::{SLOT_BYTES, State};
use crate::scene::Scene;
use crate::split::Split;
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
        "slot B",
        "full ms",
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
        for (label, bins) in kinds() {
            let device = DeviceScene::stored(gpu, &scene, &volume, &stored(bins))?;
            let mut frame = PhotonFrame::new(gpu, &scene, device, &Split::default())?;
            warm(gpu, &mut frame)?;
            let [full] = in_turn(effort.runs, [&mut rebuild(gpu, &mut frame)])?;
            let flights = flights(gpu, &frame, &after)?;
            let [edited] = in_turn(effort.runs, [&mut edit(gpu, &mut frame, &scene, &after)])?;
            let (u, c) = (&edited.updated, &edited.updated.counts);
            (photons, changed) = (u.photons, c.changed);
            let mut row = start(label, c.invalid, (photons, changed), flights);
            row.extend([
                round(percent(u.recomputed, u.segments)),
                json!(SLOT_BYTES),
                round(full.median(|cost| cost.total)),
                round(edited.median(|cost| cost.total)),
            ]);
            sheet.rows.push(row);
        }
        for (label, classes) in [("128 values", 1), ("64 x 2", 2), ("32 x 4", 4), ("16 x 8", 8)] {
            let flights = two_words(gpu, &scene, &after, &volume, classes)?;
            let mut row = start(label, flights.invalid, (photons, changed), flights);
            row.extend([json!(null), json!(SLOT_BYTES + 8), json!(null), json!(null)]);
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
fn kinds() -> Vec<(&'static str, Bins)> {
    let whole = Bins::uniform(1);
    let mut all = vec![("32 values", Bins { scale: whole.scale / 2, ..whole })];
    for (label, classes) in
        [("64 values", 1), ("32 values x 2 marks", 2), ("16 x 4", 4), ("8 x 8", 8)]
    {
        all.push((label, Bins::uniform(classes)));
    }
    all
}

fn stored(bins: Bins) -> Storage {
    Storage { bins: Some(bins), ..Default::default() }
}

/// Flights of all photons.
#[derive(Clone, Copy, Default)]
struct Flights {
    /// Those that an edit finds invalid.
    per_slot: u64,
    /// All flights of photons that have one, as if a photon had but one history.
    per_photon: u64,
    all: u64,
    /// Photons that have one.
    invalid: u64,
}

impl Flights {
    /// Adds the flights of a batch, given which are invalid, slot by slot.
    fn add(&mut self, states: &[State], photons: usize, invalid: &[bool]) {
        for photon in 0..photons {
            let slots = (photon..states.len()).step_by(photons);
            let flown = slots.clone().filter(|&at| !states[at].is_empty()).count() as u64;
            let found = slots.filter(|&at| invalid[at]).count() as u64;
            self.all += flown;
            self.per_slot += found;
            if found > 0 {
                self.invalid += 1;
                self.per_photon += flown;
            }
        }
    }
}

/// Whether an edit may have changed a flight, as far as the `asked` bits of histories tell.
fn is_invalid(state: State, query: &Query, asked: u64) -> bool {
    let fallen = query.changes[state.entry()] & CHANGE_FALLEN != 0;
    state.history() & query.risen & asked != 0 || state.interacts() && fallen
}

/// What an edit changes of what a frame shows.
fn query_of(frame: &PhotonFrame, after: &Scene) -> Result<Query> {
    let device = &frame.scene;
    let table = device.table_of(after)?;
    Ok(Query::between(&device.table, &table, &device.bins, device.params.majorant))
}

/// Flights that an edit finds invalid.
fn flights(gpu: &Gpu, frame: &PhotonFrame, after: &Scene) -> Result<Flights> {
    let query = query_of(frame, after)?;
    let mut flights = Flights::default();
    for batch in &frame.map.batches {
        let states = gpu.read::<State>("bins", &batch.states)?;
        let invalid: Vec<_> = states.iter().map(|&s| is_invalid(s, &query, u64::MAX)).collect();
        flights.add(&states, batch.photons as usize, &invalid);
    }
    Ok(flights)
}

/// Flights that histories of 128 bits would find invalid: those that any of four histories
/// finds, each of which knows a quarter of the bits.
fn two_words(
    gpu: &Gpu,
    before: &Scene,
    after: &Scene,
    volume: &Volume,
    mark_classes: u32,
) -> Result<Flights> {
    const QUARTER: u32 = 32;
    // Values below the quarter have bins below 8, those above it bin 40: no bit of theirs is asked.
    const FIRST: u32 = 8;
    const ASKED: u64 = (u32::MAX as u64) << FIRST;
    let split = Split::default();
    let mut found = Vec::<(Vec<State>, usize, Vec<bool>)>::new();
    for quarter in 0..4 {
        let whole = Bins::uniform(mark_classes);
        let bins = Bins {
            scale: 2 * whole.scale,
            after: FIRST as i32 - (quarter * QUARTER) as i32,
            low: 0,
            high: (FIRST + QUARTER) as i32,
            ..whole
        };
        let device = DeviceScene::stored(gpu, before, volume, &stored(bins))?;
        let mut frame = PhotonFrame::new(gpu, before, device, &split)?;
        // The photons will do.
        let mut traced = |boundary| boundary == "light field";
        frame.rebuild(gpu, &split, &mut Progress::until(&mut traced))?;
        let query = query_of(&frame, after)?;
        for (i, batch) in frame.map.batches.iter().enumerate() {
            let states = gpu.read::<State>("bins", &batch.states)?;
            let invalid = states.iter().map(|&state| is_invalid(state, &query, ASKED));
            match found.get_mut(i) {
                Some((_, _, any)) => any.iter_mut().zip(invalid).for_each(|(any, own)| *any |= own),
                None => {
                    let invalid = invalid.collect();
                    found.push((states, batch.photons as usize, invalid));
                }
            }
        }
    }
    let mut flights = Flights::default();
    for (states, photons, invalid) in &found {
        flights.add(states, *photons, invalid);
    }
    Ok(flights)
}
