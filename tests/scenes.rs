//! Scenes as a user meets them: what is read, what is refused and in which words, what
//! edits do, and that the truth scenes say what the truth was computed from.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use photogram::error::{Error, Result};
use photogram::film::Image;
use photogram::scene::{
    CameraPlace, Changes, Curve, Edit, Estimator, Filter, LightChange, LightKind, Material,
    MaterialChange, Method, Scene, VolumeSource, Weighting, preset,
};
use photogram::transfer::{Domain, PRESETS, Table};
use photogram::volume::Volume;
use serde_json::Value;

const TRUTH: [&str; 6] = [
    "ball_multiple",
    "ball_single",
    "cloud_forward",
    "knuckle",
    "knuckle_bone_edit",
    "knuckle_vessel_edit",
];

fn truth(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/truth").join(file)
}

/// A scene that uses every part of the format.
const FULL: &str = r#"name = "full"
background = [0.1, 0.2, 0.3]

[volume]
phantom = "hand"
size = 64
filter = "nearest"

[camera]
from = [1, -2, 0.5]
zoom = 1.25
fov_deg = 40
width = 64
height = 48

[[light]]
kind = "rectangle"
name = "key"
from = [1, -1, 1]
distance = 2.5
size = 0.8
radiance = [30, 29, 28]
share = 2

[[light]]
kind = "surroundings"
radiance = 0.1

[[light]]
kind = "directional"
name = "sun"
id = 0
direction = [0, 0, -1]
irradiance = 0.5

[[material]]
preset = "ct-bone"
extinction = 0.9

[[material]]
name = "fog \"thin\""
window = [-500, 100]
extinction = 0.01
albedo = [0.9, 0.45, 0]
emission = [0, 0, 1e-7]
phase_g = -0.25

[settings]
method = "photon-map"
estimator = "points"
weighting = "plain"
photons = 30_000
radius = 0.75
seed = 18446744073709551615
reference_events = 3
history = false

[film]
exposure = -1.5
curve = "srgb"

[[edit]]
name = "red bone"
[[edit.material]]
name = "ct-bone"
colour = [0.9, 0.2, 0.1]

[[edit]]
name = "everything"
background = 0
remove_material = ["ct-bone"]
remove_light = ["sun"]
[edit.camera]
from = [0, -1, 0]
fov_deg = 20
[[edit.material]]
name = "fog \"thin\""
window = [0, 50]
albedo = 0.5
[[edit.add_material]]
name = "ct-bone"
ramp = [[100, 0], [300, 1], [300, 0.5], [2000, 1]]
extinction = 3
scatter = 0.5
colour = 1
[[edit.light]]
name = "key"
radiance = 60
from = [-1, -1, 0]
[[edit.add_light]]
kind = "point"
name = "lamp"
from = [0, 0, 1]
intensity = [1e6, 1e6, 9e5]

[[edit]]
name = "lamp off"
[[edit.light]]
name = "lamp"
intensity = 0
"#;

fn full() -> Scene {
    Scene::parse(FULL, "full.toml").expect("the full scene")
}

/// 10 x 20 x 40 voxels of 1 x 1 x 0.5 mm, values 0 to 1000.
fn volume() -> Volume {
    let values: Vec<u16> = (0..10 * 20 * 40).map(|i| i % 1001).collect();
    Volume::new(
        [10, 20, 40],
        DVec3::new(1.0, 1.0, 0.5),
        DMat3::IDENTITY,
        DVec3::new(5.0, 6.0, 7.0),
        values,
    )
    .expect("a sound volume")
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        other => vec![other.as_f64().expect("a number")],
    }
}

fn vector(value: &Value) -> DVec3 {
    DVec3::from_slice(&numbers(value))
}

