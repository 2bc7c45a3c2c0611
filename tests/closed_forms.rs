//! The reference and the photon map against what can be worked out on paper:
//! transmittance, single scattering, the furnace, emission.

mod common;

use std::f64::consts::PI;

use common::{Judged, gauss, gpu, rendered, scene_over};
use glam::{DMat3, DVec3, dvec3};
use photogram::device_scene::DeviceScene;
use photogram::film::Image;
use photogram::gpu::Progress;
use photogram::reference::Reference;
use photogram::render::render;
use photogram::scene::{Estimator, Filter, Method, Scene, Weighting};
use photogram::split::Split;
use photogram::update::PhotonFrame;
use photogram::volume::Volume;

const FILTERS: [Filter; 2] = [Filter::Nearest, Filter::Linear];
/// The homogeneous box, mm; its corner is the origin.
const BOX: DVec3 = dvec3(16.0, 12.0, 20.0);
const PIXELS: u32 = 16;

/// The box in voxels of 1 mm: all 0 but one, which spreads the table over a range.
fn volume() -> Volume {
    let size = BOX.to_array().map(|n| n as u32);
    let mut values = vec![0u8; size.iter().product::<u32>() as usize];
    values[0] = 255;
    Volume::new(size, DVec3::ONE, DMat3::IDENTITY, DVec3::splat(0.5), values).expect("sound")
}

/// The box made of one material, seen from askew; some rays miss it. Table entry 1 is
/// denser: no voxel has it, but majorants must allow for it.
fn scene(volume: &Volume, material: &str, rest: &str) -> Scene {
    let text = format!(
        "[camera]\norigin = [40, -50, 31]\ntarget = [8, 6, 10]\nfov_deg = 24\n\
         width = {PIXELS}\nheight = {PIXELS}\n\
         [[material]]\nname = \"all\"\nwindow = [-1, 256]\n{material}\n\
         [[material]]\nname = \"none\"\nwindow = [0.07, 0.12]\nextinction = 0.1\nalbedo = 0.3\n\
         {rest}"
    );
    let mut scene = scene_over(volume, &text);
    scene.filter = Filter::Nearest;
    scene.settings.rays = 1;
    scene
}

/// Under the linear filter the denser material would be met beside the odd voxel.
fn filtered(mut scene: Scene, filter: Filter) -> Scene {
    scene.filter = filter;
    if filter == Filter::Linear {
        scene.materials.truncate(1);
    }
    scene
}

/// The ray through an image point in pixels: origin and unit direction.
fn ray(scene: &Scene, x: f64, y: f64) -> (DVec3, DVec3) {
    let view = scene.camera.view().expect("it is placed");
    let half = f64::from(PIXELS) / 2.0;
    let d = view.forward + (x / half - 1.0) * view.right + (y / half - 1.0) * view.down;
    (view.origin, d.normalize())
}

/// Where a ray enters and leaves the box.
fn span(origin: DVec3, d: DVec3) -> Option<(f64, f64)> {
    let (a, b) = (-origin / d, (BOX - origin) / d);
    let (near, far) = (a.min(b).max_element().max(0.0), a.max(b).min_element());
    (far > near).then_some((near, far))
}

fn pixels() -> impl Iterator<Item = (u32, u32)> {
    (0..PIXELS * PIXELS).map(|i| (i % PIXELS, i / PIXELS))
}

/// A function of the ray through each pixel's centre.
fn centres(scene: &Scene, f: impl Fn(DVec3, DVec3) -> f64) -> Vec<f64> {
    let at = |(x, y)| ray(scene, f64::from(x) + 0.5, f64::from(y) + 0.5);
    pixels().map(at).map(|(o, d)| f(o, d)).collect()
}

/// Whether the box covers a pixel.
fn is_covered(scene: &Scene, pixel: usize) -> bool {
    let (x, y) = (pixel as u32 % PIXELS, pixel as u32 / PIXELS);
    [(0, 0), (1, 0), (0, 1), (1, 1)].into_iter().all(|(i, j)| {
        let (o, d) = ray(scene, f64::from(x + i), f64::from(y + j));
        span(o, d).is_some()
    })
}

