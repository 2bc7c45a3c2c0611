//! An update after any edit leaves what a rebuild of the edited scene from nothing leaves,
//! bit for bit: slots, light field, segments and image, histories aside.

mod common;

use std::collections::BTreeMap;

use common::gpu;
use common::snapshot::{Snapshot, difference, rebuild, snapshot};
use common::world::{CLASSES, Dice, frame, random_edit, random_world, update, world};
use glam::DVec3;
use photogram::device_scene::Context;
use photogram::field::fluence::Deposit;
use photogram::gpu::GROUP;
use photogram::gpu::Progress;
use photogram::gpu::counter::CounterBuffer;
use photogram::gpu::queue::Total;
use photogram::history::{CHANGE_EMISSION, Query};
use photogram::scene::{Estimator, Filter, Scene, Weighting};
use photogram::split::Split;
use photogram::transfer::Material;
use photogram::update::{PhotonFrame, Scope, Updated};

/// Edits of the random sequences that have something to do, of each light field;
/// `PHOTOGRAM_SOAK` asks for more.
fn edits_wanted() -> u64 {
    match std::env::var("PHOTOGRAM_SOAK") {
        Ok(text) => text.parse().expect("PHOTOGRAM_SOAK is a number of edits"),
        Err(_) => 1000,
    }
}

#[test]
fn random_edits_of_random_scenes_leave_what_a_rebuild_leaves() {
    const EACH: usize = 24;
    const BAND_ROWS: u32 = 7;
    let mut seen = Coverage::default();
    for world in 0.. {
        if seen.fields.iter().all(|&n| n >= edits_wanted()) {
            break;
        }
        let mut dice = Dice(world);
        let (home, volume) = random_world(&mut dice);
        // Parts of the journal, batches and bands are small, so that there are several of each.
        let split = Split {
            batch_photons: Some(300),
            band_rows: Some(BAND_ROWS),
            journal: Some(200),
            table_slots: [None, Some(5000)][world as usize / 3 % 2],
            buckets: [None, Some(50)][world as usize / 6 % 2],
            salt: Some(world as u32),
            anew: [None, Some(true), Some(false)][world as usize % 3],
            shuffle: Some(world).filter(|_| dice.below(3) == 0),
        };
        let mut frame = frame(&home, &volume, &split);
        let first = snapshot(gpu(), &frame);
        let mut before = first.clone().without_histories();
        let mut scene = home.clone();
        let mut earlier = Vec::new();
        for i in 0..EACH {
            let class = CLASSES[dice.below(CLASSES.len())];
            // Now and then the last edits are undone.
            let class = match dice.below(8) {
                0 if !earlier.is_empty() => {
                    scene = earlier.swap_remove(dice.below(earlier.len()));
                    "undone"
                }
                1 => {
                    scene = home.clone();
                    "all undone"
                }
                _ => {
                    earlier.push(scene.clone());
                    random_edit(&mut scene, class, &mut dice, &home)
                }
            };
            earlier.truncate(6);
            // Now and then an update is abandoned on the way, and another edit comes.
            let abandoned = dice.below(8) == 0 && abandon(&mut frame, &scene, &split, &mut dice);
            if abandoned {
                random_edit(&mut scene, CLASSES[dice.below(CLASSES.len())], &mut dice, &home);
            }
            let (scope, done) = update(&mut frame, &scene, &split);
            let now = snapshot(gpu(), &frame).without_histories();
            let bands = scene.camera.height.div_ceil(BAND_ROWS) * scene.settings.rays;
            // An update after one that was abandoned does the work of both.
            match abandoned {
                true => seen.abandoned += 1,
                false => seen.look((class, scope), (&done, bands), &frame, (&before, &now)),
            }
            let fresh = rebuild(gpu(), &scene, &volume, &Split::default());
            let wrong = now.difference(&fresh.without_histories());
            assert_eq!(wrong, None, "world {world}, edit {i} ({class}): {}", scene.to_toml());
            before = now;
        }
        update(&mut frame, &home, &split);
        let last = snapshot(gpu(), &frame).without_histories();
        let wrong = last.difference(&first.without_histories());
        assert_eq!(wrong, None, "world {world}: all undone");
    }
    println!("{seen:?}");
    seen.suffices(edits_wanted());
}

