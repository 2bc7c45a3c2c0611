//! Scenes for volumes that come without one, and changes of one line.

use glam::{DMat3, DVec3};
use photogram::scene::{CameraPlace, Filter, LightKind, Material, ScanKind, Scene, VolumeSource};
use photogram::transfer::{Table, ramp_weight};
use photogram::volume::phantom::{Phantom, build};
use photogram::volume::{Values, Volume};

const EDGE: u32 = 40;

fn volume(values: impl Into<Values>, spacing: f64) -> Volume {
    let spacing = DVec3::splat(spacing);
    Volume::new([EDGE; 3], spacing, DMat3::IDENTITY, DVec3::ZERO, values).unwrap()
}

/// Values by the distance from the middle, 0 there and 1 at the faces.
fn by_distance<T>(value: impl Fn(f64, usize) -> T) -> Vec<T> {
    let (n, middle) = (EDGE as usize, (f64::from(EDGE) - 1.0) / 2.0);
    let away = |at: usize| {
        let away = [at % n, at / n % n, at / n / n].map(|x| (x as f64 - middle) / middle);
        away.iter().map(|x| x * x).sum::<f64>().sqrt()
    };
    (0..n * n * n).map(|at| value(away(at), at)).collect()
}

/// Even in [0, 1), without an order.
fn noise(at: usize) -> f64 {
    let mixed = (at as u32 ^ 0x9e37_79b9).wrapping_mul(0x85eb_ca6b);
    f64::from((mixed ^ mixed >> 15).wrapping_mul(0xc2b2_ae35) >> 8) / f64::from(1 << 24)
}

/// A head as MR shows it: dark air with noise, liquid, grey and white matter, bright fat.
fn mr() -> Vec<f32> {
    by_distance(|away, at| {
        let tissue = match away {
            a if a < 0.2 => 150.0,
            a if a < 0.45 => 620.0,
            a if a < 0.65 => 400.0,
            a if a < 0.75 => 900.0,
            _ => return (-(1.0 - noise(at)).ln()).sqrt() as f32 * 20.0,
        };
        (tissue + 60.0 * (noise(at) - 0.5)) as f32
    })
}

fn made(volume: &Volume) -> (Scene, ScanKind) {
    let source = VolumeSource::Phantom { phantom: Phantom::Hand, size: 64 };
    let (scene, kind) = Scene::for_volume(source, "scan", volume).expect("a scene");
    scene.check().expect("nothing impossible");
    let mut settled = scene.clone();
    settled.settle(volume);
    settled.check_against(volume).expect("something to see");
    let table =
        Table::build(&settled.materials, &settled.domain(volume), settled.settings.majorant);
    assert_eq!(table.clamped, 0);
    let text = scene.to_toml();
    assert_eq!(Scene::parse(&text, "scan.toml").expect("it reads back"), scene, "{text}");
    (scene, kind)
}

fn names(scene: &Scene) -> Vec<&str> {
    scene.materials.iter().map(|m| m.name.as_str()).collect()
}

fn named<'a>(scene: &'a Scene, name: &str) -> &'a Material {
    let found = scene.materials.iter().find(|m| m.name == name);
    found.unwrap_or_else(|| panic!("no {name} among {:?}", names(scene)))
}

fn weight(scene: &Scene, name: &str, value: f64) -> f64 {
    ramp_weight(&named(scene, name).ramp, value)
}

#[test]
fn ct_has_the_presets_that_it_meets() {
    for phantom in [Phantom::Hand, Phantom::Torso, Phantom::Kidneys] {
        let volume = build(phantom, 64).unwrap();
        let (scene, kind) = made(&volume);
        assert_eq!((kind, scene.filter), (ScanKind::Hounsfield, Filter::Linear), "{phantom}");
        let has_lungs = phantom == Phantom::Torso;
        assert_eq!(names(&scene).contains(&"lung"), has_lungs, "{phantom}: {:?}", names(&scene));
        // Contrast agent at 380 is told apart from what is denser.
        // The vessels of so small a hand are too thin for that.
        let denser = if phantom == Phantom::Kidneys { 700.0 } else { 1100.0 };
        assert!(weight(&scene, "bone", denser) > 0.9, "{phantom}: {:?}", scene.materials);
        if phantom != Phantom::Hand {
            assert!(weight(&scene, "vessels", 380.0) > 0.9, "{phantom}: {:?}", scene.materials);
            assert_eq!(weight(&scene, "vessels", denser), 0.0);
            assert_eq!(weight(&scene, "bone", 380.0), 0.0);
        }
        assert_eq!(weight(&scene, "skin", -90.0), 1.0);
        assert!(scene.materials.iter().all(|m| ramp_weight(&m.ramp, -1000.0) == 0.0));
        // What lies inside shows through what lies around it.
        let across = volume.extent().element_product().cbrt();
        assert!(named(&scene, "skin").extinction * across < 1.0);
        assert!(named(&scene, "bone").extinction * across > 50.0 || across < 80.0);
    }
}

