//! What people do with files: outputs into pipes and through links, inputs from pipes, files that
//! other programs wrote in their own way. Each is read or written as it is meant, or refused with
//! what to do.

use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::Stdio;

use files::{COUNT, Folder, Nifti, SIZE, cases, gzip, nrrd_file, nrrd_header, ramp};
use glam::DVec3;
use photogram::film::Image;
use photogram::volume::{Volume, load};
use place::Place;

#[allow(dead_code)]
#[path = "volumes/files.rs"]
mod files;
#[allow(dead_code)]
#[path = "cli/place.rs"]
mod place;
#[path = "cases/read.rs"]
mod read;
#[path = "cases/table.rs"]
mod table;

/// The ramp as NRRD of 5 x 4 x 3 voxels of 1 x 2 x 3 mm.
fn scan() -> Vec<u8> {
    nrrd_file("uint8", "little", "gzip", &gzip(&bytes()))
}

fn bytes() -> Vec<u8> {
    (0..COUNT).map(|n| ramp(n) as u8).collect()
}

/// All voxels are the ramp's.
fn is_ramp(volume: &Volume, what: &str) {
    assert_eq!(volume.size(), SIZE, "{what}");
    for n in 0..COUNT as u32 {
        let value = volume.value(n % 5, n / 5 % 4, n / 20);
        assert_eq!(value, ramp(n as usize) as f64, "{what}: voxel {n}");
    }
}

/// What `info --json` writes of the ramp.
fn is_description(text: &[u8]) {
    let info: serde_json::Value = serde_json::from_slice(text).expect("JSON and nothing else");
    assert_eq!(info["size"], serde_json::json!(SIZE));
    assert_eq!(info["range"], serde_json::json!([0.0, 59.0]));
}

/// A place with the ramp as `scan.nrrd`.
fn place() -> Place {
    let place = Place::new();
    place.file("scan.nrrd", scan());
    place
}

#[cfg(unix)]
fn pipe(path: &Path) {
    let made = std::process::Command::new("mkfifo").arg(path).status();
    assert!(made.expect("mkfifo").success());
}

#[cfg(unix)]
#[test]
fn json_goes_into_a_pipe() {
    use std::os::unix::fs::FileTypeExt as _;
    let place = place();
    let path = place.path("pipe.json");
    pipe(&path);
    let reader = std::thread::spawn({
        let path = path.clone();
        move || fs::read(path).unwrap()
    });
    place.fine(&["info", "scan.nrrd", "--json", "pipe.json"]);
    // A reader of a pipe that was replaced would wait forever.
    assert!(fs::metadata(&path).unwrap().file_type().is_fifo());
    is_description(&reader.join().unwrap());
}

#[cfg(unix)]
#[test]
fn json_goes_into_a_device() {
    use std::os::unix::fs::FileTypeExt as _;
    let place = place();
    let path = place.path("full.json");
    let made = std::process::Command::new("mknod").arg(&path).args(["c", "1", "7"]).output();
    if !made.is_ok_and(|made| made.status.success()) {
        return eprintln!("skipped: only the system's administrator makes devices");
    }
    let output = place.program(&["info", "scan.nrrd", "--json", "full.json"]).output().unwrap();
    assert!(fs::symlink_metadata(&path).unwrap().file_type().is_char_device());
    let error = String::from_utf8(output.stderr).unwrap();
    // Some file systems allow to make devices, but not to use them.
    let full = error.contains("full.json: cannot write: No space left");
    assert!(full || error.contains("full.json: cannot write: Permission denied"), "{error}");
}

#[cfg(unix)]
#[test]
fn json_follows_links() {
    let place = place();
    fs::create_dir(place.path("folder")).unwrap();
    place
        .file("folder/there.json", "{ a longer text than what comes there, were it only so long }");
    for (link, to) in [("a.json", "folder/there.json"), ("b.json", "new/not-yet.json")] {
        std::os::unix::fs::symlink(to, place.path(link)).unwrap();
        place.fine(&["info", "scan.nrrd", "--json", link]);
        assert_eq!(fs::read_link(place.path(link)).unwrap(), Path::new(to));
        assert!(fs::symlink_metadata(place.path(to)).unwrap().is_file());
        is_description(&fs::read(place.path(to)).unwrap());
    }
}