/// Applies an edit, and abandons its update at a random boundary, if it comes to that; returns
/// whether it did.
fn abandon(frame: &mut PhotonFrame, scene: &Scene, split: &Split, dice: &mut Dice) -> bool {
    frame.edit(gpu(), scene, split).expect("applies");
    let mut left = dice.below(12);
    let mut stop = |_: &str| {
        left = left.wrapping_sub(1);
        left == usize::MAX
    };
    let progress = &mut Progress::until(&mut stop);
    !frame.update(gpu(), split, progress).expect("updates").finished
}

/// What the random edits have met.
#[derive(Debug, Default)]
struct Coverage {
    /// Edits of each class that had a part of all computed anew, or stages of which settings changed.
    classes: BTreeMap<&'static str, u64>,
    /// Edits that had anything computed anew, with the fluence and with points.
    fields: [u64; 2],
    /// Edits whose update was abandoned.
    abandoned: u64,
    /// Edits that touched nothing, a part, everything, or had settings changed.
    scopes: [u64; 4],
    invalid: u64,
    reweighed: u64,
    changed: u64,
    listed: u64,
    untouched_photons: u64,
    recomputed: u64,
    untouched_segments: u64,
    /// Empty slots, interactions, exits.
    slots: [u64; 3],
    /// Segments that let all through, a part, nothing.
    segments: [u64; 3],
    /// Segments whose light alone was corrected.
    corrected: u64,
    /// Updates with a work list of photons and of segments longer than a work group.
    long_lists: [u64; 2],
    /// Updates that changed the upper word of a sum of light in passing: in the fluence where
    /// flights left and entered it, in segments where light alone was corrected.
    carried: [u64; 2],
    /// Updates of several batches of one light.
    batches: u64,
    /// Of batches of several lights, and of those with photons of lights that were gone.
    shared: u64,
    idle: u64,
    /// Updates of several tables of points, and of one that has several batches.
    tables: [u64; 2],
}