/// The same as the mean over each pixel; one that the box's outline crosses is finely cut.
fn means(scene: &Scene, f: impl Fn(DVec3, DVec3) -> f64) -> Vec<f64> {
    let pixel = |(x, y): (u32, u32)| {
        let cut = if is_covered(scene, (y * PIXELS + x) as usize) { 5 } else { 24 };
        let part = |i: u32| (f64::from(i) + 0.5) / f64::from(cut);
        let parts = (0..cut * cut).map(|i| {
            let (o, d) = ray(scene, f64::from(x) + part(i % cut), f64::from(y) + part(i / cut));
            f(o, d)
        });
        parts.sum::<f64>() / f64::from(cut * cut)
    };
    pixels().map(pixel).collect()
}

fn reference(scene: &Scene, volume: &Volume, samples: u32) -> (Image, Image) {
    let mut scene = scene.clone();
    scene.settings.method = Method::Reference;
    let device = DeviceScene::new(gpu(), &scene, volume).expect("uploads");
    let mut reference = Reference::new(gpu(), &scene, &device).expect("fits");
    reference.add(gpu(), &device, samples, &mut Progress::silent()).expect("traces");
    let estimate = reference.image(gpu()).expect("reads");
    (estimate.mean, estimate.error)
}

/// The reference's red against a truth: each pixel inside the outline, and the mean of all.
fn agrees(name: &str, scene: &Scene, (image, error): &(Image, Image), truth: &[f64]) -> bool {
    let mut judged = Judged::default();
    let (mut sum, mut squares) = (0.0, 0.0);
    for (i, &truth) in truth.iter().enumerate() {
        let (x, e) = (f64::from(image.rgb[i][0]), f64::from(error.rgb[i][0]));
        sum += x;
        squares += e * e;
        // At the outline too few samples make the difference for a normal law.
        if is_covered(scene, i) {
            judged.estimate(format!("{name}, pixel {i}"), x, e, truth);
        }
    }
    judged.estimate(format!("{name}, mean"), sum, squares.sqrt(), truth.iter().sum());
    judged.hold()
}

/// The greatest difference of the photon map's red from a truth.
fn photon_map_off(scene: &Scene, volume: &Volume, truth: &[f64]) -> f64 {
    let image = rendered(scene, volume).image;
    let off = |(x, truth): (&[f32; 3], &f64)| (f64::from(x[0]) - truth).abs();
    let all = image.rgb.iter().zip(truth).map(off);
    all.fold(0.0, |worst, x| {
        if x >= worst {
            x
        } else if x.is_nan() {
            f64::NAN
        } else {
            worst
        }
    })
}

const FEEBLE: &str =
    "[[light]]\nkind = \"surroundings\"\nradiance = 0\n[settings]\nphotons = 100\n";

fn through(extinction: f64) -> impl Fn(DVec3, DVec3) -> f64 {
    move |o, d| span(o, d).map_or(1.0, |(near, far)| (-extinction * (far - near)).exp())
}

#[test]
fn a_background_is_seen_through_a_slab_as_beer_and_lambert_say() {
    let volume = volume();
    for filter in FILTERS {
        let mut scene = filtered(scene(&volume, "extinction = 0.11\nalbedo = 0", FEEBLE), filter);
        scene.background = DVec3::ONE;
        let seen = reference(&scene, &volume, 4096);
        assert!(agrees("transmittance", &scene, &seen, &means(&scene, through(0.11))), "{filter}");
        assert!(!agrees("2 % off", &scene, &seen, &means(&scene, through(0.1122))), "{filter}");
        let off = photon_map_off(&scene, &volume, &centres(&scene, through(0.11)));
        println!("photon map, {filter}: within {off:.1e}");
        assert!(off < 1e-4, "{filter}: off by {off:.1e}");
        let off = photon_map_off(&scene, &volume, &centres(&scene, through(0.1111)));
        assert!(off > 1e-4, "{filter}: a fault of 1 % went unseen");
    }
}

/// A quadrature on each of `panels`.
fn integral(a: f64, b: f64, panels: u32, nodes: &[(f64, f64)], f: impl Fn(f64) -> f64) -> f64 {
    let edge = (b - a) / f64::from(panels);
    let panel = |i| nodes.iter().map(move |&(x, w)| (a + edge * (f64::from(i) + x), w * edge));
    (0..panels).flat_map(panel).map(|(t, w)| w * f(t)).sum()
}

/// A light of the single-scattering tests.
#[derive(Clone, Copy)]
enum Sun {
    Directional(DVec3),
    Point(DVec3),
}

