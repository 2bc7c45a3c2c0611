//! The order of work changes nothing: full rebuilds are equal bit for bit, however the
//! work is listed, batched, banded or sliced; and skipping empty cells changes nothing
//! but histories.

mod common;

use std::time::Duration;

use common::snapshot::{rebuild, snapshot};
use common::{gpu, truth_scene};
use photogram::device_scene::DeviceScene;
use photogram::gpu::AdapterChoice;
use photogram::gpu::Progress;
use photogram::scene::{Estimator, Filter, Scene, Weighting};
use photogram::split::Split;
use photogram::update::PhotonFrame;
use photogram::volume::Volume;

/// Small scenes that between them use every estimator, filter and phase function.
fn scenes() -> Vec<(&'static str, Scene, Volume)> {
    let mut all = Vec::new();
    let variants = [
        ("fluence", "knuckle", Estimator::Fluence, Weighting::Even, Filter::Nearest),
        ("fluence, linear", "knuckle", Estimator::Fluence, Weighting::Even, Filter::Linear),
        ("points even", "knuckle", Estimator::Points, Weighting::Even, Filter::Linear),
        ("points plain", "knuckle", Estimator::Points, Weighting::Plain, Filter::Nearest),
        (
            "points, anisotropic",
            "cloud_forward",
            Estimator::Points,
            Weighting::Even,
            Filter::Nearest,
        ),
    ];
    for (label, name, estimator, weighting, filter) in variants {
        let (mut scene, volume) = truth_scene(name);
        scene.filter = filter;
        (scene.camera.width, scene.camera.height) = (40, 30);
        let settings = &mut scene.settings;
        settings.estimator = Some(estimator);
        settings.weighting = weighting;
        settings.photons = 5000;
        settings.max_events = 12;
        settings.segments = 7;
        settings.rays = 2;
        settings.grid = 0.5;
        all.push((label, scene, volume));
    }
    all
}

#[test]
fn order_of_work_changes_no_bit() {
    let plain = Split::default();
    let splits = [
        ("again", plain),
        ("shuffled", Split { shuffle: Some(7), ..plain }),
        ("bands", Split { band_rows: Some(7), ..plain }),
        ("batches", Split { batch_photons: Some(1234), ..plain }),
        ("hashed", Split { buckets: Some(100), ..plain }),
        ("hashed otherwise", Split { buckets: Some(100), salt: Some(0x5eed), ..plain }),
        ("tables", Split { batch_photons: Some(500), table_slots: Some(20_000), ..plain }),
        ("all", Split { batch_photons: Some(999), band_rows: Some(4), shuffle: Some(11), ..plain }),
    ];
    for (label, scene, volume) in scenes() {
        let first = rebuild(gpu(), &scene, &volume, &plain);
        assert!(first.pixels.iter().flatten().any(|&p| p != 0), "{label} is black");
        for (how, split) in splits {
            let other = rebuild(gpu(), &scene, &volume, &split);
            assert_eq!(first.difference(&other), None, "{label}, {how}");
        }
    }
}

#[test]
fn slices_of_any_length_give_the_same_bits() {
    let hasty = pollster::block_on(photogram::open(&AdapterChoice::Best)).expect("an adapter");
    hasty.set_slice_budget(Duration::from_micros(200));
    for (label, scene, volume) in scenes() {
        let plain = rebuild(gpu(), &scene, &volume, &Split::default());
        let sliced = rebuild(&hasty, &scene, &volume, &Split::default());
        assert_eq!(plain.difference(&sliced), None, "{label}");
    }
}

