//! An update after any edit leaves what a rebuild of the edited scene from nothing leaves,
//! bit for bit: slots, light field, segments and image, histories aside.

mod common;

use common::gpu;
use common::snapshot::{Snapshot, rebuild, snapshot};
use glam::DVec3;
use photogram::frame::DeviceScene;
use photogram::render::{Progress, Split};
use photogram::scene::{Estimator, Filter, Scene, Spatial, Weighting};
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