#[test]
fn without_contrast_agent_all_that_is_dense_is_bone() {
    let ct = by_distance(|away, at| {
        let spread = 40.0 * (noise(at) - 0.5);
        match away {
            // From spongy to dense: ever fewer voxels.
            a if a < 0.4 => (150.0 + 60.0 * -(1.0 - noise(at)).ln() + spread) as i16,
            a if a < 0.8 => (50.0 + spread) as i16,
            _ => -1000,
        }
    });
    let (scene, kind) = made(&volume(ct, 2.0));
    assert_eq!((kind, names(&scene)), (ScanKind::Hounsfield, vec!["soft tissue", "bone"]));
    assert!(weight(&scene, "bone", 300.0) > 0.0);
}

#[test]
fn mr_has_materials_of_its_histogram() {
    let (scene, kind) = made(&volume(mr(), 1.0));
    assert_eq!((kind, names(&scene)), (ScanKind::Grey, vec!["low", "middle", "high"]));
    for air in [0.0, 20.0, 40.0] {
        assert!(scene.materials.iter().all(|m| ramp_weight(&m.ramp, air) == 0.0), "{scene:?}");
    }
    for (name, value) in [("low", 400.0), ("middle", 620.0), ("high", 900.0), ("high", 950.0)] {
        assert_eq!(weight(&scene, name, value), 1.0, "{:?}", scene.materials);
    }
    let colours: Vec<_> = scene.materials.iter().map(Material::albedo).collect();
    assert!(scene.materials.is_sorted_by(|a, b| a.extinction < b.extinction));
    assert!(colours[0] != colours[1] && colours[1] != colours[2]);
}

#[test]
fn phantoms_without_a_unit_have_what_their_histogram_says() {
    for phantom in [Phantom::Cornell, Phantom::Engine] {
        let volume = build(phantom, 64).unwrap();
        let (scene, kind) = made(&volume);
        assert_eq!(kind, ScanKind::Grey, "{phantom}");
        let densest = phantom.tissues().last().unwrap().plateau();
        assert_eq!(weight(&scene, "high", densest), 1.0, "{phantom}: {:?}", scene.materials);
    }
}

#[test]
fn labels_have_a_material_each() {
    let label = |away: f64| match away {
        a if a < 0.15 => 5,
        a if a < 0.3 => 1,
        a if a < 0.35 => 3,
        a if a < 0.9 => 2,
        _ => 0,
    };
    let bytes = volume(by_distance(|away, _| label(away) as u8), 1.0);
    let floats = volume(by_distance(|away, _| label(away) as f32), 1.0);
    for volume in [bytes, floats] {
        let (scene, kind) = made(&volume);
        assert_eq!((kind, scene.filter), (ScanKind::Labels, Filter::Nearest));
        assert_eq!(names(&scene), ["label-1", "label-2", "label-3", "label-5"]);
        for value in [0.0, 1.0, 2.0, 3.0, 5.0] {
            let own = format!("label-{value}");
            for m in &scene.materials {
                let expect = if m.name == own { 1.0 } else { 0.0 };
                assert_eq!(ramp_weight(&m.ramp, value), expect, "{value} in {m:?}");
            }
        }
        let colours: Vec<_> = scene.materials.iter().map(|m| m.colour.to_array()).collect();
        assert!((0..4).all(|a| (0..a).all(|b| colours[a] != colours[b])));
        // Label 2 is around the others, which are to be seen.
        let hull = named(&scene, "label-2").extinction;
        assert!(hull < 0.1 * named(&scene, "label-1").extinction);
    }
}

#[test]
fn a_few_values_with_noise_are_no_labels() {
    let coarse = by_distance(|away, at| match away {
        a if a < 0.8 => (20.0 + 20.0 * noise(at)) as u8,
        _ => 0,
    });
    assert_eq!(made(&volume(coarse, 1.0)).1, ScanKind::Grey);
}

#[test]
fn two_values_are_enough_and_one_is_refused() {
    let mask = volume(by_distance(|away, _| if away < 0.7 { 1.5f32 } else { 0.25 }), 1.0);
    let (scene, kind) = made(&mask);
    assert_eq!((kind, names(&scene)), (ScanKind::Grey, vec!["high"]));
    assert_eq!((weight(&scene, "high", 1.5), weight(&scene, "high", 0.25)), (1.0, 0.0));
    let constant = volume(vec![-3i16; (EDGE * EDGE * EDGE) as usize], 1.0);
    let source = VolumeSource::File("x.nrrd".into());
    let error = Scene::for_volume(source, "x", &constant).expect_err("nothing to see").to_string();
    assert!(error.contains("all voxels have the value -3: there is nothing to see"), "{error}");
}

