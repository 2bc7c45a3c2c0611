//! The samplers against their densities: free flight and phase function.

mod common;

use common::draws::{CAMERA, DRAWS, about, bin, draws, judge_uniform, put, vector};
use common::{Judged, gpu, scene_over};
use glam::{DMat3, DVec3, dvec3};
use photogram::device_scene::{DeviceScene, Storage};
use photogram::photon::probe::{ProbeParams, What, draw};
use photogram::scene::{Filter, LightKind, Scene};
use photogram::volume::texture::MAX_SQUARES;
use photogram::volume::{Values, Volume};

/// Layers across x of given extinctions; values 0, 1, 2 ..., so that under either filter
/// the border is that of the voxels.
struct Layers {
    /// Ends in mm, and extinctions.
    layers: Vec<(f64, f64)>,
    majorant: f64,
}

impl Layers {
    const EXTENT: DVec3 = dvec3(20.0, 11.2, 16.0);

    /// In voxels of `EXTENT` / (40, 16, 16) times `edge`; bytes, or floats where these are not 1.
    fn volume(&self, edge: u32) -> Volume {
        let size = [40 / edge, 16 / edge, 16 / edge];
        let spacing = Self::EXTENT / DVec3::from(size.map(f64::from));
        let layer = |i: u32| {
            let x = (f64::from(i) + 0.5) * spacing.x;
            self.layers.iter().position(|&(end, _)| x < end).expect("layers fill the volume")
        };
        let count = size.iter().product::<u32>();
        let layers = (0..count).map(|i| layer(i % size[0]));
        let values: Values = match edge {
            1 => layers.map(|l| l as u8).collect::<Vec<_>>().into(),
            _ => layers.map(|l| l as f32).collect::<Vec<_>>().into(),
        };
        Volume::new(size, spacing, DMat3::IDENTITY, DVec3::ZERO, values).expect("sound")
    }

    fn scene(&self, volume: &Volume, filter: Filter, skip_empty: bool, seed: u64) -> Scene {
        let mut text = String::from(CAMERA);
        for (i, (_, extinction)) in self.layers.iter().enumerate() {
            text += &format!(
                "[[material]]\nname = \"{i}\"\nwindow = [{}, {}]\nextinction = {extinction}\nalbedo = 1\n",
                i as f64 - 0.5,
                i as f64 + 0.5
            );
        }
        let mut scene = scene_over(volume, &text);
        scene.filter = filter;
        scene.settings.majorant = Some(self.majorant);
        scene.settings.skip_empty = skip_empty;
        scene.settings.seed = seed;
        scene
    }

    /// Optical depth from `origin` to distance `t`.
    fn depth(&self, origin: DVec3, direction: DVec3, t: f64) -> f64 {
        let (a, b) = (origin.x, origin.x + direction.x * t);
        let (low, high) = (a.min(b), a.max(b));
        let mut begin = 0.0;
        let mut depth = 0.0;
        for &(end, extinction) in &self.layers {
            depth += extinction * (high.min(end) - low.max(begin)).max(0.0);
            begin = end;
        }
        depth / direction.x.abs()
    }

    fn is_empty_at(&self, x: f64) -> bool {
        self.layers.iter().find(|&&(end, _)| x < end).is_none_or(|&(_, e)| e == 0.0)
    }
}

fn exit(origin: DVec3, direction: DVec3, extent: DVec3) -> f64 {
    let wall = DVec3::select(direction.cmpgt(DVec3::ZERO), extent, DVec3::ZERO);
    ((wall - origin) / direction)
        .to_array()
        .into_iter()
        .filter(|t| t.is_finite())
        .fold(1e9, f64::min)
}

/// Flights through `medium`, judged by the density that `law` says they have.
fn judge_flights(
    judged: &mut Judged,
    name: &str,
    medium: &Layers,
    law: &Layers,
    case: (u32, Filter, bool, u64),
) {
    const BINS: usize = 64;
    let (edge, filter, skip, seed) = case;
    let volume = medium.volume(edge);
    let scene = medium.scene(&volume, filter, skip, seed);
    let rays = [
        (dvec3(0.0, 5.0, 7.0), DVec3::X),
        (dvec3(0.3, 0.2, 0.1), dvec3(0.8, 0.44, 0.6)),
        (dvec3(20.0, 9.7, 1.1), dvec3(-0.9, -0.3, 0.5)),
    ];
    for (ray, (origin, direction)) in rays.into_iter().enumerate() {
        let direction = direction.normalize();
        let params = ProbeParams {
            origin: origin.as_vec3().to_array(),
            direction: direction.as_vec3().to_array(),
            count: DRAWS,
            ..Default::default()
        };
        let far = exit(origin, direction, Layers::EXTENT);
        let collide = -(-law.depth(origin, direction, far)).exp_m1();
        let mut counts = [0; BINS + 1];
        for [distance, _, collided, _] in draws(&scene, &volume, What::Flight, params)[0].iter() {
            let t = f64::from(*distance);
            if *collided == 0.0 {
                assert!((t - far).abs() < 1e-5 * far, "{name}: left at {t} mm, not {far}");
                counts[BINS] += 1;
                continue;
            }
            let x = origin.x + direction.x * t;
            let around = [x - 1e-3, x + 1e-3];
            assert!(
                (0.0..=far).contains(&t) && !around.iter().all(|&x| medium.is_empty_at(x)),
                "{name}: a collision with nothing, {t} mm along ray {ray}"
            );
            counts[bin(-(-law.depth(origin, direction, t)).exp_m1() / collide, BINS)] += 1;
        }
        let mut shares = [collide / BINS as f64; BINS + 1];
        shares[BINS] = 1.0 - collide;
        let (n, left) = (f64::from(DRAWS), shares[BINS]);
        let error = (left * (1.0 - left) / n).sqrt();
        let name = format!("{name}, ray {ray}, {filter} filter, skip {skip}, cells {edge}");
        judged.estimate(format!("{name}, leaving"), counts[BINS] as f64 / n, error, left);
        judged.counts(name, &counts, &shares);
    }
}

