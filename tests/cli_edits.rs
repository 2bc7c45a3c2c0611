//! Edits from outside: what `edit` reports, checks and refuses.

use photogram::film::{Image, Notes};
use photogram::scene::Scene;
use place::Place;

#[allow(dead_code)]
#[path = "volumes/files.rs"]
mod files;
#[allow(dead_code)]
#[path = "cli/place.rs"]
mod place;

#[test]
fn an_edit_is_verified_and_reported() {
    for estimator in ["fluence", "points"] {
        let place = Place::new();
        place.file("scene.toml", format!("{}{MORE}", place::SCENE));
        let said = place.fine(&[
            "edit",
            "scene.toml",
            "--volume",
            "volume.nrrd",
            "--edit",
            "dark",
            "--edit",
            "dense",
            "--estimator",
            estimator,
            "--verify",
            "fresh",
            "--json",
            "out/edits.json",
            "-o",
            "edited.exr",
        ]);
        assert!(said.contains("0 pixels differ"), "{said}");
        let rows = place.json("out/edits.json");
        let rows = rows.as_array().unwrap();
        assert_eq!(rows.len(), 2);
        for (row, name) in rows.iter().zip(["dark", "dense"]) {
            assert_eq!(row["edit"], name);
            let number = |a: &str, b: &str| row[a][b].as_f64().unwrap_or_else(|| panic!("{a}.{b}"));
            assert_eq!(number("photons", "total"), 1000.0);
            assert!(number("photons", "changed") <= number("photons", "total"));
            assert!(number("segments", "recomputed") > 0.0);
            assert!(number("visits", "incremental") > 0.0 && number("visits", "full") > 0.0);
            for side in ["full", "incremental"] {
                assert!(row["time_ms"][side]["total"].as_f64() > Some(0.0));
                assert!(!row["time_ms"][side]["stages"].as_array().unwrap().is_empty());
            }
            assert!(row["speedup"].as_f64() > Some(0.0));
            for what in ["photon", "field", "segment", "pixel"] {
                assert_eq!(row["verify"][format!("{what}_mismatches")], 0, "{name}");
            }
        }
        // A colour edit traces nothing; a denser ball stops photons.
        assert_eq!(rows[0]["photons"]["invalid"], 0);
        assert!(rows[0]["photons"]["reweighed"].as_u64() > Some(0));
        assert!(rows[1]["photons"]["invalid"].as_u64() > Some(0));
        // The picture is that of the edited scene.
        let both = ["--edit", "dark", "--edit", "dense", "--estimator", estimator];
        place.fine(&[&["render", "scene.toml", "-o", "rendered.exr"], &both[..]].concat());
        let image = |name| photogram::film::Image::read_exr(place.path(name)).unwrap();
        assert_eq!(image("edited.exr").rgb, image("rendered.exr").rgb);
    }
}

/// The main job of the README, whole.
#[test]
fn the_demo_shows_its_edits() {
    let place = Place::new();
    let said = place.fine(&["demo", "--out", "shots", "--json", "edits.json"]);
    assert!(said.contains("retraced %") && said.contains("speed-up"), "{said}");
    let rows = place.json("edits.json");
    let rows = rows.as_array().unwrap();
    assert_eq!(rows.iter().map(|row| &row["edit"]).collect::<Vec<_>>(), ["bone", "vessels"]);
    for row in rows {
        assert!(row["photons"]["changed"].as_u64() > Some(0));
        assert!(row["segments"]["recomputed"].as_u64() > Some(0));
        for what in ["photon", "field", "segment", "pixel"] {
            assert_eq!(row["verify"][format!("{what}_mismatches")], 0);
        }
    }
    let [before, bone, vessels] = ["before", "bone", "vessels"].map(|name| {
        let file = std::fs::File::open(place.path(&format!("shots/{name}.png"))).unwrap();
        let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        pixels
    });
    assert!(before != bone && before != vessels && bone != vessels);
}

const MORE: &str = r#"
[[edit]]
name = "dense"
[[edit.material]]
name = "ball"
extinction = 0.4
"#;

#[test]
fn what_an_edit_adds_or_removes_another_process_has_or_lacks() {
    const EDITS: &str = r#"
[[edit]]
name = "more"
[[edit.add_material]]
name = "shell"
window = [20, 90]
extinction = 0.05
albedo = 0.5
[[edit.add_light]]
kind = "point"
name = "lamp"
position = [30, 0, 0]
intensity = 5000
[[edit]]
name = "fewer"
remove_material = ["shell"]
remove_light = ["key"]
"#;
    let place = Place::new();
    place.file("scene.toml", format!("{}{EDITS}", place::SCENE));
    for edits in [&["--edit", "more"][..], &["--edit", "more", "--edit", "fewer"]] {
        let fresh = ["--verify", "fresh", "-o", "edited.exr"];
        let said = place.fine(&[&["edit", "scene.toml"], edits, &fresh].concat());
        assert!(said.contains("0 pixels differ"), "{said}");
        // The picture tells the scene that it shows.
        let notes = Notes::read_exr(place.path("edited.exr")).unwrap();
        let shown = Scene::parse(&notes.scene, "edited.exr").unwrap();
        assert!(shown.lights.iter().any(|light| light.name == "lamp"), "{}", notes.scene);
        assert_eq!(shown.lights.len(), if edits.len() == 2 { 2 } else { 1 });
    }
}

