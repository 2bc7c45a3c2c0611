//! What the transfer function's table resolves: labels, masks, scans with outliers and padding, and
//! what is said where it cannot.

use glam::{DMat3, DVec3};
use photogram::film::Image;
use photogram::film::metrics::Metrics;
use photogram::scene::{Filter, Scene};
use photogram::transfer::Table;
use photogram::volume::{Values, Volume};

use common::{rendered, scene_over};

mod common;
#[path = "table/edits.rs"]
mod edits;
#[path = "table/rows.rs"]
mod rows;

const SIZE: [u32; 3] = [20, 12, 12];
const COUNT: usize = 20 * 12 * 12;

fn volume(values: impl Into<Values>) -> Volume {
    sized(SIZE, values)
}

fn sized(size: [u32; 3], values: impl Into<Values>) -> Volume {
    Volume::new(size, DVec3::ONE, DMat3::IDENTITY, DVec3::ZERO, values).expect("a sound volume")
}

/// Numbers without an order, from 0 to 1.
fn noise(n: usize) -> f64 {
    let mixed = (n as u32 ^ 0x9e37_79b9).wrapping_mul(0x85eb_ca6b);
    let mixed = (mixed ^ mixed >> 13).wrapping_mul(0xc2b2_ae35);
    f64::from(mixed ^ mixed >> 16) / f64::from(u32::MAX)
}

/// A scan in Hounsfield units: muscle with a vessel and a bone in it, in air.
fn scan() -> Vec<f64> {
    let value = |n: usize| {
        let at = DVec3::new((n % 20) as f64, (n / 20 % 12) as f64, (n / 240) as f64);
        let off = at - DVec3::new(9.5, 5.5, 5.5);
        let near = |x: f64| (off.truncate() - glam::DVec2::new(x, 0.0)).length();
        match () {
            () if near(-3.0) < 1.5 => 320.0 + 20.0 * noise(n),
            () if near(3.0) < 2.0 => 700.0 + 800.0 * noise(n),
            () if off.length() < 5.5 => 20.0 + 60.0 * noise(n),
            () => -1000.0 + 10.0 * noise(n),
        }
    };
    (0..COUNT).map(value).collect()
}

const CT: &str = r#"
[camera]
from = [0.1, -1, 0.2]
width = 32
height = 24
[[light]]
kind = "directional"
name = "sun"
direction = [0.3, 1, -0.4]
irradiance = 3.0
[[material]]
name = "muscle"
window = [0, 100]
extinction = 0.05
albedo = [0.8, 0.3, 0.2]
[[material]]
name = "vessel"
window = [290, 350]
extinction = 1.0
albedo = [0.9, 0.1, 0.1]
emission = [0.02, 0.0, 0.0]
[[material]]
name = "bone"
window = [480, 2000]
extinction = 1.0
albedo = [0.9, 0.9, 0.8]
[settings]
photons = 4000
max_events = 4
segments = 8
rays = 1
"#;

fn ct(volume: &Volume, filter: Filter) -> Scene {
    let mut scene = scene_over(volume, CT);
    scene.filter = filter;
    scene
}

fn rel_mse(image: &Image, truth: &Image) -> f64 {
    Metrics::of(image, truth).expect("of one size").rel_mse
}

/// The scan as integers or as floats, with one more value somewhere in the air.
fn scan_with(outlier: Option<f64>, is_float: bool) -> Volume {
    with(scan(), outlier, is_float)
}

fn with(mut values: Vec<f64>, outlier: Option<f64>, is_float: bool) -> Volume {
    values[2] = outlier.unwrap_or(values[2]);
    match is_float {
        true => volume(values.iter().map(|&v| v as f32).collect::<Vec<_>>()),
        false => volume(values.iter().map(|&v| v.floor() as i32).collect::<Vec<_>>()),
    }
}

