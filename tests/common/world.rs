//! A small world that edits are tried on.

use glam::{DMat3, DVec3};
use photogram::device_scene::DeviceScene;
use photogram::gpu::Progress;
use photogram::scene::{
    CameraPlace, Estimator, Filter, LightKind, Material, Scene, Spatial, Weighting,
};
use photogram::split::Split;
use photogram::update::{PhotonFrame, Scope, Updated};
use photogram::volume::Volume;

use super::gpu;

/// A small world: a point light and surroundings, three tissues over a hand of 32 voxels.
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
    let mut frame = PhotonFrame::new(gpu(), scene, device, split).expect("fits");
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

pub const CLASSES: [&str; 22] = [
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
    "scatter",
    "light power",
    "light moved",
    "light gone or back",
    "background",
    "camera",
    "majorant",
    "photons",
    "light field",
    "size and rays",
    "step",
];

/// A random scene: size, spacing, orientation and type of the volume, three tissues over
/// blobs, lights of all kinds, settings.
pub fn random_world(dice: &mut Dice) -> (Scene, Volume) {
    let size = [0; 3].map(|_| 8 + dice.below(20) as u32);
    let spacing = DVec3::new(0.5 + dice.unit(), 0.5 + dice.unit(), 0.5 + dice.unit());
    let turned = DMat3::from_axis_angle(random_direction(dice), 6.0 * dice.unit());
    let mirror = DMat3::from_diagonal(DVec3::new([-1.0, 1.0][dice.below(2)], 1.0, 1.0));
    let origin = 50.0 * random_direction(dice);
    let levels = blobs(size, dice);
    // Values of a level, so that a ramp is the same whatever the type.
    let (volume, value): (_, fn(f64) -> f64) = match dice.below(3) {
        0 => (Volume::new(size, spacing, turned * mirror, origin, levels), |x| x),
        1 => {
            let values: Vec<i16> = levels.iter().map(|&x| i16::from(x) * 13 - 1000).collect();
            (Volume::new(size, spacing, turned, origin, values), |x| 13.0 * x - 1000.0)
        }
        _ => {
            // Far from zero, where neighbours in single precision are some table entries apart.
            let far = |x: &u8| f32::from(*x) * 0.03125 + 101_320.0;
            let values: Vec<f32> = levels.iter().map(far).collect();
            (Volume::new(size, spacing, turned, origin, values), |x| 0.03125 * x + 101_320.0)
        }
    };
    let volume = volume.expect("a sound volume");
    let text = &WORLD[WORLD.find("[camera]").expect("a camera")..];
    // A third light, so that one is seldom more than half of all.
    let third =
        "[[light]]\nkind = \"surroundings\"\nname = \"third\"\nshare = 0.5\nradiance = 0.1\n";
    let mut scene = super::scene_over(&volume, &format!("{text}{third}"));
    let (glows, is_askew) = (dice.below(2) == 0, dice.below(3) == 0);
    for material in &mut scene.materials {
        if glows {
            material.emission = DVec3::new(0.02, 0.01, 0.0) * dice.unit();
        }
        if is_askew {
            material.phase_g = dice.unit() - 0.5;
        }
        let (low, width) = (200.0 * dice.unit(), 20.0 + 100.0 * dice.unit());
        material.ramp = [(0.0, 0.0), (0.2, 1.0), (0.7, 1.0), (1.0, 0.0)]
            .map(|(at, weight)| [value(low + at * width), weight])
            .to_vec();
        material.extinction = 1.9 * dice.unit().powi(3);
        material.colour = DVec3::new(dice.unit(), dice.unit(), dice.unit());
    }
    scene.filter = [Filter::Linear, Filter::Nearest][dice.below(2)];
    scene.camera.place =
        CameraPlace::Around { from: random_direction(dice), zoom: 1.0 + dice.unit() };
    scene.camera.up = random_direction(dice);
    (scene.camera.width, scene.camera.height) =
        (5 + dice.below(18) as u32, 5 + dice.below(18) as u32);
    let kinds = [
        LightKind::PointAround { from: random_direction(dice), distance: 0.3 + 2.0 * dice.unit() },
        LightKind::Directional { direction: random_direction(dice) },
        LightKind::RectangleAround { from: random_direction(dice), distance: 2.0, size: 1.0 },
        LightKind::Surroundings,
    ];
    let first = dice.below(4);
    for (i, light) in scene.lights.iter_mut().enumerate() {
        light.kind = kinds[(first + i) % 4];
        light.emitted = DVec3::new(dice.unit(), dice.unit(), dice.unit()) * 10.0;
        light.share = 0.2 + 0.6 * dice.unit();
    }
    let settings = &mut scene.settings;
    // The fluence knows isotropic scattering only. Each has half of the worlds.
    settings.estimator = match is_askew || dice.below(4) == 0 {
        true => Some(Estimator::Points),
        false => Some(Estimator::Fluence),
    };
    settings.weighting = [Weighting::Even, Weighting::Plain][dice.below(2)];
    settings.spatial = [Spatial::Exact, Spatial::Exact, Spatial::Axes][dice.below(3)];
    settings.skip_empty = dice.below(4) > 0;
    // A dense world has segments that let nothing through.
    settings.majorant = Some([2.0, 2.0, 12.0][dice.below(3)]);
    settings.photons = 400 + dice.below(600) as u64;
    settings.max_events = 1 + dice.below(7) as u32;
    settings.roulette_from = 1 + dice.below(4) as u32;
    settings.roulette_survival = 0.5 + 0.5 * dice.unit();
    settings.radius = Some(spacing.min_element() * (0.7 + 2.0 * dice.unit()));
    settings.grid = 0.3 + 0.7 * dice.unit();
    settings.segments = 1 + dice.below(7) as u32;
    settings.step = 0.5 + dice.unit();
    settings.seed = dice.roll();
    // With several rays a pixel every update computes all segments.
    settings.rays = if dice.below(8) == 0 { 2 } else { 1 };
    settings.flux_unit = None;
    scene.settle(&volume);
    // Sums of more than one word.
    scene.settings.flux_unit =
        scene.settings.flux_unit.map(|unit| unit * 0.5_f64.powi(6 + dice.below(10) as i32));
    (scene, volume)
}