#[test]
fn what_cannot_be_edited_is_refused_before_the_work() {
    const NOTHING: &str = r#"
[[edit]]
name = "thin"
[[edit.material]]
name = "ball"
extinction = 0
[[edit]]
name = "night"
remove_light = ["key"]
"#;
    let place = Place::new();
    let more = format!("{}{NOTHING}", place::SCENE);
    place.file("more.toml", &more);
    place.file("mcvr.toml", more.replace("[settings]", "[settings]\nmethod = \"mcvr\""));
    place.file("forgetful.toml", more.replace("[settings]", "[settings]\nhistory = false"));
    place.file("off.toml", more.replace("[settings]", "[settings]\nspatial = \"off\""));
    // There is no such adapter: what is refused with another word is refused before one is asked.
    let start = ["--adapter", "99", "edit"];
    for (args, what) in [
        (&["more.toml", "--edit", "dark"][..], "no adapter matches"),
        (&["more.toml", "--edit", "dark", "--edit", "nothing"], "no edit is called `nothing`"),
        (&["more.toml", "--edit", "dark", "-o", "x.jpg"], ".exr"),
        (&["more.toml", "--edit", "dark", "--edit", "thin"], "`thin`: the transfer function is"),
        (&["more.toml", "--edit", "night"], "`night`: the scene has no light"),
        (&["mcvr.toml", "--edit", "dark"], "`photon-map` or `irradiance-cache`"),
        (
            &["more.toml", "--edit", "dark", "--method", "irradiance-cache", "--verify"],
            "updates of the photon map",
        ),
        (&["forgetful.toml", "--edit", "dark"], "`history` is false"),
        (&["off.toml", "--edit", "dark", "--verify", "fresh"], "stale light"),
    ] {
        let said = place.refused(&[&start, args].concat());
        assert!(said.contains(what), "{args:?}: {said}");
    }
    for (args, what) in [
        (&["edit", "scene.toml"][..], "--edit"),
        (&["edit", "scene.toml", "--edit", "dark", "--rays", "4"], "--rays"),
    ] {
        let said = place.failed(&mut place.program(args), 2);
        assert!(said.contains(what), "{args:?}: {said}");
    }
}

#[test]
fn what_is_clamped_is_told() {
    let place = Place::new();
    let edit = "[[edit]]\nname = \"dense\"\n[[edit.material]]\nname = \"ball\"\nextinction = 300\n";
    let scene = place::SCENE.replace("[settings]", "[settings]\nmajorant = 1");
    place.file("scene.toml", format!("{scene}{edit}"));
    let args = ["edit", "scene.toml", "--edit", "dark", "--edit", "dense", "--json", "edits.json"];
    let said = place.fine(&args);
    let rows = place.json("edits.json");
    assert_eq!(rows[0]["entries_clamped"], 0);
    let clamped = rows[1]["entries_clamped"].as_u64().unwrap();
    assert!(clamped > 0 && !said.contains("`dark` the"), "{said}");
    assert!(said.contains(&format!("after `dense` the extinction of {clamped} table")), "{said}");
}

#[test]
fn stale_light_of_the_papers_settings_is_found() {
    let place = Place::new();
    let scene = place::SCENE.replace("[settings]", "[settings]\nspatial = \"off\"");
    place.file("scene.toml", scene);
    // Light that comes round the back: its ball's segments do not see it go.
    let points = ["--estimator", "points", "--edit", "dark", "--verify", "--json", "edits.json"];
    let said = place.fine(&[&["edit", "scene.toml"], &points[..]].concat());
    assert!(said.contains("stale light"), "{said}");
    let row = &place.json("edits.json")[0];
    assert_eq!(
        (&row["verify"]["photon_mismatches"], &row["verify"]["field_mismatches"]),
        (&0.into(), &0.into())
    );
    assert!(row["segments"]["recomputed"].as_u64() > Some(0));
}

#[test]
fn an_irradiance_cache_goes_on_after_edits() {
    let place = Place::new();
    let method = ["--method", "irradiance-cache", "--passes", "6"];
    let more = ["--edit", "dark", "--set", "background=0.1,0.2,0.3", "--json", "edits.json"];
    let said = place.fine(&[&["edit", "scene.toml", "-o", "a.exr"], &method[..], &more].concat());
    assert!(said.contains("6 passes each"), "{said}");
    let rows = place.json("edits.json");
    assert_eq!(rows[1]["pixels"]["restarted"], rows[1]["pixels"]["total"]);
    assert!(rows[0]["cells"]["made"].as_u64() > Some(0), "{rows}");
    let shown = Image::read_exr(place.path("a.exr")).unwrap();
    assert!(shown.rgb.contains(&[0.1, 0.2, 0.3]), "the background is another");
}
