//! Scans without a scene, and changes on the command line, from outside.

use photogram::film::Image;
use photogram::scene::Scene;
use place::{EDGE, Place, nrrd};

#[allow(dead_code)]
#[path = "volumes/files.rs"]
mod files;
#[allow(dead_code)]
#[path = "cli/place.rs"]
mod place;

/// Little work.
const TINY: [&str; 8] =
    ["--size", "64x64", "--photons", "3000", "--segments", "4", "--max-events", "4"];

/// A folder with a small CT of a hand.
fn with_hand() -> Place {
    let place = Place::new();
    place.fine(&["phantom", "hand", "--size", "32", "-o", "hand.nrrd"]);
    place
}

fn bits(place: &Place, name: &str) -> Vec<[u32; 3]> {
    let image = Image::read_exr(place.path(name)).expect(name);
    assert!(image.rgb.iter().any(|p| *p != image.rgb[0]), "{name} is empty");
    image.rgb.iter().map(|p| p.map(f32::to_bits)).collect()
}

#[test]
fn a_scan_renders_as_the_scene_that_is_written_for_it() {
    let place = with_hand();
    let render = |what: &str, out: &str, more: &[&str]| {
        place.fine(&[&["render", what, "-o", out], &TINY[..], more].concat())
    };
    let said = render("hand.nrrd", "scan.exr", &[]);
    assert!(
        said.starts_with("hand: CT in Hounsfield units; materials: skin, soft tissue,"),
        "{said}"
    );
    let told = place.fine(&["scene", "hand.nrrd", "-o", "new/my.toml"]);
    assert!(told.contains("bone") && told.trim_end().ends_with("my.toml"), "{told}");
    render("new/my.toml", "scene.exr", &[]);
    assert_eq!(bits(&place, "scan.exr"), bits(&place, "scene.exr"));
    // What overrides a scene overrides a scan.
    render("hand.nrrd", "other.exr", &["--seed", "5"]);
    assert_ne!(bits(&place, "scan.exr"), bits(&place, "other.exr"));

    let text = std::fs::read_to_string(place.path("new/my.toml")).unwrap();
    assert!(text.starts_with("# A scene for hand.") && text.contains("photogram edit"), "{text}");
    let scene = Scene::parse(&text, place.path("new/my.toml")).unwrap();
    assert_eq!((scene.camera.width, scene.camera.height), (512, 512));
    assert!(scene.settings.majorant.is_none(), "edits of the file raise it");
    // As its comment says, it takes an edit.
    let edit = "[[edit]]\nname = \"other\"\n[[edit.material]]\nname = \"bone\"\nextinction = 9\n";
    place.file("new/my.toml", text + edit);
    render("new/my.toml", "edited.exr", &["--edit", "other"]);
    assert_ne!(bits(&place, "scan.exr"), bits(&place, "edited.exr"));
}

#[test]
fn a_scan_is_edited_by_a_line() {
    let place = with_hand();
    let sets = ["--set", "bone.albedo=0.9,0.6,0.2", "--set", "soft tissue.extinction=0.05"];
    let files = ["--verify", "fresh", "--json", "edits.json", "-o", "edited.exr"];
    let said = place.fine(&[&["edit", "hand.nrrd"], &TINY[..], &sets, &files].concat());
    assert!(said.contains("retraced %") && said.contains("0 pixels differ"), "{said}");
    let rows = place.json("edits.json");
    for (row, name) in rows.as_array().unwrap().iter().zip([sets[1], sets[3]]) {
        assert!(row["edit"] == name && said.contains(name), "{said}");
        assert_eq!(row["entries_clamped"], 0);
        for what in ["photon", "field", "segment", "pixel"] {
            assert_eq!(row["verify"][format!("{what}_mismatches")], 0, "{name}");
        }
    }
    // A colour traces nothing, an extinction does.
    assert_eq!(rows[0]["photons"]["invalid"], 0);
    assert!(rows[0]["photons"]["reweighed"].as_u64() > Some(0));
    assert!(rows[1]["photons"]["retraced_percent"].as_f64() > Some(0.0));
    let one_ray = [&["render", "hand.nrrd", "-o", "set.exr", "--rays", "1"], &TINY[..], &sets];
    place.fine(&one_ray.concat());
    assert_eq!(bits(&place, "edited.exr"), bits(&place, "set.exr"));
}

