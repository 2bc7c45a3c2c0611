//! Nothing is mirrored: markers in volumes of every orientation appear where a pinhole
//! puts them, and a real scan looks like an independent maximum-intensity projection.

mod common;

use common::{path, rendered, settled};
use glam::{DMat3, DQuat, DVec3};
use photogram::film::Image;
use photogram::scene::{Scene, VolumeSource};
use photogram::volume::{self, Volume};

const SIZE: [u32; 3] = [24, 20, 28];

/// Values of three markers, and where each lies in the world, mm from the centre: left,
/// posterior, superior. No mirror image of them is the same.
const MARKERS: [(u8, DVec3); 3] = [
    (100, DVec3::new(7.0, -3.0, 9.0)),
    (150, DVec3::new(-5.0, 2.0, 6.0)),
    (200, DVec3::new(2.0, 4.0, -8.0)),
];

/// A volume about the origin whose axes run along the columns of `axes`.
fn marked(axes: DMat3) -> Volume {
    let centre = DVec3::from(SIZE.map(|n| f64::from(n - 1) / 2.0));
    let mut data = vec![0_u8; SIZE.iter().product::<u32>() as usize];
    for (value, world) in MARKERS {
        let at = axes.transpose() * world + centre;
        for k in 0..SIZE[2] {
            for j in 0..SIZE[1] {
                for i in 0..SIZE[0] {
                    let offset = DVec3::new(i.into(), j.into(), k.into()) - at;
                    if offset.length() < 1.6 {
                        data[((k * SIZE[1] + j) * SIZE[0] + i) as usize] = value;
                    }
                }
            }
        }
    }
    Volume::new(SIZE, DVec3::ONE, axes, -(axes * centre), data).expect("a sound volume")
}

/// A scene in which one value glows and nothing else is there.
fn glowing(value: u8) -> Scene {
    let text = format!(
        "[volume]\nfile = \"none.nrrd\"\nfilter = \"nearest\"\n\
         [camera]\norigin = [20, -90, 30]\ntarget = [0, 0, 0]\nfov_deg = 25\nwidth = 96\nheight = 80\n\
         [[light]]\nkind = \"surroundings\"\nname = \"sky\"\nradiance = 1\n\
         [[material]]\nname = \"marker\"\nwindow = [{}, {}]\nextinction = 0\nemission = 1\n\
         [settings]\nphotons = 100\nmax_events = 1\nrays = 4\n",
        f64::from(value) - 0.5,
        f64::from(value) + 0.5
    );
    Scene::parse(&text, "orientation.toml").expect("the scene parses")
}

/// The glow's centre of gravity, pixels from the top left.
fn centre_of(image: &Image) -> (f64, f64) {
    let mut sums = [0.0; 3];
    for (i, pixel) in image.rgb.iter().enumerate() {
        let (x, y) = (i as u32 % image.width, i as u32 / image.width);
        let weight = f64::from(pixel[0]);
        sums[0] += weight;
        sums[1] += weight * (f64::from(x) + 0.5);
        sums[2] += weight * (f64::from(y) + 0.5);
    }
    assert!(sums[0] > 0.0, "the marker is not seen");
    (sums[1] / sums[0], sums[2] / sums[0])
}

/// A pinhole of its own: the viewer faces +y (posterior), so left (+x) is on the right.
fn pinhole(world: DVec3) -> (f64, f64) {
    let origin = DVec3::new(20.0, -90.0, 30.0);
    let z = -origin / origin.length();
    let x = z.cross(DVec3::Z) / z.cross(DVec3::Z).length();
    let y = x.cross(z);
    let p = world - origin;
    let focal = 48.0 / 12.5_f64.to_radians().tan();
    (48.0 + focal * p.dot(x) / p.dot(z), 40.0 - focal * p.dot(y) / p.dot(z))
}

