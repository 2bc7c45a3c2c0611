//! The program from outside: what it refuses, how it says so, and that a refusal is early,
//! whole, and leaves nothing behind.

use std::fs;

use files::{COUNT, Nifti, gzip, nrrd_file, nrrd_header};
use place::{Place, nrrd};
use predicates::prelude::*;
use predicates::str::contains;

#[allow(dead_code)]
#[path = "volumes/files.rs"]
mod files;
#[path = "cli/place.rs"]
mod place;

/// All of `parts` are said.
fn says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(contains(*part).eval(message), "`{part}` is not in: {message}");
    }
}

fn floats(change: impl Fn(&mut Vec<f32>)) -> Vec<u8> {
    let mut values: Vec<f32> = (0..COUNT).map(|n| n as f32).collect();
    change(&mut values);
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// `type: uint8`, raw, all fields else as given.
fn header(fields: &str) -> Vec<u8> {
    [nrrd_header(&format!("type: uint8\ndimension: 3\nencoding: raw\n{fields}")), vec![1; COUNT]]
        .concat()
}

/// Bad volume files, each with what is said of it.
fn bad_volumes() -> Vec<(&'static str, Vec<u8>, &'static str)> {
    let whole = nrrd_file("float", "little", "gzip", &gzip(&floats(|_| {})));
    let mut flipped = whole.clone();
    // The checksum that ends a gzip stream.
    flipped[whole.len() - 6] ^= 0x55;
    let nifti = || Nifti::new(16, 4, false);
    let nifti_whole = nifti().with(&floats(|_| {}));
    let packed = gzip(&nifti_whole);
    let mut packed_flipped = packed.clone();
    packed_flipped[packed.len() - 6] ^= 0x55;
    let raw = |data: &[u8]| nrrd_file("float", "little", "raw", data);
    vec![
        ("empty.nrrd", vec![], "does not start with NRRD0001"),
        ("header-cut.nrrd", whole[..40].to_vec(), "the header does not end"),
        ("data-cut.nrrd", whole[..whole.len() - 30].to_vec(), "damaged data after"),
        ("flipped.nrrd", flipped, "damaged data after"),
        ("short.nrrd", raw(&floats(|v| v.truncate(50))), "truncated: 5 x 4 x 3 voxels"),
        ("zero.nrrd", header("sizes: 5 0 3\nspacings: 1 1 1"), "size 5 x 0 x 3: no side may be 0"),
        ("negative.nrrd", header("sizes: 5 -4 3\nspacings: 1 1 1"), "size -4: invalid digit"),
        ("huge.nrrd", header("sizes: 5 4 4000000000\nspacings: 1 1 1"), "at most 2048 voxels"),
        ("flat.nrrd", header("sizes: 5 4 3\nspacings: 1 0 1"), "must be positive and finite"),
        ("vast.nrrd", header("sizes: 5 4 3\nspacings: 1 1e30 1"), "from 1e-6 to 1e6 mm"),
        ("minute.nrrd", header("sizes: 5 4 3\nspacings: 1 1e-60 1"), "from 1e-6 to 1e6 mm"),
        (
            "nan.nrrd",
            raw(&floats(|v| v[7] = f32::NAN)),
            "1 of 60 values are NaN or infinite, the first at voxel [2, 1, 0]",
        ),
        (
            "infinite.nrrd",
            raw(&floats(|v| v[20..22].fill(f32::NEG_INFINITY))),
            "2 of 60 values are NaN or infinite, the first at voxel [0, 0, 1]",
        ),
        ("header-cut.nii", nifti_whole[..100].to_vec(), "not a whole NIfTI-1 header"),
        ("data-cut.nii", nifti_whole[..500].to_vec(), "truncated: 5 x 4 x 3 voxels"),
        ("data-cut.nii.gz", packed[..packed.len() - 30].to_vec(), "damaged data"),
        ("flipped.nii.gz", packed_flipped, "damaged data"),
        ("zero.nii", nifti().i16(44, 0).with(&[]), "three are needed, all positive"),
        ("negative.nii", nifti().i16(42, -5).with(&[]), "three are needed, all positive"),
        ("bits.nii", nifti().i16(72, 16).with(&floats(|_| {})), "bitpix 16 disagrees"),
        ("garbage.nii", vec![0xa5; 1000], "not a NIfTI-1 file"),
        ("nan.nii", nifti().with(&floats(|v| v[0] = f32::NAN)), "the first at voxel [0, 0, 0]"),
        ("volume.txt", b"hello".to_vec(), "not a volume that is read here"),
    ]
}

#[test]
fn damaged_volumes_are_refused_by_name() {
    let place = Place::new();
    for (name, bytes, expect) in bad_volumes() {
        place.file(name, &bytes);
        says(&place.unrendered(&["--volume", name]), &[name, expect]);
        says(&place.refused(&["info", name, "--json", "out/info.json"]), &[name, expect]);
    }
    says(&place.unrendered(&["--volume", "none.nrrd"]), &["none.nrrd: cannot read", "No such"]);
}

#[test]
fn a_corrupt_byte_anywhere_never_panics() {
    let place = Place::new();
    let whole = nrrd_file("float", "little", "gzip", &gzip(&floats(|_| {})));
    let nifti = gzip(&Nifti::new(16, 4, false).with(&floats(|_| {})));
    for (name, whole) in [("a.nrrd", whole), ("a.nii.gz", nifti)] {
        for at in (0..whole.len()).step_by(5) {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x81;
            place.file(name, &bytes);
            let output = place.program(&["info", name]).output().unwrap();
            let code = output.status.code();
            assert!(matches!(code, Some(0 | 1)), "byte {at} of {name}: {output:?}");
        }
    }
}

#[test]
fn scenes_that_cannot_be() {
    for (old, new, expect) in [
        ("fov_deg = 30", "fov_degrees = 30", "scene.toml:7: [camera]: `fov_degrees` is unknown"),
        (
            "photons = 1000",
            "photons = 0",
            "scene.toml:23: [settings]: `photons` is 0: it must be 1",
        ),
        ("fov_deg = 30", "fov_deg = 1e-5", "mm from the volume: over "),
        ("width = 16", "width = 0", "scene.toml:8: [camera]: `width` is 0: it must be 1 to 16384"),
        ("= [100, 300]", "= [300, 100]", "scene.toml:19: [[material]] `ball`"),
        ("extinction = 0.2", "extinction = -1", "`extinction` is -1: it must be >= 0, per mm"),
        ("extinction = 0.2", "extinction = nan", "`extinction` is nan: it must be a plain finite"),
        ("extinction = 0.2", "extinction = 0", "the transfer function is empty"),
        ("window = [100, 300]", "window = [1000, 3000]", "over the data's range of 0 to 237"),
        ("[settings]", "[settings", "scene.toml:22: this is not TOML"),
        ("photons = 1000", "majorant = 1e9\nphotons = 1000", "`majorant` is 1000000000 per mm"),
        ("photons = 1000", "photons = 10_000_000_000", "`photons` is 10000000000: it must be 1"),
        ("size = 1\n", "size = 1\nshare = 1e9\n", "1000000000000 photons in all: at most"),
        (
            "[[light]]",
            "[[light]]\nkind = \"surroundings\"\nname = \"sky\"\nradiance = 1\nshare = 1e30\n[[light]]",
            "18446744073709551615 photons in all: at most",
        ),
        ("radiance = 10", "radiance = 1e300", "single precision"),
    ] {
        says(&Place::with(old, new).unrendered(&[]), &[expect]);
    }
    let gone = Place::with("volume.nrrd", "gone.nrrd");
    says(&gone.unrendered(&[]), &["gone.nrrd: cannot read", "`--volume FILE`"]);
    let missing = ["render", "none.toml", "-o", "out/image.exr"];
    says(&Place::new().refused(&missing), &["none.toml: cannot read", "No such file"]);
}

#[test]
fn settings_that_cannot_be() {
    let place = Place::new();
    for (args, expect) in [
        (&["--size", "0x5"][..], "camera: `width` is 0: it must be 1 to 16384"),
        (&["--radius", "-1"], "settings: `radius` is -1: it must be > 0, in mm"),
        (&["--radius", "nan"], "settings: `radius` is NaN: it must be > 0, in mm"),
        (&["--radius", "1e9"], "`radius` is 1000000000 mm"),
        (&["--photons", "0"], "settings: `photons` is 0: it must be 1 to 4294967295"),
        (&["--grid", "-2"], "settings: `grid` is -2: it must be in (0, 1]"),
        (&["--grid", "2"], "settings: `grid` is 2: it must be in (0, 1]"),
        (&["--exposure", "nan"], "film: `exposure` is NaN: it must be in [-32, 32] stops"),
        (&["--max-events", "65"], "settings: `max_events` is 65: it must be 1 to 64"),
        (&["--segments", "0"], "settings: `segments` is 0: it must be 1 to 1024"),
        (&["--rays", "0"], "settings: `rays` is 0"),
        (&["--edit", "bright"], "no edit is called `bright`: there is dark"),
    ] {
        says(&place.unrendered(args), &[expect]);
    }
    // The parser of the command line has a code of its own.
    for (args, expect) in [
        (&["--photons", "-1"][..], "invalid value '-1' for '--photons <PHOTONS>'"),
        (&["--size", "5"], "write WIDTHxHEIGHT, such as 512x512"),
        (&["--method", "magic"], "no method is called `magic`: there is photon-map"),
        (&["--what"], "unexpected argument '--what'"),
    ] {
        let all = [&["render", "scene.toml", "-o", "out/image.exr"], args].concat();
        says(&place.failed(&mut place.program(&all), 2), &[expect]);
    }
}

#[test]
fn fluence_needs_isotropic_media() {
    let place = Place::with("extinction = 0.2", "extinction = 0.2\nphase_g = 0.5");
    let error = place.unrendered(&["--estimator", "fluence"]);
    says(&error, &["`fluence` estimator", "phase_g other than 0", "`estimator = \"points\"`"]);
}

#[test]
fn keys_that_overflow() {
    let error = Place::new().unrendered(&["--estimator", "points", "--radius", "1e-4"]);
    says(&error, &["stage `points`", "more than 2^32: raise `radius`"]);
}

#[test]
fn what_no_adapter_holds() {
    let place = Place::new();
    place.fine(&["info", "--adapters", "--json", "adapters.json"]);
    let adapters = place.json("adapters.json");
    // The software adapter has small bindings, and is chosen last.
    let Some(software) = adapters.as_array().unwrap().iter().find(|a| a["kind"] == "software")
    else {
        return eprintln!("skipped: this machine has no software adapter, whose limits are low");
    };
    let (index, binding) =
        (software["index"].to_string(), software["max_binding_size"].as_u64().unwrap());
    if binding > 256 << 20 {
        return eprintln!("skipped: a binding of {binding} bytes takes too much memory to exceed");
    }
    let on = |args: &[&str]| place.unrendered(&[args, &["--adapter", &index]].concat());
    let error = on(&["--size", "16384x4", "--segments", "1024"]);
    says(&error, &["stage `segments`", "must lie in one piece", "`segments`", "16384x4 pixels"]);

    let size = [2048, 128, (binding as usize / 8).div_ceil(2048 * 128) + 1];
    place.file("large.nrrd", nrrd(size, &vec![200; size.iter().product()]));
    let error = on(&["--volume", "large.nrrd", "--grid", "1"]);
    says(&error, &["stage `fluence grid`", "must lie in one piece", "(`grid`)"]);

    let error = on(&["--photons", "4294967295", "--max-events", "64"]);
    says(&error, &["stage `p", "of memory are needed, and", "(`photons`, `max_events`)"]);
    let error = on(&["--size", "16384x16384"]);
    says(&error, &["stage `segments`", "of memory are needed, and", "image size", "`rays`"]);
}

#[test]
fn adapters_that_are_not_there() {
    let place = Place::new();
    for absent in ["voodoo", "77"] {
        let error = place.unrendered(&["--adapter", absent]);
        says(&error, &["no adapter matches", absent, "this machine has 0: "]);
    }
    if !cfg!(target_os = "linux") {
        return eprintln!("skipped: drivers can be hidden from the Vulkan loader alone");
    }
    let all = [&["render", "scene.toml", "-o", "out/image.exr"][..], &["info", "--adapters"]];
    for args in all {
        let mut program = place.program(args);
        program.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
        let error = place.failed(&mut program, 1);
        says(&error, &["no Vulkan, Metal or DirectX 12 adapter", "run ./setup.sh"]);
    }
}

#[test]
fn outputs_that_cannot_be_written() {
    let place = Place::new();
    fs::create_dir(place.path("folder.exr")).unwrap();
    let render = |out: &str, more: &[&str]| {
        place.refused(&[&["render", "scene.toml", "-o", out], more].concat())
    };
    says(&render("folder.exr", &[]), &["folder.exr: cannot write: is a directory"]);
    let file = render("volume.nrrd/image.exr", &[]);
    says(&file, &["volume.nrrd/image.exr: cannot write: Not a directory"]);
    says(&render("image.jpg", &[]), &["image.jpg: images are written as .exr (linear) or .png"]);
    says(&render("image", &[]), &["image: images are written as"]);
    let json = render("image.exr", &["--json", "volume.nrrd/x.json"]);
    says(&json, &["volume.nrrd/x.json: cannot write"]);
    for (out, json) in [("image.exr", "./image.exr"), ("new/image.exr", "new/image.exr")] {
        says(&render(out, &["--json", json]), &[json, "is written already"]);
    }
    says(
        &render("image.exr", &["--json", "scene.toml"]),
        &["scene.toml would be written over scene.toml, which is read"],
    );
    let args = ["info", "volume.nrrd", "--json", "./volume.nrrd"];
    says(
        &place.refused(&args),
        &["./volume.nrrd would be written over volume.nrrd, which is read"],
    );
    // The system's reason is said once.
    assert_eq!(file.matches("Not a directory").count(), 1, "{file}");
    for args in [
        &["phantom", "hand", "--size", "16", "-o", "volume.nrrd/x.nrrd"][..],
        &["info", "volume.nrrd", "--json", "folder.exr"],
        &["demo", "--out", "scene.toml"],
    ] {
        says(&place.refused(args), &["cannot write"]);
    }
}

#[test]
fn bad_outputs_are_refused_before_the_work() {
    // The volume is damaged too, and would be complained of next.
    let place = Place::new();
    place.file("volume.nrrd", "NRRD0004");
    for out in ["image.jpg", "scene.toml/image.exr"] {
        says(&place.refused(&["render", "scene.toml", "-o", out]), &["image."]);
    }
}

#[test]
fn phantoms_that_cannot_be() {
    let place = Place::new();
    let phantom =
        |name: &str, size: &str| place.refused(&["phantom", name, "-o", "a.nrrd", "--size", size]);
    says(&phantom("foot", "64"), &["no phantom is called `foot`: there is cornell, hand"]);
    for size in ["0", "15", "4000000000"] {
        says(&phantom("hand", size), &["16", "1024"]);
    }
}
