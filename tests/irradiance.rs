//! The irradiance cache: that samples are right on average whatever the cache has, that pictures tend to
//! the truth, that they are functions of the number of passes, and what edits keep.

mod common;

use std::collections::HashMap;
use std::time::Duration;

use common::world::world;
use common::{gpu, truth_image, truth_scene};
use glam::{DMat3, DVec3};
use photogram::device_scene::DeviceScene;
use photogram::film::Image;
use photogram::film::metrics::Metrics;
use photogram::gpu::{AdapterChoice, Gpu, Progress};
use photogram::irradiance::{Film, IrradianceCache, Until};
use photogram::reference::Reference;
use photogram::scene::{
    Cache, Estimator, Filter, Light, LightKind, Method, Scene, Shadows, Weighting,
};
use photogram::volume::Volume;

/// A small scene with a lamp and surroundings; and a large rectangle that touches the volume.
fn small() -> (Scene, Volume) {
    let (mut scene, volume) = world(Estimator::Fluence, Weighting::Even, Filter::Linear);
    (scene.camera.width, scene.camera.height) = (40, 36);
    scene.settings.method = Method::IrradianceCache;
    let kind =
        LightKind::RectangleAround { from: [0.7, -0.6, 0.1].into(), distance: 0.4, size: 0.8 };
    let emitted = [2.0, 1.5, 1.0].into();
    let id = 7;
    scene.lights.push(Light { id, name: "panel".to_owned(), share: 1.0, emitted, kind });
    scene.settle(&volume);
    (scene, volume)
}

fn begun(gpu: &Gpu, scene: &Scene, volume: &Volume) -> IrradianceCache {
    let device = DeviceScene::new(gpu, scene, volume).expect("uploads");
    IrradianceCache::new(gpu, scene, device).expect("fits")
}

fn after(gpu: &Gpu, scene: &Scene, volume: &Volume, passes: u32) -> IrradianceCache {
    let mut cache = begun(gpu, scene, volume);
    add(gpu, &mut cache, passes);
    cache
}

fn add(gpu: &Gpu, cache: &mut IrradianceCache, passes: u32) {
    cache.run(gpu, Until::Passes(passes), &mut Progress::silent()).expect("passes");
}

fn reference(scene: &Scene, volume: &Volume, samples: u32) -> (Image, Image) {
    let mut single = scene.clone();
    single.settings.method = Method::Mcvr;
    let device = DeviceScene::new(gpu(), &single, volume).expect("uploads");
    let mut reference = Reference::new(gpu(), &single, &device).expect("fits");
    reference.add(gpu(), &device, samples, &mut Progress::silent()).expect("traces");
    let estimate = reference.image(gpu()).expect("reads");
    (estimate.mean, estimate.error)
}

/// How many standard errors the means of two images are apart.
fn z(one: (&Image, &Image), other: (&Image, &Image)) -> f64 {
    let mean = |image: &Image| {
        let all = image.rgb.iter().flatten().map(|&v| f64::from(v));
        all.sum::<f64>() / (3 * image.rgb.len()) as f64
    };
    // Channels go together.
    let variance = |error: &Image| {
        let all = error.rgb.iter().map(|e| e.iter().map(|&e| f64::from(e)).sum::<f64>() / 3.0);
        all.map(|e| e * e).sum::<f64>() / (error.rgb.len() as f64).powi(2)
    };
    (mean(one.0) - mean(other.0)) / (variance(one.1) + variance(other.1)).sqrt()
}

type Change = fn(&mut Scene);

fn bits(film: &[Film]) -> Vec<u8> {
    bytemuck::cast_slice(film).to_vec()
}

#[test]
fn samples_are_right_on_average_whatever_the_cache_has() {
    let (mut scene, volume) = small();
    let (truth, noise) = reference(&scene, &volume, 3000);
    for cache in [Cache::None, Cache::Grid] {
        for shadows in [Shadows::One, Shadows::All, Shadows::Evenly] {
            for gather in [false, true] {
                if cache == Cache::None && gather {
                    continue;
                }
                let settings = &mut scene.settings;
                (settings.cache, settings.shadows, settings.gather) = (cache, shadows, gather);
                let run = after(gpu(), &scene, &volume, 300);
                let images = run.images(gpu()).expect("reads");
                let z = z((&images.samples, &images.error), (&truth, &noise));
                let what = format!("{cache}, {shadows}, gather {gather}");
                assert!(z.abs() < 4.0, "{what}: {z} standard errors from the reference");
                let known = run.cells(gpu()).expect("reads").map_or(0, |c| c.by_level[1]);
                assert_eq!(known > 100, cache == Cache::Grid, "{what}: {known} cells");
            }
        }
    }
}