#[test]
fn an_outlier_changes_nothing() {
    let hand = build(Phantom::Hand, EDGE).unwrap();
    let [ni, nj, nk] = hand.size();
    let places = (0..nk).flat_map(|k| (0..nj).flat_map(move |j| (0..ni).map(move |i| (i, j, k))));
    let hand_values: Vec<f32> = places.map(|(i, j, k)| hand.value(i, j, k) as f32).collect();
    let of_hand = |values: Vec<f32>| {
        Volume::new(hand.size(), hand.spacing(), hand.axes(), hand.origin(), values).unwrap()
    };
    let of_mr = |values: Vec<f32>| volume(values, 1.0);
    type Build<'a> = &'a dyn Fn(Vec<f32>) -> Volume;
    let cases: [(Vec<f32>, Build); 2] = [(hand_values, &of_hand), (mr(), &of_mr)];
    for (values, volume_of) in cases {
        let source = || VolumeSource::File("x.nrrd".into());
        let plain = Scene::for_volume(source(), "x", &volume_of(values.clone())).unwrap();
        for outlier in [1e7, -1e7] {
            let mut hurt = values.clone();
            let at = hurt.len() / 3;
            hurt[at] = outlier;
            let hurt = Scene::for_volume(source(), "x", &volume_of(hurt)).unwrap();
            assert_eq!(hurt, plain, "{outlier}");
        }
    }
}

#[test]
fn a_larger_object_looks_the_same() {
    let (small, large) = (made(&volume(mr(), 0.02)).0, made(&volume(mr(), 20.0)).0);
    assert_eq!((small.camera, small.lights), (large.camera, large.lights));
    for (a, b) in small.materials.iter().zip(&large.materials) {
        assert!((a.extinction / b.extinction - 1000.0).abs() < 1e-6, "{a:?} {b:?}");
        assert_eq!((&a.ramp, a.colour), (&b.ramp, b.colour));
    }
}

#[test]
fn the_camera_sees_the_front_of_it_all() {
    let values = [0u8, 200].repeat(32 * 16 * 8 / 2);
    // Slices run downwards, and the patient's left is on the left of each.
    let axes = DMat3::from_cols(DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z);
    for size in [[32, 16, 8], [8, 16, 32], [8, 32, 16]] {
        let volume =
            Volume::new(size, DVec3::new(1.0, 2.0, 3.0), axes, DVec3::ONE, values.clone()).unwrap();
        let (mut scene, _) = made(&volume);
        scene.settle(&volume);
        let view = scene.camera.view().unwrap();
        let mut most = 0f64;
        for corner in 0..8 {
            let sign = |axis: u32| f64::from(corner >> axis & 1);
            let local = DVec3::new(sign(0), sign(1), sign(2)) * volume.extent();
            let to = volume.corner() + volume.axes() * local - view.origin;
            let depth = to.dot(view.forward);
            let across = [view.right, view.down].map(|a| to.dot(a) / a.length_squared() / depth);
            most = most.max(across[0].abs()).max(across[1].abs());
        }
        assert!((0.9..1.15).contains(&most), "{size:?}: the farthest corner is at {most}");
        assert!(view.forward.y > 0.9 && view.down.z < 0.0 && view.right.x > 0.0);
        let LightKind::Rectangle { corner, edge_u, edge_v } = scene.lights[0].kind else {
            panic!("{:?}", scene.lights[0]);
        };
        let key = corner + (edge_u + edge_v) / 2.0
            - volume.corner()
            - volume.axes() * volume.extent() / 2.0;
        // In front, on the left of the picture, above.
        assert!(key.y < 0.0 && key.dot(view.right) < 0.0 && key.z > 0.0);
    }
}

// ---- Changes of one line

const SCENE: &str = r#"
[volume]
phantom = "hand"
[camera]
from = [0, -1, 0]
zoom = 1.5
[[light]]
kind = "rectangle"
name = "key"
from = [-1, -1, 1]
size = 1.5
radiance = 10
[[light]]
kind = "point"
name = "lamp"
position = [1, 2, 3]
intensity = 4
[[material]]
name = "bone"
window = [500, 3000]
extinction = 1
albedo = 0.9
[[material]]
name = "soft tissue"
window = [0, 100]
extinction = 0.01
albedo = 0.9
[[material]]
name = "bone.marrow"
window = [100, 200]
extinction = 0.2
albedo = 0.9
[[edit]]
name = "lamp.intensity=8"
background = 0.5
"#;

fn scene() -> Scene {
    Scene::parse(SCENE, "scene.toml").unwrap()
}

fn set(text: &str) -> Scene {
    let mut scene = scene();
    let edit = scene.edit_of(text).unwrap_or_else(|e| panic!("{e}"));
    scene.apply(&edit).unwrap();
    scene
}

