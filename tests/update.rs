//! An update after any edit leaves what a rebuild of the edited scene from nothing leaves,
//! bit for bit: slots, light field, segments and image, histories aside.

mod common;

use common::gpu;
use common::snapshot::{Snapshot, rebuild, snapshot};
use glam::DVec3;
use photogram::frame::DeviceScene;
use photogram::render::{Progress, Split};
use photogram::scene::{Estimator, Filter, Scene, Spatial, Weighting};
use photogram::segment::LightField;
use photogram::update::{PhotonFrame, Scope, Updated};
use photogram::volume::Volume;

/// A small world: a point light and surroundings, three tissues over a 24^3 hand.
const WORLD: &str = r#"
[volume]
phantom = "hand"
size = 32
[camera]
from = [-0.3, -1.0, 0.2]
width = 20
height = 16
[[light]]
kind = "point"
name = "lamp"
from = [-1.0, -1.0, 0.5]
distance = 2.0
intensity = 4000.0
[[light]]
kind = "surroundings"
name = "sky"
share = 0.5
radiance = 0.3
[[material]]
name = "soft"
window = [-200, 150]
extinction = 0.02
albedo = [0.9, 0.6, 0.5]
[[material]]
name = "vessel"
ramp = [[290, 0.0], [350, 1.0], [420, 1.0], [480, 0.0]]
extinction = 1.0
albedo = [0.9, 0.1, 0.1]
[[material]]
name = "bone"
ramp = [[480, 0.0], [700, 1.0], [2000, 1.0]]
extinction = 1.5
albedo = [0.9, 0.9, 0.8]
[settings]
photons = 700
max_events = 6
roulette_from = 3
segments = 5
rays = 1
majorant = 2.0
"#;

fn world(estimator: Estimator, weighting: Weighting, filter: Filter) -> (Scene, Volume) {
    let mut scene = Scene::parse(WORLD, "world.toml").expect("the world reads");
    scene.settings.estimator = Some(estimator);
    scene.settings.weighting = weighting;
    scene.filter = filter;
    common::settled(scene)
}

fn frame(scene: &Scene, volume: &Volume, split: &Split) -> PhotonFrame {
    let device = DeviceScene::new(gpu(), scene, volume).expect("uploads");
    let mut frame = PhotonFrame::new(gpu(), scene, device, 1, split).expect("fits");
    frame.rebuild(gpu(), split, &mut Progress::silent()).expect("rebuilds");
    frame
}

fn update(frame: &mut PhotonFrame, scene: &Scene, split: &Split) -> (Scope, Updated) {
    let scope = frame.edit(gpu(), scene, split).expect("the edit applies");
    let done = frame.update(gpu(), split, &mut Progress::silent()).expect("updates");
    assert!(done.finished);
    (scope, done)
}

fn difference(frame: &PhotonFrame, scene: &Scene, volume: &Volume) -> Option<&'static str> {
    let order = Snapshot::points_in_any_order;
    let now = order(snapshot(gpu(), frame).without_histories());
    let fresh = rebuild(gpu(), scene, volume, &Split::default()).without_histories();
    now.difference(&order(fresh))
}

