//! The program from outside: what it renders, writes and reports.

use std::fs;
use std::process::Stdio;

use files::Folder;
use photogram::film::{Image, Notes};
use place::{EDGE, Place, nrrd};

#[allow(dead_code)]
#[path = "volumes/files.rs"]
mod files;
#[allow(dead_code)]
#[path = "cli/place.rs"]
mod place;

/// Finite, not negative, and not all the same.
fn picture(place: &Place, name: &str) -> Image {
    let image = Image::read_exr(place.path(name)).expect("an image");
    assert_eq!((image.width, image.height), (16, 16));
    let mut values = image.rgb.iter().flatten();
    assert!(values.all(|x| x.is_finite() && *x >= 0.0), "{name} has bad pixels");
    assert!(image.rgb.iter().any(|p| *p != image.rgb[0]), "{name} is empty");
    image
}

fn bits(image: &Image) -> Vec<[u32; 3]> {
    image.rgb.iter().map(|p| p.map(f32::to_bits)).collect()
}

#[test]
fn a_render_reports_what_it_did() {
    let place = Place::new();
    let json = ["--json", "out/new/report.json"];
    let said = place.fine(&[&["render", "scene.toml", "-o", "out/image.exr"], &json[..]].concat());
    assert!(said.starts_with("adapter ") && said.trim_end().ends_with("out/image.exr"), "{said}");
    picture(&place, "out/image.exr");
    let report = place.json("out/new/report.json");
    assert!(!report["adapter"].as_str().unwrap().is_empty());
    assert_eq!((&report["photons"], &report["segments"]), (&1000.into(), &1024.into()));
    assert!(report["counts"]["interactions"].as_u64() > Some(0), "{report}");
    assert!(!report["bytes"].as_array().unwrap().is_empty());
    let stages = report["stages"].as_array().unwrap();
    for stage in ["trace", "deposit", "segment", "composite"] {
        let row = stages.iter().find(|s| s["stage"] == stage).expect(stage);
        assert!(row["ms"].as_f64() >= Some(0.0) && row["dispatches"].as_u64() > Some(0), "{row}");
    }
    assert!(report["total_ms"].as_f64() > Some(0.0));
}

#[test]
fn a_png_is_a_picture() {
    let place = Place::new();
    place.fine(&["render", "scene.toml", "-o", "out/image.PNG", "--json", "out/report.json"]);
    let file = fs::File::open(place.path("out/image.PNG")).unwrap();
    let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut bytes).unwrap();
    assert_eq!((frame.width, frame.height), (16, 16));
    assert!(bytes.iter().any(|&b| b != bytes[0]), "the picture is empty");
    assert_eq!(place.json("out/report.json")["photons"], 1000);
    let mut left: Vec<_> =
        fs::read_dir(place.path("out")).unwrap().map(|e| e.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["image.PNG", "report.json"]);
}

#[test]
fn an_exr_holds_the_scene_that_renders_to_it() {
    for more in [
        &["--edit", "dark"][..],
        &["--estimator", "points", "--radius", "1.5", "--rays", "2", "--seed", "7"],
        &["--method", "reference", "--edit", "dark", "--exposure", "-1"],
        &["--method", "mcvr", "--scale", "small"],
        &["--method", "irradiance-cache", "--passes", "9"],
    ] {
        let place = Place::new();
        place.fine(&[&["render", "scene.toml", "-o", "a.exr"], more].concat());
        let notes = Notes::read_exr(place.path("a.exr")).unwrap();
        // Wherever the scene is kept: its paths are absolute.
        let elsewhere = Folder::new();
        let scene = elsewhere.file("again.toml", notes.scene.as_bytes());
        place.fine(&["render", scene.to_str().unwrap(), "-o", "b.exr"]);
        let (a, b) = (picture(&place, "a.exr"), picture(&place, "b.exr"));
        assert_eq!(bits(&a), bits(&b), "{more:?}");
        // The settings matter, or the above says nothing.
        place.fine(&["render", "scene.toml", "-o", "plain.exr"]);
        assert_ne!(bits(&a), bits(&picture(&place, "plain.exr")), "{more:?}");
    }
}

#[test]
fn a_camera_or_a_light_may_be_inside() {
    let inside = Place::with("from = [0, -1, 0.2]", "origin = [5, 6, 7]\ntarget = [9, 8, 7]");
    let lit = "kind = \"point\"\nname = \"key\"\nposition = [7, 8, 7]\nintensity = 500\n";
    let (old, _) = place::SCENE.split_once("[[material]]").unwrap();
    let old = old.split_once("[[light]]\n").unwrap().1;
    for place in [inside, Place::with(old, lit)] {
        for estimator in ["points", "fluence"] {
            place.fine(&["render", "scene.toml", "-o", "a.exr", "--estimator", estimator]);
            picture(&place, "a.exr");
        }
        place.fine(&["render", "scene.toml", "-o", "a.exr", "--method", "reference"]);
        picture(&place, "a.exr");
    }
}