impl Coverage {
    fn look(
        &mut self,
        (class, scope): (&'static str, Scope),
        (done, bands): (&Updated, u32),
        frame: &PhotonFrame,
        (before, now): (&Snapshot, &Snapshot),
    ) {
        self.scopes[match scope {
            Scope::Nothing => 0,
            Scope::Part => 1,
            Scope::Everything(_) => 2,
            Scope::Anew(_) => 3,
        }] += 1;
        if matches!(scope, Scope::Part | Scope::Anew(_)) {
            *self.classes.entry(class).or_default() += 1;
        }
        if scope == Scope::Part {
            self.invalid += done.counts.invalid;
            self.reweighed += done.counts.reweighed;
            self.changed += done.counts.changed;
            self.listed += done.listed;
            self.untouched_photons += done.photons - done.listed;
            self.recomputed += done.recomputed;
            assert!(done.recomputed <= done.segments, "a segment was computed twice");
            self.untouched_segments += done.segments - done.recomputed;
            self.corrected += done.corrected;
            // Were each list as short as a group, all would have no more together.
            let many = u64::from(GROUP) * frame.map.batches.len() as u64;
            self.long_lists[0] += u64::from(done.listed > many);
            // Where all segments are computed anew none are looked for.
            let looked_for = done.recomputed < done.segments;
            let many = u64::from(GROUP * bands);
            self.long_lists[1] += u64::from(looked_for && done.recomputed > many);
            let upper = |s: &Snapshot| -> Vec<[u32; 3]> {
                match frame.field.estimator() {
                    Estimator::Fluence => s.field.iter().map(|c| [c[1], c[3], c[5]]).collect(),
                    Estimator::Points => s.segments.iter().map(|c| [c[6], c[7], 0]).collect(),
                }
            };
            let carries = upper(before) != upper(now);
            match frame.field.estimator() {
                Estimator::Fluence => {
                    // Flights of so few are not summed anew.
                    self.carried[0] += u64::from(carries && 2 * done.listed <= done.photons);
                }
                Estimator::Points => {
                    let alone = done.corrected > 0 && done.recomputed == done.corrected;
                    self.carried[1] += u64::from(carries && alone);
                }
            }
        }
        if scope == Scope::Nothing {
            return;
        }
        let which = frame.field.estimator() == Estimator::Points;
        self.fields[usize::from(which)] += 1;
        for [_, state] in &now.slots {
            self.slots[(state[1] >> 30) as usize] += 1;
        }
        for segment in &now.segments {
            let passed = f32::from_bits(segment[3]);
            self.segments[usize::from(passed < 1.0) + usize::from(passed == 0.0)] += 1;
        }
        let quotas = || frame.map.batches.iter().map(|batch| &batch.quotas);
        self.batches += u64::from(quotas().flatten().any(|quota| quota.first_index > 0));
        self.shared += u64::from(quotas().any(|all| all.len() > 1));
        self.idle += u64::from(quotas().flatten().any(|quota| quota.light.is_none()));
        if let Some(points) = frame.field.points() {
            self.tables[0] += u64::from(points.tables() > 1);
            self.tables[1] += u64::from(points.tables() < frame.map.batches.len());
        }
    }

    fn suffices(&self, edits: u64) {
        assert!(self.fields.iter().all(|&n| n >= edits), "{:?}", self.fields);
        assert!(self.abandoned > edits / 20, "few updates were abandoned");
        for class in CLASSES.into_iter().chain(["undone", "all undone"]) {
            assert!(self.classes.get(class).is_some_and(|&n| n > edits / 60), "{class} is rare");
        }
        let many = [
            self.invalid,
            self.reweighed,
            self.changed,
            self.untouched_photons,
            self.recomputed,
            self.untouched_segments,
            self.corrected,
        ];
        assert!(many.iter().all(|&n| n > 20 * edits), "{many:?}");
        assert!(self.scopes.iter().all(|&n| n > edits / 100), "{:?}", self.scopes);
        assert!(self.slots.iter().all(|&n| n > 1000), "{:?}", self.slots);
        assert!(self.segments.iter().all(|&n| n > 1000), "{:?}", self.segments);
        assert!(self.long_lists.iter().all(|&n| n > edits / 20), "{:?}", self.long_lists);
        assert!(self.carried.iter().all(|&n| n > edits / 50), "few sums carried");
        assert!(self.batches > edits / 10, "few lights had several batches");
        assert!(self.shared > edits / 10, "few batches were of several lights");
        assert!(self.idle > edits / 100, "few lights left photons behind");
        assert!(self.tables.iter().all(|&n| n > edits / 20), "{:?}", self.tables);
        assert!(self.changed < self.listed, "nothing was listed in vain");
    }
}

/// The harness can fail: one bit dropped from the histories is found out, if it is one that
/// the edit asks for.
#[test]
fn one_bit_dropped_from_the_histories_turns_it_red() {
    let (home, volume) = world(Estimator::Fluence, Weighting::Even, Filter::Linear);
    let mut edited = home.clone();
    edited.materials[0].extinction = 0.3;
    let is_needed = |bit: &usize| {
        let mut frame = frame(&home, &volume, &Split::default());
        for batch in &frame.map.batches {
            let mut states = gpu().read::<[u32; 4]>("states", &batch.states).expect("reads");
            states.iter_mut().for_each(|s| s[2 + bit / 32] &= !(1 << (bit % 32)));
            gpu().write(&batch.states, &states).expect("writes");
        }
        update(&mut frame, &edited, &Split::default());
        let wrong = difference(&frame, &edited, &volume);
        assert!(wrong.is_none_or(|wrong| wrong == "slots"), "{wrong:?}");
        wrong.is_some()
    };
    let red = (0..64).filter(is_needed).collect::<Vec<_>>();
    assert!(red.len() > 3, "{red:?}");
}

/// The same of the histories of segments, which have several neighbouring bits each: of all bits
/// that an edit of few values asks for. What glows otherwise gives no photon other light.
#[test]
fn bits_dropped_from_the_histories_of_segments_turn_it_red() {
    let (world, volume) = world(Estimator::Fluence, Weighting::Even, Filter::Linear);
    let domain = world.domain(&volume);
    for part in 1..8 {
        let first = domain.used() * part / 8;
        let mut home = world.clone();
        home.materials.push(Material {
            name: "glow".to_owned(),
            ramp: [first, first + 30].map(|entry| [domain.value(entry), 1.0]).to_vec(),
            extinction: 0.0,
            emission: DVec3::splat(0.01),
            ..home.materials[0].clone()
        });
        let mut edited = home.clone();
        edited.materials.last_mut().expect("one was added").emission *= 1.5;
        let mut frame = frame(&home, &volume, &Split::default());
        let table = frame.scene.table_of(&edited).expect("it is settled");
        let majorant = frame.scene.params.majorant;
        let query = Query::between(&frame.scene.table, &table, &frame.scene.bins, majorant);
        let asked = query.mask(CHANGE_EMISSION, &frame.scene.bins);
        assert!((1..4).contains(&asked.count_ones()), "{asked:x}");
        for buffer in frame.segments.buffers() {
            let mut words = gpu().read::<[u32; 6]>("segments", buffer).expect("reads");
            for segment in &mut words {
                segment[4] &= !(asked as u32);
                segment[5] &= !((asked >> 32) as u32);
            }
            gpu().write(buffer, &words).expect("writes");
        }
        update(&mut frame, &edited, &Split::default());
        assert_eq!(difference(&frame, &edited, &volume), Some("segments"), "{asked:x}");
    }
}

/// The harness can fail: deposits that are taken out once and were made twice are found out.
#[test]
fn deposits_left_behind_turn_it_red() {
    let (mut scene, volume) = world(Estimator::Fluence, Weighting::Even, Filter::Linear);
    for photons in [0, 10] {
        let mut frame = frame(&scene, &volume, &Split::default());
        let fluence = frame.field.fluence().expect("fluence was asked for");
        let batch = &frame.map.batches[0];
        let flights = frame.map.flights(batch, 0..batch.photons);
        let counters = CounterBuffer::new(gpu()).expect("fits");
        let silent = &mut Progress::silent();
        let cx = Context { gpu: gpu(), scene: &frame.scene, counters: &counters };
        let total = Total::Known(photons);
        fluence.deposit(cx, &flights, Deposit::Add, total, silent).expect("deposits");
        scene.materials[1].extinction *= 0.9;
        update(&mut frame, &scene, &Split::default());
        let expected = if photons == 0 { None } else { Some("light field") };
        assert_eq!(difference(&frame, &scene, &volume), expected);
    }
}

/// The harness can fail: points that went and came, and that no segment hears of, are found
/// out.
#[test]
fn points_left_behind_turn_it_red() {
    let (mut scene, volume) = world(Estimator::Points, Weighting::Even, Filter::Linear);
    let mut frame = frame(&scene, &volume, &Split::default());
    scene.materials[1].extinction *= 1.25;
    frame.edit(gpu(), &scene, &Split::default()).expect("applies");
    let mut lit = |boundary: &str| boundary == "segments";
    let progress = &mut Progress::until(&mut lit);
    let done = frame.update(gpu(), &Split::default(), progress).expect("updates");
    assert!(!done.finished);
    frame.field.all_seen();
    frame.update(gpu(), &Split::default(), &mut Progress::silent()).expect("updates");
    assert_eq!(difference(&frame, &scene, &volume), Some("segments"));
}