const WAYS: [(Filter, bool); 4] = [
    (Filter::Nearest, false),
    (Filter::Nearest, true),
    (Filter::Linear, false),
    (Filter::Linear, true),
];

#[test]
fn flights_end_as_the_exponential_law_says_whatever_the_majorant() {
    let mut judged = Judged::default();
    for (i, (filter, skip)) in WAYS.into_iter().enumerate() {
        // Far below the majorant a flight without skips takes long.
        let headrooms = if skip { &[1.0, 1.7, 12.0, 300.0][..] } else { &[1.0, 1.7, 12.0] };
        for (j, headroom) in headrooms.iter().enumerate() {
            let layers = vec![(20.0, 0.08)];
            let medium = Layers { layers, majorant: 0.08 * headroom };
            let seed = 100 + 10 * i as u64 + j as u64;
            let name = format!("homogeneous, majorant x {headroom}");
            judge_flights(&mut judged, &name, &medium, &medium, (1, filter, skip, seed));
        }
    }
    assert!(judged.hold());
}

#[test]
fn flights_through_layers_follow_the_optical_depth_whatever_the_cells() {
    let two = || Layers { layers: vec![(6.0, 0.05), (20.0, 0.13)], majorant: 0.2 };
    let gap = || Layers { layers: vec![(6.0, 0.06), (14.0, 0.0), (20.0, 0.2)], majorant: 0.2 };
    let mut judged = Judged::default();
    for (i, (filter, skip)) in WAYS.into_iter().enumerate() {
        for (j, edge) in [1, 4].into_iter().enumerate() {
            let seed = 200 + 10 * i as u64 + j as u64;
            judge_flights(&mut judged, "two layers", &two(), &two(), (edge, filter, skip, seed));
            judge_flights(&mut judged, "a gap", &gap(), &gap(), (edge, filter, skip, seed + 5));
        }
    }
    assert!(judged.hold());
}

#[test]
fn two_per_cent_more_extinction_is_seen_in_the_flights() {
    let two = |by: f64| Layers { layers: vec![(6.0, 0.05 * by), (20.0, 0.13 * by)], majorant: 0.2 };
    let mut judged = Judged::default();
    let case = (1, Filter::Nearest, true, 300);
    judge_flights(&mut judged, "2 % too dense", &two(1.02), &two(1.0), case);
    assert!(!judged.hold());
}

#[test]
fn flights_read_the_values_between_voxels_however_these_lie_on_the_device() {
    let size = [9, 7, 5];
    let noise = |i: u32| i.wrapping_mul(2_654_435_761) >> 24;
    let numbers = || (0..size.iter().product::<u32>()).map(noise);
    let kinds: [Values; 3] = [
        numbers().map(|v| v as u8).collect::<Vec<_>>().into(),
        numbers().map(|v| 100 * v as u16).collect::<Vec<_>>().into(),
        numbers().map(|v| v as f32 - 50.0).collect::<Vec<_>>().into(),
    ];
    for values in kinds {
        let volume =
            Volume::new(size, DVec3::ONE, DMat3::IDENTITY, DVec3::ZERO, values).expect("sound");
        let [low, high] = volume.range();
        let material = format!("window = [{low}, {high}]\nextinction = 0.2\nalbedo = 1\n");
        let scene =
            scene_over(&volume, &format!("{CAMERA}[[material]]\nname = \"all\"\n{material}"));
        for squares in [MAX_SQUARES, 0] {
            let storage = Storage { max_squares: squares, ..Default::default() };
            let device = DeviceScene::stored(gpu(), &scene, &volume, &storage).expect("uploads");
            let map = device.domain.map(&volume.numbers());
            let (origin, direction) = (dvec3(0.1, 0.2, 0.3), dvec3(8.8, 6.7, 4.6).normalize());
            for (origin, direction) in [(origin, direction), (dvec3(9.0, 6.9, 4.9), -direction)] {
                let params = ProbeParams {
                    origin: origin.as_vec3().to_array(),
                    direction: direction.as_vec3().to_array(),
                    count: 1 << 12,
                    ..Default::default()
                };
                let flights = draw(gpu(), &device, What::Flight, params).expect("draws");
                let mut collisions = 0;
                for [distance, entry, collided, _] in &flights[0] {
                    if *collided == 0.0 {
                        continue;
                    }
                    collisions += 1;
                    let at = origin + direction * f64::from(*distance);
                    let seen = f64::from(map.gain) * between_voxels(&volume, at);
                    let off = (f64::from(*entry) + 0.5 - seen - f64::from(map.shift)).abs();
                    assert!(off < 1.0, "entry {entry} of {seen} at {at}, squares {squares}");
                }
                assert!(collisions > 1000, "{collisions} collisions");
            }
        }
    }
}