#[test]
fn one_voxel_of_another_value_changes_nothing_else() {
    for filter in [Filter::Nearest, Filter::Linear] {
        for is_float in [false, true] {
            let clean = scan_with(None, is_float);
            let clean = rendered(&ct(&clean, filter), &clean).image;
            for outlier in [1e7, -2e6, 30_000.0] {
                let what = format!("{outlier} among floats: {is_float}, {filter}");
                let hurt = scan_with(Some(outlier), is_float);
                let scene = ct(&hurt, filter);
                assert_eq!(scene.unresolved(&hurt), Vec::<String>::new(), "{what}");
                scene.check_against(&hurt).expect("nothing is amiss");
                let mut image = rendered(&scene, &hurt).image;
                if filter == Filter::Linear {
                    // Between air and that voxel the value passes through all materials: thin shells
                    // about it, which are seen, and are no error.
                    let alone = with(vec![-1000.0; COUNT], Some(outlier), is_float);
                    let shells = rendered(&ct(&alone, filter), &alone).image;
                    let seen = (0..image.rgb.len()).filter(|&i| shells.rgb[i] != [0.0; 3]);
                    let seen = seen.collect::<Vec<_>>();
                    assert!(seen.len() < image.rgb.len() / 25, "{what}: {}", seen.len());
                    seen.into_iter().for_each(|i| image.rgb[i] = clean.rgb[i]);
                }
                let error = rel_mse(&image, &clean);
                println!("{what}: relMSE {error:.2e}");
                assert!(error < 1e-3, "{what}: relMSE {error}");
                // The voxel is as transparent as the air around it.
                let is_same = filter == Filter::Nearest && !is_float;
                assert!(!is_same || image == clean, "{what}: not bit for bit");
            }
        }
    }
}

#[test]
fn a_scene_that_loses_its_vessels_is_seen_to_differ() {
    let clean = scan_with(None, false);
    let mut scene = ct(&clean, Filter::Nearest);
    let full = rendered(&scene, &clean).image;
    scene.materials.remove(1);
    assert!(rel_mse(&rendered(&scene, &clean).image, &full) > 0.01);
}

/// The emission of the entry that a value of the data goes to.
fn seen(scene: &Scene, volume: &Volume, value: f64) -> [f32; 3] {
    let (domain, numbers) = (scene.domain(volume), volume.numbers());
    let table = Table::build(&scene.materials, &domain, None);
    let entry = domain.map(&numbers).entry_of(((value - numbers.least) / numbers.step) as f32);
    table.emission[entry]
}

/// A material that emits over a window.
fn glow(name: &str, [low, high]: [f64; 2], emission: [f64; 3]) -> String {
    format!(
        "[[material]]\nname = \"{name}\"\nwindow = [{low:?}, {high:?}]\nextinction = 0.5\nalbedo = 0\n\
         emission = {emission:?}\n"
    )
}

fn head(filter: &str) -> String {
    format!(
        "[volume]\nfile = \"made by the test\"\nfilter = \"{filter}\"\n[camera]\nfrom = [0, -1, 0]\n\
         zoom = 1.05\nfov_deg = 24\nwidth = 96\nheight = 96\n[settings]\nphotons = 500\nmax_events = 1\n\
         segments = 64\nrays = 1\n[[light]]\nkind = \"directional\"\nname = \"sun\"\n\
         direction = [0.2, 1, -0.3]\nirradiance = 0.0\n"
    )
}

/// A settled scene of such materials, whose labels are looked at as they are.
fn glowing(volume: &Volume, filter: &str, materials: &str) -> Scene {
    let mut scene = Scene::parse(&(head(filter) + materials), "test.toml").expect("reads");
    scene.settle(volume);
    scene
}

/// Every label's own emission: its number in three digits.
fn own(label: u32) -> [f64; 3] {
    [label % 16, label / 16 % 16, label / 256].map(|digit| f64::from(digit + 1) / 16.0)
}

