//! Updates that are abandoned on the way: what comes after them leaves what a rebuild leaves all the
//! same.

mod common;

use common::gpu;
use common::snapshot::{difference, snapshot};
use common::world::{frame, update, world};
use glam::DVec3;
use photogram::gpu::Progress;
use photogram::gpu::counter::Choice;
use photogram::history::Query;
use photogram::scene::{CameraPlace, Estimator, Filter, Scene, Weighting};
use photogram::split::Split;
use photogram::update::PhotonFrame;

/// Applies an edit, and abandons its update at the boundary of this number; returns all that
/// it came to.
fn abandon(frame: &mut PhotonFrame, scene: &Scene, split: &Split, at: usize) -> Vec<String> {
    frame.edit(gpu(), scene, split).expect("applies");
    let mut reached = Vec::new();
    let mut stop = |boundary: &str| {
        reached.push(boundary.to_owned());
        reached.len() > at
    };
    let progress = &mut Progress::until(&mut stop);
    let done = frame.update(gpu(), split, progress).expect("updates");
    assert_eq!(done.finished, reached.len() <= at);
    reached
}

#[test]
fn an_abandoned_update_leaves_nothing_behind() {
    type Edit = fn(&mut Scene);
    let edits: [Edit; 3] = [
        // Of many photons, so that all flights are summed anew.
        |s| {
            s.materials[0].extinction *= 4.0;
            s.lights[0].emitted *= 0.5;
        },
        // Of few, so that they leave the sums and come back one by one.
        |s| s.materials[1].extinction *= 0.8,
        // Of colours alone.
        |s| s.materials[1].colour *= 0.5,
    ];
    let split = Split { journal: Some(64), ..Split::default() };
    let mut half_moved = 0;
    for (estimator, edit) in [Estimator::Fluence, Estimator::Points]
        .into_iter()
        .flat_map(|estimator| edits.map(|edit| (estimator, edit)))
    {
        let (home, volume) = world(estimator, Weighting::Even, Filter::Linear);
        let mut first = home.clone();
        edit(&mut first);
        let whole = &mut frame(&home, &volume, &split);
        let boundaries = abandon(whole, &first, &split, usize::MAX);
        for (boundary, least) in [("photons", 3), ("light field", 1), ("segments", 1)] {
            let times = boundaries.iter().filter(|b| *b == boundary).count();
            assert!(times >= least, "{estimator}: {boundaries:?}");
        }
        // The first edit is undone by the second, or stays.
        for (at, stays) in (0..boundaries.len()).flat_map(|n| [(n, false), (n, true)]) {
            let mut frame = frame(&home, &volume, &split);
            assert_eq!(abandon(&mut frame, &first, &split, at), boundaries[..=at]);
            if let Some(fluence) = frame.field.fluence() {
                let moved = frame.counts(gpu()).expect("reads").deposits > 0;
                let anew = frame.is_chosen(gpu(), Choice::Anew).expect("reads");
                half_moved += u64::from(
                    moved && fluence.is_current() && !anew && boundaries[at] == "photons",
                );
            }
            let mut second = if stays { first.clone() } else { home.clone() };
            second.materials[2].extinction = 0.7;
            second.lights.swap(0, 1);
            update(&mut frame, &second, &split);
            let wrong = difference(&frame, &second, &volume);
            assert_eq!(wrong, None, "{estimator}, stopped at {at} of {boundaries:?}, {stays}");
        }
    }
    assert!(half_moved > 3, "flights were never half moved");
}

#[test]
fn a_rebuild_can_be_abandoned() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (scene, volume) = world(estimator, Weighting::Even, Filter::Linear);
        for last in ["photons", "light field", "segments"] {
            let mut frame = frame(&scene, &volume, &Split::default());
            let mut stop = |boundary: &str| boundary == last;
            let progress = &mut Progress::until(&mut stop);
            let done = frame.rebuild(gpu(), &Split::default(), progress).expect("rebuilds");
            assert!(!done.finished, "{last}");
            update(&mut frame, &scene, &Split::default());
            assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}, {last}");
        }
    }
}

/// Segments correct their sums by what one build of the points changed: after an update that was
/// abandoned before them they cannot.
#[test]
fn points_that_an_abandoned_update_moved_are_not_forgotten() {
    let (home, volume) = world(Estimator::Points, Weighting::Even, Filter::Linear);
    let mut edited = home.clone();
    edited.materials[1].extinction *= 1.25;
    let mut again = edited.clone();
    again.materials[1].extinction *= 1.1;
    let (edited, again) = (&edited, &again);
    let cases: [(&[&Scene], &Scene); 3] =
        [(&[edited], edited), (&[edited], again), (&[edited, again], edited)];
    for (abandoned, last) in cases {
        let mut frame = frame(&home, &volume, &Split::default());
        for scene in abandoned {
            frame.edit(gpu(), scene, &Split::default()).expect("applies");
            let mut lit = |boundary: &str| boundary == "segments";
            let progress = &mut Progress::until(&mut lit);
            let done = frame.update(gpu(), &Split::default(), progress).expect("updates");
            assert!(!done.finished);
        }
        update(&mut frame, last, &Split::default());
        assert_eq!(difference(&frame, last, &volume), None);
    }
}

/// An edit may fail when its table has been taken, for want of memory say. The next one finds no
/// change of kernels then, and the rebuild that follows uses those that suit all the same.
#[test]
fn an_edit_after_one_that_failed_has_its_own_kernels() {
    let glows = |scene: &Scene| {
        let mut scene = scene.clone();
        scene.materials[2].emission = DVec3::new(0.1, 0.02, 0.0);
        scene
    };
    let askew = |scene: &Scene| {
        let mut scene = scene.clone();
        scene.materials[0].phase_g = 0.6;
        scene
    };
    for (estimator, edit) in [
        (Estimator::Fluence, &glows as &dyn Fn(&Scene) -> Scene),
        (Estimator::Points, &glows),
        (Estimator::Points, &askew),
    ] {
        let (scene, volume) = world(estimator, Weighting::Even, Filter::Linear);
        let mut frame = frame(&scene, &volume, &Split::default());
        let good = edit(&scene);
        let (table, lights) = (frame.scene.table_of(&good).expect("settled"), frame.scene.lights);
        frame.scene.edit(gpu(), table, lights, &Query::default()).expect("taken");
        frame.edit(gpu(), &good, &Split::default()).expect("applies");
        frame.rebuild(gpu(), &Split::default(), &mut Progress::silent()).expect("rebuilds");
        assert_eq!(difference(&frame, &good, &volume), None, "{estimator}");
    }
}

/// An edit whose camera is not placed is refused, and nothing of it is taken.
#[test]
fn an_edit_without_a_place_for_the_camera_is_refused() {
    let (scene, volume) = world(Estimator::Fluence, Weighting::Even, Filter::Linear);
    let mut frame = frame(&scene, &volume, &Split::default());
    let before = snapshot(gpu(), &frame);
    let mut edit = scene.clone();
    edit.materials[0].colour *= 0.5;
    edit.camera.place = CameraPlace::Around { from: DVec3::NEG_Y, zoom: 1.0 };
    frame.edit(gpu(), &edit, &Split::default()).expect_err("the camera is nowhere");
    let done = frame.update(gpu(), &Split::default(), &mut Progress::silent()).expect("updates");
    assert_eq!((done.listed, done.recomputed), (0, 0));
    assert_eq!(before.difference(&snapshot(gpu(), &frame)), None);
}