/// Where the cache is sure, light samples are taken now and then, and make up for those that are not.
#[test]
fn samples_that_are_left_out_are_made_up_for() {
    let (mut scene, volume) = small();
    scene.camera.fov_deg *= 0.05;
    let (truth, noise) = reference(&scene, &volume, 1000);
    let taken = [1.0, 0.25].map(|least| {
        scene.settings.least_chance = least;
        let run = after(gpu(), &scene, &volume, 200);
        let images = run.images(gpu()).expect("reads");
        let z = z((&images.samples, &images.error), (&truth, &noise));
        assert!(z.abs() < 4.0, "least chance {least}: {z} standard errors from the reference");
        run.counts(gpu()).expect("reads").samples
    });
    assert!(taken[1] < taken[0] / 2, "{taken:?}");
}

/// A blocker that no pixel sees, between lamp and floor: shadow rays alone know of it.
#[test]
fn edits_that_shadow_rays_alone_meet_are_heard_of() {
    const TEXT: &str = r#"
name = "floor"
[volume]
phantom = "hand"
[camera]
origin = [16, -40, 5]
target = [16, 16, 3.5]
fov_deg = 2
width = 16
height = 16
[[light]]
kind = "point"
name = "lamp"
position = [16, 16, 100]
intensity = 4000
[[material]]
name = "floor"
window = [50, 150]
extinction = 1
albedo = 0.8
[[material]]
name = "blocker"
window = [150, 250]
extinction = 0.05
albedo = 0.8
[settings]
method = "irradiance-cache"
cache = "none"
"#;
    let value = |i: u32| match i / (32 * 32) {
        0..4 => 100,
        24..28 => 200,
        _ => 0_u16,
    };
    let volume = Volume::new(
        [32; 3],
        DVec3::ONE,
        DMat3::IDENTITY,
        DVec3::ZERO,
        (0..32 * 32 * 32).map(value).collect::<Vec<u16>>(),
    )
    .expect("a sound volume");
    let mut home = Scene::parse(TEXT, "floor.toml").expect("it reads");
    home.filter = Filter::Nearest;
    home.settle(&volume);
    let mut edited = home.clone();
    edited.materials[1].extinction = 0.2;
    let mut run = after(gpu(), &home, &volume, 12);
    let lit = run.film(gpu()).expect("reads").iter().filter(|f| f.mean != [0.0; 3]).count();
    let touched = run.edit(gpu(), &edited).expect("applies");
    assert!(lit > 100 && touched.restarted >= lit as u64, "{lit} are lit, {touched:?}");
    let fresh = after(gpu(), &edited, &volume, 12).film(gpu()).expect("reads");
    for (now, fresh) in run.film(gpu()).expect("reads").iter().zip(&fresh) {
        assert!(now.passes == 0 || now.mean == fresh.mean, "{now:?}, fresh {fresh:?}");
    }
}

/// Cached light is smoothed, so that its own error has a floor; blended, it falls on.
#[test]
fn pictures_tend_to_the_truth() {
    let (mut scene, volume) = truth_scene("ball_single");
    let (truth, _) = truth_image("ball_single");
    scene.settings.method = Method::IrradianceCache;
    let mut run = begun(gpu(), &scene, &volume);
    let mut errors = Vec::new();
    for passes in [4, 16, 64, 256] {
        let more = passes - run.passes();
        add(gpu(), &mut run, more);
        let images = run.images(gpu()).expect("reads");
        let error = |image: &Image| Metrics::of(image, &truth).expect("compares").rel_mse;
        errors.push([error(&images.blended), error(&images.samples), error(&images.cached)]);
    }
    for pair in errors.windows(2) {
        assert!(pair[1][0] < 0.6 * pair[0][0], "{errors:?}");
    }
    for [blended, samples, cached] in &errors {
        assert!(*blended < 1.1 * samples.min(*cached), "{errors:?}");
    }
    assert!(errors[3][0] < 0.005, "{errors:?}");
}