/// Each label has its own material and no other, whatever the data are stored as.
fn labels_are_told_apart(what: &str, volume: &Volume, labels: &[u32], value: impl Fn(f64) -> f64) {
    for shift in [0.0, -0.5] {
        let windows = labels.iter().map(|&l| {
            let ends = [0.0, 1.0].map(|d| value(f64::from(l) + shift + d));
            glow(&format!("label {l}"), [ends[0].min(ends[1]), ends[0].max(ends[1])], own(l))
        });
        let scene = glowing(volume, "nearest", &windows.collect::<String>());
        scene.check_against(volume).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert_eq!(scene.unresolved(volume), Vec::<String>::new(), "{what}, {shift}");
        let (domain, numbers) = (scene.domain(volume), volume.numbers());
        let (table, map) = (Table::build(&scene.materials, &domain, None), domain.map(&numbers));
        for &label in labels {
            let number = (value(f64::from(label)) - numbers.least) / numbers.step;
            let found = table.emission[map.entry_of(number as f32)];
            assert_eq!(found, own(label).map(|x| x as f32), "{what}, {shift}: label {label}");
        }
    }
}

fn filled<T: Copy>(labels: &[u32], of: impl Fn(u32) -> T) -> (Vec<T>, [u32; 3]) {
    let side = 16;
    let voxels = (0..side * side * side).map(|n: u32| of(labels[n as usize % labels.len()]));
    (voxels.collect(), [side; 3])
}

#[test]
fn every_label_has_its_own_material() {
    for most in [7, 100, 4000] {
        for first in [0, 1] {
            let labels: Vec<u32> = (first..=most).collect();
            let what = |kind: &str| format!("{first} to {most} as {kind}");
            let (voxels, size) = filled(&labels, |l| l as u16);
            labels_are_told_apart(&what("u16"), &sized(size, voxels), &labels, |l| l);
            let (voxels, size) = filled(&labels, |l| l as f32);
            labels_are_told_apart(&what("f32"), &sized(size, voxels), &labels, |l| l);
            let (voxels, size) = filled(&labels, i64::from);
            labels_are_told_apart(&what("i64"), &sized(size, voxels), &labels, |l| l);
            if most < 256 {
                let (voxels, size) = filled(&labels, |l| l as u8);
                labels_are_told_apart(&what("u8"), &sized(size, voxels), &labels, |l| l);
            }
        }
    }
}

#[test]
fn labels_may_have_gaps_slopes_and_far_neighbours() {
    let gaps = [1, 2, 5, 40, 41, 999, 1000, 3001];
    let (voxels, size) = filled(&gaps, |l| l as u16);
    labels_are_told_apart("gaps", &sized(size, voxels.clone()), &gaps, |l| l);
    for (slope, intercept) in
        [(2.0, 0.0), (0.5, -3.0), (0.7_f32.into(), 0.0), (0.1_f32.into(), 5.0)]
    {
        let scaled = sized(size, Values::from(voxels.clone()).mapped(slope, intercept));
        // As people write them: with few digits.
        let digits = (slope * 1e6_f64).round() / 1e6;
        let what = format!("slope {digits}");
        labels_are_told_apart(&what, &scaled, &gaps, |l| digits * l + intercept);
    }
    // A window goes up from its value: where the slope is negative, to the label before.
    let turned = sized(size, Values::from(voxels).mapped(-1.0, 0.0));
    for label in gaps {
        let at = -f64::from(label);
        let scene = glowing(&turned, "nearest", &glow("one", [at, at + 1.0], [1.0; 3]));
        for other in gaps {
            let is_drawn = seen(&scene, &turned, -f64::from(other)) != [0.0; 3];
            assert_eq!(is_drawn, other == label, "{label} of -1 each, seen at {other}");
        }
    }
    // As many as there are entries: from 0 to 4095.
    let (mut voxels, size) = filled(&[0, 1, 2, 4094, 4095], |l| l as u16);
    labels_are_told_apart("4095", &sized(size, voxels.clone()), &[0, 1, 2, 4094, 4095], |l| l);
    // One voxel far off does not take the others' entries.
    voxels[17] = 60_000;
    let labels = [0, 1, 2];
    for v in &mut voxels {
        *v = if *v == 4094 || *v == 4095 { 2 } else { *v };
    }
    labels_are_told_apart("60000", &sized(size, voxels), &labels, |l| l);
}

