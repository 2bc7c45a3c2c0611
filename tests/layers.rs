//! Rooms import only rooms that stand before them, in the order of ARCHITECTURE.md.

use std::fs;
use std::path::{Path, PathBuf};

const SOURCES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/src");

/// The rooms of `src/`, lowest first: the first word of each line of the block `rooms`.
fn rooms() -> Vec<String> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/ARCHITECTURE.md");
    let text = fs::read_to_string(path).expect("ARCHITECTURE.md");
    let block = text.split("```rooms\n").nth(1).and_then(|rest| rest.split("```").next());
    let lines = block.expect("a block `rooms`").lines();
    lines.filter_map(|line| line.split_whitespace().next().map(str::to_owned)).collect()
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("entry").path());
    let each = entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] });
    each.filter(|path| path.extension().is_some_and(|e| e == "rs")).collect()
}

/// The room that a file of `src/` belongs to.
fn room_of(file: &Path) -> String {
    let inside = file.strip_prefix(SOURCES).expect("a source");
    let first = inside.components().next().expect("a name").as_os_str().to_string_lossy();
    first.trim_end_matches(".rs").to_owned()
}

/// The rooms that a text names as `crate::room` or in `crate::{...}`.
fn named(text: &str) -> Vec<String> {
    let code = text.lines().map(|line| line.split("//").next().unwrap_or_default());
    let code = code.collect::<Vec<_>>().join("\n");
    let mut names = Vec::new();
    for after in code.split("crate::").skip(1) {
        let word = |text: &str| -> String {
            text.trim().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
        };
        let Some(group) = after.strip_prefix('{') else {
            names.push(word(after));
            continue;
        };
        // The heads of a group, whatever is grouped again below them.
        let mut depth = 0;
        let mut head = String::new();
        for c in group.chars() {
            match c {
                '{' => depth += 1,
                '}' if depth == 0 => break,
                '}' => depth -= 1,
                ',' if depth == 0 => names.push(word(&std::mem::take(&mut head))),
                c if depth == 0 => head.push(c),
                _ => {}
            }
        }
        names.push(word(&head));
    }
    names
}

fn wrong(room: &str, text: &str, rooms: &[String]) -> Vec<String> {
    let rank = |name: &str| rooms.iter().position(|room| room == name);
    let own = rank(room).unwrap_or_else(|| panic!("ARCHITECTURE.md does not name `{room}`"));
    named(text).into_iter().filter(|name| rank(name).is_some_and(|other| other > own)).collect()
}

#[test]
fn no_room_imports_one_above_it() {
    let rooms = rooms();
    let mut seen = Vec::new();
    for file in files(Path::new(SOURCES)) {
        let room = room_of(&file);
        if room == "lib" {
            continue;
        }
        let text = fs::read_to_string(&file).expect("a source");
        let wrong = wrong(&room, &text, &rooms);
        assert!(wrong.is_empty(), "{} imports {wrong:?}, above `{room}`", file.display());
        seen.push(room);
    }
    assert!(rooms.iter().all(|room| seen.contains(room)), "a room of {rooms:?} is not there");
}

#[test]
fn an_import_of_a_higher_room_is_found() {
    let rooms: Vec<String> = ["gpu", "scene", "photon"].map(str::to_owned).into();
    let above = |text| wrong("scene", text, &rooms);
    assert_eq!(above("use crate::photon::{Batch, PhotonMap};"), ["photon"]);
    assert_eq!(above("use crate::{gpu, photon};"), ["photon"]);
    assert_eq!(above("use crate::{\n    gpu::{Gpu, lock},\n    photon::Batch,\n};"), ["photon"]);
    assert_eq!(above("let n = crate::photon::SLOT_BYTES;"), ["photon"]);
    assert!(above("use crate::gpu::Gpu; // crate::photon\n/// [`crate::photon`]").is_empty());
    assert!(above("use crate::{gpu::{photon, Gpu}, scene};").is_empty());
}