#[test]
fn every_field_is_set_and_nothing_else() {
    type Change = fn(&mut Scene);
    let cases: [(&str, Change); 17] = [
        ("bone.albedo=0.8,0.4,0.2", |s| {
            s.materials[0].scatter = 0.8;
            s.materials[0].colour = DVec3::new(0.8, 0.4, 0.2) / 0.8;
        }),
        (" bone.extinction = 1.5 ", |s| s.materials[0].extinction = 1.5),
        ("bone.scatter=.5", |s| s.materials[0].scatter = 0.5),
        ("bone.colour=[0.5, 1, 0]", |s| s.materials[0].colour = DVec3::new(0.5, 1.0, 0.0)),
        ("bone.emission=2", |s| s.materials[0].emission = DVec3::splat(2.0)),
        ("bone.phase_g=-0.5", |s| s.materials[0].phase_g = -0.5),
        ("bone.window=100,200", |s| s.materials[0].ramp = vec![[100.0, 1.0], [200.0, 1.0]]),
        ("bone.ramp=[[100,0],[200,1]]", |s| s.materials[0].ramp = vec![[100.0, 0.0], [200.0, 1.0]]),
        ("bone.ramp=[100,0],[200,1]", |s| s.materials[0].ramp = vec![[100.0, 0.0], [200.0, 1.0]]),
        ("bone.marrow.extinction=3", |s| s.materials[2].extinction = 3.0),
        ("soft tissue.extinction=0", |s| s.materials[1].extinction = 0.0),
        ("light.key.radiance=1,2,3", |s| s.lights[0].emitted = DVec3::new(1.0, 2.0, 3.0)),
        ("lamp.intensity=7", |s| s.lights[1].emitted = DVec3::splat(7.0)),
        ("key.from=1,0,0", |s| {
            let from = DVec3::X;
            s.lights[0].kind = LightKind::RectangleAround { from, distance: 3.0, size: 1.5 };
        }),
        ("camera.from=1,0,0", |s| {
            s.camera.place = CameraPlace::Around { from: DVec3::X, zoom: 1.5 };
        }),
        ("camera.fov_deg=20", |s| s.camera.fov_deg = 20.0),
        ("background=0.25", |s| s.background = DVec3::splat(0.25)),
    ];
    for (text, change) in cases {
        let mut expect = scene();
        change(&mut expect);
        assert_eq!(set(text), expect, "{text}");
    }
}

#[test]
fn an_edit_is_named_by_its_text_unless_that_is_taken() {
    assert_eq!(scene().edit_of("bone.scatter=1").unwrap().name, "bone.scatter=1");
    assert_eq!(scene().edit_of("lamp.intensity=8").unwrap().name, "lamp.intensity=8 (2)");
}

#[test]
fn what_cannot_be_set_is_refused_as_in_a_file() {
    for (text, expect) in [
        ("bone", "`bone`: write KEY=VALUE, such as"),
        ("bone=1", "`bone=1`: it names no field: write bone.FIELD=VALUE"),
        (
            "boan.albedo=1",
            "no material is called `boan`: there is bone, soft tissue, bone.marrow; and key, lamp, camera, background",
        ),
        ("light.sun.radiance=1", "no light is called `sun`: there is key, lamp"),
        ("bone.albdo=1", "`albdo` is unknown: known are name, window"),
        ("bone.name=x", "`name` is no field: there is window, ramp, extinction"),
        ("bone.=1", "`` is no field"),
        (
            "bone.albedo=red",
            "`albedo` is the text \"red\": it must be plain finite numbers [r, g, b]",
        ),
        ("bone.albedo=", "`albedo` is the text \"\""),
        ("bone.albedo=1,2", "`albedo` is a list of 2: it must be plain finite numbers [r, g, b]"),
        ("bone.albedo=2", "each channel must be in [0, 1]"),
        ("bone.extinction=nan", "`extinction` is nan: it must be a plain finite number, per mm"),
        ("bone.extinction=-1", "`extinction` is -1: it must be >= 0, per mm"),
        ("bone.extinction=1\nscatter=0", "`extinction` is the text"),
        ("bone.window=2,1", "`window` is [2, 1]: it is empty"),
        ("bone.ramp=[[1,0]]", "`ramp` has 1 points: it takes two or more"),
        ("lamp.radiance=1", "`radiance` is unknown: known are intensity, position"),
        ("camera.width=5", "`width` is unknown: known are origin, target, from, zoom"),
        ("camera.fov_deg=180", "`fov_deg` is 180: it must be in (0, 180) degrees"),
        ("background=-1", "each channel must be >= 0"),
    ] {
        let error = scene().edit_of(text).expect_err(text).to_string();
        assert!(error.contains(expect) && error.starts_with(&format!("`{text}`: ")), "{error}");
    }
}