#[test]
fn a_mask_is_drawn() {
    let inside = |n: usize| (n % 20 / 4 % 2) as u8;
    for (high, window) in
        [(1, [1.0, 2.0]), (1, [0.5, 1.5]), (255, [255.0, 256.0]), (255, [0.5, 255.5])]
    {
        let mask = volume((0..COUNT).map(|n| high * inside(n)).collect::<Vec<_>>());
        for filter in ["nearest", "linear"] {
            let scene = glowing(&mask, filter, &glow("mask", window, [0.0, 1.0, 0.0]));
            scene.check_against(&mask).expect("it is not empty");
            assert!(scene.unresolved(&mask).is_empty());
            assert_eq!(seen(&scene, &mask, 0.0), [0.0; 3]);
            assert_eq!(seen(&scene, &mask, high.into()), [0.0, 1.0, 0.0], "{window:?}");
            let image = rendered(&scene, &mask).image;
            let greatest = image.rgb.iter().map(|p| p[1]).fold(0.0, f32::max);
            assert!(greatest > 0.3, "{window:?}, {filter}: {greatest}");
        }
    }
}

#[test]
fn labels_too_far_apart_are_refused_by_name() {
    let ids: Vec<u32> = (0..300).map(|n| (noise(n) * 2_147_483_647.0) as u32).collect();
    let windows = |shift: f64| {
        let all = ids.iter().map(|&id| {
            let from = f64::from(id) + shift;
            glow(&format!("id {id}"), [from, from + 1.0], [1.0; 3])
        });
        all.collect::<String>()
    };
    let (wide, size) = filled(&ids, i64::from);
    let i32s: Vec<i32> = wide.iter().map(|&v| v as i32).collect();
    let u64s: Vec<u64> = wide.iter().map(|&v| v as u64).collect();
    let kinds: [(&str, Values); 3] =
        [("i64", wide.into()), ("i32", i32s.into()), ("u64", u64s.into())];
    for (kind, values) in kinds {
        let volume = sized(size, values);
        for shift in [0.0, -0.5] {
            let scene = glowing(&volume, "nearest", &windows(shift));
            let refused = scene.check_against(&volume).expect_err(kind).to_string();
            assert!(refused.contains("material `id ") && refused.contains("renumber"), "{refused}");
        }
    }
    // Neighbours that single precision cannot tell apart, whatever the range.
    let ids = [0, 1 << 26, (1 << 26) + 1];
    let (voxels, size) = filled(&ids, i64::from);
    let volume = sized(size, voxels);
    let last = f64::from(ids[2]);
    let mut scene = glowing(&volume, "nearest", &glow("last", [last, last + 1.0], [1.0; 3]));
    scene.settings.range = Some([last - 8.0, last + 8.0]);
    let refused = scene.check_against(&volume).expect_err("not in single precision").to_string();
    assert!(refused.contains("material `last`"), "{refused}");
}

#[test]
fn few_labels_of_many_may_be_looked_at() {
    let ids = [1, 2, 3, 70_000, 2_000_000_000];
    let (voxels, size) = filled(&ids, i64::from);
    let volume = sized(size, voxels);
    let windows = [1, 2, 3].map(|l| glow(&format!("{l}"), [l.into(), f64::from(l + 1)], own(l)));
    let mut scene = glowing(&volume, "nearest", &windows.concat());
    scene.settings.range = Some([1.0, 4.0]);
    scene.check_against(&volume).expect("the range is enough");
    assert!(scene.unresolved(&volume).is_empty());
    for id in ids {
        let expect = if id < 4 { own(id).map(|x| x as f32) } else { [0.0; 3] };
        assert_eq!(seen(&scene, &volume, id.into()), expect, "label {id}");
    }
}