impl Sun {
    /// Irradiance 3 W/mm2, or intensity 900 W/sr.
    fn text(self) -> String {
        match self {
            Self::Directional(d) => format!(
                "[[light]]\nkind = \"directional\"\ndirection = [{}, {}, {}]\nirradiance = 3\n",
                d.x, d.y, d.z
            ),
            Self::Point(p) => format!(
                "[[light]]\nkind = \"point\"\nposition = [{}, {}, {}]\nintensity = 900\n",
                p.x, p.y, p.z
            ),
        }
    }

    /// Irradiance at a point through the medium, and the direction of travel.
    fn at(self, point: DVec3, extinction: f64) -> (f64, DVec3) {
        let (strength, travel, away) = match self {
            Self::Directional(d) => (3.0, d.normalize(), f64::INFINITY),
            Self::Point(p) => {
                let away = (point - p).length();
                (900.0 / away.powi(2), (point - p) / away, away)
            }
        };
        let (_, far) = span(point, -travel).unwrap_or((0.0, 0.0));
        (strength * (-extinction * far.min(away)).exp(), travel)
    }
}

/// Radiance of light scattered once toward the viewer.
fn scattered_once(sun: Sun, extinction: f64, albedo: f64, g: f64) -> impl Fn(DVec3, DVec3) -> f64 {
    let nodes = gauss(5);
    move |o, d| {
        let Some((near, far)) = span(o, d) else { return 0.0 };
        integral(near, far, 12, &nodes, |t| {
            let (light, travel) = sun.at(o + d * t, extinction);
            let across = 1.0 + g * g - 2.0 * g * travel.dot(-d);
            let phase = (1.0 - g * g) / (4.0 * PI * across.powf(1.5));
            (-extinction * (t - near)).exp() * extinction * albedo * phase * light
        })
    }
}

const SUNS: [(&str, Sun); 3] = [
    ("a sun", Sun::Directional(dvec3(0.4, 0.7, -0.6))),
    ("a point", Sun::Point(dvec3(-9.0, -12.0, 26.0))),
    ("a point within", Sun::Point(dvec3(5.1, 7.3, 12.2))),
];

#[test]
fn the_reference_scatters_once_as_quadrature_says() {
    let volume = volume();
    // Near a point light within, the radiance has no variance to judge by.
    for (name, sun) in &SUNS[..2] {
        for (filter, g) in [(Filter::Nearest, 0.0), (Filter::Linear, 0.6), (Filter::Nearest, -0.4)]
        {
            let material = format!("extinction = 0.09\nalbedo = 0.8\nphase_g = {g}");
            let mut scene = filtered(scene(&volume, &material, &sun.text()), filter);
            scene.settings.reference_events = Some(1);
            let seen = reference(&scene, &volume, 2048);
            let truth = means(&scene, scattered_once(*sun, 0.09, 0.8, g));
            assert!(agrees(&format!("{name}, g {g}"), &scene, &seen, &truth));
            let spoilt: Vec<_> = truth.iter().map(|t| 1.02 * t).collect();
            assert!(!agrees("2 % off", &scene, &seen, &spoilt));
        }
    }
}

/// Mean difference over the mean of the truth.
fn relative_error(image: &Image, truth: &[f64]) -> f64 {
    let off = image.rgb.iter().zip(truth).map(|(x, t)| (f64::from(x[0]) - t).abs());
    off.sum::<f64>() / truth.iter().sum::<f64>()
}

#[test]
fn the_photon_map_scatters_once_with_an_error_that_falls_with_the_grid() {
    let volume = volume();
    for (name, sun) in SUNS {
        let mut scene = scene(&volume, "extinction = 0.09\nalbedo = 0.8", &sun.text());
        scene.settings.estimator = Some(Estimator::Fluence);
        scene.settings.max_events = 1;
        scene.settings.photons = 1_000_000;
        let truth = centres(&scene, scattered_once(sun, 0.09, 0.8, 0.0));
        let errors = [0.25, 0.5, 1.0].map(|grid| {
            scene.settings.grid = grid;
            relative_error(&rendered(&scene, &volume).image, &truth)
        });
        println!("{name}: relative error {errors:.4?} at cells of 4, 2, 1 mm");
        assert!(errors[1] < 0.55 * errors[0] && errors[2] < 0.55 * errors[1], "{name}: {errors:?}");
    }
}

const FURNACE: &str = "[[light]]\nkind = \"surroundings\"\nradiance = 1\n";

