//! Segments under the linear filter: where the value varies linearly along a ray, extinction and
//! emission between two samples are integrated in closed form, whatever the step.

mod common;

use common::{rendered, scene_over};
use glam::{DMat3, DVec3};
use photogram::film::Image;
use photogram::scene::Scene;
use photogram::volume::Volume;

const EDGE: u32 = 24;
/// The value rises by so much from one voxel to the next, along z.
const RISE: u32 = 40;

/// Voxels of 1 mm whose value is linear in z, all whole numbers.
fn ramp() -> Volume {
    let values =
        (0..EDGE * EDGE * EDGE).map(|i| (i / (EDGE * EDGE) * RISE) as u16).collect::<Vec<_>>();
    let origin = DVec3::splat(0.5);
    Volume::new([EDGE; 3], DVec3::ONE, DMat3::IDENTITY, origin, values).expect("sound")
}

/// Seen askew, against a background of 1, with so long a step.
fn scene(volume: &Volume, step: f64, materials: &str) -> Scene {
    let text = format!(
        "background = [1, 1, 1]\n[camera]\norigin = [50, 20, -60]\ntarget = [12, 12, 12]\nfov_deg = 12\n\
         width = 8\nheight = 8\n{materials}"
    );
    let mut scene = scene_over(volume, &text);
    (scene.settings.step, scene.settings.rays) = (step, 1);
    scene
}

/// The mean of a property over the table entries that a piece of a ray passes, from the z where it
/// begins to where it ends, by brute force.
fn integral(scene: &Scene, volume: &Volume, z: [f64; 2], of: impl Fn(f64) -> f64) -> f64 {
    let domain = scene.domain(volume);
    let map = domain.map(&volume.numbers());
    let parts = 100_000;
    let at = |i: u32| z[0] + (z[1] - z[0]) * (f64::from(i) + 0.5) / f64::from(parts);
    let value = |z: f64| (z - 0.5).clamp(0.0, f64::from(EDGE - 1)) * f64::from(RISE);
    let entry = |z: f64| map.entry_of(value(z) as f32);
    (0..parts).map(|i| of(domain.value(entry(at(i))))).sum::<f64>() / f64::from(parts)
}

/// What each pixel of a scene should show: (transmittance, emission if nothing extinguishes).
fn expected(scene: &Scene, volume: &Volume, of: impl Fn(f64) -> f64) -> Vec<f64> {
    let view = scene.camera.view().expect("it is placed");
    let pixel = |i: u32| {
        let [x, y] = [i % 8, i / 8].map(|at| (f64::from(at) + 0.5) / 4.0 - 1.0);
        let way = (view.forward + x * view.right + y * view.down).normalize();
        let edge = DVec3::splat(EDGE.into());
        let (a, b) = (-view.origin / way, (edge - view.origin) / way);
        let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
        let z = [near, far].map(|t| view.origin.z + way.z * t);
        (far - near) * integral(scene, volume, z, &of)
    };
    (0..64).map(pixel).collect()
}

fn reds(image: &Image) -> Vec<f64> {
    image.rgb.iter().map(|rgb| f64::from(rgb[0])).collect()
}

/// The greatest difference, relative to the truth.
fn off(image: &Image, truth: impl Iterator<Item = f64>) -> f64 {
    reds(image).into_iter().zip(truth).map(|(x, t)| (x - t).abs() / t).fold(0.0, f64::max)
}

/// A shell a tenth of a voxel thick, far thinner than a step, and a haze behind dense matter: neither
/// is stepped over, nor lost beside what is denser.
#[test]
fn thin_ramps_are_not_stepped_over() {
    let volume = ramp();
    let materials = "[[material]]\nname = \"shell\"\nwindow = [500, 504]\nextinction = 3.9\nalbedo = 0\n\
                     [[material]]\nname = \"haze\"\nwindow = [600, 2000]\nextinction = 1e-4\nalbedo = 0\n";
    let within = |low: f64, high: f64, v: f64| f64::from(u8::from((low..high).contains(&v)));
    let haze = |v: f64| 1e-4 * within(600.0, 2000.0, v);
    for step in [4.0, 1.0, 0.3] {
        let scene = scene(&volume, step, materials);
        let depths = expected(&scene, &volume, |v| 3.9 * within(500.0, 504.0, v) + haze(v));
        assert!(depths.iter().all(|&depth| depth > 0.3), "{depths:?}");
        let image = rendered(&scene, &volume).image;
        let worst = off(&image, depths.iter().map(|depth| (-depth).exp()));
        assert!(worst < 2e-3, "step {step}: off by {worst}");
        // The same without the haze tells what that takes.
        let mut clear = scene.clone();
        clear.materials.truncate(1);
        let depths = expected(&scene, &volume, haze);
        let clear = reds(&rendered(&clear, &volume).image);
        let taken = reds(&image).into_iter().zip(clear).map(|(x, clear)| -(x / clear).ln());
        let worst = taken.zip(depths).map(|(x, depth)| (x / depth - 1.0).abs()).fold(0.0, f64::max);
        assert!(worst < 0.02, "step {step}: the haze is off by {worst}");
    }
}

#[test]
fn emission_of_thin_ramps_is_seen_at_any_step() {
    let volume = ramp();
    let materials = "[[material]]\nname = \"glow\"\nramp = [[300, 0], [310, 1], [320, 0]]\nextinction = 0\n\
                     albedo = 0\nemission = [7, 0, 0]\n\
                     [[material]]\nname = \"dim\"\nwindow = [700, 800]\nextinction = 0\nalbedo = 0\n\
                     emission = [1e-3, 1, 0]\n";
    let glow = |v: f64| {
        7.0 * (1.0 - (v - 310.0).abs() / 10.0).max(0.0)
            + 1e-3 * f64::from(u8::from((700.0..800.0).contains(&v)))
    };
    for step in [4.0, 1.0, 0.3] {
        let scene = scene(&volume, step, materials);
        let seen = expected(&scene, &volume, glow);
        let worst = off(&rendered(&scene, &volume).image, seen.iter().map(|glow| 1.0 + glow));
        assert!(worst < 1e-3, "step {step}: off by {worst}");
    }
}
