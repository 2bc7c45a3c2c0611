//! Edits from outside: what `edit` reports, checks and refuses.

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

const MORE: &str = r#"
[[edit]]
name = "dense"
[[edit.material]]
name = "ball"
extinction = 0.4
"#;

#[test]
fn what_cannot_be_edited_is_refused() {
    let place = Place::new();
    for (args, what) in [
        (&["edit", "scene.toml"][..], "no edit is named"),
        (&["edit", "scene.toml", "--edit", "nothing"], "no edit is called `nothing`"),
        (&["edit", "scene.toml", "--edit", "dark", "--method", "reference"], "photon map"),
        (&["edit", "scene.toml", "--edit", "dark", "-o", "x.jpg"], ".exr"),
        (&["edit", "scene.toml", "--edit", "dark", "--rays", "4"], "one ray a pixel"),
    ] {
        let said = place.refused(args);
        assert!(said.contains(what), "{args:?}: {said}");
    }
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