/// Where an update is sliced, also where light changed is marked slice by slice.
#[test]
fn updates_in_slices_leave_what_a_rebuild_leaves() {
    const EDITS: u64 = 8;
    let hasty = pollster::block_on(photogram::open(&AdapterChoice::Best)).expect("an adapter");
    hasty.set_slice_budget(Duration::from_micros(20));
    let plain = Split::default();
    for (label, mut scene, volume) in scenes() {
        scene.settings.rays = 1;
        let device = DeviceScene::new(&hasty, &scene, &volume).expect("uploads");
        let mut frame = PhotonFrame::new(&hasty, &scene, device, &plain).expect("fits");
        let silent = &mut Progress::silent();
        frame.rebuild(&hasty, &plain, silent).expect("rebuilds");
        hasty.take_timings().expect("a clock");
        for _ in 0..EDITS {
            scene.materials[0].extinction *= 0.8;
            frame.edit(&hasty, &scene, &plain).expect("applies");
            frame.update(&hasty, &plain, silent).expect("updates");
            let now = snapshot(&hasty, &frame).without_histories();
            let fresh = rebuild(gpu(), &scene, &volume, &plain).without_histories();
            assert_eq!(now.difference(&fresh), None, "{label}");
        }
        let timings = hasty.take_timings().expect("a clock");
        let marked = timings.rows().iter().find(|row| row.stage == "points_dirty");
        let slices = marked.map_or(0, |row| u64::from(row.dispatches));
        let is_points = scene.settings.estimator == Some(Estimator::Points);
        // Those of a table that changed, and those that came: two lists an update, at most.
        assert!(!is_points || slices > 2 * EDITS, "{label}: {slices} slices");
    }
}

#[test]
fn skipping_empty_cells_changes_nothing_but_histories() {
    for (label, mut scene, volume) in scenes() {
        let skipping = rebuild(gpu(), &scene, &volume, &Split::default());
        scene.settings.skip_empty = false;
        let visiting = rebuild(gpu(), &scene, &volume, &Split::default());
        let (fewer, more) = (skipping.counts, visiting.counts);
        assert!(fewer.tentative < more.tentative, "{label}: no photon skipped a cell");
        assert!(fewer.samples < more.samples, "{label}: no segment skipped a cell");
        let difference = skipping.without_histories().difference(&visiting.without_histories());
        assert_eq!(difference, None, "{label}");
    }
}

#[test]
fn histories_change_nothing_else() {
    for (label, mut scene, volume) in scenes() {
        let kept = rebuild(gpu(), &scene, &volume, &Split::default());
        scene.settings.history = false;
        let without = rebuild(gpu(), &scene, &volume, &Split::default());
        assert!(without.slots.iter().all(|[_, s]| s[2] == 0 && s[3] == 0));
        let difference = kept.without_histories().difference(&without.without_histories());
        assert_eq!(difference, None, "{label}");
    }
}

/// The harness can fail: another seed is another everything.
#[test]
fn another_seed_differs_in_every_part() {
    let (_, mut scene, volume) = scenes().swap_remove(0);
    let one = rebuild(gpu(), &scene, &volume, &Split::default());
    scene.settings.seed += 1;
    let two = rebuild(gpu(), &scene, &volume, &Split::default());
    assert_eq!(one.difference(&two), Some("slots"));
    assert!(one.field != two.field && one.segments != two.segments && one.pixels != two.pixels);
}

/// Mesa's software adapter ends a thread's loops after 65 535 iterations of all of them
/// together, without a word. Long gathers are split, whatever the adapter.
#[test]
fn long_gathers_are_not_cut_short() {
    let (_, mut scene, volume) = scenes().swap_remove(4);
    (scene.camera.width, scene.camera.height) = (12, 12);
    let settings = &mut scene.settings;
    (settings.photons, settings.radius) = (40_000, Some(16.0));
    (settings.segments, settings.rays) = (1, 1);
    let one = rebuild(gpu(), &scene, &volume, &Split::default());
    let longest = one.counts.gathered / 144;
    assert!(longest > 4 * 65_535, "a gather tests only {longest} photons on average");
    let batches = Split { batch_photons: Some(2000), ..Split::default() };
    let other = rebuild(gpu(), &scene, &volume, &batches);
    assert_eq!(one.counts.gathered, other.counts.gathered);
    assert_eq!(one.difference(&other), None);
}