#[test]
fn truth_scenes_say_what_the_truth_was_computed_from() -> Result<()> {
    for name in TRUTH {
        let text = std::fs::read_to_string(truth(&format!("{name}.json"))).expect("the JSON");
        let json: Value = serde_json::from_str(&text).expect("sound JSON");
        let scene = Scene::load(truth(&format!("{name}.toml")))?;

        assert_eq!(scene.name, name);
        let file = json["volume"].as_str().expect("a volume");
        assert_eq!(scene.volume, VolumeSource::File(truth(file)));
        assert_eq!(scene.filter.to_string(), json["filter"].as_str().expect("a filter"));

        let c = &json["camera"];
        let place = CameraPlace::At { origin: vector(&c["origin"]), target: vector(&c["target"]) };
        assert_eq!((scene.camera.place, scene.camera.up), (place, vector(&c["up"])), "{name}");
        let frame = [scene.camera.fov_deg, scene.camera.width.into(), scene.camera.height.into()];
        assert_eq!(frame.to_vec(), ["fov_deg", "width", "height"].map(|k| numbers(&c[k])[0]));

        let l = &json["light"];
        let (kind, emitted) = match l["kind"].as_str() {
            Some("point") => (LightKind::Point { position: vector(&l["position"]) }, "intensity"),
            Some("directional") => {
                (LightKind::Directional { direction: vector(&l["direction"]) }, "irradiance")
            }
            _ => {
                let [corner, edge_u, edge_v] =
                    ["corner", "edge_u", "edge_v"].map(|k| vector(&l[k]));
                (LightKind::Rectangle { corner, edge_u, edge_v }, "radiance")
            }
        };
        let [light] = &scene.lights[..] else { panic!("{name}: one light") };
        assert_eq!((light.kind, light.emitted), (kind, vector(&l[emitted])), "{name}");

        let materials = json["materials"].as_array().expect("materials");
        assert_eq!(scene.materials.len(), materials.len());
        for (ours, theirs) in scene.materials.iter().zip(materials) {
            assert_eq!(ours.name, theirs["name"].as_str().expect("a name"));
            let [lo, hi] = ["lo", "hi"].map(|k| numbers(&theirs[k])[0]);
            assert_eq!(ours.ramp, [[lo, 1.0], [hi, 1.0]]);
            assert_eq!(ours.extinction, numbers(&theirs["extinction"])[0]);
            assert!((ours.albedo() - vector(&theirs["albedo"])).length() < 1e-15, "{name}");
            assert_eq!(ours.phase_g, numbers(&json["phase_g"])[0]);
            assert_eq!(ours.emission, DVec3::ZERO);
        }
        let events = json["max_events"].as_i64().expect("max_events");
        assert_eq!(scene.settings.reference_events, u32::try_from(events).ok(), "{name}");
        let slots = if events < 0 { 32 } else { events as u32 };
        assert_eq!(scene.settings.max_events, slots);
        assert_eq!((scene.background, scene.edits.len()), (DVec3::ZERO, 0));
    }
    Ok(())
}

#[test]
fn truth_images_read_and_are_light() -> Result<()> {
    for name in TRUTH {
        for (file, at_least) in [(format!("{name}.exr"), 1e-3), (format!("{name}.stderr.exr"), 0.0)]
        {
            let image = Image::read_exr(truth(&file))?;
            assert_eq!((image.width, image.height), (128, 128));
            let values = image.rgb.as_flattened();
            let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64;
            assert!(mean.is_finite() && mean > at_least, "{file}: mean {mean}");
        }
    }
    Ok(())
}

#[test]
fn a_full_scene_is_read_as_written() {
    let scene = full();
    assert_eq!((scene.settings.method, scene.settings.seed), (Method::PhotonMap, u64::MAX));
    assert_eq!(scene.settings.estimator, Some(Estimator::Points));
    assert_eq!((scene.settings.weighting, scene.settings.history), (Weighting::Plain, false));
    assert_eq!((scene.filter, scene.film.curve), (Filter::Nearest, Curve::Srgb));
    let ids: Vec<_> = scene.lights.iter().map(|l| (l.id, l.name.as_str())).collect();
    assert_eq!(ids, [(1, "key"), (2, "light-2"), (0, "sun")]);
    assert_eq!(scene.edits[1].changes.add_lights[0].id, 3);
    let [bone, fog] = &scene.materials[..] else { panic!("two materials") };
    let plain = preset("ct-bone").expect("a preset");
    assert_eq!(*bone, Material { extinction: 0.9, ..plain });
    assert_eq!((fog.scatter, fog.colour), (0.9, DVec3::new(1.0, 0.5, 0.0)));
    assert_eq!(fog.emission, DVec3::new(0.0, 0.0, 1e-7));
}