/// A unit vector.
fn random_direction(dice: &mut Dice) -> DVec3 {
    loop {
        let v = 2.0 * DVec3::new(dice.unit(), dice.unit(), dice.unit()) - 1.0;
        if v.length() > 0.1 && v.length() < 1.0 {
            return v.normalize();
        }
    }
}

/// Ellipsoids of random levels, the later ones before the others.
fn blobs(size: [u32; 3], dice: &mut Dice) -> Vec<u8> {
    let size = size.map(f64::from);
    let mut place = |low: f64, high: f64| size.map(|n| n * (low + (high - low) * dice.unit()));
    let bodies: Vec<_> = (0..8).map(|_| (place(0.1, 0.9), place(0.1, 0.5))).collect();
    let levels: Vec<u8> = (0..8).map(|_| 20 + dice.below(236) as u8).collect();
    let mut voxels = Vec::new();
    for k in 0..size[2] as u32 {
        for j in 0..size[1] as u32 {
            for i in 0..size[0] as u32 {
                let at = [i, j, k].map(f64::from);
                let within = |(centre, radii): &([f64; 3], [f64; 3])| {
                    (0..3).map(|a| ((at[a] - centre[a]) / radii[a]).powi(2)).sum::<f64>() < 1.0
                };
                voxels.push(bodies.iter().rposition(within).map_or(0, |body| levels[body]));
            }
        }
    }
    voxels
}

fn shift(material: &mut Material, spans: f64) {
    let ends = (material.ramp[0][0], material.ramp[material.ramp.len() - 1][0]);
    material.ramp.iter_mut().for_each(|p| p[0] += spans * (ends.1 - ends.0));
}