/// All that the scan has is told as its own value says, to within a step.
fn tissues_are_told(what: &str, values: Vec<f64>, most_step: f64) {
    let floats = volume(values.iter().map(|&v| v as f32).collect::<Vec<_>>());
    let whole = volume(values.iter().map(|&v| v.floor() as i32).collect::<Vec<_>>());
    for (kind, volume) in [("f32", floats), ("i32", whole)] {
        let scene = glowing(
            &volume,
            "nearest",
            &[
                glow("muscle", [0.0, 100.0], [1.0, 0.0, 0.0]),
                glow("vessel", [290.0, 350.0], [0.0, 1.0, 0.0]),
                glow("bone", [480.0, 2000.0], [0.0, 0.0, 1.0]),
            ]
            .concat(),
        );
        let step = scene.domain(&volume).step();
        assert!(step <= most_step, "{what}, {kind}: {step} from entry to entry");
        assert_eq!(scene.unresolved(&volume), Vec::<String>::new(), "{what}, {kind}");
        let within = |v: f64, [low, high]: [f64; 2]| f32::from((low..high).contains(&v));
        for at in 0..COUNT as u32 {
            let value = volume.value(at % 20, at / 20 % 12, at / 240);
            let expect = [
                within(value, [0.0, 100.0]),
                within(value, [290.0, 350.0]),
                within(value, [480.0, 2000.0]),
            ];
            if at % 7 == 0 || !(-1100.0..=2000.0).contains(&value) {
                assert_eq!(seen(&scene, &volume, value), expect, "{what}, {kind}: {value}");
            }
        }
    }
}

#[test]
fn padding_leaves_the_table_to_the_tissues() {
    let padded = |with: f64| -> Vec<f64> {
        let pad = |(n, v): (usize, f64)| if n % 10 < 3 && v < -900.0 { with } else { v };
        scan().into_iter().enumerate().map(pad).collect()
    };
    for with in [-2000.0, -3024.0, -32_768.0, -1e6, 30_000.0, 1e6, 1e7] {
        tissues_are_told(&format!("padding of {with}"), padded(with), 1.5);
    }
    // At both ends, and an outlier beyond.
    let mut both = padded(-1e6);
    for n in (0..COUNT).filter(|n| n % 20 == 19) {
        both[n] = 30_000.0;
    }
    both[COUNT - 2] = 2e7;
    tissues_are_told("padding at both ends", both, 1.5);
}

#[test]
fn what_is_left_out_keeps_its_own_material() {
    // Bone is all from 480 on, which is as high as anybody's metal; and that metal is 30 % of all.
    let metal = |(n, v): (usize, f64)| if n % 10 < 3 { 1e6 } else { v };
    let values: Vec<f32> = scan().into_iter().enumerate().map(metal).map(|v| v as f32).collect();
    let volume = volume(values);
    let bone = glow("bone", [480.0, 5e5], [0.0, 0.0, 1.0]);
    let scene = glowing(&volume, "nearest", &bone);
    assert_eq!(seen(&scene, &volume, 1e6), [0.0; 3]);
    let scene = glowing(&volume, "nearest", &glow("bone", [480.0, 5e6], [0.0, 0.0, 1.0]));
    assert_eq!(seen(&scene, &volume, 1e6), [0.0, 0.0, 1.0]);
    assert_eq!(seen(&scene, &volume, 700.0), [0.0, 0.0, 1.0]);
    assert_eq!(seen(&scene, &volume, 400.0), [0.0; 3]);
    assert!(scene.domain(&volume).step() < 1.5);
}

