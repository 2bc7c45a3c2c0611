//! An update after any edit leaves what a rebuild of the edited scene from nothing leaves,
//! bit for bit: slots, light field, segments and image, histories aside.

mod common;

use std::collections::BTreeMap;

use common::gpu;
use common::snapshot::{Snapshot, rebuild, snapshot};
use common::world::{CLASSES, Dice, frame, random_edit, update, world};
use glam::{DMat3, DVec3, Vec3};
use photogram::render::{Progress, Split};
use photogram::scene::{Estimator, Filter, Scene, Spatial, Weighting};
use photogram::segment::LightField;
use photogram::update::{PhotonFrame, Scope, Updated};
use photogram::volume::Volume;

fn difference(frame: &PhotonFrame, scene: &Scene, volume: &Volume) -> Option<&'static str> {
    let order = Snapshot::points_in_any_order;
    let now = order(snapshot(gpu(), frame).without_histories());
    let fresh = rebuild(gpu(), scene, volume, &Split::default()).without_histories();
    now.difference(&order(fresh))
}

/// Edits of the random sequences; `PHOTOGRAM_SOAK` asks for more.
fn edits_wanted() -> usize {
    std::env::var("PHOTOGRAM_SOAK").ok().and_then(|n| n.parse().ok()).unwrap_or(1000)
}

#[test]
fn random_edits_leave_what_a_rebuild_leaves() {
    let variants = [
        (Estimator::Fluence, Weighting::Even, Filter::Linear, Spatial::Exact),
        (Estimator::Points, Weighting::Even, Filter::Linear, Spatial::Exact),
        (Estimator::Fluence, Weighting::Even, Filter::Nearest, Spatial::Axes),
        (Estimator::Points, Weighting::Plain, Filter::Nearest, Spatial::Exact),
    ];
    // Parts of the journal, batches and bands are small, so that there are several of each.
    let split =
        Split { batch_photons: Some(300), band_rows: Some(7), journal: Some(128), shuffle: None };
    let mut seen = Coverage::default();
    let each = edits_wanted().div_ceil(variants.len());
    for (seed, (estimator, weighting, filter, spatial)) in (1..).zip(variants) {
        let (mut home, volume) = world(estimator, weighting, filter);
        home.settings.spatial = spatial;
        let mut dice = Dice(seed);
        let mut frame = frame(&home, &volume, &split);
        let first = snapshot(gpu(), &frame);
        let mut scene = home.clone();
        let mut earlier = Vec::new();
        for i in 0..each {
            let class = CLASSES[i % CLASSES.len()];
            // Now and then the last edits are undone.
            match dice.below(8) {
                0 if !earlier.is_empty() => scene = earlier.swap_remove(dice.below(earlier.len())),
                1 => scene = home.clone(),
                _ => {
                    earlier.push(scene.clone());
                    random_edit(&mut scene, class, &mut dice, &home);
                    *seen.classes.entry(class).or_default() += 1;
                }
            }
            earlier.truncate(6);
            let (scope, done) = update(&mut frame, &scene, &split);
            let now = snapshot(gpu(), &frame).without_histories().points_in_any_order();
            seen.look(scope, &done, &now);
            let fresh = rebuild(gpu(), &scene, &volume, &Split::default());
            let wrong = now.difference(&fresh.without_histories().points_in_any_order());
            assert_eq!(wrong, None, "edit {i} ({class}), {estimator}, {weighting}, {filter}");
        }
        update(&mut frame, &home, &split);
        let last = snapshot(gpu(), &frame);
        assert_eq!(last.without_histories().difference(&first.without_histories()), None);
    }
    println!("{seen:?}");
    seen.suffices(edits_wanted() as u64);
}

