//! Edits that change the table's domain, the majorant, or more than there is memory for.

use glam::DVec3;
use photogram::scene::{Estimator, Filter, Weighting};
use photogram::split::Split;
use photogram::update::Scope;

use super::common::snapshot::difference;
use super::common::{gpu, world};

#[test]
fn edits_beyond_domain_and_majorant_equal_a_fresh_frame() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (mut scene, volume) = world::world(estimator, Weighting::Even, Filter::Linear);
        let all = volume.range();
        scene.settings.range = Some([-100.0, 500.0]);
        scene.settings.majorant = Some(0.5);
        (scene.materials[1].extinction, scene.materials[2].extinction) = (0.2, 0.25);
        scene.materials[2].ramp = vec![[420.0, 0.0], [480.0, 1.0], [5000.0, 1.0]];
        let before = scene.domain(&volume);
        let split = Split::default();
        let mut frame = world::frame(&scene, &volume, &split);
        assert_eq!(difference(&frame, &scene, &volume), None);

        let mut beyond = scene.clone();
        beyond.materials[0].ramp = vec![[-900.0, 1.0], [600.0, 0.0], [900.0, 1.0], [all[1], 0.0]];
        assert_ne!(beyond.domain(&volume), before, "another domain");
        let mut dense = beyond.clone();
        dense.materials[1].extinction = 1.0;
        for (what, next) in [("beyond", &beyond), ("denser", &dense), ("back", &scene)] {
            let (scope, done) = world::update(&mut frame, next, &split);
            assert!(matches!(scope, Scope::Anew(anew) if anew.photons), "{what}: {scope:?}");
            assert_eq!(done.listed, done.photons, "{what}");
            assert_eq!(difference(&frame, next, &volume), None, "{what}");
        }
    }
}

#[test]
fn a_refused_edit_leaves_the_frame_as_it_was() {
    let (scene, volume) = world::world(Estimator::Fluence, Weighting::Even, Filter::Linear);
    let split = Split::default();
    let mut frame = world::frame(&scene, &volume, &split);
    if gpu().free_bytes().is_none() {
        return eprintln!("skipped: nobody knows what memory of this adapter is free");
    }
    let image = |frame: &photogram::update::PhotonFrame| {
        frame
            .segments
            .image(gpu())
            .expect("reads")
            .rgb
            .iter()
            .map(|p| p.map(f32::to_bits))
            .collect()
    };
    let before: Vec<[u32; 3]> = image(&frame);
    let mut many = scene.clone();
    (many.settings.photons, many.settings.max_events) = (2_863_311_530, 64);
    let mut large = scene.clone();
    (large.camera.width, large.camera.height) = (16_384, 16_384);
    let mut long = scene.clone();
    (long.camera.width, long.camera.height, long.settings.segments) = (16_384, 1, 1024);
    let mut light = scene.clone();
    light.lights[1].share = 3e6;
    let cases = [
        ("photons", &many, &["`photons`", "`max_events`", "GiB are free"][..]),
        ("size", &large, &["16384x16384", "image size", "`segments`", "`rays`"]),
        ("a row", &long, &["`segments`"]),
        ("share", &light, &["`photons`", "`max_events`"]),
    ];
    for (what, edited, words) in cases {
        let begun = std::time::Instant::now();
        let Err(error) = frame.edit(gpu(), edited, &split) else {
            if what == "a row" {
                // An adapter that binds as much takes it.
                world::update(&mut frame, &scene, &split);
                continue;
            }
            panic!("{what} is taken")
        };
        assert!(begun.elapsed().as_secs() < 5, "{what}");
        let error = error.to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{what}: {error}");
        let done = frame
            .update(gpu(), &split, &mut photogram::gpu::Progress::silent())
            .expect("there is nothing to do");
        assert_eq!((done.listed, done.recomputed), (0, 0), "{what}");
        assert!(image(&frame) == before, "{what}: another image");
        assert_eq!(frame.source(), &scene, "{what}");
    }
    // And the next edit is one of a frame that is whole.
    let mut next = scene.clone();
    next.materials[1].colour = DVec3::new(0.1, 0.9, 0.1);
    let (scope, _) = world::update(&mut frame, &next, &split);
    assert_eq!(scope, Scope::Part);
    assert_eq!(difference(&frame, &next, &volume), None);
}