#[test]
fn without_light_there_is_the_background() {
    let (head, rest) = place::SCENE.split_once("[[light]]").unwrap();
    let (light, tail) = rest.split_once("[[material]]").unwrap();
    let place = Place::new();
    place.file("scene.toml", format!("{head}[[material]]{tail}"));
    let said = place.unrendered(&[]);
    assert!(said.contains("no light") && said.contains("add a [[light]]"), "{said}");
    let dark = light.replace("radiance = 10", "radiance = 0");
    place.file("dark.toml", format!("{head}[[light]]{dark}[[material]]{tail}"));
    for args in [
        &["dark.toml", "--estimator", "points"][..],
        &["dark.toml", "--estimator", "fluence"],
        &["scene.toml", "--method", "reference", "--samples", "64"],
    ] {
        place.fine(&[&["render", "-o", "a.exr"], args].concat());
        let image = picture(&place, "a.exr");
        assert!(image.rgb.contains(&[0.25; 3]), "{args:?}");
        assert!(image.rgb.iter().flatten().all(|x| *x <= 0.2501), "{args:?}");
    }
}

#[test]
fn flat_and_smallest_volumes_render() {
    let place = Place::new();
    for (name, size) in [("flat.nrrd", [EDGE; 3]), ("one.nrrd", [1; 3]), ("line.nrrd", [1, 1, 9])] {
        place.file(name, nrrd(size, &vec![200; size.iter().product()]));
        for estimator in ["points", "fluence"] {
            let out = ["-o", "a.exr", "--volume", name, "--estimator", estimator];
            place.fine(&[&["render", "scene.toml"], &out[..]].concat());
            picture(&place, "a.exr");
        }
    }
}

#[test]
fn a_phantom_is_described() {
    let place = Place::new();
    let said = place.fine(&["phantom", "hand", "-o", "new/hand.nrrd", "--size", "24"]);
    assert!(said.starts_with("new/hand.nrrd: hand, "), "{said}");
    let said = place.fine(&["info", "new/hand.nrrd", "--json", "hand.json"]);
    assert!(said.contains("i runs along") && said.contains("values "), "{said}");
    let info = place.json("hand.json");
    let size: Vec<u64> =
        info["size"].as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).collect();
    assert_eq!(size.iter().max(), Some(&24));
    let counted: u64 =
        info["histogram"].as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).sum();
    assert_eq!(counted, size.iter().product::<u64>());
    assert_eq!(info["stored_as"], "u16");
    assert!(info["range"][0].as_f64() < info["range"][1].as_f64());
}

#[test]
fn adapters_are_listed_and_chosen() {
    let place = Place::new();
    let said = place.fine(&["info", "--adapters", "--json", "adapters.json"]);
    let adapters = place.json("adapters.json");
    for (i, adapter) in adapters.as_array().unwrap().iter().enumerate() {
        let name = adapter["name"].as_str().unwrap();
        assert!(said.contains(name), "{name} is not in: {said}");
        assert_eq!(adapter["index"], i);
        assert!(adapter["max_binding_size"].as_u64() >= Some(128 << 20));
    }
    let last = adapters.as_array().unwrap().last().unwrap();
    let index = last["index"].to_string();
    let chosen = ["--adapter", &index, "--json", "report.json"];
    place.fine(&[&["render", "scene.toml", "-o", "a.exr"], &chosen[..]].concat());
    assert_eq!(place.json("report.json")["adapter"], last["name"]);
}

#[test]
fn a_pipe_gets_no_noise() {
    let place = Place::new();
    let args = ["render", "scene.toml", "-o", "a.exr"];
    // Without a display, Mesa's layer would complain of this variable.
    let mut program = place.program(&args);
    let output = program.env_remove("XDG_RUNTIME_DIR").output().unwrap();
    assert!(output.status.success());
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(!error.contains("XDG_RUNTIME_DIR") && !error.contains(['%', '\r']), "{error}");
}

#[test]
fn a_reader_may_stop_early() {
    let place = Place::new();
    let mut info = std::process::Command::new(env!("CARGO_BIN_EXE_photogram"))
        .arg("info")
        .arg(place.path("volume.nrrd"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(info.stdout.take());
    let output = info.wait_with_output().unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{error}");
    assert_eq!(error, "");
}