/// What the random edits have met.
#[derive(Debug, Default)]
struct Coverage {
    classes: BTreeMap<&'static str, u64>,
    /// Edits that touched nothing, a part, everything.
    scopes: [u64; 3],
    invalid: u64,
    reweighed: u64,
    changed: u64,
    listed: u64,
    untouched_photons: u64,
    recomputed: u64,
    untouched_segments: u64,
    /// Empty slots, interactions, exits.
    slots: [u64; 3],
    /// Work lists of photons and of segments longer than a work group.
    long_lists: [u64; 2],
    /// Sums of light above 32 bits.
    carried: u64,
}

impl Coverage {
    fn look(&mut self, scope: Scope, done: &Updated, now: &Snapshot) {
        self.scopes[match scope {
            Scope::Nothing => 0,
            Scope::Part => 1,
            Scope::Everything(_) => 2,
        }] += 1;
        if scope == Scope::Part {
            self.invalid += done.counts.invalid;
            self.reweighed += done.counts.reweighed;
            self.changed += done.counts.changed;
            self.listed += done.listed;
            self.untouched_photons += done.photons - done.listed;
            self.recomputed += done.recomputed;
            self.untouched_segments += done.segments - done.recomputed;
            self.long_lists[0] += u64::from(done.listed > 64);
            self.long_lists[1] += u64::from(done.recomputed > 64);
        }
        for [_, state] in &now.slots {
            self.slots[(state[1] >> 30) as usize] += 1;
        }
        // Upper words of the fluence's sums, and of the points' sums in segments.
        let upper = |words: &[u32]| words.iter().any(|&w| w != 0);
        let sums = now.field.iter().filter(|c| c[6..] == [0, 0]).any(|c| c[1] | c[3] | c[5] != 0);
        self.carried += u64::from(sums || now.segments.iter().any(|s| upper(&s[6..])));
    }

    fn suffices(&self, edits: u64) {
        for class in CLASSES {
            assert!(self.classes.get(class).is_some_and(|&n| n > edits / 40), "{class} is rare");
        }
        let many = [
            self.invalid,
            self.reweighed,
            self.changed,
            self.untouched_photons,
            self.recomputed,
            self.untouched_segments,
        ];
        assert!(many.iter().all(|&n| n > 20 * edits), "{many:?}");
        assert!(self.scopes.iter().all(|&n| n > edits / 100), "{:?}", self.scopes);
        assert!(self.slots.iter().all(|&n| n > 1000), "{:?}", self.slots);
        assert!(self.long_lists.iter().all(|&n| n > edits / 20), "{:?}", self.long_lists);
        assert!(self.carried > edits / 10, "no sum had an upper word");
        assert!(self.changed < self.listed, "nothing was listed in vain");
    }
}

/// Applies an edit to a fresh frame and checks it; returns what the update did.
fn check(estimator: Estimator, edit: impl Fn(&mut Scene)) -> (Scope, Updated) {
    let (mut scene, volume) = world(estimator, Weighting::Even, Filter::Linear);
    let mut frame = frame(&scene, &volume, &Split::default());
    edit(&mut scene);
    let (scope, done) = update(&mut frame, &scene, &Split::default());
    assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}");
    (scope, done)
}

fn check_both(edit: impl Fn(&mut Scene)) -> [Updated; 2] {
    [Estimator::Fluence, Estimator::Points].map(|estimator| check(estimator, &edit).1)
}

#[test]
fn an_edit_that_changes_no_entry_visits_nothing() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        // The window lies beyond all values; then nothing at all is edited.
        let beyond = |s: &mut Scene| {
            let mut m = s.materials[0].clone();
            (m.name, m.ramp) = ("beyond".into(), vec![[9000.0, 1.0], [9100.0, 1.0]]);
            s.materials.push(m);
        };
        for edit in [beyond as fn(&mut Scene), |_| ()] {
            let (scope, done) = check(estimator, edit);
            assert_eq!(scope, Scope::Nothing);
            assert_eq!((done.counts.visits(), done.listed, done.recomputed), (0, 0, 0));
        }
    }
}