#[cfg(unix)]
#[test]
fn permissions_stay() {
    use std::os::unix::fs::PermissionsExt as _;
    let place = place();
    let mode = |name: &str| fs::metadata(place.path(name)).unwrap().permissions().mode() & 0o777;
    place.file("old.json", "old");
    fs::set_permissions(place.path("old.json"), fs::Permissions::from_mode(0o604)).unwrap();
    for name in ["old.json", "new.json"] {
        place.fine(&["info", "scan.nrrd", "--json", name]);
    }
    assert_eq!(mode("old.json"), 0o604);
    // As any program's new file.
    place.file("plain", "");
    assert_eq!(mode("new.json"), mode("plain"));
}

#[test]
fn json_on_standard_output_is_alone_there() {
    let place = place();
    for name in ["-", "/dev/stdout"] {
        if name != "-" && !cfg!(target_os = "linux") {
            continue;
        }
        let output = place.program(&["info", "scan.nrrd", "--json", name]).output().unwrap();
        assert!(output.status.success());
        is_description(&output.stdout);
        assert!(String::from_utf8(output.stderr).unwrap().contains("values 0 to 59"));
    }
    let edit = ["edit", "scene.toml", "--edit", "dark", "--json", "-"];
    let output = place.program(&edit).output().unwrap();
    let rows: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(rows[0]["edit"], "dark");
    let render = ["render", "scene.toml", "-o", "a.exr", "--json", "-"];
    let output = place.program(&render).output().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["photons"], 1000);
    assert!(!place.path("-").exists());
}

#[test]
fn a_phantom_goes_through_a_pipe() {
    let place = Place::new();
    let made = place.program(&["phantom", "hand", "-o", "-", "--size", "24"]).output().unwrap();
    place.fine(&["phantom", "hand", "-o", "hand.nrrd", "--size", "24"]);
    assert!(made.stdout == fs::read(place.path("hand.nrrd")).unwrap());
    assert!(!place.path("-").exists());
}

#[test]
fn a_regular_file_is_whole_or_as_it_was() {
    let folder = Folder::new();
    let path = folder.file("a", b"before");
    let failed = photogram::files::write_whole(&path, |file| {
        file.write_all(&[1; 100_000]).unwrap();
        Err(photogram::Error::setting("enough"))
    });
    assert_eq!(failed.unwrap_err().to_string(), "enough");
    assert_eq!(fs::read(&path).unwrap(), b"before");
    assert_eq!(fs::read_dir(folder.0.path()).unwrap().count(), 1, "nothing else is left");
}

/// Refused, and what is read stays as it is.
fn kept(place: &Place, args: &[&str], says: &str) {
    let read = ["scan.nrrd", "volume.nrrd", "scene.toml"].map(|name| place.path(name));
    let before = read.clone().map(|path| fs::read(path).unwrap());
    let error = place.refused(args);
    assert!(error.contains(says), "{args:?}: {error}");
    assert!(before == read.map(|path| fs::read(path).unwrap()), "{args:?} wrote over its input");
}