/// The number at a point, linear between the centres of voxels of 1 mm.
fn between_voxels(volume: &Volume, at: DVec3) -> f64 {
    let last = volume.size().map(|n| f64::from(n - 1));
    let at = (at - 0.5).to_array();
    let base = at.map(f64::floor);
    let mut value = 0.0;
    for corner in 0..8 {
        let beyond = [0, 1, 2].map(|axis| f64::from(corner >> axis & 1));
        let weight = |axis: usize| {
            let part = at[axis] - base[axis];
            if beyond[axis] == 1.0 { part } else { 1.0 - part }
        };
        let voxel = |axis: usize| (base[axis] + beyond[axis]).clamp(0.0, last[axis]) as u32;
        let number = f64::from(volume.number(voxel(0), voxel(1), voxel(2)));
        value += number * weight(0) * weight(1) * weight(2);
    }
    value
}

/// Share of directions whose cosine with that of travel is below `cosine`.
fn henyey_greenstein(g: f64, cosine: f64) -> f64 {
    if g == 0.0 {
        return (1.0 + cosine) / 2.0;
    }
    let root = (1.0 + g * g - 2.0 * g * cosine).sqrt();
    (1.0 - g * g) / (2.0 * g) * (1.0 / root - 1.0 / (1.0 + g))
}

fn judge_phase(drawn: f64, judged_by: f64) -> Judged {
    let travels = [
        DVec3::Z,
        -DVec3::Z,
        DVec3::X,
        dvec3(1e-4, -3e-5, 1.0),
        dvec3(2e-4, 1e-4, -1.0),
        dvec3(1e-7, 0.0, -1.0),
        dvec3(-0.48, 0.6, 0.64),
        dvec3(0.3, -0.8, -1e-7),
    ];
    let medium = Layers { layers: vec![(20.0, 0.1)], majorant: 0.1 };
    let volume = medium.volume(4);
    let mut judged = Judged::default();
    for (i, travel) in travels.into_iter().enumerate() {
        let scene = medium.scene(&volume, Filter::Nearest, false, 400 + i as u64);
        let direction = travel.normalize().as_vec3();
        let params = ProbeParams {
            direction: direction.to_array(),
            g: drawn as f32,
            count: DRAWS,
            ..Default::default()
        };
        let directions: Vec<_> =
            draws(&scene, &volume, What::Phase, params)[0].iter().map(|&d| vector(d)).collect();
        assert!(directions.iter().all(|d| (d.length() - 1.0).abs() < 1e-6));
        let name = format!("g {drawn} along {travel}");
        let local = || directions.iter().map(|&d| about(direction.as_dvec3(), d));
        let g = judged_by;
        judge_uniform(&mut judged, &name, 16, local().map(|(c, t)| [henyey_greenstein(g, c), t]));
        let n = f64::from(DRAWS);
        let mean = local().map(|(c, _)| c).sum::<f64>() / n;
        // The mean of the squared cosine is (1 + 2 g^2) / 3.
        let error = (((1.0 + 2.0 * g * g) / 3.0 - g * g) / n).sqrt();
        judged.estimate(format!("{name}, mean cosine"), mean, error, g);
    }
    judged
}

#[test]
fn scattered_directions_follow_henyey_and_greenstein() {
    for g in [-0.7, 0.0, 0.3, 0.9] {
        assert!(judge_phase(g, g).hold(), "g {g}");
    }
}

#[test]
fn an_asymmetry_off_by_a_hundredth_is_seen() {
    assert!(!judge_phase(0.3, 0.31).hold());
}

#[test]
fn a_channel_without_power_stays_without_it() {
    let medium = Layers { layers: vec![(20.0, 0.1)], majorant: 0.1 };
    let volume = medium.volume(1);
    let mut scene = medium.scene(&volume, Filter::Nearest, true, 801);
    let light = put(LightKind::Surroundings, &volume, dvec3(0.0, 2.0, 0.0), 801).lights.remove(0);
    scene.lights.push(light);
    scene.settings.photons = 20_000;
    scene.camera.width = 16;
    scene.camera.height = 16;
    let image = common::rendered(&scene, &volume).image;
    assert!(image.rgb.iter().all(|p| p[0] == 0.0 && p[2] == 0.0));
    assert!(common::mean(&image) > 0.01);
}