#[test]
fn a_colour_edit_makes_no_tentative_collision() {
    for done in check_both(|s| s.materials[2].colour = DVec3::new(0.3, 0.5, 0.9)) {
        assert!(done.counts.reweighed > 0 && done.recomputed > 0);
        assert_eq!((done.counts.tentative, done.counts.invalid), (0, 0));
    }
}

#[test]
fn a_transparent_value_made_opaque_stops_what_had_flown_through_and_left() {
    // Nothing but bone at first: photons leave through flesh without a collision there.
    let bone_alone = |s: &mut Scene| s.materials.retain(|m| m.name == "bone");
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (home, volume) = world(estimator, Weighting::Even, Filter::Linear);
        let mut scene = home.clone();
        bone_alone(&mut scene);
        let mut frame = frame(&scene, &volume, &Split::default());
        // Skipped macro-cells, too: much of the volume was empty.
        let (_, done) = update(&mut frame, &home, &Split::default());
        assert!(done.counts.changed > 0);
        assert_eq!(difference(&frame, &home, &volume), None, "{estimator}");
    }
}

#[test]
fn awkward_edits_are_exact() {
    type Edit = (&'static str, fn(&mut Scene));
    let edits: [Edit; 12] = [
        ("everything changes", |s| s.materials.iter_mut().for_each(|m| m.extinction *= 0.5)),
        ("all is removed", |s| s.materials.clear()),
        ("the occluder goes", |s| s.materials.retain(|m| m.name != "soft")),
        ("colour of what only absorbs", |s| s.materials[1].scatter = 0.0),
        ("emission comes", |s| s.materials[2].emission = DVec3::new(0.1, 0.0, 0.0)),
        ("a light goes", |s| drop(s.lights.remove(0))),
        ("all lights go", |s| s.lights.clear()),
        ("a light goes out", |s| s.lights[0].emitted = DVec3::ZERO),
        ("the background", |s| s.background = DVec3::ONE),
        ("one entry at a bin's edge", |s| {
            // Entry 1024 is the first of bin 16.
            let [low, high] = s.volume.load().expect("the phantom").range();
            let edge = |entry: f64| low + (high - low) * entry / 4096.0;
            let mut m = s.materials[2].clone();
            m.name = "edge".into();
            m.ramp = vec![[edge(1024.0), 1.0], [edge(1025.0), 1.0]];
            s.materials.push(m);
        }),
        ("values outside the window", |s| {
            s.materials[2].ramp =
                vec![[-9000.0, 1.0], [-2000.0, 1.0], [-2000.0, 0.0], [600.0, 1.0], [9000.0, 1.0]];
        }),
        ("the top value", |s| s.materials[2].ramp = vec![[-2000.0, 0.0], [9000.0, 1.0]]),
    ];
    for (what, edit) in edits {
        println!("{what}");
        check_both(edit);
    }
}

#[test]
fn a_light_that_goes_out_shines_again() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (home, volume) = world(estimator, Weighting::Even, Filter::Linear);
        let mut dark = home.clone();
        dark.lights[0].emitted = DVec3::ZERO;
        let mut frame = frame(&dark, &volume, &Split::default());
        update(&mut frame, &home, &Split::default());
        assert_eq!(difference(&frame, &home, &volume), None, "{estimator}");
    }
}

/// Photons that ended without power go on where they never flew: a flight each, though no
/// history tells.
#[test]
fn what_only_absorbed_scatters_again() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (home, volume) = world(estimator, Weighting::Even, Filter::Linear);
        let mut black = home.clone();
        black.materials[1].scatter = 0.0;
        let mut frame = frame(&black, &volume, &Split::default());
        let (_, done) = update(&mut frame, &home, &Split::default());
        assert!(done.counts.invalid == 0 && done.counts.tentative > 0, "{:?}", done.counts);
        assert_eq!(difference(&frame, &home, &volume), None, "{estimator}");
    }
}