/// The picture is a function of the number of passes: not of slices, nor of the process.
#[test]
fn pictures_are_functions_of_the_passes() {
    let (mut scene, volume) = small();
    (scene.camera.width, scene.camera.height) = (100, 90);
    let first = after(gpu(), &scene, &volume, 24);
    let film = first.film(gpu()).expect("reads");
    let cells = first.cells(gpu()).expect("reads").expect("a grid");
    assert!(cells.by_level[..3].iter().all(|&n| n > 20) && cells.refused == 0, "{cells:?}");
    let other = pollster::block_on(photogram::open(&AdapterChoice::Best)).expect("an adapter");
    other.set_slice_budget(Duration::from_micros(200));
    let second = after(&other, &scene, &volume, 24);
    assert!(other.effort().submits > 100, "slices are long");
    assert!(bits(&film) == bits(&second.film(&other).expect("reads")));
    let shown = |run: &IrradianceCache, gpu: &Gpu| run.images(gpu).expect("reads").blended;
    assert_eq!(shown(&first, gpu()), shown(&second, &other));
    assert_eq!(second.cells(&other).expect("reads"), Some(cells));
}

/// Each cell is there once, in reach of its key, and all samples are in the cells that they were added to,
/// however many threads made cells at once.
#[test]
fn cells_are_sound_under_contention() {
    let (mut scene, volume) = small();
    // All pixels see the same few cells.
    scene.camera.fov_deg *= 0.05;
    for (mib, is_full) in [(4.0, false), (0.004, true)] {
        scene.settings.cache_mib = mib;
        let run = after(gpu(), &scene, &volume, 20);
        let counts = run.counts(gpu()).expect("reads");
        let table = run.table(gpu()).expect("reads").expect("a grid");
        let mut seen = HashMap::new();
        let mut coarse = 0;
        for slot in table.chunks_exact(8).filter(|slot| slot[0] != 0) {
            assert_eq!(seen.insert(slot[0], slot[1]), None, "a cell is there twice");
            assert!(slot[1] > 0, "a cell without samples");
            coarse += if run.level_of(slot[0]) == Some(0) { u64::from(slot[1]) } else { 0 };
        }
        let cells = run.cells(gpu()).expect("reads").expect("a grid");
        assert_eq!(seen.len() as u64, cells.by_level.iter().sum::<u64>());
        assert_eq!(seen.len() as u64, cells.made, "cells were counted otherwise");
        assert!(counts.samples > 1000, "few samples");
        let most = seen.values().max().expect("a cell");
        assert!(*most < 4096, "some have learned enough: the sum below does not hold");
        match is_full {
            // What was refused may be of any level.
            true => assert!(cells.refused > 0 && coarse <= counts.samples, "{cells:?}"),
            false => assert_eq!((coarse, cells.refused), (counts.samples, 0), "{cells:?}"),
        }
        // Full or not, samples are right.
        let images = run.images(gpu()).expect("reads");
        assert!(images.blended.rgb.iter().flatten().all(|v| v.is_finite()));
    }
}

/// Pixels that an edit does not touch have the samples that they would have, had it been there from the
/// start: bit for bit, without a cache.
#[test]
fn pixels_that_are_kept_are_those_of_a_fresh_start() {
    let (mut home, volume) = small();
    home.settings.cache = Cache::None;
    let passes = 12;
    let edits: [(&str, Change); 5] = [
        ("colour", |scene| scene.materials[2].colour.x *= 0.3),
        ("vessel", |scene| scene.materials[1].extinction *= 0.4),
        ("denser", |scene| scene.materials[1].extinction *= 1.4),
        ("light", |scene| scene.lights[0].emitted *= 2.0),
        ("nothing", |_| ()),
    ];
    for (what, change) in edits {
        let mut edited = home.clone();
        change(&mut edited);
        let mut run = after(gpu(), &home, &volume, passes);
        let touched = run.edit(gpu(), &edited).expect("applies");
        let now = run.film(gpu()).expect("reads");
        let fresh = after(gpu(), &edited, &volume, passes).film(gpu()).expect("reads");
        let restarted = now.iter().filter(|f| f.passes == 0).count() as u64;
        assert_eq!(touched.restarted, restarted, "{what}");
        let all = touched.pixels;
        match what {
            "nothing" => assert_eq!(restarted, 0),
            "light" => assert_eq!(restarted, all),
            _ => assert!(restarted > all / 50 && restarted < all * 49 / 50, "{what}: {restarted}"),
        }
        for (i, (now, fresh)) in now.iter().zip(&fresh).enumerate() {
            let same = now.mean == fresh.mean && now.deviation == fresh.deviation;
            assert!(now.passes == 0 || same, "{what}, pixel {i}: {now:?}, fresh {fresh:?}");
        }
    }
}