#[test]
fn markers_appear_where_a_pinhole_puts_them() {
    // The viewer's right is the patient's left.
    assert!(pinhole(DVec3::X * 5.0).0 > pinhole(DVec3::X * -5.0).0);
    assert!(pinhole(DVec3::Z * 5.0).1 < pinhole(DVec3::Z * -5.0).1);
    let flip = |x, y, z| DMat3::from_diagonal(DVec3::new(x, y, z));
    let oblique =
        DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.4));
    let orientations = [
        ("left, posterior, superior", DMat3::IDENTITY),
        ("right", flip(-1.0, 1.0, 1.0)),
        ("right, anterior", flip(-1.0, -1.0, 1.0)),
        ("inferior", flip(1.0, 1.0, -1.0)),
        ("oblique", oblique),
        ("oblique and mirrored", oblique * flip(1.0, -1.0, 1.0)),
    ];
    for (label, axes) in orientations {
        let volume = marked(axes);
        for (value, world) in MARKERS {
            let mut scene = glowing(value);
            scene.settle(&volume);
            let (x, y) = centre_of(&rendered(&scene, &volume).image);
            let (wanted_x, wanted_y) = pinhole(world);
            let off = (x - wanted_x).hypot(y - wanted_y);
            assert!(
                off < 2.0,
                "{label}, {value}: ({x:.1}, {y:.1}), not ({wanted_x:.1}, {wanted_y:.1})"
            );
        }
    }
}

/// Pixels of the projection and of the picture.
const PIXELS: u32 = 64;

/// Greatest value along y for each (x, z) of the world, seen from the front. It reads
/// nothing of the renderer's but voxel values and their places.
fn projection(volume: &Volume) -> Vec<f64> {
    let centre = volume.corner() + volume.axes() * (volume.extent() / 2.0);
    let half = volume.extent().length() / 2.0;
    let mut greatest = vec![volume.range()[0]; (PIXELS * PIXELS) as usize];
    let [ni, nj, nk] = volume.size();
    for k in 0..nk {
        for j in 0..nj {
            for i in 0..ni {
                let at = DVec3::new(i.into(), j.into(), k.into()) * volume.spacing();
                let p = volume.origin() + volume.axes() * at - centre;
                let column = ((p.x / half + 1.0) / 2.0 * f64::from(PIXELS)) as usize;
                let row = ((1.0 - p.z / half) / 2.0 * f64::from(PIXELS)) as usize;
                let pixel = &mut greatest[row * PIXELS as usize + column];
                *pixel = pixel.max(volume.value(i, j, k));
            }
        }
    }
    greatest
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (ma, mb) = (mean(a), mean(b));
    let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
        a.iter().zip(b).map(|(&x, &y)| f(x - ma, y - mb)).sum()
    };
    sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt()
}

fn mirrored(image: &[f64]) -> Vec<f64> {
    image.chunks(PIXELS as usize).flat_map(|row| row.iter().rev().copied()).collect()
}

#[test]
fn real_scans_look_like_an_independent_projection() {
    for (name, bone) in [("aorta_ct.nii.gz", 300.0), ("pelvis_ct.nii.gz", 250.0)] {
        let file = path("../shared/volumes").join(name);
        if !file.exists() {
            println!("skipped: {} is not here", file.display());
            continue;
        }
        let projected = projection(&volume::load(&file).expect("the scan loads"));
        let text = format!(
            "[volume]\nfile = \"none.nrrd\"\n\
             [camera]\nfrom = [0, -1, 0]\nfov_deg = 2\nwidth = {PIXELS}\nheight = {PIXELS}\n\
             [[light]]\nkind = \"surroundings\"\nname = \"sky\"\nradiance = 1\n\
             [[material]]\nname = \"bone\"\nramp = [[{bone}, 0.0], [4000, 1.0]]\nextinction = 0\n\
             emission = 1\n[settings]\nphotons = 100\nmax_events = 1\nrays = 4\n"
        );
        let mut scene = Scene::parse(&text, "projection.toml").expect("the scene parses");
        scene.volume = VolumeSource::File(file);
        let (scene, volume) = settled(scene);
        let image = rendered(&scene, &volume).image;
        let seen: Vec<_> = image.rgb.iter().map(|p| f64::from(p[0]).sqrt()).collect();
        let bright: Vec<_> = projected.iter().map(|&v| (v - bone).max(0.0).sqrt()).collect();
        let (right, wrong) = (correlation(&seen, &bright), correlation(&seen, &mirrored(&bright)));
        println!("{name}: correlation {right:.3}, mirrored {wrong:.3}");
        assert!(right > 0.75 && right > wrong + 0.1, "{name} is mirrored or misplaced");
    }
}