/// A furnace of this albedo, up to 2.8 mean free paths across.
fn furnace(volume: &Volume, albedo: f64) -> Scene {
    let mut scene = scene(volume, &format!("extinction = 0.1\nalbedo = {albedo}"), FURNACE);
    scene.background = DVec3::ONE;
    scene
}

#[test]
fn in_a_furnace_the_reference_sees_nothing() {
    let volume = volume();
    let truth = vec![1.0; (PIXELS * PIXELS) as usize];
    let agrees = |scene: &Scene| agrees("furnace", scene, &reference(scene, &volume, 1024), &truth);
    for filter in FILTERS {
        let white = filtered(furnace(&volume, 1.0), filter);
        assert!(agrees(&white), "{filter}");
    }
    assert!(!agrees(&furnace(&volume, 0.98)), "an albedo of 0.98 went unseen");
}

#[test]
fn in_a_furnace_the_photon_map_sees_nothing() {
    let volume = volume();
    let mean = |albedo: f64| {
        let mut scene = furnace(&volume, albedo);
        scene.settings.estimator = Some(Estimator::Fluence);
        scene.settings.photons = 200_000;
        scene.settings.grid = 0.25;
        // From anywhere a flight leaves with a chance of exp(-2.8) at the very least, and
        // of a half or so on average: no power to speak of is left after 64.
        scene.settings.max_events = 64;
        scene.settings.roulette_survival = 1.0;
        let image = rendered(&scene, &volume).image;
        let covered: Vec<_> = (0..image.rgb.len()).filter(|&i| is_covered(&scene, i)).collect();
        let red = |i: &usize| f64::from(image.rgb[*i][0]);
        let worst = covered.iter().map(|i| (red(i) - 1.0).abs()).fold(0.0, f64::max);
        let mean = covered.iter().map(red).sum::<f64>() / covered.len() as f64;
        println!("albedo {albedo}: mean {mean:.5}, the worst pixel off by {worst:.4}");
        (mean, worst)
    };
    let (white, worst) = mean(1.0);
    assert!((white - 1.0).abs() < 0.003 && worst < 0.05);
    assert!((mean(0.99).0 - 1.0).abs() > 0.003, "an albedo of 0.99 went unseen");
}

/// Radiance of a medium that emits `emission` per mm.
fn glow(emission: f64, extinction: f64) -> impl Fn(DVec3, DVec3) -> f64 {
    move |o, d| {
        let length = span(o, d).map_or(0.0, |(near, far)| far - near);
        match extinction > 0.0 {
            true => emission * -(-extinction * length).exp_m1() / extinction,
            false => emission * length,
        }
    }
}

const GLOWS: [(f64, &str); 2] = [
    (0.0, "emission = 0.3\nextinction = 0"),
    (0.12, "emission = 0.3\nextinction = 0.12\nalbedo = 0.5"),
];

#[test]
fn the_reference_sees_a_medium_glow_through_itself() {
    let volume = volume();
    for (extinction, material) in GLOWS {
        for filter in FILTERS {
            let scene = filtered(scene(&volume, material, ""), filter);
            let seen = reference(&scene, &volume, 1024);
            let truth = means(&scene, glow(0.3, extinction));
            assert!(agrees("glow", &scene, &seen, &truth), "{filter}");
            let truth = means(&scene, glow(0.306, extinction));
            assert!(!agrees("2 % off", &scene, &seen, &truth), "{filter}");
        }
    }
}

#[test]
fn the_photon_map_sees_a_medium_glow_through_itself() {
    let volume = volume();
    for (extinction, material) in GLOWS {
        for filter in FILTERS {
            let scene = filtered(scene(&volume, material, FEEBLE), filter);
            let name = format!("extinction {extinction}, {filter}");
            let off = photon_map_off(&scene, &volume, &centres(&scene, glow(0.3, extinction)));
            println!("{name}: within {off:.1e}");
            assert!(off < 1e-4, "{name}: off by {off:.1e}");
            let off = photon_map_off(&scene, &volume, &centres(&scene, glow(0.303, extinction)));
            assert!(off > 1e-4, "{name}: a fault of 1 % went unseen");
        }
    }
}