#[test]
fn no_output_replaces_what_is_read() {
    let place = place();
    let at = |name: &str| place.path(name).to_str().unwrap().to_owned();
    fs::create_dir(place.path("folder")).unwrap();
    let mut names = vec![
        "volume.nrrd".to_owned(),
        "./volume.nrrd".to_owned(),
        "folder/../volume.nrrd".to_owned(),
        "folder/not/yet/../../../volume.nrrd".to_owned(),
        at("volume.nrrd"),
    ];
    // An image by its name, so that it is refused for what it is a link to.
    for name in ["hard.png", "hard.json"] {
        fs::hard_link(place.path("volume.nrrd"), place.path(name)).unwrap();
        names.push(name.to_owned());
    }
    #[cfg(unix)]
    for name in ["soft.png", "soft.json"] {
        std::os::unix::fs::symlink("volume.nrrd", place.path(name)).unwrap();
        names.push(name.to_owned());
    }
    let says = "which is read: name another file";
    for name in &names {
        kept(&place, &["info", "volume.nrrd", "--json", name], says);
        // The scene alone names this volume.
        kept(&place, &["render", "scene.toml", "-o", "a.png", "--json", name], says);
        kept(&place, &["edit", "scene.toml", "--edit", "dark", "--json", name], says);
        let other = ["--volume", "scan.nrrd", "--json", name];
        kept(&place, &[&["render", "scene.toml", "-o", "a.png"], &other[..]].concat(), says);
        if name.ends_with(".png") {
            kept(&place, &["render", "scene.toml", "-o", name], says);
            kept(&place, &["edit", "scene.toml", "--edit", "dark", "-o", name], says);
        }
    }
    let volume = ["--volume", "scan.nrrd", "--json", "folder/../scan.nrrd"];
    kept(&place, &[&["render", "scene.toml", "-o", "a.png"], &volume[..]].concat(), says);
    kept(&place, &["edit", "scene.toml", "--edit", "dark", "--json", "./scene.toml"], says);
    // What comes on standard input is a file here.
    let mut program = std::process::Command::new(env!("CARGO_BIN_EXE_photogram"));
    program.args(["info", "-", "--json"]).arg(place.path("scan.nrrd"));
    program.stdin(fs::File::open(place.path("scan.nrrd")).unwrap());
    let output = program.output().unwrap();
    assert!(String::from_utf8(output.stderr).unwrap().contains(says));
    assert!(fs::read(place.path("scan.nrrd")).unwrap() == scan());
}

#[test]
fn two_outputs_go_to_two_places() {
    let place = place();
    let says = "is written already";
    place.file("a.png", "old");
    fs::hard_link(place.path("a.png"), place.path("b.json")).unwrap();
    for json in ["a.png", "./a.png", "new/../a.png", "b.json"] {
        kept(&place, &["render", "scene.toml", "-o", "a.png", "--json", json], says);
    }
    let nested = ["render", "scene.toml", "-o", "new/a.png", "--json", "new/a.png/b.json"];
    kept(&place, &nested, "one is the other's folder");
    for shot in ["before", "bone", "vessels"] {
        let json = format!("shots/{shot}.png");
        kept(&place, &["demo", "--out", "./shots", "--json", &json], says);
    }
    for file in ["overhead.json", "overhead.csv", "x.svg"] {
        let json = format!("out/../new/{file}");
        kept(&place, &["bench", "overhead", "--out", "new", "--json", &json], "written already");
    }
}

#[test]
fn a_volume_comes_on_standard_input() {
    let place = place();
    let nifti = Nifti::new(2, 1, false).with(&bytes());
    let raw = nrrd_file("uint8", "little", "raw", &bytes());
    for input in [scan(), raw, nifti.clone(), gzip(&nifti), gzip(&scan())] {
        for name in if cfg!(target_os = "linux") { &["-", "/dev/stdin"][..] } else { &["-"] } {
            let args = ["info", name, "--json", "info.json"];
            let output = place.program(&args).write_stdin(input.clone()).output().unwrap();
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            is_description(&fs::read(place.path("info.json")).unwrap());
        }
    }
    // A picture of what is piped in is that of the file.
    let volume = fs::read(place.path("volume.nrrd")).unwrap();
    place.file("other.toml", place::SCENE.replace("volume.nrrd", "scan.nrrd"));
    let args = ["render", "other.toml", "--volume", "-", "-o", "piped.exr"];
    let output = place.program(&args).write_stdin(volume).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    place.fine(&["render", "scene.toml", "-o", "file.exr"]);
    let image = |name| Image::read_exr(place.path(name)).unwrap();
    assert_eq!(image("piped.exr").rgb, image("file.exr").rgb);
    // Another process has another standard input.
    let fresh = ["edit", "scene.toml", "--edit", "dark", "--verify", "fresh", "--volume", "-"];
    kept(&place, &fresh, "save the volume as a file");
}

