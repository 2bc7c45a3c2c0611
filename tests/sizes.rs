//! Frames of the smallest and of large sizes, and work that is too long for a driver: an update leaves
//! what a rebuild leaves all the same.

mod common;

use common::gpu;
use common::snapshot::{difference, snapshot};
use common::world::{WORLD, frame, update, world};
use glam::{DMat3, DVec3, Vec3};
use photogram::device_scene::DeviceScene;
use photogram::gpu::Progress;
use photogram::scene::{Estimator, Filter, Scene, Weighting};
use photogram::split::Split;
use photogram::volume::Volume;

/// More segments than a thread looks at: those that see changed light are found wherever they are.
#[test]
fn rays_of_many_segments_are_exact() {
    const SEGMENTS: usize = 200;
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (mut scene, volume) = world(estimator, Weighting::Even, Filter::Linear);
        scene.settings.segments = SEGMENTS as u32;
        let mut frame = frame(&scene, &volume, &Split::default());
        let before = snapshot(gpu(), &frame).without_histories().segments;
        scene.lights[0].emitted *= 0.5;
        let (_, done) = update(&mut frame, &scene, &Split::default());
        assert!(done.recomputed < done.segments, "{done:?}");
        assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}");
        let after = snapshot(gpu(), &frame).without_histories().segments;
        let mut changed = [0; SEGMENTS.div_ceil(32)];
        for i in (0..before.len()).filter(|&i| before[i] != after[i]) {
            changed[i % SEGMENTS / 32] += 1;
        }
        assert!(changed.iter().filter(|&&n| n > 10).count() > 1, "{estimator}: {changed:?}");
    }
}

/// Cells that are hashed, by several hashes.
#[test]
fn hashed_cells_are_exact() {
    for salt in [0, 1, 0xffff_ffff] {
        let split = Split { buckets: Some(1), salt: Some(salt), ..Split::default() };
        let (mut scene, volume) = world(Estimator::Points, Weighting::Plain, Filter::Linear);
        let mut frame = frame(&scene, &volume, &split);
        let mut edit = |scene: &Scene| {
            let (_, done) = update(&mut frame, scene, &split);
            assert_eq!(difference(&frame, scene, &volume), None, "salt {salt}");
            done
        };
        scene.materials[2].colour *= 0.5;
        assert!(edit(&scene).corrected > 0);
        scene.materials[1].extinction = 0.9;
        assert!(edit(&scene).points > 0);
    }
}

#[test]
fn the_smallest_frames_are_exact() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (mut scene, volume) = world(estimator, Weighting::Even, Filter::Linear);
        scene.lights.truncate(1);
        (scene.camera.width, scene.camera.height) = (1, 1);
        (scene.settings.photons, scene.settings.segments) = (1, 1);
        scene.settings.max_events = 1;
        let mut changed = 0;
        for seed in 0..8 {
            scene.settings.seed = seed;
            let mut frame = frame(&scene, &volume, &Split::default());
            for extinction in [0.0, 1.9, 0.01] {
                scene.materials[0].extinction = extinction;
                let (_, done) = update(&mut frame, &scene, &Split::default());
                assert_eq!((done.photons, done.segments), (1, 1));
                changed += done.counts.changed;
                assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}");
            }
        }
        assert!(changed > 0, "{estimator}: no photon met the flesh");
    }
}

/// A volume of one voxel of 1 mm, all of one material.
fn one_voxel(estimator: Estimator, photons: u32) -> (Scene, Volume) {
    let volume = Volume::new([1; 3], DVec3::ONE, DMat3::IDENTITY, DVec3::ZERO, vec![7_u16])
        .expect("a sound volume");
    let (_, lights) = WORLD.split_once("[[light]]").expect("lights");
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
/// together, without a word. Where it cut any short, all photons are traced anew, event by event.
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

/// A scene that nobody has checked against its volume: steps between collisions would be lost to
/// rounding, and a flight endless.
#[test]
fn a_majorant_beyond_single_precision_is_refused() {
    let (mut scene, volume) = one_voxel(Estimator::Fluence, 1);
    scene.settings.majorant = Some(1e7);
    let refused = DeviceScene::new(gpu(), &scene, &volume).map(|_| ()).expect_err("too dense");
    assert!(refused.to_string().contains("single precision"), "{refused}");
    scene.settings.step = 1e-8;
    let refused = DeviceScene::new(gpu(), &scene, &volume).map(|_| ()).expect_err("endless steps");
    assert!(refused.to_string().contains("`step` is"), "{refused}");
}

/// An update that the device refuses half way is followed by one that computes everything.
#[test]
fn a_failed_update_leaves_nothing_behind() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (mut scene, volume) = one_voxel(estimator, 400);
        // Across an empty voxel even a single flight is too long for Mesa's software adapter.
        (scene.settings.majorant, scene.settings.skip_empty) = (Some(60_000.0), false);
        scene.materials[0].extinction = 50_000.0;
        let mut frame = frame(&scene, &volume, &Split::default());
        let mut empty = scene.clone();
        empty.materials[0].extinction = 0.0;
        frame.edit(gpu(), &empty, &Split::default()).expect("applies");
        let failed = frame.update(gpu(), &Split::default(), &mut Progress::silent());
        if gpu().report().kind == "software" {
            assert!(failed.is_err(), "{estimator}: an update that cannot be done");
        }
        scene.materials[0].extinction = 40_000.0;
        let (_, done) = update(&mut frame, &scene, &Split::default());
        assert!(failed.is_ok() || done.counts.changed == done.photons);
        assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}");
    }
}

/// Light that is read from afar: so many blocks are around a point, or read a cell of the
/// fluence, that a loop over them is longer than a driver has patience for.
#[test]
fn light_that_reaches_across_the_volume_is_updated() {
    const EDGE: usize = 240;
    let values: Vec<u8> =
        (0..EDGE.pow(3)).map(|i| ((i % EDGE + i / EDGE % EDGE) / 2) as u8).collect();
    let volume = Volume::new([EDGE as u32; 3], DVec3::ONE, DMat3::IDENTITY, DVec3::ZERO, values)
        .expect("sound");
    let text = &WORLD[WORLD.find("[camera]").expect("a camera")..];
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let mut scene = common::scene_over(&volume, text);
        for (i, material) in scene.materials.iter_mut().enumerate() {
            material.ramp = vec![[30.0 * i as f64, 0.0], [30.0 * i as f64 + 60.0, 1.0]];
            material.extinction = 0.01;
        }
        let settings = &mut scene.settings;
        (settings.estimator, settings.weighting) = (Some(estimator), Weighting::Even);
        (settings.radius, settings.grid, settings.photons) = (Some(90.0), 0.0125, 100);
        (scene.camera.width, scene.camera.height) = (4, 4);
        scene.settle(&volume);
        let mut frame = frame(&scene, &volume, &Split::default());
        scene.materials[1].extinction *= 1.5;
        update(&mut frame, &scene, &Split::default());
        assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}");
    }
}