#[test]
fn the_smallest_frames_are_exact() {
    let (mut scene, volume) = world(Estimator::Fluence, Weighting::Even, Filter::Linear);
    (scene.camera.width, scene.camera.height) = (1, 1);
    (scene.settings.photons, scene.settings.segments) = (1, 1);
    scene.settings.max_events = 1;
    let mut frame = frame(&scene, &volume, &Split::default());
    for extinction in [0.0, 1.9, 0.01] {
        scene.materials[0].extinction = extinction;
        update(&mut frame, &scene, &Split::default());
        assert_eq!(difference(&frame, &scene, &volume), None);
    }
}

/// A volume of one voxel of 1 mm, all of one material.
fn one_voxel(estimator: Estimator, photons: u32) -> (Scene, Volume) {
    let volume = Volume::new([1; 3], DVec3::ONE, DMat3::IDENTITY, DVec3::ZERO, vec![7_u16])
        .expect("a sound volume");
    let (_, lights) = common::world::WORLD.split_once("[[light]]").expect("lights");
    let (lights, _) = lights.split_once("[[material]]").expect("materials");
    let text = format!(
        "[camera]\nfrom = [0, -1, 0]\nwidth = 6\nheight = 6\n[[light]]{lights}[[material]]\nname = \
         \"all\"\nwindow = [0, 10]\nextinction = 1.0\nalbedo = 0.5\n[settings]\nphotons = {photons}\n\
         max_events = 4\nsegments = 2\nrays = 1\nmajorant = 2.0\n"
    );
    let mut scene = common::scene_over(&volume, &text);
    scene.settings.estimator = Some(estimator);
    (scene, volume)
}

#[test]
fn one_voxel_is_exact() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (mut scene, volume) = one_voxel(estimator, 200);
        let mut frame = frame(&scene, &volume, &Split::default());
        for extinction in [0.3, 0.0, 1.9] {
            scene.materials[0].extinction = extinction;
            let (_, done) = update(&mut frame, &scene, &Split::default());
            assert!(done.listed > 0 && done.recomputed > 0);
            assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}, {extinction}");
        }
    }
}

/// Mesa's software adapter ends a thread's loops after 65 535 iterations of all of them
/// together, without a word. What it cut short is traced again event by event, in an update
/// from the slots that were there.
#[test]
fn long_flights_are_not_cut_short() {
    const MAJORANT: f64 = 37_000.0;
    let (mut scene, volume) = one_voxel(Estimator::Fluence, 400);
    (scene.settings.majorant, scene.settings.skip_empty) = (Some(MAJORANT), false);
    let mut frame = frame(&scene, &volume, &Split::default());
    let before = snapshot(gpu(), &frame);
    // The tentative collisions of the flights between a photon's interactions.
    let lengths = before.slots.chunks(4).map(|slots| {
        let met = slots.iter().take_while(|[_, state]| state[1] >> 30 != 0);
        let places: Vec<_> =
            met.map(|[at, _]| Vec3::from_array([0, 1, 2].map(|i| f32::from_bits(at[i])))).collect();
        places.windows(2).map(|p| p[0].distance(p[1])).sum::<f32>()
    });
    let most = f64::from(lengths.fold(0.0, f32::max)) * MAJORANT;
    assert!(most > 1.1 * 65_535.0, "no photon makes more than {most} tentative collisions");
    scene.materials[0].extinction = 1.5;
    let (_, done) = update(&mut frame, &scene, &Split::default());
    assert!(done.counts.changed > 0);
    assert_eq!(difference(&frame, &scene, &volume), None);
}

