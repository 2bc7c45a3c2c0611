//! What the commands say of materials that cannot look as they are meant to, and of memory that there
//! is not.

use std::fs;
use std::time::Instant;

use super::place::{Place, SCENE};

/// A material in Hounsfield units, of data that are stored from 0 on.
const AIR: &str =
    "[[material]]\nname = \"air\"\nwindow = [-1024, -200]\nextinction = 0.1\nalbedo = 0.5\n";

#[test]
fn materials_that_meet_nothing_are_named_by_every_command() {
    let place = Place::new();
    place.file("hu.toml", SCENE.replacen("[[material]]", &format!("{AIR}[[material]]"), 1));
    let commands: [&[&str]; 3] = [
        &["render", "hu.toml", "-o", "a.exr"],
        &["edit", "hu.toml", "--edit", "dark"],
        &["info", "hu.toml", "--json", "info.json"],
    ];
    for args in commands {
        let output = place.program(args).output().unwrap();
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{args:?}: {error}");
        let said = "warning: material `air` (-1024 to -200) meets no value of the data";
        assert_eq!(error.matches(said).count(), 1, "{args:?}: {error}");
        assert_eq!(error.matches("warning: ").count(), 1, "{args:?}: {error}");
    }
    let warnings = place.json("info.json")["warnings"].clone();
    assert!(warnings[0].as_str().unwrap().contains("material `air`"), "{warnings}");
    // Alone it is all that there is, and nothing would be seen.
    place.file("hu.toml", SCENE.replace("window = [100, 300]", "window = [-1024, -200]"));
    let refused = place.refused(&["render", "hu.toml", "-o", "a.png"]);
    assert!(refused.contains("the transfer function is empty"), "{refused}");
}

#[test]
fn a_range_in_the_scene_is_read_and_its_line_is_named() {
    let place = Place::with("rays = 1\n", "rays = 1\nrange = [300, 100]\n");
    let line = 1 + SCENE.lines().position(|line| line == "rays = 1").unwrap() + 1;
    let refused = place.unrendered(&[]);
    assert!(refused.contains(&format!("scene.toml:{line}: ")), "{refused}");
    assert!(refused.contains("`range` is 100: it must ascend, from 300 on"), "{refused}");
    let place = Place::with("rays = 1\n", "rays = 1\nrange = [90, 310]\n");
    place.fine(&["render", "scene.toml", "-o", "a.exr"]);
    let notes = photogram::film::Notes::read_exr(place.path("a.exr")).unwrap();
    assert!(notes.scene.contains("range = [90.0, 310.0]"), "{}", notes.scene);
}

#[test]
fn what_does_not_fit_memory_is_refused_before_it_is_taken() {
    let place = Place::new();
    place.fine(&["info", "--adapters", "--json", "adapters.json"]);
    let adapters = place.json("adapters.json");
    let kinds = adapters.as_array().unwrap().iter();
    let mut kinds = kinds.map(|a| (a["kind"].clone(), a["index"].to_string()));
    let software = kinds.find(|(kind, _)| *kind == "software");
    let Some((_, index)) = software.filter(|_| cfg!(target_os = "linux")) else {
        return eprintln!("skipped: nobody knows what memory of this adapter is free");
    };
    let before = fs::read(place.path("scene.toml")).unwrap();
    let cases: [(&[&str], &[&str]); 2] = [
        (&["--photons", "4294967295", "--max-events", "64"], &["`photons`", "`max_events`"]),
        (&["--size", "16384x16384"], &["16384x16384", "image size", "`segments`", "`rays`"]),
    ];
    for (more, words) in cases {
        let begun = Instant::now();
        let refused = place.unrendered(&[more, &["--adapter", &index]].concat());
        assert!(begun.elapsed().as_secs() < 10, "{more:?} took {:?}", begun.elapsed());
        for word in [words, &["of memory are needed, and", "are free"]].concat() {
            assert!(refused.contains(word), "{more:?}: no {word} in {refused}");
        }
    }
    assert_eq!(fs::read(place.path("scene.toml")).unwrap(), before);
    place.fine(&["render", "scene.toml", "-o", "a.exr"]);
}