#[test]
fn what_is_written_reads_back_equal() -> Result<()> {
    let mut scene = full();
    assert_eq!(Scene::parse(&scene.to_toml(), "elsewhere/x.toml")?, scene);
    scene.settle(&volume());
    assert!(scene.settings.majorant.is_some() && scene.settings.flux_unit.is_some());
    assert_eq!(Scene::parse(&scene.to_toml(), "x.toml")?, scene);
    for name in TRUTH {
        let scene = Scene::load(truth(&format!("{name}.toml")))?;
        assert_eq!(Scene::parse(&scene.to_toml(), "x.toml")?, scene);
    }
    Ok(())
}

#[test]
fn edits_change_what_they_name_and_nothing_else() -> Result<()> {
    let mut base = full();
    base.settle(&volume());
    let red = base.edited("red bone")?;
    let mut expect = base.clone();
    expect.materials[0].colour = DVec3::new(0.9, 0.2, 0.1);
    assert_eq!(red, expect);

    let all = base.edited("everything")?;
    let names = |s: &Scene| -> Vec<String> {
        let materials = s.materials.iter().map(|m| m.name.clone());
        materials.chain(s.lights.iter().map(|l| l.name.clone())).collect()
    };
    assert_eq!(names(&all), ["fog \"thin\"", "ct-bone", "key", "light-2", "lamp"]);
    assert_eq!((all.background, all.camera.fov_deg), (DVec3::ZERO, 20.0));
    assert_eq!(all.lights[0].emitted, DVec3::splat(60.0));
    assert_eq!((all.materials[0].scatter, all.materials[0].colour), (0.5, DVec3::ONE));
    assert_eq!(all.materials[0].phase_g, -0.25);
    assert_eq!(all.settings, base.settings, "what is frozen stays");

    assert_eq!(all.edited("lamp off")?.lights[2].emitted, DVec3::ZERO);
    let early = base.edited("lamp off").expect_err("no lamp yet").to_string();
    assert!(early.contains("no light is called `lamp`: there is key, light-2, sun"), "{early}");
    assert!(base.edited("blue").is_err_and(|e| e.to_string().contains("red bone, everything")));
    Ok(())
}

#[test]
fn an_edit_may_change_what_it_adds() -> Result<()> {
    let edit = r#"
[[edit]]
name = "another"
remove_material = ["ct-bone"]
[[edit.add_material]]
name = "ct-bone"
window = [100, 200]
extinction = 1
albedo = 0.5
[[edit.material]]
name = "ct-bone"
extinction = 2
[[edit.add_light]]
kind = "point"
name = "spot"
from = [0, 0, 1]
intensity = 1
[[edit.light]]
name = "spot"
intensity = 3
"#;
    let scene = Scene::parse(&format!("{FULL}{edit}"), "full.toml")?;
    let edited = scene.edited("another")?;
    let bone = edited.materials.last().expect("a material");
    assert_eq!((bone.name.as_str(), bone.extinction, bone.scatter), ("ct-bone", 2.0, 0.5));
    assert_eq!(edited.lights.last().expect("a light").emitted, DVec3::splat(3.0));
    assert_eq!(Scene::parse(&scene.to_toml(), "full.toml")?, scene);
    Ok(())
}