#[test]
fn without_any_light_the_photon_map_sees_the_glow_alone() {
    let volume = volume();
    let mut worst: f64 = 0.0;
    for (extinction, material) in GLOWS {
        for estimator in [Estimator::Fluence, Estimator::Points] {
            let mut scene = scene(&volume, material, "");
            scene.settings.estimator = Some(estimator);
            let off = photon_map_off(&scene, &volume, &centres(&scene, glow(0.3, extinction)));
            println!("extinction {extinction}, {estimator}: within {off:.1e}");
            worst = if off.is_nan() { f64::INFINITY } else { worst.max(off) };
        }
    }
    assert!(worst < 1e-4);
}

/// A sum that 52 bits cannot hold is refused, not cut to what they can.
#[test]
fn a_glow_beyond_the_sums_is_refused() {
    let volume = volume();
    let mut scene = scene(&volume, "emission = 1e6\nextinction = 0", "");
    scene.settings.estimator = Some(Estimator::Points);
    for emission in [1e6, 1e12, 1e30] {
        scene.materials[0].emission = DVec3::splat(emission);
        let error = render(gpu(), &scene, &volume, &Split::default(), &mut Progress::silent())
            .err()
            .expect("no such light fits");
        assert!(error.to_string().contains("52 bits"), "{error}");
    }
}

/// What a march of one pixel gathers of points, as a plain search over all of them finds: with
/// a radius a little less, and a little more.
fn searched(
    (o, d): (DVec3, DVec3),
    (extinction, step, radius): (f64, f64, f64),
    points: &[(DVec3, f64)],
) -> [f64; 2] {
    let Some((near, far)) = span(o, d) else { return [0.0; 2] };
    let samples = ((far - near) / step).ceil();
    let h = (far - near) / samples;
    let depth = extinction * h;
    let lean = 1.0 / depth - 1.0 / depth.exp_m1() - 0.5;
    [-1e-5, 1e-5].map(|off| {
        let reach = (radius * (1.0 + off)).powi(2);
        let at = |i: u32| {
            let t = near + (f64::from(i) + 0.5) * h;
            let seen = o + d * (t + lean * h);
            let near_by = points.iter().filter(|(place, _)| place.distance_squared(seen) < reach);
            let passed = (-extinction * (t - 0.5 * h - near)).exp();
            passed * -(-depth).exp_m1() / extinction * near_by.map(|(_, light)| light).sum::<f64>()
        };
        (0..samples as u32).map(at).sum()
    })
}

#[test]
fn a_gather_sums_every_point_within_the_radius_and_no_other() {
    let volume = volume();
    let sun = Sun::Directional(dvec3(0.4, 0.7, -0.6)).text();
    for radius in [0.7, 1.3, 4.5] {
        let material = "extinction = 0.09\nalbedo = 0.8";
        let mut scene = filtered(scene(&volume, material, &sun), Filter::Linear);
        let settings = &mut scene.settings;
        settings.estimator = Some(Estimator::Points);
        settings.weighting = Weighting::Plain;
        (settings.photons, settings.max_events, settings.radius) = (4000, 3, Some(radius));
        scene.settle(&volume);
        let device = DeviceScene::new(gpu(), &scene, &volume).expect("uploads");
        let mut frame = PhotonFrame::new(gpu(), &scene, device, &Split::default()).expect("fits");
        frame.rebuild(gpu(), &Split::default(), &mut Progress::silent()).expect("rebuilds");
        let points = frame.field.points().expect("points were asked for");
        let float = |word: u32| f64::from(f32::from_bits(word));
        let table = points.read(gpu()).expect("reads").swap_remove(0);
        let points = table.places.iter().zip(&table.lights).map(|(place, light)| {
            (dvec3(float(place[0]), float(place[1]), float(place[2])), f64::from(light[0]))
        });
        let points: Vec<_> = points.collect();
        let march = (0.09, f64::from(frame.scene.params.step), radius);
        let image = frame.segments.image(gpu()).expect("reads");
        let mut lit = 0;
        for ((x, y), seen) in pixels().zip(&image.rgb) {
            let [least, most] =
                searched(ray(&scene, f64::from(x) + 0.5, f64::from(y) + 0.5), march, &points);
            let (seen, slack) = (f64::from(seen[0]), 2e-4 * most);
            assert!(
                (least - slack..=most + slack).contains(&seen),
                "radius {radius}, pixel {x}, {y}: {seen} is not from {least} to {most}"
            );
            lit += u32::from(least > 0.0);
        }
        assert!(lit > 100, "{lit} pixels saw light");
    }
}