/// What a reader finds at the end of a pipe that `bytes` come through, the first few singly.
#[cfg(unix)]
fn piped(bytes: Vec<u8>) -> photogram::error::Result<Volume> {
    let folder = Folder::new();
    let path = folder.0.path().join("pipe");
    pipe(&path);
    let writer = std::thread::spawn({
        let path = path.clone();
        move || {
            let mut out = fs::OpenOptions::new().write(true).open(path).unwrap();
            for byte in bytes.iter().take(300) {
                out.write_all(&[*byte]).unwrap();
            }
            out.write_all(bytes.get(300..).unwrap_or(&[])).unwrap();
        }
    });
    let read = load(&path);
    writer.join().unwrap();
    read
}

#[cfg(unix)]
#[test]
fn a_volume_comes_through_a_pipe() {
    for case in cases() {
        let data = case.bytes(true);
        let nrrd = |encoding: &str, data: &[u8]| nrrd_file(case.nrrd[0], "big", encoding, data);
        let nifti = Nifti::new(case.nifti, data.len() / COUNT, true).with(&data);
        let all = [nrrd("raw", &data), nrrd("gzip", &gzip(&data)), gzip(&nifti), nifti];
        for (n, file) in all.into_iter().enumerate() {
            let what = format!("{}, {n}", case.nrrd[0]);
            case.check(&piped(file).expect(&what), &what);
        }
    }
    // What a header claims is not set aside before it comes.
    let fields =
        "type: double\nendian: little\ndimension: 3\nsizes: 2048 2048 2048\nspacings: 1 1 1";
    for (encoding, data) in [("raw", vec![7; 80]), ("gzip", gzip(&[7; 80]))] {
        let header = nrrd_header(&format!("{fields}\nencoding: {encoding}"));
        let error = piped([header, data].concat()).unwrap_err().to_string();
        assert!(error.contains("truncated: ") && error.contains("there are 80"), "{error}");
    }
}

#[test]
fn a_reader_of_json_may_stop_early() {
    let place = place();
    let mut info = std::process::Command::new(env!("CARGO_BIN_EXE_photogram"))
        .arg("info")
        .arg(place.path("scan.nrrd"))
        .args(["--json", "-"])
        .current_dir(place.path(""))
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    drop(info.stdout.take());
    assert!(info.wait().unwrap().success());
}

#[test]
fn warnings_are_told_once() {
    let place = place();
    let volume = fs::read(place.path("volume.nrrd")).unwrap();
    place.file("volume.nrrd", [&volume[..], b"\n"].concat());
    let args = ["info", "volume.nrrd", "--json", "info.json"];
    let shot = ["render", "scene.toml", "-o", "a.exr"];
    let edit = ["edit", "scene.toml", "--edit", "dark"];
    for args in [&args[..], &shot, &edit] {
        let output = place.program(args).output().unwrap();
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{error}");
        assert_eq!(error.matches("warning: ").count(), 1, "{error}");
        assert!(error.contains("volume.nrrd: 1 byte follows the data and is not read"), "{error}");
    }
    let warnings = &place.json("info.json")["warnings"];
    assert_eq!(warnings.as_array().unwrap().len(), 1);
    assert!(warnings[0].as_str().unwrap().contains("1 byte follows"), "{warnings}");
    place.fine(&["info", "scan.nrrd", "--json", "info.json"]);
    assert_eq!(place.json("info.json")["warnings"], serde_json::json!([]));
}

fn near(a: DVec3, b: [f64; 3], what: &str) {
    assert!(a.abs_diff_eq(b.into(), 1e-9), "{what}: {a} is not {b:?}");
}