#[test]
fn an_impossible_edit_leaves_the_scene_as_it_was() {
    let before = full();
    let material = |change| Changes { materials: vec![change], ..Default::default() };
    let bone = MaterialChange { name: "ct-bone".into(), ..Default::default() };
    let light = LightChange {
        name: "sun".into(),
        kind: Some(LightKind::Surroundings),
        ..Default::default()
    };
    for (changes, message) in [
        (material(MaterialChange { extinction: Some(-1.0), ..bone.clone() }), "must be >= 0"),
        (material(MaterialChange { phase_g: Some(f64::NAN), ..bone.clone() }), "(-1, 1)"),
        (material(MaterialChange { name: "skin".into(), ..bone }), "no material is called `skin`"),
        (Changes { lights: vec![light], ..Default::default() }, "cannot become a surroundings"),
        (
            Changes { add_materials: before.materials.clone(), ..Default::default() },
            "two have the material `ct-bone`",
        ),
    ] {
        let mut scene = before.clone();
        let edit = Edit { name: "e".into(), changes };
        let error = scene.apply(&edit).expect_err(message).to_string();
        assert!(error.contains(message) && error.starts_with("edit `e`: "), "{error}");
        assert_eq!(scene, before);
    }
}

#[test]
fn placement_fits_the_volume_and_freezes_the_scale() -> Result<()> {
    let volume = volume();
    let centre = volume.corner() + volume.extent() / 2.0;
    let radius = volume.extent().length() / 2.0;
    let mut scene = full();
    assert!(scene.camera.view().is_err(), "not placed yet");
    scene.camera.place = CameraPlace::Around { from: DVec3::new(0.0, -3.0, 0.0), zoom: 1.0 };
    scene.settle(&volume);

    // The image is wider than high: the sphere touches its upper and lower edge.
    let view = scene.camera.view()?;
    assert!((view.forward - DVec3::Y).length() < 1e-12);
    let [right, down] = [view.right, view.down].map(DVec3::normalize);
    assert!((right - DVec3::X).length() < 1e-12 && (down + DVec3::Z).length() < 1e-12);
    assert!((view.right.length() - 20f64.to_radians().tan()).abs() < 1e-12);
    let edge = (view.forward + view.down).normalize();
    let to_centre = centre - view.origin;
    let miss = (to_centre - edge * to_centre.dot(edge)).length();
    assert!((miss - radius).abs() < 1e-9);

    let LightKind::Rectangle { corner, edge_u, edge_v } = scene.lights[0].kind else {
        panic!("a placed rectangle");
    };
    let middle = corner + (edge_u + edge_v) / 2.0;
    let inwards = (centre - middle).normalize();
    assert!((middle.distance(centre) - 2.5 * radius).abs() < 1e-9);
    assert!((edge_u.cross(edge_v) - inwards * (0.8 * radius).powi(2)).length() < 1e-9);
    let lamp = scene.edits[1].changes.add_lights[0].kind;
    let LightKind::Point { position } = lamp else { panic!("a placed point") };
    assert!((position - centre - 3.0 * radius * DVec3::Z).length() < 1e-9);

    let pi = std::f64::consts::PI;
    let (square, sphere) = ((0.8 * radius).powi(2), radius * radius);
    let flux = pi * square * 30.0 + 4.0 * pi * pi * sphere * 0.1 + pi * sphere * 0.5;
    let unit = scene.settings.flux_unit.expect("a flux unit");
    assert!((unit / flux - 1.0).abs() < 1e-12);
    // The edit's bone of 3 per mm, where the ramp is at its height of these data.
    let edited = scene.edited("everything")?;
    let table = Table::build(&edited.materials, &scene.domain(&volume), None);
    assert_eq!(scene.settings.majorant, Some(table.max_extinction().into()));

    let mut dense = full();
    dense.materials[1].extinction = 1e3;
    dense.settle(&volume);
    assert_eq!(dense.settings.majorant, Some(8.0), "four mean free paths in half a millimetre");
    let mut empty = full();
    (empty.materials, empty.lights, empty.edits) = Default::default();
    empty.settle(&volume);
    assert!(empty.settings.majorant > Some(0.0));
    assert_eq!(empty.settings.flux_unit, Some(1.0));
    Ok(())
}

#[test]
fn presets_are_sound() -> Result<()> {
    for (name, _) in PRESETS {
        let m = preset(name)?;
        assert_eq!(m.name, name);
        assert!(m.extinction > 0.0 && m.ramp.len() >= 2, "{name}");
        let table = Table::build(&[m], &Domain::over([-1024.0, 3071.0]), None);
        assert!(table.max_extinction() > 0.0, "{name} is found in a CT");
    }
    let unknown = preset("ct-teeth").expect_err("no such preset").to_string();
    assert!(unknown.contains("there is ct-bone, ct-vessels"), "{unknown}");
    Ok(())
}