#[test]
fn sparse_vessels_have_the_table() {
    // All but a few voxels have one value: the ten thousandth at the end is of that, too.
    let size = [64, 64, 32];
    let voxels = 64 * 64 * 32;
    let is_vessel = |n: usize| n % 13_001 < 1;
    let value = |n: usize| if is_vessel(n) { 0.4 + 0.5 * noise(n) as f32 } else { 0.0 };
    let volume = sized(size, (0..voxels).map(value).collect::<Vec<_>>());
    assert_eq!(volume.quantiles(&[1e-4, 1.0 - 1e-4]), [0.0, 0.0]);
    for (window, is_half) in [([0.3, 1.0], false), ([0.3, 1e9], false), ([0.0, 1.0], true)] {
        let scene = glowing(&volume, "nearest", &glow("vessel", window, [0.0, 1.0, 0.0]));
        assert!(scene.unresolved(&volume).is_empty(), "{window:?}");
        let background = if is_half { [0.0, 1.0, 0.0] } else { [0.0; 3] };
        assert_eq!(seen(&scene, &volume, 0.0), background);
        for n in (0..voxels).filter(|&n| is_vessel(n)) {
            assert_eq!(seen(&scene, &volume, value(n).into()), [0.0, 1.0, 0.0], "{window:?}");
        }
    }
    let inner = glowing(&volume, "nearest", &glow("inner", [0.5, 0.6], [0.0, 1.0, 0.0]));
    for n in (0..voxels).filter(|&n| is_vessel(n)) {
        let is_inner = f32::from((0.5..0.6).contains(&value(n)));
        assert_eq!(seen(&inner, &volume, value(n).into()), [0.0, is_inner, 0.0], "{}", value(n));
    }
}

#[test]
fn volumes_of_one_value_and_of_two_have_their_materials() {
    let one_of = |values: Values, at: f64, window: [f64; 2], is_drawn: bool| {
        let volume = sized([8, 8, 8], values);
        let scene = glowing(&volume, "nearest", &glow("m", window, [1.0; 3]));
        assert_eq!(seen(&scene, &volume, at), [f32::from(is_drawn); 3], "{at} in {window:?}");
        assert_eq!(scene.unresolved(&volume).is_empty(), is_drawn, "{at} in {window:?}");
        assert_eq!(scene.check_against(&volume).is_ok(), is_drawn, "{at} in {window:?}");
        if is_drawn {
            rendered(&scene, &volume);
        }
    };
    for (window, is_drawn) in [([7.0, 8.0], true), ([6.0, 7.0], false), ([7.5, 9.0], false)] {
        one_of(vec![7u8; 512].into(), 7.0, window, is_drawn);
        one_of(vec![7i32; 512].into(), 7.0, window, is_drawn);
        one_of(vec![7f32; 512].into(), 7.0, window, is_drawn);
    }
    for (window, is_drawn) in [([7.5, 8.0], true), ([7.0, 7.5], false), ([7.0, 8.0], true)] {
        one_of(vec![7.5f32; 512].into(), 7.5, window, is_drawn);
    }
    for span in [1_u16, 4095] {
        let values: Vec<u16> = (0..512).map(|n| if n % 2 == 0 { 3 } else { 3 + span }).collect();
        let top = f64::from(3 + span);
        for slope in [1.0, -1.0] {
            let volume = sized([8, 8, 8], Values::from(values.clone()).mapped(slope, 0.0));
            let (low, high) = if slope > 0.0 { (3.0, top) } else { (-top, -3.0) };
            let scene = glowing(
                &volume,
                "nearest",
                &(glow("a", [low, low + 1.0], own(1)) + &glow("b", [high, high + 1.0], own(2))),
            );
            assert_eq!(seen(&scene, &volume, low), own(1).map(|x| x as f32));
            assert_eq!(seen(&scene, &volume, high), own(2).map(|x| x as f32));
        }
    }
}

