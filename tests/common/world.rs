//! A small world that edits are tried on.

use glam::DVec3;
use photogram::frame::DeviceScene;
use photogram::render::{Progress, Split};
use photogram::scene::{Estimator, Filter, LightKind, Scene, Weighting};
use photogram::update::{PhotonFrame, Scope, Updated};
use photogram::volume::Volume;

use super::gpu;

/// A small world: a point light and surroundings, three tissues over a 24^3 hand.
pub const WORLD: &str = r#"
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

pub fn world(estimator: Estimator, weighting: Weighting, filter: Filter) -> (Scene, Volume) {
    let mut scene = Scene::parse(WORLD, "world.toml").expect("the world reads");
    scene.settings.estimator = Some(estimator);
    scene.settings.weighting = weighting;
    scene.filter = filter;
    super::settled(scene)
}

pub fn frame(scene: &Scene, volume: &Volume, split: &Split) -> PhotonFrame {
    let device = DeviceScene::new(gpu(), scene, volume).expect("uploads");
    let mut frame = PhotonFrame::new(gpu(), scene, device, 1, split).expect("fits");
    frame.rebuild(gpu(), split, &mut Progress::silent()).expect("rebuilds");
    frame
}

pub fn update(frame: &mut PhotonFrame, scene: &Scene, split: &Split) -> (Scope, Updated) {
    let scope = frame.edit(gpu(), scene, split).expect("the edit applies");
    let done = frame.update(gpu(), split, &mut Progress::silent()).expect("updates");
    assert!(done.finished);
    (scope, done)
}

/// Explicit randomness: SplitMix64.
pub struct Dice(pub u64);

impl Dice {
    pub fn roll(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.roll() >> 33) as usize % n
    }

    pub fn unit(&mut self) -> f64 {
        (self.roll() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

pub const CLASSES: [&str; 16] = [
    "denser",
    "thinner",
    "transparent",
    "opaque",
    "recoloured",
    "absorbing",
    "moved window",
    "removed",
    "added",
    "emission",
    "phase",
    "light power",
    "light moved",
    "light gone or back",
    "background",
    "camera",
];

/// One random edit of the given class.
pub fn random_edit(scene: &mut Scene, class: &str, dice: &mut Dice, home: &Scene) {
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
        // Off as often as on.
        "emission" => {
            material.emission = DVec3::new(0.02, 0.0, 0.01) * dice.unit() * dice.below(2) as f64;
        }
        // The fluence knows isotropic scattering only.
        "phase" if scene.settings.estimator == Some(Estimator::Points) => {
            material.phase_g = 1.6 * (dice.unit() - 0.5) * dice.below(2) as f64;
        }
        "phase" => material.scatter = dice.unit(),
        "light power" => scene.lights[light].emitted *= DVec3::new(0.5, 1.5, dice.unit()),
        "light moved" => {
            let kind = &mut scene.lights[0].kind;
            if let LightKind::Point { position } = kind {
                position.x += 20.0 * (dice.unit() - 0.5);
            }
        }
        "light gone or back" => match scene.lights.len() {
            1 => scene.lights.clone_from(&home.lights),
            _ => drop(scene.lights.remove(light)),
        },
        "background" => scene.background = DVec3::splat(dice.unit()),
        _ => scene.camera.fov_deg *= 0.95 + 0.1 * dice.unit(),
    }
}