#[test]
fn edits_of_both_kinds_are_made_in_the_order_given() {
    let place = Place::new();
    let colour = ["--set", "ball.albedo=0.9"];
    let dark = ["--edit", "dark"];
    let radiance = ["--set", "key.radiance=5"];
    let json = ["--json", "edits.json", "-o", "last.exr"];
    let args = [&["edit", "scene.toml"], &radiance[..], &dark, &colour, &json].concat();
    place.fine(&args);
    let rows = place.json("edits.json");
    let made: Vec<_> = rows.as_array().unwrap().iter().map(|row| &row["edit"]).collect();
    assert_eq!(made, ["key.radiance=5", "dark", "ball.albedo=0.9"]);
    // The last one decides, in a render too.
    let render = |name: &str, changes: &[&[&str]]| {
        place.fine(&[&["render", "scene.toml", "-o", name][..], &changes.concat()].concat());
        bits(&place, name)
    };
    let bright = render("bright.exr", &[&radiance, &dark, &colour]);
    assert_eq!(bright, bits(&place, "last.exr"));
    assert_ne!(bright, render("dark.exr", &[&radiance, &colour, &dark]));
    // The same line again, after another.
    place.fine(&[&["edit", "scene.toml"], &colour[..], &dark, &colour, &json].concat());
    assert_eq!(place.json("edits.json")[2]["edit"], "ball.albedo=0.9 (2)");
}

#[test]
fn no_extinction_that_is_set_is_clamped() {
    let more = "[[material]]\nname = \"shell\"\nwindow = [20, 90]\nextinction = 0.05\nalbedo = 0.5\n\
                [[edit]]\nname = \"fewer\"\nremove_material = [\"shell\"]\n";
    let place = Place::new();
    place.file("scene.toml", format!("{}{more}", place::SCENE));
    // Only all three make it dense, and only without the scene's own edit.
    let sets = ["ball.extinction=1", "shell.extinction=1", "shell.window=100,300"];
    let sets: Vec<&str> = sets.iter().flat_map(|set| ["--set", set]).collect();
    let json = ["--json", "edits.json", "--verify", "fresh"];
    let said = place.fine(&[&["edit", "scene.toml"], &sets[..], &json].concat());
    assert!(!said.contains("warning"), "{said}");
    for row in place.json("edits.json").as_array().unwrap() {
        assert_eq!(row["entries_clamped"], 0, "{row}");
    }
}

#[test]
fn what_is_no_scan_and_what_is_no_change() {
    let place = Place::new();
    place.file("notes.txt", "hello");
    place.file("flat.nrrd", nrrd([EDGE; 3], &[7; EDGE * EDGE * EDGE]));
    let refuses = |args: &[&str], expect: &str| {
        let said = place.refused(&[&["--adapter", "99"], args].concat());
        assert!(said.contains(expect), "{args:?}: {said}");
    };
    let out = ["-o", "out/image.exr"];
    let render = |args: &[&str], expect: &str| {
        refuses(&[&["render"], args, &out].concat(), expect);
    };
    render(&["notes.txt"], "notes.txt: not a volume");
    render(&["notes.txt"], "; a scene would end in .toml");
    render(&["none.nrrd"], "none.nrrd: cannot read");
    render(&["flat.nrrd"], "flat.nrrd: all voxels have the value 7: there is nothing to see");
    render(&["volume.nrrd", "--volume", "volume.nrrd"], "--volume goes with a scene file");
    render(
        &["volume.nrrd", "--set", "bone.albedo=1"],
        "--set `bone.albedo=1`: no material is called `bone`: there is low, middle, high; and key",
    );
    render(&["scene.toml", "--set", "ball.albedo=red"], "--set `ball.albedo=red`: `albedo` is the");
    refuses(&["edit", "scene.toml", "--set", "ball"], "--set `ball`: write KEY=VALUE");
    refuses(
        &["edit", "scene.toml", "--set", "ball.extinction=0"],
        "after edit `ball.extinction=0`: the transfer function is empty",
    );
    refuses(&["scene", "scene.toml", "-o", "a.toml"], "scene.toml is a scene already");
    refuses(&["scene", "volume.nrrd", "-o", "volume.nrrd"], "name it .toml");
    refuses(&["scene", "notes.txt", "-o", "a.toml"], "not a volume");
    let said = place.failed(&mut place.program(&["edit", "scene.toml"]), 2);
    assert!(said.contains("--edit") && said.contains("--set"), "{said}");
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(place.path("volume.nrrd"), place.path("link.toml")).unwrap();
        refuses(&["scene", "volume.nrrd", "-o", "link.toml"], "which is read");
    }
}