#[test]
fn an_abandoned_update_leaves_nothing_behind() {
    let split = Split { journal: Some(64), ..Split::default() };
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (home, volume) = world(estimator, Weighting::Even, Filter::Linear);
        // The first edit is undone by the second, or stays.
        for (stop_after, stays) in (0..12).flat_map(|n| [(n, false), (n, true)]) {
            let mut frame = frame(&home, &volume, &split);
            let mut first = home.clone();
            first.materials[0].extinction *= 4.0;
            first.lights[0].emitted *= 0.5;
            frame.edit(gpu(), &first, &split).expect("applies");
            let mut boundaries = 0;
            let mut stop = |_: &str| {
                boundaries += 1;
                boundaries > stop_after
            };
            let progress = &mut Progress::until(&mut stop);
            let done = frame.update(gpu(), &split, progress).expect("updates");
            if stop_after < 3 {
                assert!(!done.finished, "{estimator}: never asked whether to stop");
            }
            let mut second = if stays { first.clone() } else { home.clone() };
            second.materials[2].extinction = 0.7;
            second.lights.swap(0, 1);
            update(&mut frame, &second, &split);
            let wrong = difference(&frame, &second, &volume);
            assert_eq!(wrong, None, "{estimator}, stopped after {stop_after} boundaries, {stays}");
        }
    }
}

/// Of an invalid flight only the marks are drawn that the edit can have made real.
#[test]
fn a_flight_is_flown_only_where_it_may_be_stopped() {
    let (mut scene, volume) = world(Estimator::Fluence, Weighting::Even, Filter::Linear);
    // One flight a photon through thin tissue alone, all of whose marks a rebuild draws.
    scene.settings.max_events = 1;
    scene.materials.truncate(1);
    scene.settings.skip_empty = false;
    let mut frame = frame(&scene, &volume, &Split::default());
    let full = frame.counts(gpu()).expect("reads");
    scene.materials[0].extinction *= 1.5;
    let (_, done) = update(&mut frame, &scene, &Split::default());
    let now = done.counts;
    assert!(now.invalid > 50, "{now:?}");
    let each = |tentative: u64, photons: u64| tentative as f64 / photons as f64;
    let [full, now] = [each(full.tentative, done.photons), each(now.tentative, now.invalid)];
    assert!(4.0 * now < 3.0 * full, "{now} tentative collisions a photon, in a rebuild {full}");
    assert_eq!(difference(&frame, &scene, &volume), None);
}

/// The harness can fail: a history that lost its bits is found out.
#[test]
fn lost_histories_turn_it_red() {
    let (mut scene, volume) = world(Estimator::Fluence, Weighting::Even, Filter::Linear);
    let mut frame = frame(&scene, &volume, &Split::default());
    for batch in &frame.map.batches {
        let mut states = gpu().read::<[u32; 4]>("states", &batch.states).expect("reads");
        states.iter_mut().for_each(|s| (s[2], s[3]) = (0, 0));
        gpu().write(&batch.states, &states);
    }
    scene.materials[0].extinction = 0.3;
    update(&mut frame, &scene, &Split::default());
    assert_eq!(difference(&frame, &scene, &volume), Some("slots"));
}

/// The harness can fail: a deposit that was never taken out is found out.
#[test]
fn a_deposit_left_behind_turns_it_red() {
    let (mut scene, volume) = world(Estimator::Fluence, Weighting::Even, Filter::Linear);
    let mut frame = frame(&scene, &volume, &Split::default());
    if let LightField::Fluence(fluence) = &frame.field {
        let mut sums = gpu().read::<u64>("sums", &fluence.sums[1]).expect("reads");
        let lit = sums.iter().position(|&s| s > 0).expect("some light");
        sums[lit] += 1;
        gpu().write(&fluence.sums[1], &sums);
    }
    scene.materials[1].extinction = 0.9;
    update(&mut frame, &scene, &Split::default());
    assert_eq!(difference(&frame, &scene, &volume), Some("light field"));
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
    let LightField::Points(points) = &mut frame.field else { panic!("asked for points") };
    points.settle();
    frame.update(gpu(), &Split::default(), &mut Progress::silent()).expect("updates");
    assert_eq!(difference(&frame, &scene, &volume), Some("segments"));
}