#[test]
fn edits_keep_what_they_can() {
    let (mut home, volume) = small();
    // Near the panel single samples are bright, and errors of few frames are theirs.
    home.lights.pop();
    let before = after(gpu(), &home, &volume, 40).table(gpu()).expect("reads");
    // What a colour has no part in stays, bit for bit.
    let mut run = after(gpu(), &home, &volume, 40);
    let mut edited = home.clone();
    edited.materials[2].colour = [0.2, 0.5, 0.9].into();
    assert!(run.edit(gpu(), &edited).expect("applies").cells_stand);
    let sorted = |table: Option<Vec<u32>>| {
        let mut slots: Vec<[u32; 8]> = bytemuck::cast_slice(&table.expect("a grid")).to_vec();
        slots.sort_unstable();
        slots
    };
    assert!(sorted(before) == sorted(run.table(gpu()).expect("reads")));
    // Another extinction leaves what was learned as a beginning, which beats a fresh start.
    let mut scene = home.clone();
    let mut edited = home.clone();
    edited.materials[1].extinction *= 0.5;
    let (truth, _) = reference(&edited, &volume, 2000);
    let error = |run: &IrradianceCache| {
        let image = run.images(gpu()).expect("reads").blended;
        Metrics::of(&image, &truth).expect("compares").rel_mse
    };
    const FRAMES: [u32; 5] = [1, 2, 4, 8, 16];
    let mut errors = [[0.0; 2]; FRAMES.len()];
    let mut last = None;
    // Single frames are noisy, and a few bright samples would rule their mean.
    for seed in 1..=12 {
        (edited.settings.seed, scene.settings.seed) = (seed, seed);
        let mut run = after(gpu(), &scene, &volume, 40);
        let touched = run.edit(gpu(), &edited).expect("applies");
        assert!(!touched.cells_stand && touched.restarted > 0, "{touched:?}");
        let table = run.table(gpu()).expect("reads").expect("a grid");
        assert_eq!(table.chunks_exact(8).map(|slot| slot[1]).max(), Some(8));
        let mut fresh = begun(gpu(), &edited, &volume);
        for (frames, errors) in FRAMES.into_iter().zip(&mut errors) {
            let more = frames - fresh.passes();
            add(gpu(), &mut fresh, more);
            add(gpu(), &mut run, more);
            *errors = [errors[0] + error(&run).ln(), errors[1] + error(&fresh).ln()];
        }
        last = Some(run);
    }
    println!("{errors:?}");
    assert!(errors.iter().all(|[kept, fresh]| kept < fresh), "{errors:?}");
    let mut run = last.expect("a run");
    // The camera takes the cache along.
    let mut moved = edited.clone();
    moved.camera.width = 41;
    assert!(run.edit(gpu(), &moved).is_err());
    let cells = run.table(gpu()).expect("reads");
    edited.background = [0.1, 0.2, 0.3].into();
    let touched = run.edit(gpu(), &edited).expect("applies");
    assert!(touched.cells_stand && touched.restarted == touched.pixels, "{touched:?}");
    assert!(cells == run.table(gpu()).expect("reads"));
}

#[test]
fn what_cannot_be_is_refused() {
    let (mut scene, volume) = small();
    let refusal = |scene: &Scene| {
        let device = DeviceScene::new(gpu(), scene, &volume).expect("uploads");
        IrradianceCache::new(gpu(), scene, device).err().map(|e| e.to_string())
    };
    assert_eq!(refusal(&scene), None);
    scene.materials[0].phase_g = 0.5;
    assert!(refusal(&scene).is_some_and(|e| e.contains("phase_g")));
    scene.materials[0].phase_g = 0.0;
    scene.settings.cache_mib = 0.0;
    assert!(scene.check().is_err());
}