/// One random edit of the given class, or of one that the scene knows; returns which.
pub fn random_edit(
    scene: &mut Scene,
    class: &'static str,
    dice: &mut Dice,
    home: &Scene,
) -> &'static str {
    // The fluence knows isotropic scattering only.
    let class = match (class, scene.settings.estimator) {
        ("phase", Some(Estimator::Fluence)) => "scatter",
        _ => class,
    };
    let m = dice.below(scene.materials.len().max(1));
    let light = dice.below(scene.lights.len());
    let most = 0.95 * scene.settings.majorant.expect("the world has one");
    if scene.materials.is_empty() {
        scene.materials = home.materials.clone();
        return "added";
    }
    let material = &mut scene.materials[m];
    match class {
        "denser" => material.extinction = (material.extinction * (1.1 + dice.unit())).min(most),
        "thinner" => material.extinction *= 0.2 + 0.7 * dice.unit(),
        "transparent" => material.extinction = 0.0,
        "opaque" => material.extinction = most,
        "recoloured" => {
            material.colour = DVec3::new(dice.unit(), dice.unit(), dice.unit());
            material.scatter = 1.0;
        }
        "absorbing" => material.scatter = 0.0,
        "moved window" => shift(material, 0.2 * (dice.unit() - 0.5)),
        "removed" => drop(scene.materials.remove(m)),
        "added" => {
            let mut new = home.materials[dice.below(home.materials.len())].clone();
            new.name = format!("new {}", dice.roll());
            shift(&mut new, dice.unit() - 0.5);
            scene.materials.push(new);
        }
        // Off as often as on.
        "emission" => {
            material.emission = DVec3::new(0.02, 0.0, 0.01) * dice.unit() * dice.below(2) as f64;
        }
        "phase" => material.phase_g = 1.6 * (dice.unit() - 0.5) * dice.below(2) as f64,
        "scatter" => material.scatter = dice.unit(),
        "light power" => scene.lights[light].emitted *= DVec3::new(0.5, 1.5, dice.unit()),
        "light moved" => {
            let by = DVec3::new(dice.unit(), dice.unit(), dice.unit()) - 0.5;
            match &mut scene.lights[light].kind {
                LightKind::Point { position } => *position += 20.0 * by,
                LightKind::Rectangle { corner, .. } => *corner += 20.0 * by,
                LightKind::Directional { direction } => *direction += 0.5 * by,
                _ => {}
            }
        }
        "light gone or back" => match scene.lights.len() {
            1 => scene.lights.clone_from(&home.lights),
            _ => drop(scene.lights.remove(light)),
        },
        "background" => scene.background = DVec3::splat(dice.unit()),
        // By an extinction above it, or by its word.
        "majorant" => match dice.below(2) {
            0 => material.extinction = most * (1.1 + dice.unit()),
            _ => scene.settings.majorant = Some(most * (1.0 + dice.unit())),
        },
        "photons" => match dice.below(3) {
            0 => scene.settings.max_events = 1 + dice.below(7) as u32,
            1 => scene.settings.seed = dice.roll(),
            _ => scene.settings.photons = 400 + dice.below(600) as u64,
        },
        "light field" => {
            let settings = &mut scene.settings;
            settings.grid = 0.3 + 0.7 * dice.unit();
            settings.radius = settings.radius.map(|r| (r * (0.6 + dice.unit())).clamp(0.3, 4.0));
        }
        "size and rays" => match dice.below(3) {
            0 => scene.camera.width = 5 + dice.below(18) as u32,
            1 => scene.settings.segments = 1 + dice.below(7) as u32,
            _ => scene.settings.rays = 1 + u32::from(dice.below(8) == 0),
        },
        "step" => scene.settings.step = 0.5 + dice.unit(),
        _ => {
            let by = DVec3::new(dice.unit(), dice.unit(), dice.unit()) - 0.5;
            match (dice.below(4), &mut scene.camera.place) {
                (0, CameraPlace::At { origin, .. }) => *origin += 10.0 * by,
                (1, CameraPlace::At { target, .. }) => *target += 10.0 * by,
                (2, _) => scene.camera.up = random_direction(dice),
                _ => scene.camera.fov_deg *= 1.0 + 0.1 * by.x,
            }
        }
    }
    class
}