/// Explicit randomness: SplitMix64.
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    fn below(&mut self, n: usize) -> usize {
        (self.roll() >> 33) as usize % n
    }

    fn unit(&mut self) -> f64 {
        (self.roll() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

const CLASSES: [&str; 12] = [
    "denser",
    "thinner",
    "transparent",
    "opaque",
    "recoloured",
    "absorbing",
    "moved window",
    "removed",
    "added",
    "light power",
    "light moved",
    "camera",
];

/// One random edit of the given class.
fn random_edit(scene: &mut Scene, class: &str, dice: &mut Dice, home: &Scene) {
    let m = dice.below(scene.materials.len().max(1));
    let light = dice.below(scene.lights.len());
    if scene.materials.is_empty() {
        scene.materials = home.materials.clone();
        return;
    }
    let material = &mut scene.materials[m];
    match class {
        "denser" => material.extinction = (material.extinction * (1.1 + dice.unit())).min(1.9),
        "thinner" => material.extinction *= 0.2 + 0.7 * dice.unit(),
        "transparent" => material.extinction = 0.0,
        "opaque" => material.extinction = 1.9,
        "recoloured" => {
            material.colour = DVec3::new(dice.unit(), dice.unit(), dice.unit());
            material.scatter = 1.0;
        }
        "absorbing" => material.scatter = 0.0,
        "moved window" => {
            let by = 60.0 * (dice.unit() - 0.5);
            material.ramp.iter_mut().for_each(|p| p[0] += by);
        }
        "removed" => drop(scene.materials.remove(m)),
        "added" => {
            let mut new = home.materials[dice.below(home.materials.len())].clone();
            new.name = format!("new {}", dice.roll());
            let by = 400.0 * (dice.unit() - 0.5);
            new.ramp.iter_mut().for_each(|p| p[0] += by);
            scene.materials.push(new);
        }
        "light power" => scene.lights[light].emitted *= DVec3::new(0.5, 1.5, dice.unit()),
        "light moved" => {
            let kind = &mut scene.lights[0].kind;
            if let photogram::scene::LightKind::Point { position } = kind {
                position.x += 20.0 * (dice.unit() - 0.5);
            }
        }
        _ => scene.camera.fov_deg *= 0.95 + 0.1 * dice.unit(),
    }
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
    let mut total = Updated::default();
    let (mut untouched_photons, mut untouched_segments) = (0, 0);
    let each = edits_wanted().div_ceil(variants.len());
    for (seed, (estimator, weighting, filter, spatial)) in (1..).zip(variants) {
        let (mut home, volume) = world(estimator, weighting, filter);
        home.settings.spatial = spatial;
        let mut dice = Dice(seed);
        let mut frame = frame(&home, &volume, &split);
        let first = snapshot(gpu(), &frame);
        let mut scene = home.clone();
        let mut history = Vec::new();
        for i in 0..each {
            let class = CLASSES[i % CLASSES.len()];
            // Now and then the last edits are undone.
            match dice.below(8) {
                0 if !history.is_empty() => scene = history.swap_remove(dice.below(history.len())),
                1 => scene = home.clone(),
                _ => {
                    history.push(scene.clone());
                    random_edit(&mut scene, class, &mut dice, &home);
                }
            }
            history.truncate(6);
            let (_, done) = update(&mut frame, &scene, &split);
            total.counts.invalid += done.counts.invalid;
            total.counts.changed += done.counts.changed;
            total.counts.reweighed += done.counts.reweighed;
            total.recomputed += done.recomputed;
            untouched_photons += done.photons - done.listed;
            untouched_segments += done.segments - done.recomputed;
            let wrong = difference(&frame, &scene, &volume);
            assert_eq!(wrong, None, "edit {i} ({class}), {estimator}, {weighting}, {filter}");
        }
        update(&mut frame, &home, &split);
        let last = snapshot(gpu(), &frame);
        assert_eq!(last.without_histories().difference(&first.without_histories()), None);
    }
    let c = total.counts;
    println!(
        "{} edits: {} photons invalid, {} reweighed, {} changed, {untouched_photons} untouched; {} \
         segments recomputed, {untouched_segments} untouched",
        4 * each,
        c.invalid,
        c.reweighed,
        c.changed,
        total.recomputed
    );
    let states = [c.invalid, c.reweighed, c.changed, untouched_photons, total.recomputed];
    let least = 20 * edits_wanted() as u64;
    assert!(states.iter().chain([&untouched_segments]).all(|&n| n > least), "{states:?}");
    assert!(c.changed < c.invalid + c.reweighed, "nothing was listed in vain");
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
    let edits: [(&str, fn(&mut Scene)); 10] = [
        ("everything changes", |s| s.materials.iter_mut().for_each(|m| m.extinction *= 0.5)),
        ("all is removed", |s| s.materials.clear()),
        ("the occluder goes", |s| s.materials.retain(|m| m.name != "soft")),
        ("colour of what only absorbs", |s| s.materials[1].scatter = 0.0),
        ("emission comes", |s| s.materials[2].emission = DVec3::new(0.1, 0.0, 0.0)),
        ("a light goes", |s| drop(s.lights.remove(0))),
        ("all lights go", |s| s.lights.clear()),
        ("a light goes out", |s| s.lights[0].emitted = DVec3::ZERO),
        ("the background", |s| s.background = DVec3::ONE),
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

#[test]
fn an_abandoned_update_leaves_nothing_behind() {
    let split = Split { journal: Some(64), ..Split::default() };
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (home, volume) = world(estimator, Weighting::Even, Filter::Linear);
        for stop_after in 0..12 {
            let mut frame = frame(&home, &volume, &split);
            let mut first = home.clone();
            first.materials[0].extinction = 0.05;
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
            let mut second = home.clone();
            second.materials[2].extinction = 0.7;
            second.lights.swap(0, 1);
            update(&mut frame, &second, &split);
            let wrong = difference(&frame, &second, &volume);
            assert_eq!(wrong, None, "{estimator}, stopped after {stop_after} boundaries");
        }
    }
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
