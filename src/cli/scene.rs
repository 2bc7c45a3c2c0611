//! `scene`: a scan to a scene for editing; and scans where a command takes a scene.

use std::io::Write as _;
use std::path::Path;

use anyhow::{Result, anyhow, ensure};
use photogram::files;
use photogram::scene::{ScanKind, Scene, VolumeSource};
use photogram::volume::{self, Volume};

use super::{check_places, failed, make_folder, say, warn_of};

/// A scene that a scan was given, with its volume.
pub struct Made {
    pub scene: Scene,
    pub volume: Volume,
    pub kind: ScanKind,
}

impl Made {
    /// What it was taken for, and what can be changed.
    pub fn told(&self) -> String {
        let names: Vec<&str> = self.scene.materials.iter().map(|m| m.name.as_str()).collect();
        format!("{}: {}; materials: {}", self.scene.name, self.kind, names.join(", "))
    }
}

/// Scenes end in `.toml`; all else is a volume.
pub fn is_scene(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"))
}

/// Reads a scan and makes a scene for it.
pub fn make(scan: &Path) -> Result<Made> {
    const VOLUMES: [&str; 3] = ["nrrd", "nii", "gz"];
    let volume = volume::load(scan).map_err(|e| {
        let ending = scan.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match VOLUMES.contains(&ending.as_str()) {
            true => anyhow!(e),
            false => anyhow!("{e}; a scene would end in .toml"),
        }
    })?;
    let is_standard = files::is_standard(scan);
    let path = if is_standard { scan.to_owned() } else { std::path::absolute(scan)? };
    let source = VolumeSource::File(path);
    let (scene, kind) = Scene::for_volume(source, name_of(scan), &volume)
        .map_err(|e| anyhow!("{}: {e}", scan.display()))?;
    Ok(Made { scene, volume, kind })
}

/// The file's name without its endings, of which `.nii.gz` are two.
fn name_of(scan: &Path) -> String {
    let name = scan.file_name().unwrap_or_default().to_string_lossy();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    let stem = Path::new(name).file_stem().unwrap_or_default().to_string_lossy();
    if stem.is_empty() { "scan".into() } else { stem.into() }
}

pub fn run_scene(scan: &Path, out: &Path) -> Result<()> {
    ensure!(!is_scene(scan), "{} is a scene already: copy it", scan.display());
    ensure!(is_scene(out), "{}: a scene is told by its ending: name it .toml", out.display());
    check_places(&[Some(out)], &[Some(scan)])?;
    ensure!(!files::is_standard(scan), "a scene names its volume: save what is piped as a file");
    let made = make(scan)?;
    warn_of(&made.volume);
    ensure!(
        scan.to_str().is_some(),
        "{}: a scene is text, and this path is not: rename the scan",
        scan.display()
    );
    let text = header(&made, out) + &made.scene.to_toml();
    make_folder(out)?;
    files::write_whole(out, |file| {
        file.write_all(text.as_bytes()).map_err(|e| failed(out, "write", e))
    })?;
    say(format_args!("{}\n{}", made.told(), out.display()))
}

/// What a reader of the file wants to know first, as comments.
fn header(made: &Made, out: &Path) -> String {
    let (name, out) = (&made.scene.name, out.display());
    let (values, unit) = match made.kind {
        ScanKind::Hounsfield => ("CT in Hounsfield units", "Hounsfield units"),
        ScanKind::Labels => ("labels: each whole number names a part", "labels"),
        ScanKind::Grey => ("bright and dark, without a unit", "values of the scan"),
    };
    let dense = made.scene.materials.last().map_or("", |m| m.name.as_str());
    format!(
        "# A scene for {name}. Its values were taken for {values}.
#
#     photogram render {out} -o picture.png
#     photogram edit {out} --set \"{dense}.albedo=0.9,0.6,0.2\" --verify
#
# Each [[material]] is for a range of values. Its `ramp` has points [value, weight]: {unit},
# and from 0 (nothing of it) to 1. `extinction` is per mm: 0.001 is a haze, 1 a surface. Of the light
# that it stops the share `scatter` goes on, in the linear RGB `colour`; `albedo` says both.
# Lengths are in mm, places and directions point left, posterior, superior. A light's `radiance` is in
# W/(sr mm^2). `photogram info` shows the histogram of the scan. Named changes may follow at the end,
# and are made by `--edit NAME`:
#
#     [[edit]]
#     name = \"other\"
#     [[edit.material]]
#     name = \"{dense}\"
#     albedo = [0.9, 0.6, 0.2]

"
    )
}