#[test]
fn relative_volumes_are_relative_to_the_scene() -> Result<()> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("s.toml");
    let text = "[volume]\nfile = \"sub/v.nrrd\"\n[camera]\nfrom = [1, 0, 0]\n";
    std::fs::write(&path, text).expect("a scene");
    let scene = Scene::load(&path)?;
    assert_eq!(scene.volume, VolumeSource::File(folder.path().join("sub/v.nrrd")));
    assert_eq!(scene.name, "s");
    assert!(matches!(Scene::load(folder.path().join("t.toml")), Err(Error::Io { .. })));
    Ok(())
}

/// Each refusal: what to replace in the full scene, by what, how many lines after that the
/// fault is told (what is missing is told at the table's head), and the message.
const REFUSED: &[(&str, &str, i32, &str)] = &[
    ("size = 64", "size = = 64", 0, "this is not TOML"),
    ("name = \"full\"", "title = \"full\"", 0, "`title` is unknown: known are name,"),
    ("zoom = 1.25", "zoon = 1.25", 0, "[camera]: `zoon` is unknown"),
    ("radiance = 0.1", "intensity = 0.1", 0, "`intensity` is unknown: known are radiance"),
    ("seed = 184", "sede = 184", 0, "[settings]: `sede` is unknown"),
    ("colour = [0.9, 0.2, 0.1]", "share = 2", 0, "`share` is unknown"),
    ("fov_deg = 40", "fov_deg = \"40\"", 0, "`fov_deg` is the text \"40\": it must be a plain"),
    ("extinction = 0.01", "extinction = \"1.2/cm\"", 0, "plain finite number, per mm"),
    ("photons = 30_000", "photons = 3e4", 0, "`photons` is 3e4: it must be a whole number"),
    ("photons = 30_000", "photons = -1", 0, "`photons` is -1"),
    ("history = false", "history = 1", 0, "it must be true or false"),
    ("[film]", "[[film]]", 0, "it must be a table, [film]"),
    (
        "[[edit]]\nname = \"red bone\"\n[[edit.material]]",
        "[[edit]]\nname = \"red bone\"\n[edit.material]",
        2,
        "list of tables",
    ),
    ("background = [0.1, 0.2, 0.3]", "background = [0.1, 0.2]", 0, "a list of 2: it must be"),
    ("background = [0.1, 0.2, 0.3]", "background = -1", 0, "each channel must be >= 0"),
    ("from = [1, -2, 0.5]", "from = [1, -2, inf]", 0, "three plain finite numbers"),
    ("exposure = -1.5", "exposure = nan", 0, "`exposure` is nan"),
    ("exposure = -1.5", "exposure = 40", 0, "[-32, 32] stops"),
    ("curve = \"srgb\"", "curve = \"log\"", 0, "one of \"filmic\", \"srgb\""),
    ("filter = \"nearest\"", "filter = \"cubic\"", 0, "one of \"nearest\", \"linear\""),
    ("phantom = \"hand\"", "phantom = \"foot\"", 0, "[volume]: `phantom`: "),
    ("phantom = \"hand\"", "file = \"x.nrrd\"", 0, "`file` and `size` say the same"),
    ("phantom = \"hand\"\n", "", -1, "it needs a `file` or a built-in `phantom`"),
    ("size = 64", "size = 0", 0, "`size` is 0: it must be 16 to 1024"),
    ("[camera]", "[camera]\norigin = [0, 0, 0]", 2, "`from` and `origin` say the same"),
    ("from = [1, -2, 0.5]\nzoom = 1.25", "origin = [1, 1, 1]", -1, "`target` is missing, in mm"),
    (
        "from = [1, -2, 0.5]\nzoom = 1.25",
        "origin = [1, 1, 1]\ntarget = [1, 1, 1]",
        1,
        "must look somewhere",
    ),
    ("from = [1, -2, 0.5]", "from = [0, 0, 0]", 0, "it must have a length"),
    ("from = [1, -2, 0.5]", "from = [1, -2, 0.5]\nup = [-2, 4, -1]", 1, "parallel to the view"),
    ("zoom = 1.25", "zoom = 0", 0, "`zoom` is 0: it must be > 0"),
    ("fov_deg = 40", "fov_deg = 180", 0, "it must be in (0, 180) degrees"),
    ("width = 64", "width = 0", 0, "`width` is 0: it must be 1 to 16384"),
    ("height = 48", "height = 5000000000", 0, "it must be at most 4294967295"),
    ("kind = \"surroundings\"", "kind = \"spot\"", 0, "one of \"point\", \"directional\""),
    ("share = 2", "share = 0", 0, "`share` is 0: it must be > 0"),
    ("distance = 2.5", "distance = -1", 0, "radii of the bounding sphere"),
    ("size = 0.8", "size = 0", 0, "[[light]] `key`: `size` is 0"),
    ("from = [1, -1, 1]\ndistance = 2.5\nsize = 0.8\n", "", -3, "`corner` is missing"),
    ("radiance = [30, 29, 28]", "radiance = [30, -29, 28]", 0, "`radiance` is [30, -29, 28]"),
    (
        "direction = [0, 0, -1]",
        "direction = [0, 0, 0]",
        0,
        "`direction` is [0, 0, 0]: it must have",
    ),
    ("name = \"sun\"", "name = \"key\"", 0, "two lights are called `key`"),
    ("share = 2", "id = 0", 9, "two lights have the `id` 0"),
    ("preset = \"ct-bone\"", "preset = \"ct-bones\"", 0, "no preset is called `ct-bones`"),
    ("preset = \"ct-bone\"", "name = \"bone\"", -1, "it needs a `window`, a `ramp` or a `preset`"),
    (
        "name = \"fog \\\"thin\\\"\"\nwindow",
        "name = \"ct-bone\"\nwindow",
        0,
        "two materials are called `ct-bone`",
    ),
    ("window = [-500, 100]", "window = [100, 100]", 0, "`window` is [100, 100]: it is empty"),
    ("window = [-500, 100]", "window = [100]", 0, "two finite data values [low, high]"),
    ("window = [-500, 100]", "window = [-500, 100]\nramp = [[0, 1], [1, 1]]", 0, "say the same"),
    ("window = [-500, 100]", "ramp = [[0, 1], [-1, 1]]", 0, "descends from 0 to -1"),
    ("window = [-500, 100]", "ramp = [[0, 1.5], [1, 1]]", 0, "a weight is in [0, 1]"),
    ("window = [-500, 100]", "ramp = [[0, 1]]", 0, "it takes two or more"),
    ("window = [-500, 100]", "ramp = [[0, 1], [0, 1]]", 0, "it must cover a range"),
    (
        "extinction = 0.01",
        "extinction = -0.01",
        0,
        "`extinction` is -0.01: it must be >= 0, per mm",
    ),
    ("extinction = 0.01\n", "", -3, "`extinction` is missing, per mm"),
    ("albedo = [0.9, 0.45, 0]", "albedo = [1.1, 0.45, 0]", 0, "each channel must be in [0, 1]"),
    (
        "albedo = [0.9, 0.45, 0]",
        "albedo = 1\nscatter = 1",
        0,
        "`albedo` and `scatter` say the same",
    ),
    ("albedo = [0.9, 0.45, 0]\n", "", -4, "it needs an `albedo`, or `scatter` and `colour`"),
    ("emission = [0, 0, 1e-7]", "emission = -1", 0, "`emission` is [-1, -1, -1]"),
    ("phase_g = -0.25", "phase_g = -1", 0, "`phase_g` is -1: it must be in (-1, 1)"),
    ("method = \"photon-map\"", "method = \"path\"", 0, "\"irradiance-cache\", \"reference\""),
    ("photons = 30_000", "photons = 0", 0, "`photons` is 0: it must be 1 to"),
    ("radius = 0.75", "radius = 0", 0, "`radius` is 0: it must be > 0, in mm"),
    ("radius = 0.75", "max_events = 0", 0, "it must be 1 to 64"),
    ("radius = 0.75", "max_events = 65", 0, "it must be 1 to 64"),
    ("radius = 0.75", "roulette_from = 0", 0, "`roulette_from` is 0"),
    ("radius = 0.75", "roulette_survival = 0", 0, "it must be in (0, 1]"),
    ("radius = 0.75", "roulette_survival = 1.01", 0, "it must be in (0, 1]"),
    ("radius = 0.75", "grid = 1.5", 0, "it must be in (0, 1] cells per voxel"),
    ("radius = 0.75", "segments = 0", 0, "it must be 1 to 1024"),
    ("radius = 0.75", "step = 4.1", 0, "it must be in [0.001, 4] smallest spacings"),
    ("radius = 0.75", "step = 1e-8", 0, "it must be in [0.001, 4] smallest spacings"),
    ("radius = 0.75", "majorant = 0", 0, "it must be > 0, per mm"),
    ("radius = 0.75", "rays = 0", 0, "`rays` is 0"),
    ("radius = 0.75", "rays = 65537", 0, "it must be 1 to 65536"),
    ("radius = 0.75", "samples = 0", 0, "`samples` is 0"),
    ("radius = 0.75", "flux_unit = -2", 0, "it must be > 0, in W"),
    ("reference_events = 3", "reference_events = 0", 0, "`reference_events` is 0"),
    ("name = \"everything\"", "name = \"red bone\"", 0, "two edits are called `red bone`"),
    (
        "name = \"ct-bone\"\ncolour",
        "name = \"bone\"\ncolour",
        0,
        "no material is called `bone`: there is ct-bone, fog",
    ),
    (
        "colour = [0.9, 0.2, 0.1]",
        "colour = [2, 0, 0]",
        0,
        "[[edit.material]] `ct-bone`: `colour` is [2, 0, 0]",
    ),
    (
        "remove_material = [\"ct-bone\"]",
        "remove_material = [\"x\"]",
        0,
        "no material is called `x`",
    ),
    ("remove_material = [\"ct-bone\"]\n", "", 9, "two materials are called `ct-bone`"),
    ("remove_light = [\"sun\"]", "remove_light = \"sun\"", 0, "a list of names in quotes"),
    ("remove_light = [\"sun\"]", "remove_light = [\"moon\"]", 0, "no light is called `moon`"),
    ("from = [0, -1, 0]", "from = [0, 0, 1]", -1, "parallel to the view"),
    (
        "name = \"key\"\nradiance = 60",
        "name = \"key\"\nintensity = 60",
        1,
        "`intensity` is unknown",
    ),
    ("from = [-1, -1, 0]", "size = 2", 0, "`size` goes with `from`, which is missing"),
    ("name = \"lamp\"\nintensity = 0", "name = \"bulb\"", 0, "no light is called `bulb`"),
];

#[test]
fn every_refusal_names_the_line_the_key_and_the_remedy() {
    let mut wrong = Vec::new();
    for &(old, new, after, message) in REFUSED {
        let at = FULL.find(old).unwrap_or_else(|| panic!("not in the scene: {old}"));
        let line = 1 + FULL[..at].matches('\n').count() as i32 + after;
        match Scene::parse(&FULL.replacen(old, new, 1), "dir/s.toml") {
            Ok(_) => wrong.push(format!("{new:?} is not refused")),
            Err(e) => {
                let shown = e.to_string();
                if !shown.starts_with(&format!("dir/s.toml:{line}: ")) || !shown.contains(message) {
                    wrong.push(format!("{new:?}: not in line {line}, or not {message:?}: {shown}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_scene_needs_a_volume_and_a_camera() {
    let camera = Scene::parse("[volume]\nphantom = \"hand\"\n", "s.toml");
    assert!(camera.is_err_and(|e| e.to_string() == "s.toml: `camera` is missing"));
    let volume = Scene::parse("[camera]\nfrom = [1, 0, 0]\n", "s.toml");
    assert!(volume.is_err_and(|e| e.to_string() == "s.toml: `volume` is missing"));
}