#[test]
fn what_no_data_meet_is_named() {
    // Stored with an offset of 1024, and looked at with windows in Hounsfield units.
    let stored = volume(scan().iter().map(|v| (v + 1024.0) as u16).collect::<Vec<_>>());
    let air = glow("air", [-1100.0, -200.0], [1.0; 3]);
    let muscle = glow("muscle", [0.0, 100.0], [1.0; 3]);
    let far = glow("far", [4000.0, 5000.0], [1.0; 3]);
    let scene = glowing(&stored, "linear", &[air, muscle, far].concat());
    let said = scene.unresolved(&stored);
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(said[0].contains("`air` (-1100 to -200) meets no value of the data"), "{said:?}");
    assert!(said[1].contains("`far` (4000 to 5000) meets no value of the data"), "{said:?}");

    // What lies beyond all reach of the range is named as that, and the rest is resolved.
    let mut values = scan();
    values[0] = 1e9;
    let hurt = volume(values.iter().map(|&v| v as f32).collect::<Vec<_>>());
    let metal = glow("metal", [1e8, 2e9], [1.0; 3]);
    let vessel = glow("vessel", [290.0, 350.0], [1.0; 3]);
    let scene = glowing(&hurt, "linear", &(metal + &vessel));
    let said = scene.unresolved(&hurt);
    assert_eq!(said.len(), 1, "{said:?}");
    assert!(said[0].contains("`metal`") && said[0].contains("no entry"), "{said:?}");

    // Thinner than what is told apart there.
    let mut scene = glowing(&hurt, "linear", &glow("thin", [300.0, 300.5], [1.0; 3]));
    scene.settings.range = Some([-1e5, 1e5]);
    let said = scene.unresolved(&hurt);
    assert!(said.len() == 1 && said[0].contains("set `range`"), "{said:?}");
}

fn parsed(settings: &str) -> photogram::Result<Scene> {
    let text = format!("{}[film]\nexposure = 0\n", head("linear"));
    Scene::parse(&text.replace("max_events = 1\n", settings), "test.toml")
}

#[test]
fn a_range_is_checked_kept_and_honoured() {
    for wrong in ["[10, 5]", "[5, 5]", "[0, inf]", "[nan, 1]", "[-1e308, 1e308]", "[1]", "7"] {
        let refused = parsed(&format!("range = {wrong}\n")).expect_err(wrong).to_string();
        assert!(refused.contains("test.toml:12") && refused.contains("`range`"), "{refused}");
    }
    let floats: Vec<f32> = (0..COUNT).map(|n| 1000.0 * noise(n) as f32).collect();
    let floats = volume(floats);
    let mut given = parsed("range = [100, 200.5]\n").expect("it reads");
    assert_eq!(given.settings.range, Some([100.0, 200.5]));
    given.settle(&floats);
    assert_eq!(given.settings.range, Some([100.0, 200.5]), "what is given stays");
    assert!(given.domain(&floats).step() < 101.0 / 4090.0);

    let mut derived = parsed("").expect("it reads");
    derived.settle(&floats);
    let range = derived.settings.range.expect("frozen");
    assert!(range[0] >= 0.0 && range[0] < 2.0 && range[1] <= 1000.0 && range[1] > 998.0);
    let again = Scene::parse(&derived.to_toml(), "again.toml").expect("it reads back");
    assert_eq!(again.settings.range, Some(range));
    assert_eq!(again.domain(&floats), derived.domain(&floats));

    // Whole numbers that are few need none, but may have one.
    let whole = volume((0..COUNT).map(|n| (n % 1000) as u16).collect::<Vec<_>>());
    let mut scene = parsed("").expect("it reads");
    scene.settle(&whole);
    assert_eq!(scene.settings.range, None);
    scene.settings.range = Some([10.0, 20.0]);
    let (domain, map) = (scene.domain(&whole), scene.domain(&whole).map(&whole.numbers()));
    assert!(domain.step() < 0.01);
    for n in 9..=21_u8 {
        assert_eq!(domain.value(map.entry_of(f32::from(n))), f64::from(n));
    }
    assert!(domain.value(map.entry_of(0.0)) < 10.0 && domain.value(map.entry_of(999.0)) > 20.0);
}
